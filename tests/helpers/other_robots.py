"""Robots of other structures than the shipped ones, described as little as a file may, and logs of
a minute on the ball-bar, from kinematics alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_geometry, robot_frames
from ballbar.cell.inverse import bar_angles
from ballbar.cell.load import load_cell
from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.ident.estimator.closure import closed_angles
from tests.helpers.device_logs import EPOCH, PER_RAD, description

# a [m], d [m], alpha [deg], theta [deg]: UR5e (Universal Robots, DH parameters of the UR5e),
# LBR iiwa 14 R820 (its standard DH rows).
UR = (
    (0.0, 0.1625, 90, 0),
    (-0.425, 0.0, 0, 0),
    (-0.3922, 0.0, 0, 0),
    (0.0, 0.1333, 90, 0),
    (0.0, 0.0997, -90, 0),
    (0.0, 0.0996, 0, 0),
)
SEVEN_AXES = (
    (0.0, 0.36, -90, 0),
    (0.0, 0.0, 90, 0),
    (0.0, 0.42, 90, 0),
    (0.0, 0.0, -90, 0),
    (0.0, 0.4, -90, 0),
    (0.0, 0.0, 90, 0),
    (0.0, 0.126, 0, 0),
)
FIVE_AXES = (
    (0.10, 0.4, -90, 0),
    (0.5, 0.0, 0, -90),
    (0.5, 0.0, 0, 0),
    (0.0, 0.0, -90, 0),
    (0.0, 0.1, 0, 0),
)
START = {  # [deg] a posture in the middle of the path
    UR: (10, -100, 100, -60, -80, 20),
    SEVEN_AXES: (10, 30, 20, -80, 15, 60, 20),
    FIVE_AXES: (10, 20, 60, 40, 15),
}
Rows = tuple[tuple[float, float, float, float], ...]
NOISE = 1e-5  # [rad] of every row
SWING_DEG = 20.0
CLOCK = Clock(0.1, 2e-5)


def robot_text(rows: Rows) -> str:
    """A robot file with what is required and nothing else."""
    dh = [f"  - {{a_m: {a}, d_m: {d}, alpha_deg: {al}, theta_deg: {th}}}" for a, d, al, th in rows]
    limits = ", ".join(["360"] * len(rows))
    lower = ", ".join(["-360"] * len(rows))
    return "\n".join(
        [
            "schema: ballbar-robot/1",
            "title: another robot",
            "dh:",
            *dh,
            f"axis_lower_deg: [{lower}]",
            f"axis_upper_deg: [{limits}]",
            "",
        ]
    )


def cell_of(folder: Path, rows: Rows) -> Cell:
    """The cell of a robot whose file is written to a folder."""
    path = folder / "other.yaml"
    path.write_text(robot_text(rows), encoding="utf-8")
    return load_cell(str(path), "lund_600", "plate_250")


@dataclass(frozen=True, eq=False)
class OtherMinute:
    """A minute of a robot on the ball-bar."""

    nominal: Geometry
    t: Array  # (N,) [s]
    q: Array  # (N, J) [rad] of the nominal robot
    b: Array  # (N, 5) [rad]

    def logs(self, true: Geometry, *, seed: int = 0) -> tuple[RobotLog, BallBarLog]:
        """Both logs of the mechanism `true`, with white noise and a clock error."""
        rng, joints = np.random.default_rng(seed), (1, 2, 4, 5)
        q, b = closed_angles(true, self.q, self.b)
        b = b[:, [j - 1 for j in joints]] + NOISE * rng.standard_normal((self.t.size, 4))
        robot = RobotLog(self.t, q + NOISE * rng.standard_normal(q.shape))
        late = CLOCK.ballbar_time(self.t)
        rows = late >= 0.0
        return robot, BallBarLog(late[rows], b[rows], joints)


def other_minute(cell: Cell, rows: Rows, *, step: float = 0.01) -> OtherMinute:
    """A harmonic of every joint about the robot's posture in START, bent onto the sphere."""
    start = np.radians(START[rows])[None]
    pose = robot_frames(nominal_geometry(cell, np.zeros(3)), start).poses()
    rod = np.array([0.35, 0.45, 1.0])
    origin = pose[0, :3, 3] - cell.ballbar.length * rod / np.linalg.norm(rod)
    nominal = nominal_geometry(cell, origin)
    t = np.arange(round(60.0 / step) + 1) * step
    turns = 2.0 * np.pi * t[:, None] / 60.0 * np.array([3, 2, 4, 1, 5, 6, 7])[: len(rows)]
    q = start + np.radians(SWING_DEG) * np.sin(turns + np.arange(len(rows)))
    b = np.unwrap(bar_angles(robot_frames(nominal, q).poses(), origin), axis=0)
    return OtherMinute(nominal, t, *closed_angles(nominal, q, b))


def write_other_recording(folder: Path, rows: Rows, logs: tuple[RobotLog, BallBarLog]) -> Path:
    """A recording folder with the robot's file in it, joint angles in rad and counters."""
    robot, bar = logs
    (folder / "raw").mkdir(parents=True)
    (folder / "other.yaml").write_text(robot_text(rows), encoding="utf-8")
    names = [f"q{k + 1}" for k in range(len(rows))]
    lines = [
        ",".join(("time", *names)),
        *(",".join(map(repr, row)) for row in np.column_stack((robot.t, robot.q)).tolist()),
    ]
    (folder / "raw/robot.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    counts = np.rint(bar.angles * PER_RAD).astype(np.int64).astype(np.uint32).astype(np.int64)
    stamps = EPOCH + np.rint(bar.t * 1e9).astype(np.int64)
    columns = [f"b{joint}" for joint in bar.joints]
    lines = [
        ";".join(("time", *columns)),
        *(";".join(map(str, row)) for row in np.column_stack((stamps, counts)).tolist()),
    ]
    (folder / "raw/ballbar.csv").write_text("\r\n".join(lines) + "\r\n", newline="")
    data = description()
    data["robot"] = "other.yaml"
    data["sources"]["robot"]["dialect"] = "joint-rad"
    for encoder in data["encoders"].values():
        encoder["sign"] = 1
    (folder / "recording.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    return folder

"""A robot that an instrument follows, made by plain arithmetic: nothing of the product is used.

A UR10e by its published DH rows, with drawn errors, moves along sums of sines. An instrument
with a frame, a target, a clock and a latency of its own logs points or poses with white noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
# Universal Robots, parameters for calculations of kinematics and dynamics: a, d [m], alpha [rad]
DH = np.array(
    [
        [0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0],
        [0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655],
        [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0],
    ]
)
MIDDLE = np.array([0.3, -1.4, 1.6, -1.2, -1.0, 0.4])  # [rad] of each joint


def flange(dh: Array, zeros: Array, q: Array) -> tuple[Array, Array]:
    """(N, 3, 3) rotation and (N, 3) [m] position of the flange at joint angles q (N, 6) [rad]."""
    turn, place = np.eye(3)[None].repeat(len(q), axis=0), np.zeros((len(q), 3))
    for j in range(6):
        a, d, alpha = dh[:, j]
        about_z = Rotation.from_rotvec(np.outer(q[:, j] + zeros[j], [0.0, 0.0, 1.0])).as_matrix()
        about_x = Rotation.from_rotvec([alpha, 0.0, 0.0]).as_matrix()
        place = place + turn @ np.array([0.0, 0.0, d])
        turn = turn @ about_z
        place = place + turn @ np.array([a, 0.0, 0.0])
        turn = turn @ about_x
    return turn, place


@dataclass(frozen=True, eq=False)
class FollowedRobot:
    """One drawn robot, its motion, and what followed it."""

    seed: int = 0
    length_error: float = 3e-4  # [m] standard deviation of the robot's lengths
    angle_error: float = 5e-4  # [rad] of its angles
    offset: float = 0.217  # [s] robot's time at the instrument's first row
    skew: float = 3e-5
    target: tuple[float, float, float] = (0.03, -0.02, 0.12)  # [m] on the flange
    seat: tuple[float, float, float] = (2.6, -1.1, 0.4)  # [m] in the base frame
    noise_m: tuple[float, float] = (7.5e-6, 3e-6)  # constant, and per metre of distance
    noise_rad: float = 9e-5  # of poses
    angle_noise: float = 1e-6  # [rad] of the robot's log
    speed: float = 1.0  # of the motion
    resting: tuple[int, ...] = ()  # joints, from 0, that do not move
    turned: tuple[int, float] = (0, 0.0)  # joint, from 0, and [rad] by which its zero went since

    def _drawn(self, name: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, name])

    @property
    def dh(self) -> Array:
        """(3, 6) true rows; the first and last joint's own are a gauge and stay as they are."""
        sigma = np.array([self.length_error, self.length_error, self.angle_error])[:, None]
        drawn = sigma * self._drawn(1).normal(size=(3, 6))
        drawn[1, 0] = 0.0  # moves the base
        drawn[:, 5] = 0.0  # moves the target
        return DH + drawn

    @property
    def zeros(self) -> Array:
        """(6,) [rad] true zeros of the joints."""
        drawn = self.angle_error * self._drawn(2).normal(size=6)
        drawn[[0, 5]] = 0.0  # turn the base, and the target
        drawn[self.turned[0]] += self.turned[1]
        return np.asarray(drawn)

    def angles(self, t: Array) -> Array:
        """(N, 6) [rad] at robot times t (N,) [s]."""
        rng = self._drawn(3)
        rate = 2.0 * np.pi * rng.uniform(0.03, 0.16, (6, 4))
        phase, size = rng.uniform(0.0, 2.0 * np.pi, (6, 4)), rng.normal(size=(6, 4))
        size *= np.array([0.5, 0.3, 0.4, 0.5, 0.6, 1.0])[:, None] / 1.5
        size[list(self.resting)] = 0.0
        waves = np.sin(self.speed * rate * t[:, None, None] + phase)
        return np.asarray(MIDDLE + (size * waves).sum(axis=2))

    @property
    def turn(self) -> Array:
        """(3, 3) of the instrument in the base frame."""
        return np.asarray(Rotation.from_rotvec([0.2, -0.3, 2.1]).as_matrix())

    def points(self, q: Array) -> Array:
        """(N, 3) [m] of the target in the base frame."""
        turn, place = flange(self.dh, self.zeros, q)
        return np.asarray(place + turn @ np.array(self.target))

    def measured(self, t: Array, *, pose: bool = False) -> Array:
        """(N, 3 or 6) [m, rad] rows at the instrument's times t (N,) [s]."""
        q, rng = self.angles(self.offset + (1.0 + self.skew) * t), self._drawn(4)
        points = (self.points(q) - np.array(self.seat)) @ self.turn
        away = np.linalg.norm(points, axis=1)[:, None]
        values = points + (self.noise_m[0] + self.noise_m[1] * away) * rng.normal(size=points.shape)
        if not pose:
            return np.asarray(values)
        marked = Rotation.from_rotvec([0.4, 0.1, -0.7])  # of the body of markers on the flange
        seen = Rotation.from_matrix(self.turn.T @ flange(self.dh, self.zeros, q)[0]) * marked
        seen = Rotation.from_rotvec(self.noise_rad * rng.normal(size=(len(t), 3))) * seen
        return np.hstack((values, seen.as_rotvec()))

    def logged(self, t: Array) -> Array:
        """(N, 6) [rad] the robot's log at its times t (N,) [s]."""
        return self.angles(t) + self.angle_noise * self._drawn(5).normal(size=(t.size, 6))

    def write(
        self,
        folder: Path,
        *,
        seconds: float = 60.0,
        rate: float = 200.0,
        robot_rate: float = 250.0,
        pose: bool = False,
    ) -> Path:
        """The folder with both logs and recording.yaml."""
        folder.mkdir(parents=True, exist_ok=True)
        t = np.arange(round(seconds * robot_rate)) / robot_rate
        joints = ",".join(f"q{k}" for k in range(1, 7))
        _table(folder / "robot.csv", f"time,{joints}", t, self.logged(t))
        t = np.arange(round((seconds - 1.0) * rate)) / rate
        values = self.measured(t, pose=pose)
        values[:, :3] *= 1e3
        names = "x,y,z" + ",rx,ry,rz" * pose
        _table(folder / "tracker.csv", f"time,{names}", t + 17.0, values)
        rotation = "    rotation: {columns: [rx, ry, rz], form: rotvec}\n" * pose
        (folder / "recording.yaml").write_text(
            "schema: ballbar-recording/1\nkind: real\nrobot: ur10e\n"
            f"instrument: tracker_{'pose' if pose else 'point'}\nsources:\n"
            "  robot: {files: [robot.csv], dialect: joint-rad, time: s}\n"
            "  tracker:\n    files: [tracker.csv]\n    dialect: tracker-points\n"
            f"    time: s\n    unit: mm\n{rotation}"
        )
        return folder


def _table(path: Path, head: str, t: Array, values: Array) -> None:
    rows = np.column_stack((t, values))
    form = ["%.6f", *["%.9f"] * values.shape[1]]
    np.savetxt(path, rows, fmt=form, delimiter=",", header=head, comments="")

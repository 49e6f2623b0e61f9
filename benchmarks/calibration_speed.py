"""Poses a second of a calibration used as a service: forward and inverse kinematics, Jacobian.

Random poses of the accuracy box, in the time of one processor. `geometry` has no corrections,
`loads` compliance, backlash and transmission error of the gears and tilting bearings; arms from
still poses have sag and joint errors, and configurations of the Panda have to be searched. Every
solution of the inverse kinematics has been put through the forward kinematics.

    python -m benchmarks.calibration_speed
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy is imported

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import has_arm_branches
from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_cell
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics
from ballbar.result.calibration import load
from tests.helpers.calibrations import GEARS, corrections_of, write_calibration_of
from tests.helpers.pose_results import write_pose_result
from tests.helpers.simulated_recordings import perturbed

FORWARD, INVERSE, SEARCHED = 100_000, 10_000, 300  # poses
REPEATS = 3  # the fastest counts


def robots(folder: Path) -> dict[str, IdentifiedKinematics]:
    """Drawn calibrations, by the name of their row."""
    cell, rng = load_cell("irb2400", "lund_600", "plate_250"), np.random.default_rng(3)
    nominal = nominal_geometry(cell, np.array([0.7, 0.0, 0.54]))
    out = {}
    for name, effects in (("geometry", ()), ("loads", (*GEARS, "bearing_tilt"))):
        file = write_calibration_of(
            folder / f"{name}.yaml",
            nominal,
            perturbed(nominal, rng, 5e-4),
            corrections=corrections_of(cell, effects, rng),
        )
        out[f"irb2400, {name}"] = load(file).kinematics()
    for name in ("ur10", "panda"):
        poses = write_pose_result(folder / f"{name}.yaml", name, seed=1)
        out[f"{name}, still poses"] = load(poses).kinematics()
    return out


def rate(count: int, work: Callable[[], object]) -> float:
    """Poses a second of processor time."""
    seconds = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        seconds.append(time.process_time() - begin)
    return count / min(seconds)


def row(name: str, robot: IdentifiedKinematics) -> str:
    """A line of the table."""
    rng, own = np.random.default_rng(1), robot.robot
    axes = rng.uniform(own.accuracy_lower, own.accuracy_upper, (FORWARD, own.joints))
    q = controller_to_joints(own, axes)
    poses, searched = robot.forward(q), not has_arm_branches(robot.nominal)
    count = SEARCHED if searched else INVERSE
    some, near = poses[:count], q[:count] + 0.05

    def reached(angles: Array) -> str:
        return f"{robot.nearest(some, angles).reached.mean():.4f}"

    rates = (
        rate(FORWARD, lambda: robot.forward(q)),
        rate(FORWARD, lambda: robot.jacobian(q)),
        rate(count, lambda: robot.nearest(some, near)),
        rate(count, lambda: robot.inverse(some)),
    )
    return f"{name:20s}" + "".join(f"{r:12.0f}" for r in rates) + f"{reached(near):>10s}"


def main() -> None:
    """Print the table."""
    print(f"{'poses a second':20s}{'forward':>12s}{'jacobian':>12s}{'nearest':>12s}"
          f"{'all':>12s}{'reached':>10s}")  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for name, robot in robots(Path(folder)).items():
            print(row(name, robot), flush=True)


if __name__ == "__main__":
    main()

"""What a recording passes through: rests, stretches near a singular pose, changes of configuration; on the robot's clock.

The ball-bar is singular where its rod stands vertical (theta2 = 0) and where the cardan joint is straight (theta4 = 0, pi); the
robot where its wrist is (axis 5). Beyond a singular pose the mechanism is in the other configuration. Samples there are not
cut: their covariance weighs them (docs/identification.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition import find_dwells
from ballbar.replay.motion import CellMotion, cell_motion
from ballbar.result.run_data import RunData
from cell.arrays import Array
from ident.identify import Identification

NEAR = np.deg2rad(
    5.0
)  # [rad] from the singular pose: angles beside it are then known eleven times worse


@dataclass(frozen=True, eq=False)
class Marks:
    """Stretches of one recording, each (K, 2) [s] on the robot's clock."""

    rests: Array
    near_singular: dict[str, Array]  # by what is singular
    configuration: dict[str, Array]  # (K,) [s] instants at which each crosses over


def marks(data: RunData, motion: CellMotion | None = None) -> Marks:
    """The marks of the recording that was identified; motion : of `cell_motion`, if it is at hand."""
    motion = motion or cell_motion(data)
    log = data.recording.robot_log
    rests = log.t[find_dwells(log.t, log.q).intervals].reshape(-1, 2)
    distance = singular_angles(data.identification, motion)
    near = {name: stretches(motion.t, np.abs(angle) < NEAR) for name, angle in distance.items()}
    crossings = {name: _crossings(motion.t, angle) for name, angle in distance.items()}
    return Marks(rests, near, crossings)


def singular_angles(result: Identification, motion: CellMotion) -> dict[str, Array]:
    """(N,) [rad] signed distance from each singular pose that the mechanism has."""
    theta = {k: motion.b[:, k - 1] + result.geometry[f"btheta{k}"] for k in (2, 4)}
    wrist = motion.q[:, 4] + result.geometry["rtheta5"]
    angles = {
        "ball-bar: rod vertical": theta[2],
        "ball-bar: cardan straight": theta[4],
        "robot: wrist straight": wrist,
    }
    return {name: np.asarray(np.arcsin(np.sin(angle))) for name, angle in angles.items()}


def stretches(t: Array, where: NDArray[np.bool_]) -> Array:
    """(K, 2) [s] first and last instant of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], where.astype(np.int8), [0]))))
    return np.stack((t[edges[::2]], t[edges[1::2] - 1]), axis=1)


def _crossings(t: Array, angle: Array) -> Array:
    """(K,) [s] where an angle passes through zero, and not from one end of the sine's branch to the other."""
    step = (np.sign(angle[1:]) != np.sign(angle[:-1])) & (np.abs(np.diff(angle)) < 0.5)
    return np.asarray(0.5 * (t[1:] + t[:-1])[step])


def mark_sentences(found: Marks) -> list[str]:
    """The marks in words."""
    total = float((found.rests[:, 1] - found.rests[:, 0]).sum())
    lines = [f"The robot stands still {len(found.rests)} times, {total:.1f} s in all."]
    for name, spans in found.near_singular.items():
        seconds, crossings = float((spans[:, 1] - spans[:, 0]).sum()), found.configuration[name]
        what, near = name[0].upper() + name[1:], f"within {np.rad2deg(NEAR):.0f} deg"
        if not len(spans):
            lines.append(f"{what}: never {near}.")
            continue
        at = (
            f"; it passes to the other configuration at {', '.join(f'{t:.1f}' for t in crossings[:6])} s"
            if crossings.size
            else ""
        )
        lines.append(f"{what}: {near} for {seconds:.1f} s in {len(spans)} stretches{at}.")
    return lines

"""Dwells, stretches near a singular pose and configuration changes of a recording, robot's clock.

The ball-bar is singular where its rod stands vertical (theta2 = 0) and where the universal joint is
straight (theta4 = 0, pi); the robot where its wrist is (axis 5). Beyond a singular pose the
mechanism is in the other configuration. Samples there are not cut: their covariance weighs them
(docs/identification.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.dwells import find_dwells
from ballbar.report.motion import CellMotion, cell_motion
from ballbar.result.run_data import FittedRecording
from cell.arrays import Array
from cell.geometry import Geometry

# [rad] from the singular pose: the angles beside it are known 1 / sin(5 deg) = eleven times worse
CLOSE = np.deg2rad(5.0)


@dataclass(frozen=True, eq=False)
class Marks:
    """Stretches of one recording, each (K, 2) [s] on the robot's clock."""

    dwells: Array
    near_singular: dict[str, Array]  # by what is singular
    configuration: dict[str, Array]  # (K,) [s] instants at which each passes through


def marks(fitted: FittedRecording, motion: CellMotion | None = None) -> Marks:
    """The marks of a recording; motion : of `cell_motion`, if it is at hand."""
    motion = motion or cell_motion(fitted)
    log = fitted.recording.robot_log
    dwells = log.t[find_dwells(log.t, log.q).intervals].reshape(-1, 2)
    distance = singular_angles(fitted.estimate.geometry, motion)
    if fitted.recording.length_log is not None:  # cup and ball are singular nowhere
        distance = {name: a for name, a in distance.items() if not name.startswith("ball-bar")}
    return Marks(
        dwells,
        {name: stretches(motion.t, np.abs(a) < CLOSE) for name, a in distance.items()},
        {name: _crossings(motion.t, a) for name, a in distance.items()},
    )


def singular_angles(geometry: Geometry, motion: CellMotion) -> dict[str, Array]:
    """(N,) [rad] signed distance from each singular pose that the mechanism has."""
    theta = {k: motion.b[:, k - 1] + geometry[f"btheta{k}"] for k in (2, 4)}
    angles = {
        "ball-bar: rod vertical": theta[2],
        "ball-bar: universal joint straight": theta[4],
        "robot: wrist straight": motion.q[:, 4] + geometry["rtheta5"],
    }
    return {name: np.asarray(np.arcsin(np.sin(angle))) for name, angle in angles.items()}


def stretches(t: Array, where: NDArray[np.bool_]) -> Array:
    """(K, 2) [s] first and last instant of each run of true; t (N,) [s], where (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], where.astype(np.int8), [0]))))
    return np.stack((t[edges[::2]], t[edges[1::2] - 1]), axis=1)


def _crossings(t: Array, angle: Array) -> Array:
    """(K,) [s] where an angle passes through zero, jumps between the sine's branches left out."""
    step = (np.sign(angle[1:]) != np.sign(angle[:-1])) & (np.abs(np.diff(angle)) < 0.5)
    return np.asarray(0.5 * (t[1:] + t[:-1])[step])


def mark_sentences(recording_marks: Marks) -> list[str]:
    """The marks as sentences."""
    total = float((recording_marks.dwells[:, 1] - recording_marks.dwells[:, 0]).sum())
    lines = [f"The robot dwells {len(recording_marks.dwells)} times, {total:.1f} s in all."]
    for name, spans in recording_marks.near_singular.items():
        what, close = name[0].upper() + name[1:], f"within {np.rad2deg(CLOSE):.0f} deg"
        if not len(spans):
            lines.append(f"{what}: never {close}.")
            continue
        seconds, crossings = float((spans[:, 1] - spans[:, 0]).sum()), ""
        if (instants := recording_marks.configuration[name]).size:
            times = ", ".join(f"{t:.1f}" for t in instants[:6])
            crossings = f"; it passes to the other configuration at {times} s"
        lines.append(f"{what}: {close} for {seconds:.1f} s in {len(spans)} stretches{crossings}.")
    return lines

"""Axis targets of a trajectory, for a controller that moves linearly between them in axis angles.

They are so close that the rod's length is off by at most SAG between two of them, which the soft
servo absorbs with a few newtons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import robot_frames
from cell.robot_angles import joints_to_axes
from planning.request import PlanTiming
from planning.trajectory import Trajectory

SAG = 1.0e-4  # [m] about 5 N under soft servo, of which 1 mm makes some 50 N
SPACINGS = (0.5, 0.25, 0.2, 0.1, 0.05)  # [s] between targets


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of the controller."""

    t: Array  # (K,) [s] at which each is to be reached
    axes: Array  # (K, J) [deg] as the controller shows them
    dwells: Array  # (K,) [s] at the targets; 0 where the robot passes
    sag: float  # [m] by which the rod's length is off between them


def targets_of(cell: Cell, trajectory: Trajectory, timing: PlanTiming) -> Targets:
    """The fewest evenly spaced targets that keep SAG, or as many as SPACINGS allows."""
    spline = CubicSpline(trajectory.t, trajectory.q)
    for spacing in SPACINGS:
        # evenly spaced within each piece of motion, with its ends
        ends = _piece_ends(timing)
        spaced = [np.linspace(a, b, max(2, round((b - a) / spacing) + 1)) for a, b in ends]
        t = np.concatenate(spaced)
        sag = _sag(trajectory, t, np.asarray(spline(t)))
        if sag <= SAG:
            break
    targets, dwells = _dwells(t, timing)
    axes = np.degrees(joints_to_axes(cell.robot, spline(t[targets])))
    reached = t[targets]
    reached[0] = 0.0  # the run begins with the first dwell
    return Targets(reached, np.asarray(axes), dwells, sag)


def _piece_ends(timing: PlanTiming) -> list[tuple[float, float]]:
    """Start and end [s] of each piece of motion between two dwells."""
    pieces = timing.stops + 1
    moving = (timing.duration_s - (timing.stops + 2) * timing.dwell_s) / pieces
    starts = [timing.dwell_s + k * (moving + timing.dwell_s) for k in range(pieces)]
    return [(start, start + moving) for start in starts]


def _dwells(t: Array, timing: PlanTiming) -> tuple[NDArray[np.bool_], Array]:
    """Mask (K,) of the times that are targets of their own, and the dwell [s] at each of those.

    The end of a piece and the beginning of the next one are a single target.
    """
    pieces = _piece_ends(timing)
    ends = np.array([end for _, end in pieces])
    later_starts = np.array([start for start, _ in pieces[1:]])
    dwell = np.where(np.isclose(t[:, None], ends).any(axis=1), timing.dwell_s, 0.0)
    dwell[0] = timing.dwell_s
    targets = ~np.isclose(t[:, None], later_starts).any(axis=1)
    return targets, dwell[targets]


def _sag(trajectory: Trajectory, t: Array, q: Array) -> float:
    """[m] largest error of the rod's length half way between targets q (K, J) [rad] at t (K,)."""
    rod = robot_frames(trajectory.nominal, 0.5 * (q[1:] + q[:-1])).tip.T - trajectory.nominal.origin
    commanded = np.linalg.norm(trajectory.tip - trajectory.nominal.origin, axis=1)
    there = CubicSpline(trajectory.t, commanded)(0.5 * (t[1:] + t[:-1]))
    return float(np.abs(np.linalg.norm(rod, axis=1) - there).max())

"""A course as axis targets for a controller that moves straight between them in axis angles.

Close enough together that the tool leaves the sphere by no more than SAG between two of them: the soft servo takes that up with a few
newtons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import robot_frames
from cell.robot_angles import joints_to_axes
from planning.course import Course
from planning.request import PlanTiming

SAG = 1.0e-4  # [m] 1 mm between robot and bar is some 50 N under soft servo
SPACINGS = (0.5, 0.25, 0.2, 0.1, 0.05)  # [s] between targets


@dataclass(frozen=True, eq=False)
class Targets:
    """What the controller is told."""

    t: Array  # (K,) [s] at which each is to be reached
    axes: Array  # (K, 6) [deg] as the controller shows them
    rests: Array  # (K,) [s] of standstill there; 0 where the robot passes
    sag: float  # [m] by which the tool leaves the sphere between them


def targets_of(cell: Cell, course: Course, timing: PlanTiming) -> Targets:
    """The fewest evenly spaced targets that keep SAG, or as many as SPACINGS gives."""
    spline = CubicSpline(course.t, course.q)
    for spacing in SPACINGS:
        t = _times(timing, spacing)
        sag = _sag(course, np.asarray(spline(t)))
        if sag <= SAG:
            break
    moving, rests = _rests(t, timing)
    axes = np.degrees(joints_to_axes(cell.robot, spline(t[moving])))
    reached = t[moving]
    reached[0] = 0.0  # the run begins with the first rest
    return Targets(reached, np.asarray(axes), rests, sag)


def _times(timing: PlanTiming, spacing: float) -> Array:
    """Evenly spaced within each piece of motion, its ends among them."""
    ends = _piece_ends(timing)
    pieces = [np.linspace(a, b, max(2, round((b - a) / spacing) + 1)) for a, b in ends]
    return np.concatenate(pieces)


def _piece_ends(timing: PlanTiming) -> list[tuple[float, float]]:
    pieces = timing.stops + 1
    moving = (timing.duration_s - (timing.stops + 2) * timing.dwell_s) / pieces
    starts = [timing.dwell_s + k * (moving + timing.dwell_s) for k in range(pieces)]
    return [(start, start + moving) for start in starts]


def _rests(t: Array, timing: PlanTiming) -> tuple[Array, Array]:
    """Which times are targets of their own, and the rest at each: where a piece ends and the next begins, one is enough."""
    ends = np.array([end for _, end in _piece_ends(timing)])
    begins = np.array([begin for begin, _ in _piece_ends(timing)])
    rest = np.where(np.isclose(t[:, None], ends).any(axis=1), timing.dwell_s, 0.0)
    rest[0] = timing.dwell_s
    kept = (
        ~np.isclose(t[:, None], begins[1:]).any(axis=1)
        if begins.size > 1
        else np.ones(t.size, dtype=bool)
    )
    return kept, rest[kept]


def _sag(course: Course, q: Array) -> float:
    """[m] how far from the sphere the tool is half way between targets q (K, 6) [rad]."""
    between = 0.5 * (q[1:] + q[:-1])
    out = robot_frames(course.nominal, between).tip.T - course.nominal.origin
    return float(np.abs(np.linalg.norm(out, axis=1) - course.nominal["bd3"]).max())

"""A candidate's course: what ball-bar and nominal robot do over time, in every configuration of the arm.

Screening looks at many candidates at a few phases each; judging at one, over time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry, bar_frames, nominal_geometry
from cell.inverse import robot_branches
from cell.robot_angles import joints_to_axes
from planning.candidate import Candidate
from planning.request import PlanTiming
from sim.path import phase_over_time

STEP = 0.2  # [s] of the grid; the motion has no part above 1 Hz


@dataclass(frozen=True, eq=False)
class Course:
    """One candidate over time, in one configuration of the arm."""

    nominal: Geometry
    t: Array  # (N,) [s]
    b: Array  # (N, 5) [rad]
    q: Array  # (N, 6) [rad]
    speed: Array  # (N, 6) [rad/s]
    acceleration: Array  # (N, 6) [rad/s^2]
    tip: Array  # (N, 3) [m]
    tip_speed: Array  # (N,) [m/s]


def course_over(
    cell: Cell, candidate: Candidate, timing: PlanTiming, *, step: float = STEP
) -> list[Course]:
    """The courses of those configurations that reach every sample; none where the robot does not reach."""
    nominal = nominal_geometry(cell, candidate.position)
    t = np.arange(round(timing.duration_s / step) + 1, dtype=np.float64) * step
    phase = phase_over_time(t, duration=timing.duration_s, dwell=timing.dwell_s, stops=timing.stops)
    b = candidate.shape.angles(phase)
    poses = bar_frames(nominal, b).poses()
    branches = robot_branches(nominal.robot, poses)
    tip = poses[:, :3, 3]
    tip_speed = np.linalg.norm(CubicSpline(t, tip)(t, 1), axis=1)
    courses = []
    for branch in branches:
        if np.isnan(branch).any():
            continue
        q = near_middle(cell, np.unwrap(branch, axis=0))
        spline = CubicSpline(t, q)
        courses.append(
            Course(
                nominal, t, b, q, np.asarray(spline(t, 1)), np.asarray(spline(t, 2)), tip, tip_speed
            )
        )
    return courses


def near_middle(cell: Cell, q: Array) -> Array:
    """Joint angles (N, 6) [rad], whole turns taken off where the middle of an axis's range is nearer then."""
    middle = joints_to_axes(cell.robot, q)
    off = 0.5 * (middle.max(axis=0) + middle.min(axis=0)) - 0.5 * (
        cell.robot.axis_lower + cell.robot.axis_upper
    )
    turns = 2.0 * np.pi * np.round(off / (2.0 * np.pi))
    turns[:3] = 0.0  # the arm's angles are unique
    return np.asarray(q - turns @ cell.robot.controller_to_joint)

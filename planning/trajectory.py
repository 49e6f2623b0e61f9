"""Trajectories of a candidate: ball-bar and nominal robot over time, one per arm configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry, nominal_geometry
from cell.inverse import has_closed_form
from cell.numerical_inverse import in_range
from cell.robot_angles import joints_to_axes
from planning.candidate import Candidate
from planning.request import PlanTiming
from sim.path import branches_along, phase_over_time, tool_poses

STEP = 0.2  # [s] of the grid; the motion has no part above 1 Hz


@dataclass(frozen=True, eq=False)
class Passage:
    """Robot and ball-bar over time: of a candidate, or as recorded."""

    nominal: Geometry  # nominal, or as identified
    t: Array  # (N,) [s]
    b: Array  # (N, 5) [rad]
    q: Array  # (N, J) [rad]


@dataclass(frozen=True, eq=False)
class Trajectory(Passage):
    """One candidate over time, in one configuration of the arm."""

    speed: Array  # (N, J) [rad/s]
    acceleration: Array  # (N, J) [rad/s^2]
    tip: Array  # (N, 3) [m]
    tip_speed: Array  # (N,) [m/s]


def trajectories(
    cell: Cell, candidate: Candidate, timing: PlanTiming, *, step: float = STEP
) -> list[Trajectory]:
    """Trajectories in all configurations that reach every sample; none where the robot does not.

    step : [s] of the grid.
    """
    nominal = nominal_geometry(cell, candidate.position)
    t = np.arange(round(timing.duration_s / step) + 1, dtype=np.float64) * step
    phase = phase_over_time(t, duration=timing.duration_s, dwell=timing.dwell_s, stops=timing.stops)
    b = candidate.shape.angles(phase)
    tip = tool_poses(nominal, candidate.shape, phase)[:, :3, 3]
    tip_speed = np.linalg.norm(CubicSpline(t, tip)(t, 1), axis=1)
    out = []
    unique = has_closed_form(nominal.robot)
    for branch in branches_along(cell.robot, nominal, candidate.shape, phase):
        q = centred(cell, branch) if unique else in_range(cell.robot, branch)
        spline = CubicSpline(t, q)
        out.append(
            Trajectory(
                nominal=nominal,
                t=t,
                b=b,
                q=q,
                speed=np.asarray(spline(t, 1)),
                acceleration=np.asarray(spline(t, 2)),
                tip=tip,
                tip_speed=tip_speed,
            )
        )
    return out


def centred(cell: Cell, q: Array) -> Array:
    """(N, J) [rad] joint angles q (N, J) less the whole turns that bring each wrist axis nearest to
    the centre of its range.
    """
    axes = joints_to_axes(cell.robot, q)
    centre = 0.5 * (cell.robot.axis_lower + cell.robot.axis_upper)
    off = 0.5 * (axes.max(axis=0) + axes.min(axis=0)) - centre
    turns = 2.0 * np.pi * np.round(off / (2.0 * np.pi))
    turns[:3] = 0.0  # the arm's angles are unique
    return np.asarray(q - turns @ cell.robot.controller_to_joint)

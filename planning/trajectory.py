"""Trajectories of a candidate: ball-bar and nominal robot over time, one per arm configuration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.closed_form import ARM_AXES, ELBOWS, has_closed_form, robot_branches
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames, nominal_geometry, robot_frames
from ballbar.cell.numerical_inverse import in_range
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.planning.candidate import PathCandidate, shape_of
from ballbar.planning.request import PlanTiming
from ballbar.sim.path import Lissajous, branches_along, phase_over_time, tool_poses

STEP = 0.2  # [s] of the grid; the motion has no part above 1 Hz
DEGREE = 5  # of the spline that is differentiated; a cubic one is off by 9 % at steps of 0.5 s


@dataclass(frozen=True, eq=False)
class Passage:
    """Robot and ball-bar over time: of a candidate, or as recorded."""

    nominal: Geometry  # nominal, or as identified
    t: Array  # (N,) [s]
    b: Array  # (N, 5) [rad]
    q: Array  # (N, J) [rad]


@dataclass(frozen=True, eq=False)
class Trajectory(Passage):
    """One candidate over time, in one configuration of the arm; or several of equal duration.

    The samples of several runs follow one another, N in all. `nominal` then has the ball-bar at
    its base's origin; the position of each is to be added where it matters.
    """

    speed: Array  # (N, J) [rad/s]
    acceleration: Array  # (N, J) [rad/s^2]
    tip: Array  # (N, 3) [m]
    tip_speed: Array  # (N,) [m/s]
    runs: int = 1

    @cached_property
    def robot(self) -> Frames:
        """Frames of the robot at all samples."""
        return robot_frames(self.nominal, self.q)

    @cached_property
    def bar(self) -> Frames:
        """Frames of the ball-bar at all samples."""
        return bar_frames(self.nominal, self.b)

    @property
    def first(self) -> NDArray[np.intp]:
        """(N,) index of the sample with which the run of each begins."""
        length = self.t.size // self.runs
        return np.repeat(np.arange(self.runs) * length, length)

    def of_runs(self, some: NDArray[np.intp], *, every: int = 1) -> Trajectory:
        """Some of the runs, in this order, and of their samples the first and every so many."""
        rows = np.arange(self.t.size).reshape(self.runs, -1)[some, ::every].ravel()
        return self.part(rows, runs=some.size)

    def part(self, rows: NDArray[np.intp], *, runs: int) -> Trajectory:
        """The samples of some rows, as many of each run; frames that are known stay known."""
        sampled = ("t", "b", "q", "speed", "acceleration", "tip", "tip_speed")
        some = replace(self, runs=runs, **{name: getattr(self, name)[rows] for name in sampled})
        for name in {"robot", "bar"} & self.__dict__.keys():
            some.__dict__[name] = self.__dict__[name].part(rows)
        return some


def trajectories(
    cell: Cell, candidate: PathCandidate, timing: PlanTiming, *, step: float = STEP
) -> list[Trajectory]:
    """Trajectories in all configurations that reach every sample; none where the robot does not.

    step : [s] of the grid.
    """
    nominal = nominal_geometry(cell, candidate.position)
    t, phase = _times(timing, step)
    b = candidate.shape.angles(phase)
    tip = tool_poses(nominal, candidate.shape, phase)[:, :3, 3]
    first = ARM_AXES if has_closed_form(nominal.robot) else 0
    branches = branches_along(cell.robot, nominal, candidate.shape, phase)
    angles = [in_range(cell.robot, q, first=first) for q in branches]
    return [_moving(nominal, t, b, q, tip, runs=1) for q in angles]


def trajectories_of_many(
    cell: Cell,
    shapes: Lissajous,
    positions: Array,
    timing: PlanTiming,
    *,
    allowed: NDArray[np.bool_],
    step: float,
) -> tuple[Trajectory, NDArray[np.intp]] | None:
    """The trajectories of M candidates as runs, and the candidate (R,) of each; None for none.

    shapes : Lissajous parameters (M, 5). positions : (M, 3) [m] of the ball-bar. allowed : (M, 4)
    configurations that count, of an arm with closed form; others are led along one candidate after
    the other. step : [s] of the grid.
    """
    nominal = nominal_geometry(cell, np.zeros(3))
    (t, phase), m = _times(timing, step), len(positions)
    b, poses = shapes.angles(phase).reshape(-1, BAR_ROWS), tool_poses(nominal, shapes, phase)
    poses[:, :3, 3] += np.repeat(positions, t.size, axis=0)
    if has_closed_form(nominal.robot):
        elbows = allowed.reshape(m, 2, 2).any(axis=(0, 2))  # that any candidate may take
        branches = robot_branches(nominal.robot, poses, np.array(ELBOWS)[elbows].tolist())
        branches = branches.reshape(-1, t.size, 6)  # (2 or 4 M, T, 6)
        counted = np.flatnonzero(allowed[:, np.repeat(elbows, 2)].T)
        reached = counted[~np.isnan(branches[counted]).any(axis=(1, 2))]
        which = reached % m
        q = in_range(cell.robot, np.unwrap(branches[reached], axis=1), first=ARM_AXES)
    else:
        led = [
            branches_along(cell.robot, nominal_geometry(cell, position), shape_of(shapes, k), phase)
            for k, position in enumerate(positions)
        ]
        which = np.repeat(np.arange(m), [len(of_candidate) for of_candidate in led])
        q = np.array([in_range(cell.robot, angles) for of_one in led for angles in of_one])
    if not which.size:
        return None
    rows = (which[:, None] * t.size + np.arange(t.size)).ravel()
    return _moving(nominal, t, b[rows], q, poses[rows, :3, 3], runs=which.size), which


def _times(timing: PlanTiming, step: float) -> tuple[Array, Array]:
    """Times (T,) [s] of the grid, and the phases (T,) of the path there."""
    t = np.arange(round(timing.duration_s / step) + 1, dtype=np.float64) * step
    phase = phase_over_time(t, duration=timing.duration_s, dwell=timing.dwell_s, stops=timing.stops)
    return t, phase


def _moving(
    nominal: Geometry, t: Array, b: Array, q: Array, tip: Array, *, runs: int
) -> Trajectory:
    """Runs with their derivatives. t : (T,) [s]. q : (T, J), or (R, T, J) [rad] of R runs."""
    joints = q.shape[-1]
    side_by_side = np.concatenate(
        (q.reshape(runs, t.size, joints), tip.reshape(runs, t.size, 3)), axis=2
    )
    spline = make_interp_spline(t, side_by_side, k=DEGREE, axis=1)
    rate, bend = spline(t, 1), spline(t, 2)
    return Trajectory(
        nominal=nominal,
        t=np.tile(t, runs),
        b=b,
        q=q.reshape(-1, joints),
        speed=rate[:, :, :joints].reshape(-1, joints),
        acceleration=bend[:, :, :joints].reshape(-1, joints),
        tip=tip,
        tip_speed=np.linalg.norm(rate[:, :, joints:], axis=2).ravel(),
        runs=runs,
    )


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

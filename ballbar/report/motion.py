"""The motion of the identified cell on the robot's clock, its dwells and its singular poses.

Rows of the robot's log, thinned, not smoothed. Ball-bar angles come from the encoders, brought to
the robot's clock by the identified clock; unmeasured joints, and instants outside the ball-bar's
log, follow from the robot's pose.

The ball-bar is singular where its rod stands vertical (theta2 = 0) and where the universal joint is
straight (theta4 = 0, pi); the robot where its wrist is (axis 5). Beyond a singular pose the
mechanism is in the other configuration. Samples there are not cut: their covariance weighs them
(docs/identification.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.dwells import find_dwells
from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames, robot_frames
from ballbar.cell.logs import BallBarLog
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.closure import complete_bar_angles, pointing_bar
from ballbar.ident.result import RecordingEstimate
from ballbar.result.run_data import FittedRecording

# [rad] from the singular pose: the angles beside it are known 1 / sin(5 deg) = eleven times worse
CLOSE = np.deg2rad(5.0)
POSE_RATE = 30.0  # [Hz] smooth to the eye; the mechanism moves below 3 Hz
POSES = 120_000  # of the mechanism, at most: 67 minutes at that rate
GAP_PERIODS = 3.0  # as signals.smooth_log: a longer stretch without rows is not bridged


@dataclass(frozen=True, eq=False)
class CellMotion:
    """The identified mechanism over time."""

    t: Array  # (N,) [s] robot's clock, from the first row of its log
    q: Array  # (N, 6) [rad] logged robot joint angles
    robot: Frames
    b: Array  # (N, 5) [rad] ball-bar joint angles
    bar: Frames

    @property
    def tool(self) -> Array:
        """(N, 3) [m] identified tool position, robot base frame."""
        return self.robot.tip.T

    @property
    def frames(self) -> list[tuple[Frames, int]]:
        """Chain and frame that each body moves with: base, links and plate, then the ball-bar's.

        Frame 0 stands. Frame 0 of the robot is its base, the last one is that of link and plate.
        """
        last = len(self.robot.x) - 1
        rows = [(self.robot, row) for row in (*range(last + 1), last)]
        return [*rows, *((self.bar, row) for row in range(len(self.bar.x)))]


def cell_motion(fitted: FittedRecording, rows: NDArray[np.intp] | None = None) -> CellMotion:
    """Robot and ball-bar at rows (N,) of the robot's log; by default those that are shown."""
    recording, estimate, geometry = fitted.recording, fitted.estimate, fitted.estimate.geometry
    log, ballbar, length = recording.robot_log, recording.ballbar_log, recording.length_log
    if rows is None:
        rows = np.arange(0, log.t.size, thinning(log.t))
    t, q = log.t[rows], log.q[rows]
    t_other = (estimate.clock or Clock(0.0, 0.0)).ballbar_time(t)
    if length is not None:
        distance = np.linalg.norm(robot_frames(geometry, q).tip.T - geometry.origin, axis=1)
        sensed = np.interp(t_other, length.t, length.length) - estimate.nominal["bd3"]
        extension = np.where(_covered(length.t, t_other), sensed, distance - geometry["bd3"])
        return moving_cell(geometry, t, q, pointing_bar(geometry, q, extension))
    b = bar_angles_at(estimate, None, t, q)
    if ballbar is not None and estimate.clock is not None:
        completed = bar_angles_at(estimate, ballbar, t_other, q)
        b = np.where(_covered(ballbar.t, t_other)[:, None], completed, b)
    return moving_cell(geometry, t, q, b)


def moving_cell(geometry: Geometry, t: Array, q: Array, b: Array) -> CellMotion:
    """A mechanism at t (N,) [s], robot angles q (N, J) [rad] and ball-bar angles b (N, 5) [rad].

    b : (N, 6) of a telescoping bar, as in `bar_frames`.
    """
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    return CellMotion(t=t, q=q, robot=robot, b=b[:, :BAR_ROWS], bar=bar)


def thinning(t: Array) -> int:
    """Step between the rows of a log, t (N,) [s], that gives about POSE_RATE, or POSES in all."""
    smooth = round(1.0 / (POSE_RATE * float(np.median(np.diff(t)))))
    return max(1, smooth, -(-t.size // POSES))


def on_robot_clock(estimate: RecordingEstimate, t: Array) -> Array:
    """(N,) [s] ball-bar instants t (N,) [s] on the robot's clock.

    Unchanged without encoders, where all instants are the robot's.
    """
    return t if estimate.clock is None else estimate.clock.robot_time(t)


def mechanism_angles(estimate: RecordingEstimate, log: BallBarLog) -> Array:
    """(N, E) [rad] measured ball-bar joint angles, identified directions and offsets applied.

    Whole turns are taken off so that the mean of each is within half a turn.
    """
    offsets = np.array([estimate.geometry[f"btheta{joint}"] for joint in log.joints])
    angles = log.angles * np.array(estimate.directions) + offsets
    return np.asarray(angles - 2.0 * np.pi * np.round(angles.mean(axis=0) / (2.0 * np.pi)))


def logged_joints(fitted: FittedRecording, t: Array) -> Array:
    """(N, 6) [rad] logged robot joint angles at ball-bar instants t (N,) [s]."""
    log, times = fitted.recording.robot_log, on_robot_clock(fitted.estimate, t)
    return np.stack([np.interp(times, log.t, column) for column in log.q.T], axis=1)


def rms_norm(vectors: Array) -> float:
    """Root mean square of the norms of vectors (N, 3), in their unit."""
    return rms(np.linalg.norm(vectors, axis=1))


def bar_angles_at(estimate: RecordingEstimate, log: BallBarLog | None, t: Array, q: Array) -> Array:
    """(N, 5) [rad] angles that `bar_frames` takes, at ball-bar instants t (N,) [s].

    q : (N, J) [rad] of the robot at the same instants; unmeasured angles follow from it.
    """
    if log is None:
        return complete_bar_angles(estimate.geometry, q, np.zeros((t.size, 0)), ())
    angles = log.angles * np.array(estimate.directions)
    measured = np.stack([np.interp(t, log.t, column) for column in angles.T], axis=1)
    return complete_bar_angles(estimate.geometry, q, measured, log.joints)


def _covered(rows: Array, t: Array) -> Array:
    """(N,) whether a log has rows close by on both sides of each instant."""
    after = np.clip(np.searchsorted(rows, t), 1, rows.size - 1)
    dense = rows[after] - rows[after - 1] <= GAP_PERIODS * np.median(np.diff(rows))
    return np.asarray((t >= rows[0]) & (t <= rows[-1]) & dense)


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

"""A tracker beside a ball-bar: are its points where the robot of the ball-bar alone is predicted?

The tracker follows an LED that sits at a point l of the tool, in a frame and on a clock of its own.
Before it joins the fit it is held against the robot that the ball-bar identified. With position x
and rotation F of the tool by a given robot, its logged angles and loads, the point at the tracker's
time t is predicted at

    p(t) = R (x(s) + F(s) l) + o,      s = offset + (1 + skew) t.

R, o, l and the clock, 11 unknowns, are fitted to the points by least squares (Gauss-Newton), for
the identified and for the nominal robot each. They absorb what a shift or a turn of the whole robot
and another place of the LED explain: a calibration that is wrong in these alone is not seen. Points
that noise, accuracy and the stated uncertainty explain are fitted together with the ball-bar
(ballbar.ident.identify); two instruments that contradict each other are not averaged.

The noise is that of the log about a smooth motion, whatever the robot. A tracker is also off by
what changes slowly with place and time; that is allowed for by its stated accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.logs import TrackerLog
from ballbar.cell.neighbours import Rows
from ballbar.cell.poses import PoseGroup
from ballbar.cell.rigid_fit import kabsch
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.cell.splines import DEGREE
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.model import Evaluation
from ballbar.ident.signals.motion import MotionByLog
from ballbar.ident.signals.smooth_log import SmoothLog, motion_of
from ballbar.ident.start.followed import SCAN_STEP, likely_offsets, poses_at_rows
from ballbar.ident.verdict import SUSPECT, Verdict

CLOSE = 0.75  # row periods of the tracker between a sample of the fit and the row compared
MIN_OVERLAP = 10.0  # [s] of motion; less validates nothing
LEAST = 50  # points
MOST = 3000  # rows that enter a fit beside a ball-bar, evenly taken
NOT_COMPARED = (
    f"the tracker's log shares no {MIN_OVERLAP:g} s of motion with the others, or has fewer than "
    f"{LEAST} points beside the samples of the fit, so it validates nothing"
)
ITERATIONS, CONVERGED, RANK = 50, 1e-9, 1e-6  # [m] of a step; share of the largest singular value


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Measured minus predicted points of one robot."""

    error: Array  # (N, 3) [m] tracker's frame
    clock: Clock  # of the tracker, against the robot's
    unknowns: int  # that the points determine, of 11

    @property
    def distance(self) -> Array:
        """(N,) [m]"""
        return np.asarray(np.linalg.norm(self.error, axis=1))

    @property
    def rms(self) -> float:
        """[m] of the distance"""
        return rms(self.distance)

    @property
    def largest(self) -> float:
        """[m] distance"""
        return float(self.distance.max())


@dataclass(frozen=True, eq=False)
class TrackerCheck:
    """How far the points of a tracker are from those of the identified and the nominal robot."""

    t: Array  # (N,) [s] of the points on the robot's clock
    identified: PointErrors
    nominal: PointErrors
    noise: float  # [m] rms distance by the noise that the log shows
    accuracy: float  # [m] along each axis, as stated for the tracker
    tcp_sigma: float  # [m] stated TCP uncertainty, rms over the workspace
    followed: PoseGroup  # the points as a fit takes them

    @property
    def degrees(self) -> int:
        """Degrees of freedom: coordinates less unknowns."""
        return int(self.identified.error.size) - self.identified.unknowns

    @property
    def expected(self) -> float:
        """[m] rms distance that tracker and stated TCP uncertainty explain."""
        return float(np.hypot(max(self.noise, np.sqrt(3.0) * self.accuracy), self.tcp_sigma))

    @property
    def acceptable(self) -> bool:
        return self.identified.rms**2 <= SUSPECT * self.expected**2

    @property
    def sentence(self) -> str:
        """The distances with their units."""
        robots = (("identified", self.identified), ("nominal", self.nominal))
        sizes = " and ".join(
            f"{e.rms * 1e3:.3f} mm rms (largest {e.largest * 1e3:.3f}) from the {name} robot's"
            for name, e in robots
        )
        return (
            f"Tracker: its {self.t.size} points are {sizes}; its noise makes "
            f"{self.noise * 1e3:.3f} mm. Its frame, clock and LED were fitted to each robot "
            f"({self.identified.unknowns} unknowns, {self.degrees} degrees of freedom), and what "
            "these absorb is not seen."
        )

    @property
    def care(self) -> str:
        """The warning where the tracker contradicts the identified robot."""
        return (
            f"the tracker contradicts the identified robot: its points are "
            f"{self.identified.rms * 1e3:.2f} mm rms off, and noise, accuracy and the stated TCP "
            f"uncertainty explain {self.expected * 1e3:.2f} mm. Check that LED and tracker did not "
            "move, and accuracy_m in recording.yaml; else the result is wrong."
        )


def check_tracker(
    log: TrackerLog,
    identified: Evaluation,
    nominal: Evaluation,
    *,
    tcp_sigma: float,
    name: str = "",
) -> TrackerCheck | None:
    """The points of a tracker against both robots at the samples of a fit.

    tcp_sigma : [m] stated for the identified robot. name : of the recording. None where log and
    samples share too little.
    """
    smooth = motion_of(log, log.points)
    good = ~np.isin(log.t, smooth.outliers.times)
    t, points = log.t[good], log.points[good]
    path, within = _tool_path(identified), CLOSE * smooth.row_period
    velocity = path.speed(np.arange(path.t[0], path.t[-1], SCAN_STEP))[:, :3]
    starts = (
        Clock(offset, 0.0) for offset in likely_offsets(smooth, path.t[0], velocity, MIN_OVERLAP)
    )
    fits = [fit for clock in starts if (fit := _refined(t, points, path, clock, within))]
    if not fits:
        return None
    best, rows = min(fits, key=lambda fit: fit[0].rms)
    return TrackerCheck(
        t=np.asarray(best.clock.robot_time(t[rows])),
        identified=best,
        nominal=_fitted(t[rows], points[rows], _tool_path(nominal), best.clock),
        noise=float(np.linalg.norm(smooth.noise)),
        accuracy=float(log.sigma[:, :3].max()),
        tcp_sigma=tcp_sigma,
        followed=_followed(log, smooth, identified, best.clock, name),
    )


def _followed(
    log: TrackerLog, smooth: SmoothLog, point: Evaluation, clock: Clock, name: str
) -> PoseGroup:
    """The rows of a tracker beside a ball-bar, with the loads that the fit of it found."""
    loads, state, samples = None, point.state, point.recording
    t, first = np.unique(point.robot_time, return_index=True)
    if state is not None:
        loads = state.loads.part(first).over_time(t, state.tension[first])
    motion = MotionByLog(name or "tracker", samples.robot, clock, loads)
    group = poses_at_rows(log, smooth, motion)
    at = np.asarray(clock.robot_time(np.asarray(group.time)))
    rows = np.flatnonzero(samples.robot.covers(at) & (at >= t[0]) & (at <= t[-1]))
    group = group.part(rows[:: max(1, -(-rows.size // MOST))])
    return replace(group, seat=f"{motion.name} seat", target=f"{motion.name} target")


def judged_by_tracker(
    verdict: Verdict, log: TrackerLog | None, check: TrackerCheck | None, *, name: str = ""
) -> Verdict:
    """The verdict with what a tracker has against it; name : of the recording, where needed."""
    prefix = f"{name}: " if name else ""
    if check is not None and not check.acceptable:
        return verdict.with_care(prefix + check.care)
    if log is not None and check is None:
        return verdict.with_warning(prefix + NOT_COMPARED)
    return verdict


@dataclass(frozen=True, eq=False)
class _ToolPath:
    """The tool over the robot's clock, base frame."""

    t: Array  # (K,) [s] of the samples
    spline: BSpline  # (12,) position [m], then rotation row by row
    speed: BSpline

    def at(self, t: Array, led: Array) -> tuple[Array, Array, Array]:
        """LED (N, 3) [m] at (3,) [m] of the tool, the tool's turns (N, 3, 3), its speed (N, 3)."""
        pose, rate = self.spline(t), self.speed(t)
        turns, spins = (part[:, 3:].reshape(-1, 3, 3) for part in (pose, rate))
        return pose[:, :3] + turns @ led, turns, rate[:, :3] + spins @ led


def _tool_path(point: Evaluation) -> _ToolPath:
    position, rotation = point.closure.robot.tip, point.closure.robot.rotation()
    if point.yielded is not None:
        position = position + point.yielded[:3]
        bend = matrix_from_rotvec(point.yielded[3:])
        rotation = np.einsum("ijn,jkn->ikn", bend, rotation)
    t, chosen = np.unique(point.robot_time, return_index=True)
    poses = np.concatenate((position, rotation.reshape(9, -1)))[:, chosen]
    spline = make_interp_spline(t, poses.T, k=DEGREE)
    return _ToolPath(t, spline, spline.derivative())


def _refined(
    t: Array, points: Array, path: _ToolPath, clock: Clock, within: float
) -> tuple[PointErrors, Rows] | None:
    """The errors of the rows beside samples from a clock on; None of too few rows."""
    for _ in range(2):  # the clock decides which rows these are
        rows = _beside_samples(t, path.t, clock, within)
        if rows.size < LEAST:
            return None
        errors = _fitted(t[rows], points[rows], path, clock)
        clock = errors.clock
    return errors, rows


def _beside_samples(t: Array, samples: Array, clock: Clock, within: float) -> Rows:
    """Rows of t (N,) [s], each the next one to a sample (K,) [s] of the robot's clock."""
    wanted = np.asarray(clock.ballbar_time(samples))
    right = np.clip(np.searchsorted(t, wanted), 1, t.size - 1)
    rows = np.where(wanted - t[right - 1] < t[right] - wanted, right - 1, right)
    at = np.asarray(clock.robot_time(t[rows]))
    close = (np.abs(t[rows] - wanted) <= within) & (at >= samples[0]) & (at <= samples[-1])
    return np.unique(rows[close])


def _fitted(t: Array, points: Array, path: _ToolPath, clock: Clock) -> PointErrors:
    """Frame, LED and clock by least squares; t (N,) [s], points (N, 3) [m]."""
    middle, led = float(t.mean()), np.zeros(3)
    places, _, _ = path.at(np.asarray(clock.robot_time(t)), led)
    rotation = kabsch(places - places.mean(axis=0), points - points.mean(axis=0))
    origin = points.mean(axis=0) - rotation @ places.mean(axis=0)
    columns = np.zeros((t.size, 3, 11))
    columns[:, :, 3:6] = np.eye(3)
    for _ in range(ITERATIONS):
        at = np.clip(np.asarray(clock.robot_time(t)), path.t[0], path.t[-1])
        places, turns, speed = path.at(at, led)
        turned = places @ rotation.T
        residual = points - turned - origin
        columns[:, :, :3] = np.cross(np.eye(3), turned[:, None, :]).transpose(0, 2, 1)
        columns[:, :, 6:9] = rotation @ turns
        columns[:, :, 9] = speed @ rotation.T
        columns[:, :, 10] = columns[:, :, 9] * (t - middle)[:, None]
        step, _, rank, _ = np.linalg.lstsq(columns.reshape(-1, 11), residual.ravel(), rcond=RANK)
        rotation = matrix_from_rotvec(step[:3, None])[:, :, 0] @ rotation
        origin, led = origin + step[3:6], led + step[6:9]
        skew = clock.skew + float(step[10])
        clock = Clock(float(clock.robot_time(middle) + step[9]) - (1.0 + skew) * middle, skew)
        if np.abs(columns @ step).max() < CONVERGED:
            break
    return PointErrors(residual, clock, int(rank))

"""Poses by an instrument that follows a moving robot: its clock, and where it stands, about.

Target and flange are about equally fast, wherever the frame and the target are, so the lags at
which their speeds agree best are tried. From
each, seat and target are found by the nominal robot as those of still poses are, with the clock
among the unknowns, on a part of the rows; what explains these best is taken.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import TrackerLog
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.statistics import rms
from ballbar.ident.signals.motion import MotionByLog
from ballbar.ident.signals.smooth_log import SmoothLog, motion_of
from ballbar.ident.start.automatic import StartError
from ballbar.ident.start.lag_scan import best_lags, subsample
from ballbar.ident.start.placements import PoseStartError, placed_fit
from ballbar.ident.start.speed_scan import scan_speeds

SCAN_STEP = 0.02  # [s] of the lags
MIN_OVERLAP = 5.0  # [s] of motion; points of less cannot tell one motion from another
LAGS, LAG_SEPARATION = 4, 0.5  # peaks of the scan that are tried, and [s] between them
TRIED_ROWS = 600  # from which clock, seat and target are found from each of them
# [m] along each axis, that a robot by its file leaves at the right lag, and never at a wrong one
CLOSE, GROSS = 3e-3, 0.03
SEAT, TARGET = "tracker", "target"


def followed_table(
    name: str, robot: Robot, geometry: Geometry, motion: SmoothLog, log: TrackerLog
) -> PoseTable:
    """The poses at the rows of a tracker's log, by a clock that a fit can start from.

    name : of the recording. geometry : of the robot, about. Raises StartError where the logs share
    too little motion, PoseStartError where their measurements and the robot cannot be brought
    together.
    """
    smooth = motion_of(log, log.points)
    whole = poses_at_rows(log, smooth, MotionByLog(name, motion, Clock(0.0, 0.0)))
    best, clock, refused = np.inf, None, None
    for offset in _offsets(smooth, motion, geometry):
        trial = Clock(offset, 0.0)
        try:
            for _ in range(2):  # the clock decides which rows these are
                group = _covered(whole, motion, trial)
                part = group.part(np.arange(0, group.size, max(1, group.size // TRIED_ROWS)))
                fit = placed_fit(geometry, PoseTable(name, robot, (part,)))
                trial = fit.model.unknowns.instrument_clock(fit.x, name)
        except PoseStartError as error:
            refused = error
            continue
        if fit.excess.position < best:
            best, clock = fit.excess.position, trial
        if best < CLOSE:
            break
    if refused is not None and best > GROSS:
        raise refused
    if clock is None:
        raise StartError(
            f"{name}: the tracker's log shares no {MIN_OVERLAP:g} s of motion with the robot's. "
            "Are they of one run? Log both in one."
        )
    return PoseTable(name, robot, (_covered(whole, motion, clock),))


def poses_at_rows(log: TrackerLog, smooth: SmoothLog, motion: MotionByLog) -> PoseGroup:
    """The rows of a log that do not stand out, as poses; smooth : its points."""
    rows = ~np.isin(log.t, smooth.outliers.times)
    times = smooth.stamps[rows]
    at = motion.within(np.asarray(motion.clock.robot_time(times)))
    return PoseGroup(
        measured=log.measured,
        seat=SEAT,
        target=TARGET,
        q=motion.angles(at),
        values=log.values[rows],
        sigma=log.sigma[rows],
        rows=np.flatnonzero(rows) + 1,
        file=motion.name,
        time=times,
        motion=motion,
    )


def _covered(group: PoseGroup, motion: SmoothLog, clock: Clock) -> PoseGroup:
    """The poses that lie in the robot's log and in no gap of it, by a clock."""
    assert group.time is not None
    return group.part(motion.covers(np.asarray(clock.robot_time(group.time)))).by(clock)


def _offsets(smooth: SmoothLog, motion: SmoothLog, geometry: Geometry) -> list[float]:
    """[s] likely clock offsets by the speed of the flange."""
    t = np.arange(motion.start, motion.end, SCAN_STEP)
    flange = forward(geometry.robot, np.asarray(motion.spline(t))).origin[-1].T
    return likely_offsets(smooth, motion.start, np.gradient(flange, SCAN_STEP, axis=0))


def likely_offsets(
    smooth: SmoothLog, start: float, velocity: Array, overlap: float = MIN_OVERLAP
) -> list[float]:
    """[s] likely clock offsets: those at which the target and the tool are equally fast.

    velocity : (K, 3) [m/s] of the tool, every SCAN_STEP from the robot's time `start` [s].
    overlap : [s] that both have to share.
    """
    t = np.arange(smooth.start, smooth.end, SCAN_STEP)
    seen = np.where(smooth.covers(t)[:, None], smooth.speed(t), 0.0)
    speeds = [np.linalg.norm(v, axis=1) for v in (velocity, seen)]
    a, b = (speed[:, None] / max(rms(speed), np.finfo(float).tiny) for speed in speeds)
    least = round(overlap / SCAN_STEP)
    if min(len(a), len(b)) < least:
        return []
    scan = scan_speeds(a, b, [(0, 0)], least=least, paired=True)
    best = best_lags(scan, count=LAGS, separation=round(LAG_SEPARATION / SCAN_STEP))
    return [float(start - smooth.start + SCAN_STEP * subsample(scan, k)) for k in best]

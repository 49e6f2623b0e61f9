"""Coarse clock offset of any size between two logs, from when things move, without geometry.

Both mechanisms move and dwell together. On one time grid each log gives two signals: activity,
ln(1 + speed / slow), where speed is summed over the log's channels and slow is a tenth of its
median moving speed, so that dwells stand out and a fast wrist does not drown the rest; and whether
it dwells. At every lag the two logs are compared inside their overlap only. The score is the
overlap times the explained variance rho^2, mean of the two signals: seconds in which one log
predicts the other. With the variance taken inside the overlap, dwell against dwell scores nothing;
with rho^2 and not the likelihood -ln(1 - rho^2), one dwell that fits perfectly in a short overlap
does not beat the whole trajectory that fits well.

This is a cross-check for people. Identification finds the offset from geometry, and finer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.dwells import find_dwells, speeds
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.logs import BallBarLog, RobotLog

STEP = 0.05  # [s] of the common grid: the speeds are smooth over 0.2 s
MIN_OVERLAP = 10.0  # [s] less cannot tell one motion from another
MOVING = 1e-2  # [rad/s] summed over the channels; a log that never does is of a standing machine
SLOW = 0.1  # of the median moving speed
APART = 2.0  # [s] two peaks closer than this are one
_FLAT = 1e-9  # variance below which a signal is constant up to rounding


@dataclass(frozen=True)
class CoarseAlignment:
    """`t_robot = offset_s + t_bar`, both from the first row of their log, and the second best."""

    offset_s: float
    # [s] overlap times explained variance; compare it with the overlap and with the runner-up's.
    score: float
    overlap_s: float
    runner_up_offset_s: float | None  # none if there is no other peak
    runner_up_score: float


@dataclass(frozen=True, eq=False)
class _Lags:
    """Every lag of the ball-bar's grid against the robot's that overlaps enough."""

    lag: NDArray[np.int64]  # (L,) [STEP] robot index minus ball-bar index
    overlap: Array  # (L,) samples
    score: Array  # (L,) [s]


def coarse_alignment(robot: RobotLog, ballbar: BallBarLog) -> CoarseAlignment:
    """The offset at which the two logs move and rest together; accurate to about 0.1 s.

    Raises LogError if a log is too short or nothing moves in it.
    """
    lags = _compare(
        _signals("robot", robot.t, robot.q), _signals("ball-bar", ballbar.t, ballbar.angles)
    )
    best = int(np.argmax(lags.score))
    if lags.score[best] <= 0.0:
        raise LogError(
            "robot and ball-bar log move at different times whatever the clock offset. Are they "
            "of the same run? Log both in one run, or correct `time` of both in recording.yaml."
        )
    runner_up = _runner_up(lags, best)
    return CoarseAlignment(
        offset_s=_vertex(lags, best) * STEP,
        score=float(lags.score[best]),
        overlap_s=float(lags.overlap[best]) * STEP,
        runner_up_offset_s=None if runner_up is None else _vertex(lags, runner_up) * STEP,
        runner_up_score=0.0 if runner_up is None else float(lags.score[runner_up]),
    )


def _runner_up(lags: _Lags, best: int) -> int | None:
    """Index of the highest other peak that is not part of the best one."""
    peak = np.zeros(lags.score.size, dtype=bool)
    inner = lags.score[1:-1]
    peak[1:-1] = (inner > lags.score[:-2]) & (inner >= lags.score[2:])
    peak &= np.abs(lags.lag - lags.lag[best]) * STEP > APART
    return int(np.argmax(np.where(peak, lags.score, -1.0))) if peak.any() else None


def _signals(name: str, t: Array, angles: Array) -> Array:
    """(2, n) activity and dwells of one log on a grid of STEP from its first row.

    t : (N,) [s]. angles : (N, C) [rad].
    """
    if t[-1] - t[0] < MIN_OVERLAP:
        raise LogError(
            f"the {name} log lasts {t[-1] - t[0]:.3g} s; aligning two clocks needs {MIN_OVERLAP:g} "
            "s in common. Log a longer run with both."
        )
    speed = sum((np.abs(channel) for channel in speeds(t, angles)), start=np.zeros(t.size))
    moving = speed[speed > MOVING]
    if not moving.size:
        raise LogError(
            f"nothing moves in the {name} log, so its clock cannot be compared with the other. "
            "Log both while the robot moves."
        )
    activity = np.log1p(speed / (SLOW * float(np.median(moving))))
    standing = find_dwells(t, angles).standing.astype(np.float64)
    grid = np.arange(0.0, t[-1] - t[0], STEP)
    return np.stack([np.interp(grid, t - t[0], signal) for signal in (activity, standing)])


def _compare(robot: Array, ballbar: Array) -> _Lags:
    """Score of every lag at which the signals (2, n) of both logs overlap enough."""
    ones_r, ones_b = np.ones(robot.shape[1]), np.ones(ballbar.shape[1])
    samples = np.rint(_cross(ones_r, ones_b))
    enough = samples >= MIN_OVERLAP / STEP
    samples, lag = samples[enough], np.arange(1 - ones_b.size, ones_r.size)[enough]
    rho = np.stack(
        [overlap_correlation(r, b, samples, enough) for r, b in zip(robot, ballbar, strict=True)]
    )
    return _Lags(lag, samples, samples * STEP * (rho**2).mean(axis=0))


def overlap_correlation(r: Array, b: Array, samples: Array, enough: NDArray[np.bool_]) -> Array:
    """(L,) dimensionless correlation of two signals inside their overlap at each lag, by FFT.

    r, b : (n,), (m,) signals. samples : (L,) of overlap at each lag that counts. enough : (n+m-1,)
        those
        lags among all.
    It is 0 where it is negative or one of the signals is constant.
    """
    r, b = r - r.mean(), b - b.mean()  # smaller numbers, less rounding in the differences below
    ones_r, ones_b = np.ones_like(r), np.ones_like(b)
    mean_r, mean_b, square_r, square_b, product = (
        _cross(x, y)[enough] / samples
        for x, y in ((r, ones_b), (ones_r, b), (r**2, ones_b), (ones_r, b**2), (r, b))
    )
    variance_r, variance_b = square_r - mean_r**2, square_b - mean_b**2
    varies = (variance_r > _FLAT) & (variance_b > _FLAT)
    deviations = np.sqrt(np.where(varies, variance_r * variance_b, 1.0))
    rho = np.where(varies, product - mean_r * mean_b, 0.0) / deviations
    return np.clip(rho, 0.0, 1.0)


def _cross(robot: Array, ballbar: Array) -> Array:
    from scipy.signal import correlate  # noqa: PLC0415  slow to import, and needed here alone

    return np.asarray(correlate(robot, ballbar, mode="full", method="fft"), dtype=np.float64)


def _vertex(lags: _Lags, peak: int) -> float:
    """Lag of a peak in grid steps, refined by a parabola through its neighbours."""
    if not 0 < peak < lags.lag.size - 1:
        return float(lags.lag[peak])
    before, at, after = lags.score[peak - 1 : peak + 2]
    bend = before - 2.0 * at + after
    return float(lags.lag[peak] + (0.5 * (before - after) / bend if bend < 0.0 else 0.0))

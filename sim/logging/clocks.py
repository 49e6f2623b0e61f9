"""Rows of both loggers: when they are taken, how they are stamped, and which files they stand in.

The robot's clock runs true but for its wander. With the clock's map of ballbar.cell.clock, the
ball-bar's clock runs slow by 1 + skew and its log begins `offset` seconds after the robot's. The
later of the two logs begins LEAD seconds into the run; the rows that the other one has before that
are of the first dwell.

The ball-bar's logger is the thesis's (sec. 4.6): a task of 5 ms writes a line and waits for the
file, which takes 10 ms per row, or 15 ms when the write takes one cycle more. Its stamps are
distributed clock time, ns since 2000-01-01.

A wandering clock takes its rows at other times and stamps them as before. Its rate does a random
walk and decays from power-on; the integral is the deviation in time, without its least-squares
line, so that offset and skew remain those of a straight line fitted to both clocks. A step, jitter
and rounding change the stamps only. Which rows are lost or doubled is drawn for every row taken, so
that losing one changes nothing for the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.dialect import ABB_PERIOD
from ballbar.cell.schema import Strict
from ballbar.sim.errors.sensor_errors import LEAD, ClockWander
from ballbar.sim.logging.load_logs import BallbarLogger
from ballbar.sim.settings import ClockSettings
from ballbar.sim.streams import stream

SAMPLE_TASKS = 2  # cycles per row: one writes the line, the next waits for the file
BAR_EPOCH_NS = 830_000_000_000_000_000  # [ns] a day in April 2026 in time since 2000
ROBOT_EPOCH = 1234.5  # [s] controller up-time at the first row
KNOT = 1.0  # [s] largest distance of knots: the rate changes over minutes, so any second will do
Rows = NDArray[np.int64]  # indices of rows taken, in the order of the file


class WanderCurve(Strict):
    """Deviation of one clock, linear between knots: later true time at a stamp."""

    t_clock_s: tuple[float, ...]
    deviation_s: tuple[float, ...]

    def at(self, t_clock: Array) -> Array:
        """(N,) [s] deviation at times (N,) [s] of the clock from its first row."""
        return np.interp(t_clock, self.t_clock_s, self.deviation_s)


class RowCounts(Strict):
    """Rows of one log."""

    taken: int
    dropped: int  # by chance, not by a restart
    duplicated: int


@dataclass(frozen=True, eq=False)
class LogTimes:
    """Times of the rows of both logs."""

    robot_true: Array  # (N,) [s]
    robot_stamp: Array  # (N,) [s]
    bar_true: Array  # (M,) [s]
    bar_stamp: NDArray[np.int64]  # (M,) [ns]
    bar_task: NDArray[np.int64]  # (M,) PLC task cycles, or rows of lengths, since the first row
    wander: WanderCurve | None = None  # of the ball-bar's clock
    robot_wander: WanderCurve | None = None


@dataclass(frozen=True, eq=False)
class LoggedRows:
    """Rows of both logs as they stand in the files."""

    robot: Rows
    ballbar: tuple[Rows, ...]  # of each file, oldest first
    counts: dict[str, RowCounts]


def log_times(
    duration: float,
    clocks: ClockSettings,
    *,
    seed: int,
    period: float = ABB_PERIOD,
    task: float = BallbarLogger().task_s,
    rate: float | None = None,
) -> LogTimes:
    """Times of the rows of both logs of a run of `duration` seconds of true time.

    period : [s] of the robot's rows. task : [s] of the PLC. rate : [Hz] of a log of lengths, which
        is even; None for the PLC's log of the ball-bar.
    """
    task_ns = round(task * 1e9)
    offset, end = clocks.offset_s, duration - LEAD
    robot_start, bar_start = LEAD - max(0.0, offset), LEAD + min(0.0, offset)
    rows = int((end - robot_start) / period) + 1
    robot_clock: Array = period * np.arange(rows, dtype=np.float64)
    if rate is None:
        longest = int((end - bar_start) * 1e9 / (SAMPLE_TASKS * task_ns)) + 1
        cycles = task_cycles(longest, clocks.overrun_probability, stream(seed, "overruns"))
        ticks = task_ns * cycles
    else:
        cycles = np.arange(int((end - bar_start) * rate) + 1, dtype=np.int64)
        ticks = np.rint(cycles * (1e9 / rate)).astype(np.int64)
    bar_clock = ticks.astype(np.float64) * 1e-9
    bar_true = Clock(bar_start, clocks.skew).robot_time(bar_clock)
    robot_true, wander, robot_wander = robot_start + robot_clock, None, None
    if clocks.wander:
        wander = _wander_curve(clocks.wander, end - bar_start, stream(seed, "clock_wander"))
        bar_true += wander.at(bar_clock)
    if clocks.robot_wander:
        rng = stream(seed, "robot_clock_wander")
        robot_wander = _wander_curve(clocks.robot_wander, float(robot_clock[-1]), rng)
        robot_true += robot_wander.at(robot_clock)
    inside = bar_true <= end
    return LogTimes(
        robot_true=robot_true,
        robot_stamp=ROBOT_EPOCH + _robot_stamps(robot_clock, clocks, stream(seed, "stamp_jitter")),
        bar_true=bar_true[inside],
        bar_stamp=BAR_EPOCH_NS + _bar_stamps(ticks[inside], bar_true[inside], clocks),
        bar_task=cycles[inside],
        wander=wander,
        robot_wander=robot_wander,
    )


def task_cycles(
    rows: int, overrun_probability: float, rng: np.random.Generator
) -> NDArray[np.int64]:
    """(M,) PLC task cycles of so many rows: 2 apart, or 3 after an overrun."""
    tasks = SAMPLE_TASKS + (rng.random(rows) < overrun_probability)
    return np.asarray(np.cumsum(tasks) - tasks[0])


def _wander_curve(wander: ClockWander, length: float, rng: np.random.Generator) -> WanderCurve:
    """The wander over a log of `length` seconds."""
    t: Array = np.linspace(0.0, length, int(np.ceil(length / KNOT)) + 1)
    step, middle = t[1], 0.5 * (t[1:] + t[:-1])
    walk = np.cumsum(rng.standard_normal(middle.size))
    walk -= walk.mean()
    rate = wander.rate_rms_ppm * 1e-6 * (walk / np.sqrt(np.mean(walk**2)))
    rate = rate + wander.warm_up_ppm * 1e-6 * np.exp(-middle / wander.warm_up_time_s)
    deviation = np.concatenate(([0.0], np.cumsum(rate * step)))
    line = np.polynomial.Polynomial.fit(t, deviation, 1)
    return WanderCurve(
        t_clock_s=tuple(t.tolist()), deviation_s=tuple((deviation - line(t)).tolist())
    )


def _robot_stamps(clock: Array, clocks: ClockSettings, rng: np.random.Generator) -> Array:
    """(N,) [s] stamps of the robot's rows; clock : (N,) [s] the robot's time from the first row."""
    stamps = clock
    if clocks.jitter:
        jitter = clocks.jitter.sigma_s * rng.standard_normal(clock.size)
        jitter[0] = 0.0
        stamps = stamps + jitter
    quantum = clocks.quantum.robot_s if clocks.quantum else 0.0
    return np.asarray(np.rint(stamps / quantum) * quantum if quantum else stamps)


def _bar_stamps(ticks: NDArray[np.int64], t: Array, clocks: ClockSettings) -> NDArray[np.int64]:
    """(M,) [ns] stamps of the ball-bar's rows.

    ticks : (M,) [ns] time of the ball-bar's clock from the first row. t : (M,) [s] run time.
    """
    stamps = ticks
    if step := clocks.step:
        stamps = ticks + np.where(t >= step.at_s, round(step.step_s * 1e9), 0).astype(np.int64)
    quantum = round(clocks.quantum.ballbar_s * 1e9) if clocks.quantum else 0
    return np.asarray((stamps + quantum // 2) // quantum * quantum if quantum else stamps)


def logged_rows(times: LogTimes, clocks: ClockSettings, *, seed: int) -> LoggedRows:
    """The rows that a scenario's loggers write."""
    lose, repeat = clocks.dropped_rows, clocks.duplicated_rows
    drawn = {
        "robot": (stream(seed, "dropped_rows_robot"), stream(seed, "duplicated_rows_robot")),
        "ballbar": (stream(seed, "dropped_rows_ballbar"), stream(seed, "duplicated_rows_ballbar")),
    }
    files, counts = {}, {}
    for log, taken in (("robot", times.robot_true.size), ("ballbar", times.bar_true.size)):
        lost, twice = (
            chosen(taken, getattr(fault, f"{log}_probability") if fault else 0.0, rng)
            for fault, rng in zip((lose, repeat), drawn[log], strict=True)
        )
        files[log] = np.repeat(np.arange(taken), np.where(lost, 0, 1 + twice)).astype(np.int64)
        dropped, duplicated = int(lost.sum()), int((twice & ~lost).sum())
        counts[log] = RowCounts(taken=taken, dropped=dropped, duplicated=duplicated)
    ballbar: tuple[Rows, ...] = (files["ballbar"],)
    if restart := clocks.restart:
        rows = files["ballbar"]
        at = times.bar_true[rows]
        ballbar = (rows[at < restart.at_s], rows[at >= restart.at_s + restart.gap_s])
    return LoggedRows(files["robot"], ballbar, counts)


def chosen(rows: int, probability: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(rows,) whether each row is hit with that probability; never the first, as time counts from
    it.
    """
    hit = rng.random(rows) < probability
    hit[0] = False
    return hit

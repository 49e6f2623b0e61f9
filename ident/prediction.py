"""Does a fit predict what was logged after it? And if not: which channel is off, and how?

The rows of a stretch that the fit has not seen are put into its loop closure as they are, without
smoothing. A row of E whitened residuals with Jacobian J has, by a fit of covariance C,

    (E + trace(J C J')) level

as its mean square on average, as in ballbar.ident.held_out; the level is what the fit leaves in its
own samples. Where rows have far more, hypotheses compete for them: columns of the encoders or of
the robot's log are exchanged or reversed, or one channel, or the clock, is off by any amount at
each row. How that amount goes on tells a channel that stands still, counts backwards or too far
from one that stepped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.logs import BallBarLog, LengthLog, RobotLog
from ballbar.cell.number_text import significant_text
from ballbar.cell.statistics import rms
from ballbar.ident.causes.robot_log import angle_kinds, other_angles
from ballbar.ident.corrections.base import BAR, GEAR
from ballbar.ident.estimator.closure import close_loop, complete_bar_angles
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import NormalEquations, jacobian, normal_equations
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.recording_fit import Logs, RecordingFit
from ballbar.ident.signals.smooth_log import interpolating_log
from ballbar.ident.signals.steps import without_steps

MARGIN = 0.1  # [s] of rows beside a stretch, for the splines through them
FEWEST, MOST = 10, 200  # rows of a stretch: fewer say nothing, of more some are looked at
OFF = 6.0  # times what the fit explains: rms residual of a row that is off; white noise reaches 3
UNLIKE = 3.0  # times the largest square that the fit leaves in its own samples
SHARE = 0.05  # of the rows of a stretch that are off, from which it is not predicted
STEPS = 4  # Gauss-Newton steps to the amount by which a channel is off
EXPLAINS = 0.3  # rms residual under a hypothesis over that as logged
EQUATIONS = 3  # a sample, from which one channel may be free at each row
MOVES = 2e-3  # [rad] motion below which nothing tells how a channel goes on
FROZEN = 1e-2  # of the motion of one log, of the other one that stands still
STILL = 0.05  # slope of logged over true motion, of a channel that stands still
STRAIGHT = 0.2  # share of the motion that may be off a straight line

Log = TypeVar("Log", RobotLog, BallBarLog, LengthLog)


@dataclass(frozen=True)
class Prediction:
    """How well a fit predicts a stretch of the logs behind it."""

    ratio: float  # rms residual over what noise and the uncertainty of the fit explain
    rows: int
    since: float | None = None  # [s] ball-bar's clock, of the first row that is off; None: agrees
    cause: str = ""  # what explains the rows that are off; empty where nothing does


def part_of(logs: Logs, clock: Clock, first: float, last: float) -> Logs:
    """The rows between two instants [s] of the ball-bar's clock, or the robot's without a log."""
    sensed = logs.ballbar is not None or logs.length is not None
    begin, end = (clock.robot_time(t) if sensed else t for t in (first, last))
    return replace(
        logs,
        robot=_rows(logs.robot, begin, end),
        ballbar=None if logs.ballbar is None else _rows(logs.ballbar, first, last),
        length=None if logs.length is None else _rows(logs.length, first, last),
    )


def _rows(log: Log, first: float, last: float) -> Log:
    some = slice(*np.searchsorted(log.t, (first, last)))
    every = {name: getattr(log, name, None) for name in ("q", "torque", "angles", "length")}
    every |= {"segment": log.segment, "flags": log.flags, "t": log.t}
    return replace(log, **{k: v[some] for k, v in every.items() if v is not None})


def predict(cell: Cell, fitted: RecordingFit, logs: Logs, seconds: float) -> Prediction | None:
    """How well a fit predicts the last seconds of the logs; None where there are too few rows.

    logs : of the same recording, from the same first rows on. Steps that the fit took out of its
    logs are taken out of these.
    """
    samples = _samples(cell, fitted, _continuous(logs, fitted.samples), seconds)
    if samples is None:
        return None
    fit = fitted.fit
    model = replace(fit.model, recordings=(samples,))
    start = samples.ballbar_angles(fitted.geometry, fitted.clock)
    linear = normal_equations(model, fit.x, [start], fit.excess)
    (residual,) = linear.residuals
    square = (residual * residual).sum(axis=0)
    stated = max(1.0, fit.chi2_per_dof) * (len(residual) + _uncertainty(fit, linear))
    left = _largest_left(fitted, samples) * len(residual)
    off = square > np.maximum(OFF**2 * stated, UNLIKE * left)
    ratio = float(np.sqrt(square.sum() / stated.sum()))
    if off.sum() <= SHARE * off.size:
        return Prediction(ratio, off.size)
    begin = int(off.argmax())
    cause = "" if samples.measures_length else _cause(_Rows(cell, fitted, linear, begin))
    return Prediction(ratio, off.size, float(samples.times[begin]), cause)


def _continuous(logs: Logs, own: Samples) -> Logs:
    """The logs without the steps that were taken out of those of a fit."""
    t, q = without_steps(logs.robot.t, logs.robot.q, own.robot.steps)
    logs = replace(logs, robot=replace(logs.robot, t=t, q=q))
    if logs.ballbar is not None and own.ballbar is not None:
        t, angles = without_steps(logs.ballbar.t, logs.ballbar.angles, own.ballbar.steps)
        logs = replace(logs, ballbar=replace(logs.ballbar, t=t, angles=angles))
    return logs


def _samples(cell: Cell, fitted: RecordingFit, logs: Logs, seconds: float) -> Samples | None:
    """The rows of the last seconds as samples; None where there are too few."""
    own, clock = fitted.samples, fitted.clock
    last = float(logs.robot.t[-1])
    behind = logs.ballbar or logs.length
    if behind is not None:
        last = min(float(behind.t[-1]), clock.ballbar_time(last))
    part = part_of(logs, clock, last - seconds - MARGIN, last + MARGIN)
    robot = part.robot
    log: RobotLog | BallBarLog | LengthLog = robot
    sensed = robot.q
    if part.ballbar is not None:
        log, sensed = part.ballbar, part.ballbar.angles
    elif part.length is not None:  # beyond the rod's nominal length, as in recording_fit
        log, sensed = part.length, part.length.length[:, None] - cell.ballbar.length
    if min(robot.t.size, log.t.size) < FEWEST:
        return None
    exact, second = interpolating_log(robot.t, robot.q, own.robot.noise), None
    inside = (log.t >= last - seconds) & (log.t <= last)
    if own.ballbar is not None:
        second = interpolating_log(log.t, sensed, own.ballbar.noise)
        at = clock.robot_time(log.t)
        inside &= (at >= exact.start) & (at <= exact.end)
    times = log.t[inside]
    if times.size < FEWEST:
        return None
    times = times[:: 1 + times.size // MOST]
    period = float(log.t[1] - log.t[0])
    return samples_of(exact, second, own.encoders, own.directions, times, spacing=period)


def _uncertainty(fit: Fit, linear: NormalEquations) -> Array:
    """(N,) trace(J C J') of each row."""
    out = np.empty(linear.residuals[0].shape[1])
    rows = tuple(point.recording for point in linear.evaluations)
    for block in jacobian(replace(fit.model, recordings=rows), linear, 0):
        covariance = fit.covariance[np.ix_(block.index, block.index)]
        out[block.samples] = np.einsum(
            "pen,pq,qen->n", block.values, covariance, block.values, optimize=True
        )
    return out


def _largest_left(fitted: RecordingFit, rows: Samples) -> float:
    """Largest mean square of a sample's residuals, in units of the noise of a row."""
    (residual,), own = fitted.fit.linear.residuals, fitted.samples
    still = rows.joint_noise == 0.0  # an axis that is logged as zero throughout
    noise = [np.where(still, 1.0, own.joint_noise / np.where(still, 1.0, rows.joint_noise))]
    if own.encoders:
        noise.append(own.encoder_noise[rows.encoder_noise > 0.0] / rows.encoder_noise.max())
    beyond = float((residual * residual).mean(axis=0).max()) - 1.0
    return 1.0 + max(0.0, beyond) * float(max(part.max() for part in noise)) ** 2


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows of a stretch from the first that is off, under hypotheses on their channels."""

    cell: Cell
    fitted: RecordingFit
    linear: NormalEquations
    begin: int

    @property
    def samples(self) -> Samples:
        return self.linear.evaluations[0].recording

    @property
    def times(self) -> Array:
        return self.samples.times[self.begin :]

    def joints(self, late: Array | float = 0.0) -> Array:
        """(N, J) [rad] logged so many seconds (N,) later than the clock says."""
        at = self.fitted.clock.robot_time(self.times) + late
        return np.asarray(self.samples.robot.spline(at))

    def readings(self) -> Array:
        """(N, E) [rad] of the encoders, in their own directions."""
        bar = self.samples.ballbar
        none = np.zeros((self.times.size, 0))
        return none if bar is None else np.asarray(bar.spline(self.times)) * self.samples.directions

    def residual(self, q: Array, readings: Array) -> Array:
        """(E, N) whitened, at joint angles (N, J) and readings (N, E) [rad]."""
        geometry = self.fitted.geometry
        b = complete_bar_angles(geometry, q, readings, self.samples.encoders)
        weights = self.linear.weights[0].part(slice(self.begin, None))
        return weights(close_loop(geometry, q, b).error)

    def columns(self) -> tuple[Array, Array]:
        """(J, E, N) and (5, E, N) whitened change per radian of each joint of robot and bar."""
        point, weights = self.linear.evaluations[0], self.linear.weights[0]
        every = weights(point.columns)[..., self.begin :]
        return every[GEAR:BAR], every[BAR : BAR + 5]


def _cause(rows: _Rows) -> str:
    """The hypothesis that explains the rows best; empty where none does."""
    q, readings = rows.joints(), rows.readings()
    if still := _still(q, readings):
        return still
    every = dict(_other_columns(rows, q, readings))
    if len(rows.linear.residuals[0]) >= EQUATIONS:
        every |= _free_channels(rows, q, readings)
    best = min(every, key=every.__getitem__)
    return best if every[best] < EXPLAINS * rms(rows.residual(q, readings)) else ""


def _still(q: Array, readings: Array) -> str:
    """A log that repeats its values while the other moves, as a sentence; empty for none."""
    if readings.shape[1] < 2:
        return ""
    late = slice(len(q) // 2, None)  # the spline rings where a log stops
    robot, bar = np.ptp(q[late], axis=0).max(), np.ptp(readings[late], axis=0).max()
    if max(robot, bar) < MOVES or min(robot, bar) > FROZEN * max(robot, bar):
        return ""
    frozen, moving = ("robot", "ball-bar") if robot < bar else ("ball-bar", "robot")
    return f"the log of the {frozen} stands still while the {moving} moves"


def _other_columns(rows: _Rows, q: Array, readings: Array) -> Iterator[tuple[str, float]]:
    """Two encoders exchanged, or another mistake in the robot's log, and the rms that each leaves.

    The declared directions of encoders stay with the columns.
    """
    names, signs = rows.samples.encoders, rows.samples.directions
    for i, j in combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[i, j]] = j, i
        turned = (readings * signs)[:, order] * signs
        yield f"encoders b{names[i]} and b{names[j]} are exchanged", rms(rows.residual(q, turned))
    for mistake in other_angles(rows.cell.robot):
        yield mistake.cause, rms(rows.residual(mistake.joints(q), readings))


def _free_channels(rows: _Rows, q: Array, readings: Array) -> Iterator[tuple[str, float]]:
    """One channel, or the clock, off by any amount at each row, and the rms that it leaves."""
    of_robot, of_bar = rows.columns()
    encoders = np.eye(readings.shape[1])
    channels = [
        (name, along, np.zeros(len(encoders)), np.einsum("j,jen->en", along, of_robot), q @ unit)
        for name, along, unit in _robot_channels(rows.cell)
    ]
    channels += [
        (f"encoder b{joint}", np.zeros(q.shape[1]), encoders[k], of_bar[joint - 1], logged)
        for k, (joint, logged) in enumerate(zip(rows.samples.encoders, readings.T, strict=True))
    ]
    for name, of_q, of_readings, column, logged in channels:

        def without(off: Array, of_q: Array = of_q, of_readings: Array = of_readings) -> Array:
            each = off[:, None]
            return rows.residual(q - each * of_q, readings - each * of_readings)

        amount, left = _freed(column, without)
        yield f"{name} {_manner(logged, amount)}", left
    if rows.samples.has_clock:
        speed = np.asarray(rows.samples.robot.speed(rows.fitted.clock.robot_time(rows.times)))
        column = np.einsum("nj,jen->en", speed, of_robot)
        amount, left = _freed(column, lambda late: rows.residual(rows.joints(-late), readings))
        jump = significant_text(float(np.median(amount)) * 1e3, sign=True)
        yield f"a clock jumped by {jump} ms", left


def _freed(column: Array, residual_without: Callable[[Array], Array]) -> tuple[Array, float]:
    """(N,) amount by which a channel is off at each row, and the rms residual without it.

    column : (E, N) whitened change per unit. residual_without : (E, N) with an amount taken out.
    """
    amount, size = np.zeros(column.shape[1]), np.maximum((column * column).sum(axis=0), 1e-30)
    for _ in range(STEPS):
        amount = amount + (column * residual_without(amount)).sum(axis=0) / size
    freedom = np.sqrt(len(column) / (len(column) - 1.0))
    return amount, float(freedom * rms(residual_without(amount)))


def _robot_channels(cell: Cell) -> Iterator[tuple[str, Array, Array]]:
    """Name, (J,) joints per radian of it and (J,) it per joints, of each motor, axis and joint."""
    tried: list[Array] = []
    for kind, (to_joint, _) in angle_kinds(cell.robot).items():
        inverse: Array = np.linalg.inv(to_joint).astype(np.float64)
        for k, direction in enumerate(to_joint):
            unit: Array = direction / float(np.linalg.norm(direction))
            if not any(abs(unit @ other) > 1.0 - 1e-9 for other in tried):
                tried.append(unit)
                yield f"{kind} {k + 1}", direction, np.asarray(inverse[:, k])


def _manner(logged: Array, amount: Array) -> str:
    """A phrase for the error of a channel (N,) [rad] that is off by an amount (N,) [rad]."""
    true = logged - amount
    moved, shown = true - true.mean(), logged - logged.mean()
    if np.std(amount) < STRAIGHT * abs(float(np.mean(amount))) or np.ptp(true) < MOVES:
        return f"stepped by {significant_text(float(np.median(amount)) * 1e3, sign=True)} mrad"
    slope = float((moved * shown).sum() / (moved * moved).sum())
    if np.std(shown - slope * moved) > STRAIGHT * np.std(moved):
        return f"is off by up to {significant_text(float(np.abs(amount).max()) * 1e3)} mrad"
    if abs(slope) < STILL:
        return "stands still"
    return "counts backwards" if slope < 0.0 else f"turns {slope:.3g} times as far as it should"

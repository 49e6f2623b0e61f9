"""Steps of a log between two rows: of its clock, or of one channel.

They are found in the log alone, so that alignment and fits start from a continuous one. A clock
that was set leaves an irregular stamp, and the motion goes on smoothly only if time is set back. A
channel that stepped leaves the rows before and behind (ballbar.cell.neighbours) on one cubic and a
step. What is too slow or too small for that is left to the complete model
(ballbar.ident.estimator.step_faults).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import (
    CUBIC,
    LONGEST_BURST,
    NORMAL_MEDIAN,
    SIDE_ROWS,
    STEP,
    Mask,
    Rows,
    damaged_bursts,
    local_fits,
    powers,
    stretches,
    suspects,
)

# [rad] a third of a signal period of 3600 lines; a joint that strikes in its backlash moves by
# less.
SMALLEST_JUMP = 6e-4
SMALLEST_STEP = 2e-3  # [s] half a row of the quicker log
EXPLAINED = 3.0  # times: by so much a step must shrink the spread of the rows beside it
# [s] a cubic bridges anything across a longer gap, so there only CLOSE shows a step.
LONG = 1.0
# Times the noise of all channels: with less left, the motion goes on as if there were no gap. So
# well it does by chance only in a dwell, where the angles say nothing of time.
CLOSE = 10.0
REFINEMENTS = 3  # of a clock step; they converge quadratically


@dataclass(frozen=True)
class LogStep:
    """One step of a log."""

    row: int  # the first one behind
    time: float  # [s] between that row and the one before, on the log's clock without its steps
    channel: int | None  # None for the clock
    size: float  # [rad] or [s]: behind minus before


@dataclass(frozen=True)
class StepFault:
    """One encoder slip or clock step."""

    recording: int  # from 0
    kind: Literal["encoder", "clock"]
    joint: int  # 1..5, of the encoder; 0 for a clock
    time: float  # [s] on the ball-bar's clock
    # [rad] in the joint's direction, or [s] of the ball-bar's clock against the robot's
    size: float
    periods: int = 0  # signal periods of the encoder, where the slip is a whole number of them
    removed: float = 0.0  # [rad] or [s] of the size that was taken out of the log before the fit

    @property
    def sentence(self) -> str:
        """The step fault as a sentence."""
        at = f"at t = {self.time:.2f} s"
        if self.kind == "clock":
            step = f"{self.size * 1e3:+.1f} ms (ball-bar's against robot's)"
            return f"clock step of {step} {at}; repaired. Do not set clocks while recording"
        if self.periods:
            slip = f"{self.periods:+d} signal period{'s' * (abs(self.periods) > 1)}"
            return f"encoder b{self.joint} slipped {slip} {at}; repaired. Check its cable and speed"
        jump = f"{self.size * 1e3:+.3f} mrad"
        return (
            f"encoder b{self.joint} jumped by {jump} {at} (slipping coupling?); repaired. Tighten "
            "its coupling"
        )


def find_steps(
    t: Array, values: Array, starts: Sequence[int] = (), *, checked: bool = False
) -> tuple[LogStep, ...]:
    """The steps of a log in order of time.

    t : (N,) [s]. values : (N, C) [rad].
    starts : rows at which the reader has joined two segments; their stamps may be off and still
        look regular.
    checked : whether damaged values have been left out already.
    """
    period = float(np.median(np.diff(t)))
    damaged = np.zeros(values.shape, dtype=bool) if checked else damaged_bursts(t, values)
    clock_steps = _clock_steps(t, values, damaged, period, starts)
    clock = continuous_clock(t, clock_steps)
    steps: list[tuple[int, int | None, float]] = [(row, None, size) for row, size in clock_steps]
    for channel in range(values.shape[1]):
        rows = np.flatnonzero(~damaged[:, channel])
        jumps = _jumps(clock[rows], values[rows, channel], period)
        steps += [(int(rows[row]), channel, size) for row, size in jumps]
    middle = 0.5 * (clock[1:] + clock[:-1])
    steps.sort(key=lambda step: step[0])
    return tuple(LogStep(row, float(middle[row - 1]), own, size) for row, own, size in steps)


def without_steps(t: Array, values: Array, steps: tuple[LogStep, ...]) -> tuple[Array, Array]:
    """(N,) [s] stamps and (N, C) [rad] values of a log as they would be without its steps.

    t : (N,) [s]. values : (N, C) [rad].
    """
    if not steps:
        return t, values
    values = values.copy()
    for step in steps:
        if step.channel is not None:
            values[step.row :, step.channel] -= step.size
    of_clock = [(step.row, step.size) for step in steps if step.channel is None]
    return continuous_clock(t, of_clock), values


def continuous_clock(t: Array, steps: list[tuple[int, float]]) -> Array:
    """(N,) [s] stamps t (N,) [s] without the steps of the clock.

    steps : first row behind and size [s] of each.
    """
    out = t.copy()
    for row, size in steps:
        out[row:] -= size
    return out


@dataclass(frozen=True, eq=False)
class _Log:
    """The rows of a log among which clock steps are looked for."""

    t: Array  # (N,) [s]
    values: Array  # (N, C) [rad]
    damaged: Mask  # (N, C) values that do not count
    sigma: Array  # (C,) [rad] noise
    period: float  # [s]


def _clock_steps(
    t: Array, values: Array, damaged: Mask, period: float, starts: Sequence[int]
) -> list[tuple[int, float]]:
    """First row behind and size [s] of each step of the clock."""
    irregular = np.flatnonzero(np.abs(np.diff(t) - period) > SMALLEST_STEP) + 1
    irregular = np.union1d(irregular, np.asarray(starts, dtype=np.intp))
    if irregular.size == 0:
        return []
    suspect, sigma = suspects(t, values, sigmas=STEP)
    log = _Log(t, values, damaged, sigma, period)
    steps: list[tuple[int, float]] = []
    for row in irregular:
        noticed = suspect[max(0, row - 2) : row + 2].any() or t[row] - t[row - 1] > LONG
        if noticed and (size := _clock_step(log, int(row))) is not None:
            steps.append((int(row), size))
    return steps


def _clock_step(log: _Log, row: int) -> float | None:
    """[s] by how much the rows behind must be set back for the motion to go on.

    None if no step explains them.
    """
    around = np.arange(max(0, row - SIDE_ROWS - 2), min(log.t.size, row + SIDE_ROWS + 2))
    known = ~log.damaged[around]
    # as if no row were missing or late
    guess = step = float(log.t[row] - log.t[row - 1] - log.period)
    for _ in range(REFINEMENTS):
        after = _misfit(log, around, known, row, step)
        step += after.correction
        # An outlier beside a step is not seen before, since the rows around it agree on nothing.
        usual = max(1.0, float(np.median(after.left[known])) / NORMAL_MEDIAN)
        known = known & (after.left < STEP * usual)
    # Up to a burst of damaged rows may have been left out between the two, and the row behind may
    # be late.
    missing = (guess - step) / log.period
    if not -1.0 <= missing <= LONGEST_BURST + 1.0 or abs(step) < SMALLEST_STEP:
        return None
    after = _misfit(log, around, known, row, step)
    if STEP * after.sigma > SMALLEST_STEP:
        return None
    if guess > LONG:
        return step if after.spread < CLOSE else None
    before = _misfit(log, around, known, row, 0.0).spread
    return step if before > max(STEP, EXPLAINED * after.spread) else None


@dataclass(frozen=True, eq=False)
class _Misfit:
    """Residual of the rows beside a clock step, by one cubic for each channel."""

    left: Array  # (n, C) size in units of the noise
    spread: float  # its rms over the known values
    correction: float  # [s] of the step that would leave least
    sigma: float  # [s] of that correction


def _misfit(log: _Log, around: Rows, known: Mask, row: int, step: float) -> _Misfit:
    """Misfit of the rows `around` (n,) if those from `row` on are set back by a step [s].

    known : (n, C) values that are fitted.
    """
    behind = (around >= row).astype(np.float64)
    t = log.t[around] - step * behind
    x = (t - t.mean()) / (SIDE_ROWS * log.period)
    values = log.values[around].T  # (C, n)
    columns = np.broadcast_to(powers(x, CUBIC)[:, None], (CUBIC, *values.shape))
    fits = local_fits(columns, known.T)
    slopes = fits.coefficients(values)[:, 1:] * np.arange(1, CUBIC) / (SIDE_ROWS * log.period)
    speed = slopes @ powers(x, CUBIC - 1) * behind  # (C, n) [rad/s]
    residual, sigma = fits.residual(values), log.sigma[:, None]
    left = residual * fits.known / sigma
    moved = fits.residual(speed) * fits.known / sigma
    # Behind the step value(t) = P(t - step): more step means less angle.
    energy = float((moved * moved).sum())
    correction = -float((moved * left).sum()) / energy if energy > 0.0 else 0.0
    spread = float(np.sqrt((left * left).sum() / max(1.0, known.sum() - CUBIC * len(values))))
    uncertainty = 1.0 / np.sqrt(energy) if energy > 0.0 else np.inf
    return _Misfit(np.abs(residual / sigma).T, spread, correction, uncertainty)


def _jumps(t: Array, values: Array, period: float) -> list[tuple[int, float]]:
    """First row behind and size [rad] of each step of one channel.

    t : (N,) [s]. values : (N,) [rad].
    """
    where = stretches(t, suspects(t, values[:, None], sigmas=STEP)[0][:, 0], period)
    behind = np.repeat([False, True], SIDE_ROWS)
    before_count, behind_count = (
        where.known[:, ~behind].sum(axis=1),
        where.known[:, behind].sum(axis=1),
    )
    where = where.take((before_count >= CUBIC) & (behind_count >= CUBIC))
    if where.first.size == 0:
        return []
    stretch, real = where.rows()
    rows = np.concatenate((where.beside, stretch), axis=1)
    known = np.concatenate((where.known, np.zeros(stretch.shape, dtype=bool)), axis=1)
    smooth = where.cubic(t, rows, period)
    step = np.broadcast_to(np.append(behind, np.zeros(stretch.shape[1], dtype=bool)), rows.shape)
    plain, stepped = (
        local_fits(smooth, known),
        local_fits(np.concatenate((smooth, step[None])), known),
    )
    without = plain.spread(plain.residual(values[rows]))
    residual = stepped.residual(values[rows])
    spread, size = stepped.spread(residual), stepped.coefficients(values[rows])[:, -1]
    sigma = spread / stepped.triangle[:, -1, -1]  # the last column's own part is not shared
    clear = np.abs(size) > np.maximum(SMALLEST_JUMP, STEP * sigma)
    jumps = []
    for k in np.flatnonzero(clear & (without > EXPLAINED * spread)):
        error = residual[k, where.beside.shape[1] :][real[k]]
        split = _split(np.abs(error), np.abs(error - size[k]))
        jumps.append((int(where.first[k]) + split, float(size[k])))
    return jumps


def _split(before: Array, behind: Array) -> int:
    """How many of the rows of a stretch lie before the step.

    before, behind : (L,) [rad] distance of each row from the motion on either side.
    """
    cost = np.concatenate(([0.0], np.cumsum(before)))
    cost += np.concatenate((np.cumsum(behind[::-1])[::-1], [0.0]))
    return int(cost.argmin())

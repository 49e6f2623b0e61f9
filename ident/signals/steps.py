"""Jumps of a log between two rows: of its clock, or of one channel.

Found in the log alone, so that alignment and fits start from a continuous one. A clock that was set leaves an irregular
stamp, and the motion goes on smoothly only if time is set back. A channel that jumped leaves sound rows before and behind
(ident.signals.outliers) on one cubic and a step. What is too slow or too small for that is left to the complete model (ident.estimator.events).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from ident.signals.outliers import (
    CUBIC,
    FAR_OUT,
    NORMAL_MEDIAN,
    SIDE_ROWS,
    Stretches,
    least_squares,
    outliers,
    powers,
    stretches,
    suspects,
)

SMALLEST_JUMP = 6e-4  # [rad] a third of a signal period of 3600 lines; a joint that strikes in its play moves by less
SMALLEST_STEP = 2e-3  # [s] half a row of the quicker log
EXPLAINED = 3.0  # times: by so much a jump must shrink the spread of the rows beside it
LONG = 1.0  # [s] a cubic bridges anything across a longer gap, so only that the motion goes on as if there were none tells of a step
CLOSE = 10.0  # times the noise of all channels: so well it does by chance only at standstill, which tells nothing of time
REFINEMENTS = 3  # of a clock step; they converge quadratically


@dataclass(frozen=True)
class Break:
    """One jump."""

    row: int  # the first one behind
    time: float  # [s] between that row and the one before, on the log's clock without its steps
    channel: int | None  # None for the clock
    size: float  # [rad] or [s]: behind minus before


def find_breaks(t: Array, values: Array, starts: Sequence[int] = ()) -> tuple[Break, ...]:
    """The jumps of a log with rows t (N,) [s], values (N, C) [rad], in order of time.

    starts : rows at which the reader has joined two segments, whose stamps may be off though they look regular.
    """
    period = float(np.median(np.diff(t)))
    out = outliers(t, values)
    steps = _clock_steps(t, values, out, period, starts)
    clock = continuous_clock(t, steps)
    found = [(row, None, size) for row, size in steps] + _channel_jumps(clock, values, out, period)
    middle = 0.5 * (clock[1:] + clock[:-1])
    return tuple(
        Break(row, float(middle[row - 1]), channel, size)
        for row, channel, size in sorted(found, key=lambda one: one[0])
    )


def without_breaks(t: Array, values: Array, breaks: tuple[Break, ...]) -> tuple[Array, Array]:
    """Stamps (N,) [s] and values (N, C) [rad] of the log as they would be had nothing jumped."""
    if not breaks:
        return t, values
    values = values.copy()
    for one in breaks:
        if one.channel is not None:
            values[one.row :, one.channel] -= one.size
    return continuous_clock(
        t, [(one.row, one.size) for one in breaks if one.channel is None]
    ), values


def continuous_clock(t: Array, steps: list[tuple[int, float]]) -> Array:
    """(N,) [s] stamps (N,) without the clock's steps: (first row behind, size [s]) each."""
    out = t.copy()
    for row, size in steps:
        out[row:] -= size
    return out


def _clock_steps(
    t: Array, values: Array, out: NDArray[np.bool_], period: float, starts: Sequence[int]
) -> list[tuple[int, float]]:
    """First row behind and size [s] of each step of the clock; out (N, C) values that must not speak."""
    irregular = np.union1d(
        np.flatnonzero(np.abs(np.diff(t) - period) > SMALLEST_STEP) + 1,
        np.asarray(starts, dtype=np.intp),
    )
    if irregular.size == 0:
        return []
    suspect, sigma = suspects(t, values)
    steps: list[tuple[int, float]] = []
    for row in irregular:
        noticed = suspect[max(0, row - 2) : row + 2].any() or t[row] - t[row - 1] > LONG
        if noticed and (size := _clock_step(t, values, out, sigma, int(row), period)) is not None:
            steps.append((int(row), size))
    return steps


def _clock_step(
    t: Array, values: Array, out: NDArray[np.bool_], sigma: Array, row: int, period: float
) -> float | None:
    """[s] by how much the rows behind must be set back for the motion to go on; None if that does not explain them."""
    beside = slice(max(0, row - SIDE_ROWS - 2), min(t.size, row + SIDE_ROWS + 2))
    behind = (np.arange(t.size)[beside] >= row).astype(np.float64)
    stamps, angles, sound = t[beside], values[beside], ~out[beside]
    guess = step = float(t[row] - t[row - 1] - period)  # as though no row were missing or late
    for _ in range(REFINEMENTS):
        after = _misfit(stamps, angles, sound, sigma, behind, period, step)
        step += after.correction
        # an outlier beside a step is not seen before, since the rows around it agree on nothing
        sound = sound & (
            after.left < FAR_OUT * max(1.0, float(np.median(after.left[sound])) / NORMAL_MEDIAN)
        )
    if abs(step - guess) > period or abs(step) < SMALLEST_STEP:
        return None
    after = _misfit(stamps, angles, sound, sigma, behind, period, step)
    if FAR_OUT * after.sigma > SMALLEST_STEP:
        return None
    if guess > LONG:
        return step if after.spread < CLOSE else None
    before = _misfit(stamps, angles, sound, sigma, behind, period, 0.0).spread
    return step if before > max(FAR_OUT, EXPLAINED * after.spread) else None


@dataclass(frozen=True)
class _Misfit:
    """What one cubic a channel leaves of the rows beside a clock step."""

    left: Array  # (n, C) size in units of the noise
    spread: float  # its rms where sound
    correction: float  # [s] of the step that would leave least
    sigma: float  # [s] of that correction


def _misfit(
    t: Array,
    values: Array,
    sound: NDArray[np.bool_],
    sigma: Array,
    behind: Array,
    period: float,
    step: float,
) -> _Misfit:
    """Of some rows, those `behind` set back by a step [s]."""
    t = t - step * behind
    x = (t - t.mean()) / (SIDE_ROWS * period)
    basis = powers(x, CUBIC) * sound.T[:, :, None]
    known = values.T * sound.T
    coefficients, inverse = least_squares(basis, known)
    slopes = coefficients[:, 1:] * np.arange(1, CUBIC) / (SIDE_ROWS * period)
    speed = np.einsum("zk,rk->zr", slopes, powers(x, CUBIC - 1)) * behind * sound.T
    left = (known - np.einsum("zrk,zk->zr", basis, coefficients)) / sigma[:, None]
    moved = (speed - np.einsum("zrk,zkl,zsl,zs->zr", basis, inverse, basis, speed)) / sigma[:, None]
    # the angle behind is that of an earlier time: value(t) = P(t - step), so more step means less angle
    energy = float((moved * moved).sum())
    correction = -float((moved * left).sum()) / energy if energy > 0.0 else 0.0
    spread = float(np.sqrt((left * left).sum() / max(1.0, sound.sum() - CUBIC * sigma.size)))
    everywhere = np.abs(values - powers(x, CUBIC) @ coefficients.T) / sigma
    return _Misfit(
        everywhere, spread, correction, 1.0 / np.sqrt(energy) if energy > 0.0 else np.inf
    )


def _channel_jumps(
    t: Array, values: Array, out: NDArray[np.bool_], period: float
) -> list[tuple[int, int | None, float]]:
    """First row behind, channel and size [rad] of each jump of one channel; out (N, C) values that must not speak."""
    jumps: list[tuple[int, int | None, float]] = []
    for channel in range(values.shape[1]):
        rows = np.flatnonzero(~out[:, channel])
        jumps += [
            (int(rows[row]), channel, size)
            for row, size in _jumps(t[rows], values[rows, channel], period)
        ]
    return jumps


def _jumps(t: Array, values: Array, period: float) -> list[tuple[int, float]]:
    """First row behind and size [rad] of each jump of one channel (N,)."""
    suspect, _ = suspects(t, values[:, None])
    where = stretches(t, suspect[:, 0], period)
    behind = np.repeat([False, True], SIDE_ROWS)
    enough = (where.counts[:, ~behind].sum(axis=1) >= CUBIC) & (
        where.counts[:, behind].sum(axis=1) >= CUBIC
    )
    where = where.take(enough)
    if where.first.size == 0:
        return []
    smooth = powers(where.clock(t, where.beside, period), CUBIC)
    stepped = np.concatenate(
        (smooth, np.broadcast_to(behind[:, None], (*smooth.shape[:2], 1))), axis=2
    )
    without, _, _ = _spread(smooth, values, where)
    spread, coefficients, inverse = _spread(stepped, values, where)
    size = coefficients[:, -1]
    clear = np.abs(size) > np.maximum(SMALLEST_JUMP, FAR_OUT * spread * np.sqrt(inverse[:, -1, -1]))
    jumps = []
    for k in np.flatnonzero(clear & (without > EXPLAINED * spread)):
        rows = np.arange(where.first[k], where.last[k] + 1)
        x = where.take(np.array([k])).clock(t, rows[None], period)[0]
        error = values[rows] - powers(x, CUBIC) @ coefficients[k, :-1]
        jumps.append(
            (int(rows[0]) + _split(np.abs(error), np.abs(error - size[k])), float(size[k]))
        )
    return jumps


def _spread(basis: Array, column: Array, where: Stretches) -> tuple[Array, Array, Array]:
    """(Z,) [rad] rms of the sound rows beside each stretch about their fit; coefficients (Z, k) and inverse normal matrix (Z, k, k)."""
    basis, known = basis * where.counts[:, :, None], column[where.beside] * where.counts
    coefficients, inverse = least_squares(basis, known)
    left = known - np.einsum("zrk,zk->zr", basis, coefficients)
    degrees = np.maximum(1, where.counts.sum(axis=1) - basis.shape[2])
    return np.sqrt((left * left).sum(axis=1) / degrees), coefficients, inverse


def _split(before: Array, behind: Array) -> int:
    """How many of the rows of a stretch lie before the jump, from how far each is from either side's motion."""
    cost = np.concatenate(([0.0], np.cumsum(before))) + np.concatenate(
        (np.cumsum(behind[::-1])[::-1], [0.0])
    )
    return int(cost.argmin())

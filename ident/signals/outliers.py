"""Rows of a log that no motion explains, judged by their neighbours, before a spline could bend towards them.

A value is suspect that stands off the cubic through its two neighbours on either side. A burst shows at its edges, so what
lies between two close suspects is suspect with them and cannot vouch for itself. Each suspect stretch is then judged by a
cubic through the sound rows on both sides of it. Where these do not lie on one cubic themselves - a kink in the motion, a
jump of the encoder or of the clock - their spread says so, and nothing is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array

SMALLEST = 5e-5  # [rad] what deviates by less may stay: it is within a few times the noise of every sensor of the cell
FAR_OUT = 5.0  # standard deviations: of a million values of white noise 0.6 are further out
LONGEST_BURST = 5  # rows; what lasts longer is no outlier but something that happened
SIDE_ROWS = 8  # sound rows on either side that judge a stretch
REACH = 3  # times as many row periods: sound rows further away do not count
LOCAL_ROWS = 24  # on either side: a quick motion spreads all values there
NOTABLE = (
    4.0  # standard deviations of the values around, for a suspect that the log as a whole makes one
)
NORMAL_MEDIAN = 0.6745  # median of |x| over its standard deviation, for normal x
CUBIC = 4  # coefficients of a cubic


@dataclass(frozen=True, eq=False)
class Stretches:
    """Suspect stretches of one channel, and the rows beside them that are not."""

    first: NDArray[np.intp]  # (Z,) row
    last: NDArray[np.intp]  # (Z,) row, in it
    beside: NDArray[np.intp]  # (Z, 2 SIDE_ROWS) rows, the earlier half before the stretch
    counts: NDArray[np.bool_]  # (Z, 2 SIDE_ROWS) whether that row is there and near enough

    def take(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Stretches:
        """Some of the stretches."""
        return Stretches(
            self.first[which], self.last[which], self.beside[which], self.counts[which]
        )

    def clock(self, t: Array, rows: NDArray[np.intp], period: float) -> Array:
        """Times of rows (Z, n), counted from the middle of each stretch in units that keep cubics well conditioned."""
        middle = 0.5 * (t[self.first] + t[self.last])
        return np.asarray((t[rows] - middle[:, None]) / (SIDE_ROWS * period))


def prediction_errors(t: Array, values: Array) -> Array:
    """(N, C) [rad] values less the cubic through two neighbours on either side, scaled to the noise of one value.

    The two rows at either end have no such neighbours and get 0.
    """
    out = np.zeros(values.shape)
    inner, neighbours = slice(2, -2), (0, 1, 3, 4)
    times = [t[k : t.size - 4 + k] for k in range(5)]
    error, power = values[inner].copy(), np.ones(t.size - 4)
    for k in neighbours:
        weight = np.ones(t.size - 4)
        for other in neighbours:
            if other != k:
                weight *= (times[2] - times[other]) / (times[k] - times[other])
        error -= weight[:, None] * values[k : t.size - 4 + k]
        power += weight * weight
    out[inner] = error / np.sqrt(power)[:, None]
    return out


def robust_sigma(values: Array) -> Array:
    """(C,) standard deviation of most of the values (N, C), whatever a few of them are."""
    return np.asarray(np.median(np.abs(values), axis=0) / NORMAL_MEDIAN)


def suspects(t: Array, values: Array) -> tuple[NDArray[np.bool_], Array]:
    """Which values (N, C) their neighbours do not predict, bursts closed; and the noise (C,) [rad] of one value."""
    error = np.abs(prediction_errors(t, values))
    sigma = robust_sigma(error)
    found = error > np.maximum(FAR_OUT * sigma, 0.5 * SMALLEST)
    for channel in np.flatnonzero(found.any(axis=0)):
        rows = np.flatnonzero(found[:, channel])
        around = np.clip(rows[:, None] + np.arange(-LOCAL_ROWS, LOCAL_ROWS + 1), 0, t.size - 1)
        local = np.median(error[around, channel], axis=1) / NORMAL_MEDIAN
        rows = rows[error[rows, channel] > NOTABLE * local]
        found[:, channel] = False
        found[rows, channel] = True
        _close(found[:, channel], rows)
    return found, sigma


def _close(found: NDArray[np.bool_], rows: NDArray[np.intp]) -> None:
    """Marks the rows between suspects that a burst may join; in place."""
    for k in np.flatnonzero((np.diff(rows) > 1) & (np.diff(rows) <= LONGEST_BURST + 1)):
        found[rows[k] : rows[k + 1]] = True


def stretches(t: Array, suspect: NDArray[np.bool_], period: float) -> Stretches:
    """The stretches of one channel's suspect rows (N,), with the sound rows beside them."""
    edges = np.diff(suspect.astype(np.int8), prepend=0, append=0)
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    sound = np.flatnonzero(~suspect)
    place = np.searchsorted(sound, first)[:, None] + np.arange(-SIDE_ROWS, SIDE_ROWS)
    there = (place >= 0) & (place < sound.size)
    beside = sound[np.clip(place, 0, sound.size - 1)]
    near = (t[beside] > t[first][:, None] - REACH * SIDE_ROWS * period) & (
        t[beside] < t[last][:, None] + REACH * SIDE_ROWS * period
    )
    return Stretches(first, last, beside, there & near)


def outliers(t: Array, values: Array) -> NDArray[np.bool_]:
    """(N, C) values that are not where the sound rows around them put them; t (N,) [s], values (N, C) [rad]."""
    suspect, _ = suspects(t, values)
    out = np.zeros(values.shape, dtype=bool)
    for channel in np.flatnonzero(suspect.any(axis=0)):
        rows = np.arange(t.size)
        while True:  # what stood in the shadow of a larger one shows once that is left out
            found = _contradicted(t[rows], values[rows, channel])
            if not found.any():
                break
            out[rows[found], channel] = True
            rows = rows[~found]
    return out


def _contradicted(t: Array, values: Array) -> NDArray[np.bool_]:
    """(N,) of one channel, the suspects that the rows beside them contradict."""
    suspect, sigma = suspects(t, values[:, None])
    period = float(np.median(np.diff(t)))
    out = np.zeros(t.size, dtype=bool)
    where = stretches(t, suspect[:, 0], period)
    where = where.take(where.counts.sum(axis=1) > CUBIC + 1)
    if where.first.size:
        _judge(t, values, where, float(sigma[0]), period, out)
    return out


def _judge(
    t: Array, values: Array, where: Stretches, sigma: float, period: float, out: NDArray[np.bool_]
) -> None:
    """Marks the outliers of one channel; in place."""
    basis = powers(where.clock(t, where.beside, period), CUBIC) * where.counts[:, :, None]
    known = values[where.beside] * where.counts
    coefficients, inverse = least_squares(basis, known)
    left = known - np.einsum("zrk,zk->zr", basis, coefficients)
    spread = np.sqrt((left * left).sum(axis=1) / (where.counts.sum(axis=1) - CUBIC))
    length = int((where.last - where.first).max()) + 1
    rows = where.first[:, None] + np.arange(length)
    inside = rows <= where.last[:, None]
    rows = np.minimum(rows, t.size - 1)
    here = powers(where.clock(t, rows, period), CUBIC)
    error = np.abs(values[rows] - np.einsum("zrk,zk->zr", here, coefficients))
    deviation = np.maximum(sigma, spread)[:, None] * np.sqrt(
        1.0 + np.einsum("zri,zij,zrj->zr", here, inverse, here)
    )
    out[rows[inside & (error > np.maximum(FAR_OUT * deviation, SMALLEST))]] = True


def powers(x: Array, count: int) -> Array:
    """(..., count) 1, x, x^2, ..."""
    return np.asarray(x[..., None] ** np.arange(count))


def least_squares(basis: Array, values: Array) -> tuple[Array, Array]:
    """Least squares of many small problems: coefficients (Z, k) and inverse normal matrices (Z, k, k) of basis (Z, n, k), values (Z, n)."""
    normal = np.einsum("zri,zrj->zij", basis, basis)
    inverse = np.linalg.pinv(normal, hermitian=True)
    return np.einsum("zij,zrj,zr->zi", inverse, basis, values), inverse

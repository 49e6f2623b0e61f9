"""Local cubics, which distinguish damaged values and steps of a log from motion.

Acquisition looks for damaged values (ballbar.acquisition.faults.damaged_values), identification for
steps of an encoder or a clock (ballbar.ident.signals.steps). Both compare a value with a cubic
through the rows beside it. Rows have times t [s] and values y [rad] with white noise of standard
deviation sigma.

Prediction error. The cubic through rows i-2, i-1, i+1 and i+2 has at t_i the value sum_k w_k y_k,
where w_k = prod_(m != k) (t_i - t_m) / (t_k - t_m) are Lagrange's weights. Its difference to y_i
has the variance sigma^2 (1 + sum_k w_k^2); divided by the root of the bracket it has the noise of
one value. For even rows w = (-1, 4, 4, -1) / 6, and a smooth motion leaves its fourth difference,
which is far below the noise.

Noise. A normal variable x has median |x| = 0.6745 sigma, and a few gross values do not change a
median.

Local fit. Gram and Schmidt make the columns of a small least-squares problem (1, x, x^2, x^3, and a
step where there may be one) orthonormal over the rows that are known: Q. The fit at any row is Q
Q'y, with the variance sigma^2 h and the leverage h = sum_p Q_p^2; a value that is not among the
known ones differs from it with the variance sigma^2 (1 + h). For sigma stands the larger one of the
noise of the log and the spread of the known rows about their own fit: where these lie on no cubic
(a kink or a step of the motion), the spread is wide and nothing is concluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array

Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]

NORMAL_MEDIAN = 0.6745  # median of |x| over its standard deviation, for normal x
CUBIC = 4  # coefficients of a cubic

# Thresholds of damaged values. With them no damaged file of benchmarks.mutated_logs is read
# wrongly in silence, and 5 % damaged rows cost no accuracy (benchmarks.robustness).
SMALLEST = (
    5e-5  # [rad] a smaller deviation is within a few times the noise of every sensor of the cell
)
NOTABLE = 3.5  # sigma: values with a larger prediction error are judged; 0.05 % of white noise
CLEAR = 5.0  # sigma: a value with a larger prediction error may hide another one
DAMAGED = 6.0  # sigma: of a million values of white noise 0.002 deviate by more from their fit
LONGEST_BURST = 5  # rows; a longer disturbance is something that happened, no damaged value

# Thresholds of steps, chosen with benchmarks.robustness.
STEP = 5.0  # sigma: rows at a step have larger prediction errors; 0.6 of a million of white noise
LOCAL = 4.0  # times the noise of LOCAL_ROWS around, so that a quick motion is not all suspect
LOCAL_ROWS = 24  # rows on either side, which a quick motion moves as it does the suspect row
SIDE_ROWS = 8  # known rows on either side of a suspect stretch: twice what a cubic and a step need
REACH = 3  # times SIDE_ROWS row periods: known rows further away do not count


def prediction_error(times: Sequence[Array], values: Sequence[Array]) -> Array:
    """(N, C) [rad] size of the prediction errors of the third of five rows.

    times : five arrays (N,) [s]. values : five arrays (N, C) [rad], of the rows i-2 to i+2.
    """
    x = [times[k] - times[2] for k in range(5)]
    # Across a clock that was set back two stamps may agree.
    with np.errstate(divide="ignore", invalid="ignore"):
        error, power = values[2].copy(order="F"), np.ones(times[2].size)
        for k, a, b, c in ((0, 1, 3, 4), (1, 0, 3, 4), (3, 0, 1, 4), (4, 0, 1, 3)):
            weight = x[a] * x[b] * x[c]
            weight /= (x[a] - x[k]) * (x[b] - x[k]) * (x[c] - x[k])
            error -= weight[:, None] * values[k]
            power += weight * weight
        error /= np.sqrt(power)[:, None]
        return np.abs(error, out=error)


def prediction_errors(t: Array, values: Array, first: int = 2, stop: int | None = None) -> Array:
    """(stop - first, C) [rad] size of the prediction errors of the rows from `first` to `stop`.

    t : (N,) [s]. values : (N, C) [rad]. Default: all rows with two neighbours on either side.
    """
    stop = t.size - 2 if stop is None else stop
    around = [slice(first + k, stop + k) for k in range(-2, 3)]
    return prediction_error([t[rows] for rows in around], [values[rows] for rows in around])


def robust_sigma(values: Array) -> Array:
    """(C,) [rad] standard deviation of most of the values (N, C) [rad], a few gross ones aside."""
    return np.asarray(np.median(np.abs(values), axis=0) / NORMAL_MEDIAN)


def powers(x: Array, count: int) -> Array:
    """(P, ...) powers 1, x, ..., x^(P-1) of a dimensionless x (...), for P = `count`."""
    out = np.ones((count, *x.shape))
    for k in range(1, count):
        np.multiply(out[k - 1], x, out=out[k])
    return out


@dataclass(frozen=True, eq=False)
class LocalFits:
    """Least-squares problems with P columns over R rows each, Z of them."""

    known: Array  # (Z, R) 1 for the rows that are fitted, 0 for those that are predicted
    basis: Array  # (P, Z, R) combinations of the columns, orthonormal over the known rows
    triangle: Array  # (Z, P, P) the columns in this basis, upper triangular
    full: Mask  # (Z,) whether the known rows determine all coefficients

    def residual(self, values: Array) -> Array:
        """(Z, R) [rad] values (Z, R) [rad] less the fit to the known ones of them."""
        return np.asarray(values - np.einsum("pzr,zp->zr", self.basis, self._projected(values)))

    def coefficients(self, values: Array) -> Array:
        """(Z, P) [rad] coefficients for values (Z, R) [rad]; 0 where undetermined."""
        solved = np.linalg.solve(self.triangle, self._projected(values)[..., None])
        return np.asarray(solved[..., 0], dtype=np.float64)

    def spread(self, residual: Array) -> Array:
        """(Z,) [rad] standard deviation of a known value, from the residual (Z, R) [rad]."""
        degrees = np.maximum(1.0, self.known.sum(axis=1) - len(self.basis))
        return np.asarray(np.sqrt((residual * residual * self.known).sum(axis=1) / degrees))

    def deviation(self, sigma: Array) -> Array:
        """(Z, R) [rad] standard deviation of unknown values less the fit.

        sigma : (Z,) [rad] of one value.
        """
        leverage = np.einsum("pzr,pzr->zr", self.basis, self.basis)
        return np.asarray(sigma[:, None] * np.sqrt(1.0 + leverage))

    def _projected(self, values: Array) -> Array:
        return np.asarray(np.einsum("pzr,zr->zp", self.basis, values * self.known))


def local_fits(columns: Array, known: NDArray[np.bool_]) -> LocalFits:
    """Fits of dimensionless columns (P, Z, R) over the rows `known` (Z, R).

    Method: modified Gram-Schmidt.
    """
    weight = known.astype(np.float64)
    basis = np.array(columns, dtype=np.float64)
    triangle = np.zeros((basis.shape[1], len(basis), len(basis)))
    full = np.ones(basis.shape[1], dtype=bool)
    for k in range(len(basis)):
        for j in range(k):
            triangle[:, j, k] = (weight * basis[j] * basis[k]).sum(axis=1)
            basis[k] -= triangle[:, j, k, None] * basis[j]
        norm = np.sqrt((weight * basis[k] * basis[k]).sum(axis=1))
        determined = norm > 1e-9  # else the rows are too few, or their times all but the same
        full &= determined
        triangle[:, k, k] = np.where(determined, norm, 1.0)
        basis[k] *= (determined / triangle[:, k, k])[:, None]
    return LocalFits(weight, basis, triangle, full)


def suspects(t: Array, values: Array, *, sigmas: float) -> tuple[Mask, Array]:
    """(N, C) values that their neighbours do not predict, and (C,) [rad] noise of each channel.

    t : (N,) [s]. values : (N, C) [rad]. sigmas : DAMAGED or STEP.
    A burst of damaged values shows at its edges, so rows between close suspects are suspect too.
    """
    error = np.zeros(values.shape)
    error[2:-2] = prediction_errors(t, values)
    sigma = robust_sigma(error)
    out = error > np.maximum(sigmas * sigma, 0.5 * SMALLEST)
    for channel in np.flatnonzero(out.any(axis=0)):
        rows = np.flatnonzero(out[:, channel])
        around = np.clip(rows[:, None] + np.arange(-LOCAL_ROWS, LOCAL_ROWS + 1), 0, t.size - 1)
        rows = rows[error[rows, channel] > LOCAL * robust_sigma(error[around, channel].T)]
        out[:, channel] = False
        out[rows, channel] = True
        for k in np.flatnonzero(np.diff(rows) <= LONGEST_BURST + 1):
            out[rows[k] : rows[k + 1], channel] = True
    return out, sigma


@dataclass(frozen=True, eq=False)
class Stretches:
    """Suspect stretches of one channel, and the known rows beside them."""

    first: Rows  # (Z,) row
    last: Rows  # (Z,) row, in it
    beside: Rows  # (Z, 2 SIDE_ROWS) rows, the earlier half before the stretch
    known: Mask  # (Z, 2 SIDE_ROWS) whether that row exists and is close enough

    def take(self, which: NDArray[np.bool_] | Rows) -> Stretches:
        """The stretches that a mask (Z,) or indices select."""
        return Stretches(self.first[which], self.last[which], self.beside[which], self.known[which])

    def rows(self) -> tuple[Rows, Mask]:
        """(Z, L) rows of the stretches, padded to the longest one, and which are no padding."""
        rows = self.first[:, None] + np.arange(int((self.last - self.first).max()) + 1)
        return np.minimum(rows, self.last[:, None]), rows <= self.last[:, None]

    def cubic(self, t: Array, rows: Rows, period: float) -> Array:
        """(CUBIC, Z, R) powers of the time of rows (Z, R) from the middle of each stretch.

        t : (N,) [s]. period : [s] of the rows; the unit of time keeps the powers near 1.
        """
        middle = 0.5 * (t[self.first] + t[self.last])
        return powers((t[rows] - middle[:, None]) / (SIDE_ROWS * period), CUBIC)


def stretches(t: Array, suspect: Mask, period: float) -> Stretches:
    """The stretches of suspect rows (N,) of one channel; t (N,) [s], period [s] of the rows."""
    edges = np.diff(suspect.astype(np.int8), prepend=0, append=0)
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    others = np.flatnonzero(~suspect)
    index = np.searchsorted(others, first)[:, None] + np.arange(-SIDE_ROWS, SIDE_ROWS)
    exists = (index >= 0) & (index < others.size)
    beside = others[np.clip(index, 0, others.size - 1)]
    reach = REACH * SIDE_ROWS * period
    close = (t[beside] > t[first][:, None] - reach) & (t[beside] < t[last][:, None] + reach)
    return Stretches(first, last, beside, exists & close)


def damaged_bursts(t: Array, values: Array) -> Mask:
    """(N, C) single values and bursts that the rows on both sides of them contradict.

    t : (N,) [s]. values : (N, C) [rad].
    A value in the shadow of a larger one is found once that is left out, hence the repetition.
    """
    out = np.zeros(values.shape, dtype=bool)
    suspect = suspects(t, values, sigmas=DAMAGED)[0]
    for channel in np.flatnonzero(suspect.any(axis=0)):
        rows = np.arange(t.size)
        while (damaged := _contradicted(t[rows], values[rows, channel])).any():
            out[rows[damaged], channel] = True
            rows = rows[~damaged]
    return out


def _contradicted(t: Array, values: Array) -> Mask:
    """(N,) suspect values of one channel that the rows beside them contradict.

    t : (N,) [s]. values : (N,) [rad].
    """
    out = np.zeros(t.size, dtype=bool)
    suspect, sigma = suspects(t, values[:, None], sigmas=DAMAGED)
    period = float(np.median(np.diff(t)))
    where = stretches(t, suspect[:, 0], period)
    where = where.take(where.known.sum(axis=1) > CUBIC + 1)
    if not where.first.size:
        return out
    inside, real = where.rows()
    rows = np.concatenate((where.beside, inside), axis=1)
    known = np.concatenate((where.known, np.zeros(real.shape, dtype=bool)), axis=1)
    fits = local_fits(where.cubic(t, rows, period), known)
    residual = fits.residual(values[rows])
    deviation = fits.deviation(np.maximum(sigma[0], fits.spread(residual)))
    off = np.abs(residual) > np.maximum(DAMAGED * deviation, SMALLEST)
    out[inside[real & off[:, where.beside.shape[1] :]]] = True
    return out

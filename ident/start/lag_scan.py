"""All clock offsets at once: encoder pairs against directions that the robot's pose gives.

Two encoders of a gimbal hold one direction, free of branches: with `theta = s e + z` (direction s,
reading e, encoder offset z)

    u_x + i u_y = -sin(e2 + z2) exp(i (s1 e1 + z1)),      u_z = cos(e2 + z2)

for the rod's direction u in the base (b1, b2), and the same form for (-v_x, v_y, v_z) with v the
rod's direction in the tool frame (b5, b4). For a fixed z2 the best z1 is the argument of a
correlation, and the correlations of all lags come out of a few FFTs. So encoder direction, both
encoder offsets and the clock offset follow from one search, without inverse kinematics, unwrapping
or a guess. The directions of b2 and b4 are unobservable (they change with the configuration) and
stay as declared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from ballbar.cell.arrays import Array

# [rad] error of a direction that an uncalibrated robot gives; the floor of all variances below
DIRECTION_SIGMA = 3e-3
OFFSETS = 90  # grid of z2 over the full turn; maxima are refined by a parabola
MIN_OVERLAP = 10.0  # [s]
WITHIN = 9.0  # local maxima whose variance is within this factor of the best are kept as branches


@dataclass(frozen=True, eq=False)
class Pair:
    """Readings of one gimbal and the direction it should hold, on even steps of their clocks."""

    turning: Array  # (Nb,) [rad] readings of b1 (or b5)
    tilting: Array  # (Nb,) [rad] readings of b2 (or b4)
    direction: Array  # (Nr, 3) unit vectors from the robot


@dataclass(frozen=True)
class OffsetBranch:
    """One way to read a pair: sign and offsets, and what it leaves unexplained."""

    sign: int  # of the turning encoder
    turning_offset: float  # [rad]
    tilting_offset: float  # [rad]
    variance: float  # [1] mean square error of the direction


@dataclass(frozen=True, eq=False)
class LagScan:
    """Score of every lag; `t_robot = lag * step + t_bar` on the two uniform grids."""

    lags: NDArray[np.intp]  # (L,)
    score: Array  # (L,) likelihood gain over a direction that stands still
    overlap: NDArray[np.intp]  # (L,) samples


@dataclass(frozen=True, eq=False)
class _Correlation:
    """A1, A2 (complex) and B1, B2 of one sign of one pair, over all lags."""

    a1: NDArray[np.complex128]
    a2: NDArray[np.complex128]
    b1: Array
    b2: Array

    def at(self, index: int) -> _Correlation:
        sample = slice(index, index + 1)
        return _Correlation(self.a1[sample], self.a2[sample], self.b1[sample], self.b2[sample])

    def gain(self, offset: float | Array) -> Array:
        c, s = np.cos(offset), np.sin(offset)
        return np.asarray(np.abs(c * self.a1 + s * self.a2) + c * self.b1 - s * self.b2)


class PairScan:
    """Correlations of one pair over all lags, for both signs of the turning encoder."""

    def __init__(self, pair: Pair, step: float) -> None:
        n_bar, n_robot = pair.turning.size, pair.direction.shape[0]
        self.lags = np.arange(-(n_bar - 1), n_robot)
        self.overlap = np.minimum(n_robot, self.lags + n_bar) - np.maximum(0, self.lags)
        self.usable = self.overlap * step >= MIN_OVERLAP
        self._correlations = {sign: _correlate(pair, sign) for sign in (1, -1)}
        self.signal = self._signal_variance(pair.direction)

    def _signal_variance(self, direction: Array) -> Array:
        sums = np.concatenate((np.zeros((1, 3)), np.cumsum(direction, axis=0)))
        first, last = np.maximum(0, self.lags), np.maximum(0, self.lags) + self.overlap
        mean = (sums[last] - sums[first]) / self.overlap[:, None]
        return np.asarray(np.maximum(0.0, 1.0 - (mean * mean).sum(axis=1)))

    def residual_variance(self) -> Array:
        """(L,) least variance over sign and offsets, on the grid of z2."""
        best = np.full(self.lags.size, -np.inf)
        for correlation in self._correlations.values():
            for offset in _grid():
                np.maximum(best, correlation.gain(offset), out=best)
        return self._variance(best)

    def _variance(self, gain: Array) -> Array:
        return np.asarray(np.maximum(0.0, 2.0 * (1.0 - gain / self.overlap)))

    def branches(self, index: int) -> list[OffsetBranch]:
        """All readings of the pair at one lag whose variance is near the best, best first."""
        branches = []
        for sign, correlations in self._correlations.items():
            at_lag = correlations.at(index)
            gains = at_lag.gain(_grid())
            for k in np.flatnonzero((gains >= np.roll(gains, 1)) & (gains > np.roll(gains, -1))):
                offset = _peak(at_lag, float(_grid()[k]))
                mean = np.cos(offset) * at_lag.a1 + np.sin(offset) * at_lag.a2
                explained = float(at_lag.gain(offset)[0]) / float(self.overlap[index])
                variance = max(0.0, 2.0 * (1.0 - explained))
                branches.append(OffsetBranch(sign, float(np.angle(mean)[0]), offset, variance))
        branches.sort(key=lambda branch: branch.variance)
        floor = DIRECTION_SIGMA**2
        return [
            b for b in branches if b.variance + floor <= WITHIN * (branches[0].variance + floor)
        ]


def scan_lags(pairs: list[PairScan]) -> LagScan:
    """Score of every lag: overlap times log(signal / residual variance), summed over the pairs."""
    first = pairs[0]
    score = np.zeros(first.lags.size)
    floor = DIRECTION_SIGMA**2
    for pair in pairs:
        score += np.log((pair.signal + floor) / (pair.residual_variance() + floor))
    score *= first.overlap
    score[~first.usable] = -np.inf
    return LagScan(first.lags, score, first.overlap)


def best_lags(scan: LagScan, *, count: int, separation: int) -> list[int]:
    """Indices of the best maxima of the score, at least `separation` lags apart, best first."""
    padded = np.concatenate(([-np.inf], scan.score, [-np.inf]))
    peaks = np.flatnonzero(
        (scan.score >= padded[:-2]) & (scan.score > padded[2:]) & np.isfinite(scan.score)
    )
    chosen: list[int] = []
    for index in peaks[np.argsort(scan.score[peaks])[::-1]]:
        if len(chosen) == count:
            break
        if all(abs(int(index) - other) >= separation for other in chosen):
            chosen.append(int(index))
    return chosen


def subsample(scan: LagScan, index: int) -> float:
    """Lag of a peak with the parabola through its neighbours, in steps."""
    if (
        index == 0
        or index == scan.lags.size - 1
        or not np.isfinite(scan.score[index - 1 : index + 2]).all()
    ):
        return float(scan.lags[index])
    left, centre, right = scan.score[index - 1 : index + 2]
    curvature = left - 2.0 * centre + right
    shift = 0.0 if curvature >= 0.0 else 0.5 * (left - right) / curvature
    return float(scan.lags[index] + np.clip(shift, -0.5, 0.5))


def _grid() -> Array:
    return np.linspace(0.0, 2.0 * np.pi, OFFSETS, endpoint=False)


def _peak(correlation: _Correlation, offset: float) -> float:
    width = 2.0 * np.pi / OFFSETS
    for _ in range(3):
        left, centre, right = correlation.gain(np.array([offset - width, offset, offset + width]))
        curvature = left - 2.0 * centre + right
        if curvature < 0.0:
            offset += width * float(np.clip(0.5 * (left - right) / curvature, -1.0, 1.0))
        width *= 0.2
    return offset


def _correlate(pair: Pair, sign: int) -> _Correlation:
    turn = np.exp(1j * sign * pair.turning)
    sine, cosine = np.sin(pair.tilting), np.cos(pair.tilting)
    ux, uy, uz = pair.direction.T
    model1, model2 = -sine * turn, -cosine * turn
    return _Correlation(
        _complex_lags(model1, ux, uy),
        _complex_lags(model2, ux, uy),
        lag_sums(cosine, uz),
        lag_sums(sine, uz),
    )


def _complex_lags(model: NDArray[np.complex128], x: Array, y: Array) -> NDArray[np.complex128]:
    """Sum over k of conj(model[k]) (x + i y)[k + lag]."""
    real = lag_sums(model.real, x) + lag_sums(model.imag, y)
    return real + 1j * (lag_sums(model.real, y) - lag_sums(model.imag, x))


def lag_sums(model: Array, signal: Array) -> Array:
    """Sum over k of model[k] signal[k + lag], lag from -(len(model) - 1) to len(signal) - 1."""
    full = model.size + signal.size - 1
    size = next_fast_len(full, real=True)
    return np.asarray(irfft(rfft(signal, size) * rfft(model[::-1], size), size)[:full])

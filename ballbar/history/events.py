"""Steps and drifts in a series of estimates, with a controlled rate of false alarms.

A series y (N,) at times t (N,) is a constant, steps that last from a date on, and drifts that begin
at one:

    y_i = c + sum_k s_k [i >= k] + sum_k r_k max(0, t_i - t_k) + e_i

with errors e of stated deviations, fitted by generalised least squares. What all dates share is in
the constant. Events enter one by one, the one with the largest gain in chi-square first; each is
moved to where it explains most beside the others; those below the limit leave again. The limit is
that of a normal deviate which is exceeded with the probability CHANCE in any of all tests
(Bonferroni). Where the series scatters more than stated, its deviations grow by that factor (Birge
1932): that of each estimate about the line through its neighbours, without the largest ones, which
steps and drifts leave as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.least_sizes import LITTLE_RIPPLE, LITTLE_SHIFT
from ballbar.ident.verification import RIVAL

CHANCE = 1e-3  # probability that anything is named in a history in which nothing changed
MOST = 4  # events of one series
MOVES = 5  # rounds of moving the events of a series
SCATTERED = 6  # dates from which the scatter of a series is judged


@dataclass(frozen=True, eq=False, kw_only=True)
class AxisSeries:
    """Estimates of one quantity of one axis at the dates that state it."""

    name: str
    axis: int  # from 1
    kind: str  # "zero", "twist", "backlash", "compliance" or "ripple"
    dates: NDArray[np.intp]  # (N,) indices into the history's dates
    t: Array  # (N,) [months] since the first date of the history
    value: Array  # (N,) [rad], or [rad/(N m)] of a compliance
    sigma: Array  # (N,) without what the results share
    moves: Array  # (3 G,) [m per unit] change of the tool over the workspace, base aligned

    @property
    def effect(self) -> float:
        """[m per unit] mean distance by which the tool moves.

        Of backlash and ripple at least that at a metre from the joint: at rest an unloaded gear
        lies on one flank, and the base takes up what axis 1 turns by.
        """
        at_rest = float(np.linalg.norm(self.moves.reshape(-1, 3), axis=1).mean())
        periodic = self.kind in ("backlash", "ripple")
        return max(at_rest, LITTLE_SHIFT / LITTLE_RIPPLE) if periodic else at_rest


@dataclass(frozen=True, kw_only=True)
class AxisEvent:
    """A step that lasts from a date on, or a drift that begins at one."""

    drift: bool
    at: int  # index into the series: the first date after a step, the last before a drift
    earliest: int  # dates that explain about as well
    latest: int
    size: float  # [unit], or [unit a month]
    sigma: float
    gain: float  # chi-square that it explains beside the others
    either: bool  # the dates do not tell a step from a drift


@dataclass(frozen=True, eq=False, kw_only=True)
class SeriesFit:
    """Constant, steps and drifts of a series."""

    series: AxisSeries
    sigma: Array  # (N,) deviations, scatter included
    events: tuple[AxisEvent, ...]
    fitted: Array  # (N,)
    fitted_sigma: Array  # (N,)
    rate: tuple[float, float]  # [unit a month] drift at the last date, and its deviation


def limit(tests: int) -> float:
    """Deviations that are exceeded with the probability CHANCE in any of so many tests."""
    return -NormalDist().inv_cdf(0.5 * CHANCE / max(tests, 1))


def count_of_tests(series: AxisSeries) -> int:
    """Tests of a series: every event, and every date against the first and the one before it."""
    return len(_candidates(series.t)[0]) + 2 * series.t.size


def scatters(series: Sequence[AxisSeries]) -> list[float]:
    """Factor on the stated deviations of each series, at least 1.

    Its own scatter, or that of most series of its kind where this is larger: a single one may be
    small by chance.
    """
    own = [_scatter(each) for each in series]
    pairs = list(zip(own, series, strict=True))
    kinds = {each.kind for each in series}
    common = {k: float(np.median([s for s, e in pairs if e.kind == k])) for k in kinds}
    return [max(1.0, s, common[each.kind]) for s, each in pairs]


def _scatter(series: AxisSeries) -> float:
    """Scatter of a series over its stated deviations; 1 where it is too short to tell."""
    if series.t.size < SCATTERED:
        return 1.0
    y, t, s = series.value, series.t, series.sigma
    span = t[2:] - t[:-2]
    after = np.where(span > 0.0, (t[1:-1] - t[:-2]) / np.where(span > 0.0, span, 1.0), 0.5)
    apart = y[1:-1] - (1.0 - after) * y[:-2] - after * y[2:]
    square = apart**2 / (s[1:-1] ** 2 + ((1.0 - after) * s[:-2]) ** 2 + (after * s[2:]) ** 2)
    small = np.sort(square)[: square.size - min(2 * MOST, square.size // 3)]
    share, normal = small.size / square.size, NormalDist()
    end = normal.inv_cdf(0.5 + 0.5 * share)  # the small ones of a normal deviate are within
    return float(np.sqrt(small.mean() / (1.0 - 2.0 * end * normal.pdf(end) / share)))


def fit_series(
    series: AxisSeries, scatter: float, least_sigma: float, least_move: float
) -> SeriesFit:
    """The events of a series.

    least_sigma : deviations from which an event is one (`limit`). least_move : [m] of the tool.
    """
    places, columns = _candidates(series.t)
    sigma = scatter * series.sigma
    model = _Model((columns.T / sigma).T, 1.0 / sigma, series.value / sigma)
    chosen = model.chosen(least_sigma**2)
    last = columns[-1] * series.effect
    sizes = model.solution(chosen)[0][1:]
    chosen = [c for c, x in zip(chosen, sizes, strict=True) if abs(x) * last[c] > least_move]
    size, _ = model.solution(chosen)
    # where a drift begins is an unknown, along which it changes by a step
    begins = [
        places.index((at + 1, False)) for at, drift in (places[c] for c in chosen) if drift and at
    ]
    wide = [*chosen, *begins] if len(chosen) + len(begins) < series.t.size else chosen
    _, covariance = model.solution(wide)
    basis = np.column_stack((np.ones_like(sigma), columns[:, wide]))
    deviations = np.sqrt(np.diag(covariance))
    drifts = np.array([0.0, *(float(places[c][1]) for c in chosen)])
    own = covariance[: drifts.size, : drifts.size]
    rate = float(drifts @ size), float(np.sqrt(drifts @ own @ drifts))
    return SeriesFit(
        series=series,
        sigma=sigma,
        events=tuple(
            _event(model, places, chosen, k, (float(size[k + 1]), float(deviations[k + 1])))
            for k in range(len(chosen))
        ),
        fitted=basis[:, : size.size] @ size,
        fitted_sigma=np.sqrt(((basis @ covariance) * basis).sum(axis=1)),
        rate=rate if drifts.any() else model.slope(series.t, chosen),
    )


@dataclass(frozen=True, eq=False)
class _Model:
    """Whitened candidates (N, M), constant (N,) and values (N,) of a series."""

    columns: Array
    constant: Array
    value: Array

    def gains(self, chosen: Sequence[int]) -> Array:
        """(M,) chi-square that each candidate explains beside the chosen ones."""
        basis = np.linalg.qr(np.column_stack((self.constant, self.columns[:, chosen])))[0]
        free = self.columns - basis @ (basis.T @ self.columns)
        square = (free * free).sum(axis=0)
        known = square > 1e-9 * (self.columns**2).sum(axis=0)
        return np.where(known, (free.T @ self.value) ** 2 / np.where(known, square, 1.0), 0.0)

    def chosen(self, least: float) -> list[int]:
        """Candidates that each explain more than `least` beside the others."""
        chosen: list[int] = []
        while len(chosen) < min(MOST, self.value.size - 1):
            gains = self.gains(chosen)
            if gains.max(initial=0.0) <= least:
                break
            chosen.append(int(gains.argmax()))
            for k in [*range(len(chosen))] * MOVES:
                chosen[k] = int(self.gains(chosen[:k] + chosen[k + 1 :]).argmax())
        while chosen:
            alone = [self.gains([c for c in chosen if c != each])[each] for each in chosen]
            if min(alone) > least:
                break
            del chosen[int(np.argmin(alone))]
        return chosen

    def solution(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Constant and sizes (1 + C,), and their covariance."""
        basis = np.column_stack((self.constant, self.columns[:, chosen]))
        covariance = np.asarray(np.linalg.inv(basis.T @ basis))
        return np.asarray(covariance @ (basis.T @ self.value)), covariance

    def slope(self, t: Array, chosen: Sequence[int]) -> tuple[float, float]:
        """Drift over all dates t (N,) beside the chosen steps, and its deviation."""
        steps = chosen if len(chosen) + 2 <= t.size else []
        columns = np.column_stack((t * self.constant, self.columns[:, steps]))
        whole = _Model(columns, self.constant, self.value)
        size, covariance = whole.solution(range(columns.shape[1]))
        return float(size[1]), float(np.sqrt(covariance[1, 1]))


def _candidates(t: Array) -> tuple[list[tuple[int, bool]], Array]:
    """Place of every event and whether it is a drift, and what it does to the series (N, M).

    A drift that begins at the last date but one is a step at the last.
    """
    steps = [k for k in range(1, t.size) if t[k] > t[k - 1]]
    drifts = [k - 1 for k in steps if t[-1] > t[k]]
    columns = [(np.arange(t.size) >= k).astype(float) for k in steps]
    columns += [np.maximum(0.0, t - t[k]) for k in drifts]
    places = [(k, False) for k in steps] + [(k, True) for k in drifts]
    return places, np.reshape(columns, (len(places), t.size)).T


def _event(
    model: _Model,
    places: Sequence[tuple[int, bool]],
    chosen: Sequence[int],
    k: int,
    size: tuple[float, float],
) -> AxisEvent:
    """An event with the dates, and the other kind of event, that explain it about as well."""
    at, drift = places[chosen[k]]
    gains = model.gains([c for c in chosen if c != chosen[k]])
    gain = float(gains[chosen[k]])
    rivals = [place for place, g in zip(places, gains, strict=True) if g > gain - 2.0 * RIVAL]
    same = [place for place, kind in rivals if kind == drift]
    return AxisEvent(
        drift=drift,
        at=at,
        earliest=min(same),
        latest=max(same),
        size=size[0],
        sigma=size[1],
        gain=gain,
        either=len(same) < len(rivals) or (not drift and at == model.value.size - 1),
    )

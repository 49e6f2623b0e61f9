"""Steps and drifts in a series of estimates, with a controlled rate of false alarms.

A series y (N,) at times t (N,) is a constant, steps that last from a date on, and drifts that begin
at one:

    y_i = c + sum_k s_k [i >= k] + sum_k r_k max(0, t_i - t_k) + e_i

with errors e of stated deviations, fitted by generalised least squares. What all dates share is in
the constant. Events enter one by one, the one with the largest gain in chi-square first; each is
moved to where it explains most beside the others; those below the limit leave again. The limit is
that of a normal deviate which is exceeded with the probability CHANCE in any of all tests
(Bonferroni). Where the series scatters more than stated, its deviations grow by that factor (Birge
1932): that of the differences of successive estimates about their median, without the largest ones,
which steps and drifts leave as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.verification import RIVAL

CHANCE = 1e-3  # probability that anything is named in a history in which nothing changed
MOST = 4  # events of one series
ROUNDS = 5  # of moving the events of a series
SCATTERED = 6  # dates from which the scatter of a series is judged


@dataclass(frozen=True, eq=False)
class Series:
    """Estimates of one quantity of one axis at the dates that state it."""

    name: str
    axis: int  # from 1
    kind: str  # "zero", "twist", "backlash", "compliance" or "ripple"
    unit: str  # SI
    dates: Array  # (N,) indices into the history's dates
    t: Array  # (N,) [months] since the first date of the history
    value: Array  # (N,)
    sigma: Array  # (N,) of what the results do not share
    moves: Array  # (3 G,) [m per unit] change of the tool over the workspace, base aligned

    @property
    def effect(self) -> float:
        """[m per unit] mean distance by which the tool moves."""
        return float(np.linalg.norm(self.moves.reshape(-1, 3), axis=1).mean())


@dataclass(frozen=True)
class Event:
    """A step that lasts from a date on, or a drift that begins at one."""

    drift: bool
    at: int  # index into the series: the first date after a step, the last before a drift
    earliest: int  # dates that explain about as well
    latest: int
    size: float  # [unit], or [unit a month]
    sigma: float
    gain: float  # chi-square that it explains beside the others
    either: bool  # the dates do not tell a step from a drift


@dataclass(frozen=True, eq=False)
class SeriesFit:
    """What happened to a series."""

    series: Series
    scatter: float  # factor on the stated deviations
    events: tuple[Event, ...]
    fitted: Array  # (N,)
    fitted_sigma: Array  # (N,)
    rate: tuple[float, float]  # [unit a month] and deviation at the last date, with any drift

    @property
    def sigma(self) -> Array:
        """(N,) deviations, scatter included."""
        return self.scatter * self.series.sigma

    def change(self, first: int, last: int) -> tuple[float, float]:
        """Difference of two estimates of the series, and how many deviations it is."""
        difference = float(self.series.value[last] - self.series.value[first])
        return difference, difference / float(np.hypot(self.sigma[first], self.sigma[last]))


def limit(tests: int) -> float:
    """Deviations that are exceeded with the probability CHANCE in any of so many tests."""
    return -NormalDist().inv_cdf(0.5 * CHANCE / max(tests, 1))


def count_of_tests(series: Series) -> int:
    """Tests that are made of a series: every event, and every date against the first and the last
    before it.
    """
    return len(_candidates(series.t)[0]) + 2 * series.t.size


def scatter_of(series: Series) -> float:
    """Scatter of a series over its stated deviations; 1 where it is too short to tell."""
    if series.t.size < SCATTERED:
        return 1.0
    steps = np.diff(series.value) / np.hypot(series.sigma[1:], series.sigma[:-1])
    square = np.sort((steps - np.median(steps)) ** 2)
    kept = square[: square.size - min(MOST, series.t.size // 4)]
    share = kept.size / square.size
    end = NormalDist().inv_cdf(0.5 + 0.5 * share)  # the kept ones of a normal deviate are within
    return float(np.sqrt(kept.mean() / (1.0 - 2.0 * end * NormalDist().pdf(end) / share)))


def scatters(series: Sequence[Series]) -> list[float]:
    """Factor on the stated deviations of each series, at least 1.

    Its own scatter, or that of most series of its kind where this is larger: a single one may be
    small by chance.
    """
    own = [scatter_of(each) for each in series]
    kinds = {each.kind for each in series}
    common = {
        kind: float(np.median([s for s, e in zip(own, series, strict=True) if e.kind == kind]))
        for kind in kinds
    }
    return [max(1.0, s, common[each.kind]) for s, each in zip(own, series, strict=True)]


def fit_series(series: Series, scatter: float, least_sigma: float, least_move: float) -> SeriesFit:
    """The events of a series.

    least_sigma : deviations from which an event is one (`limit`). least_move : [m] of the tool.
    """
    places, columns = _candidates(series.t)
    weight = 1.0 / (scatter * series.sigma)
    model = _Model(columns * weight[:, None], weight, series.value * weight)
    chosen = model.chosen(least_sigma**2)
    span = [series.t[-1] - series.t[k] if drift else 1.0 for k, drift in places]
    size, _ = model.solution(chosen)
    chosen = [
        c
        for c, x in zip(chosen, size[1:], strict=True)
        if abs(x) * span[c] * series.effect > least_move
    ]
    size, covariance = model.solution(chosen)
    basis = np.column_stack((np.ones_like(weight), columns[:, chosen]))
    return SeriesFit(
        series,
        scatter,
        tuple(
            _event(model, places, chosen, k, (size[k + 1], np.sqrt(covariance[k + 1, k + 1])))
            for k in np.argsort([places[c][0] for c in chosen], kind="stable")
        ),
        basis @ size,
        np.sqrt(np.einsum("ij,jk,ik->i", basis, covariance, basis)),
        _rate(model, series.t, [c for c in chosen if places[c][1]], chosen),
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
            chosen = self._moved([*chosen, int(gains.argmax())])
        while chosen:
            alone = [self.gains([c for c in chosen if c != each])[each] for each in chosen]
            if min(alone) > least:
                break
            del chosen[int(np.argmin(alone))]
        return chosen

    def _moved(self, chosen: list[int]) -> list[int]:
        """The events, each where it explains most beside the others."""
        for _ in range(ROUNDS):
            before = list(chosen)
            for k in range(len(chosen)):
                chosen[k] = int(self.gains(chosen[:k] + chosen[k + 1 :]).argmax())
            if chosen == before:
                break
        return chosen

    def solution(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Constant and sizes (1 + C,), and their covariance."""
        basis = np.column_stack((self.constant, self.columns[:, chosen]))
        covariance = np.linalg.inv(basis.T @ basis)
        return np.asarray(covariance @ (basis.T @ self.value)), np.asarray(covariance)


def _candidates(t: Array) -> tuple[list[tuple[int, bool]], Array]:
    """Place and kind of every event, and what it does to the series (N, M).

    A drift that begins at the last date but one is a step at the last.
    """
    steps = [k for k in range(1, t.size) if t[k] > t[k - 1]]
    drifts = [k for k in range(t.size - 2) if t[k + 1] > t[k] and t[-1] > t[k + 1]]
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
) -> Event:
    """An event with the dates, and the other kind of event, that explain it about as well."""
    at, drift = places[chosen[k]]
    gains = model.gains([c for c in chosen if c != chosen[k]])
    gain = float(gains[chosen[k]])
    rivals = [place for place, g in zip(places, gains, strict=True) if g > gain - 2.0 * RIVAL]
    alike = [place for place, kind in rivals if kind == drift]
    either = len(alike) < len(rivals) or (not drift and at == model.value.size - 1)
    return Event(drift, at, min(alike), max(alike), size[0], size[1], gain, either)


def _rate(
    model: _Model, t: Array, drifts: Sequence[int], chosen: Sequence[int]
) -> tuple[float, float]:
    """Drift at the last date [unit a month] and its deviation.

    Where none of the events is a drift, it is that of one over all dates beside them.
    """
    steps = [c for c in chosen if c not in drifts]
    columns = model.columns[:, [*drifts, *steps]]
    if not drifts:
        over_all = (t * model.constant)[:, None]
        beside = columns if len(chosen) + 2 <= t.size else columns[:, :0]
        columns = np.column_stack((over_all, beside))
    basis = np.column_stack((model.constant, columns))
    covariance = np.linalg.inv(basis.T @ basis)
    share = np.zeros(basis.shape[1])
    share[1 : 1 + max(1, len(drifts))] = 1.0
    size = covariance @ (basis.T @ model.value)
    return float(share @ size), float(np.sqrt(share @ covariance @ share))

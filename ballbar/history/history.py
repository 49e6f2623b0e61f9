"""What happened to a robot over months: what wears, what stepped, and when calibration is due."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.history.events import Event, SeriesFit, count_of_tests, fit_series, limit
from ballbar.history.results import MONTH, DatedResult, dated_results, repetitions, series_of
from ballbar.ident.least_sizes import LITTLE_SHIFT
from ballbar.result.compare import compare

GEAR = ("backlash", "compliance", "ripple")  # kinds that are a gear's alone
HORIZON = 120.0  # [months] beyond which no drift is extrapolated
DRAWS, SEED = 2000, 1  # of the rates


@dataclass(frozen=True, eq=False)
class Finding:
    """Events with one cause."""

    kind: Literal["wear", "collision", "gear", "change"]
    axes: tuple[int, ...]
    begin: date  # the last day on which it was not there yet; of wear, from when on it is seen
    end: date  # the first day on which it was there; of wear, when it began at the latest
    events: tuple[tuple[SeriesFit, Event], ...]


@dataclass(frozen=True, eq=False)
class History:
    """The results of one robot in order of time, and what they say together."""

    results: tuple[DatedResult, ...]
    nominal: Array  # (N,) [m] mean TCP error of the nominal robot against each result
    fits: tuple[SeriesFit, ...]
    limit: float  # deviations beyond which a change is named
    repeated: bool  # whether all results are of one path and one instrument
    findings: tuple[Finding, ...]

    def changes(self, first: int, last: int) -> list[tuple[SeriesFit, float, float]]:
        """Quantities that differ between two results, the difference, and its deviations."""
        changed = []
        for fit in self.fits:
            dates = fit.series.dates.tolist()
            if first in dates and last in dates:
                size, z = fit.change(dates.index(first), dates.index(last))
                if abs(z) > self.limit and abs(size) * fit.series.effect > LITTLE_SHIFT:
                    changed.append((fit, size, z))
        return sorted(changed, key=lambda change: -abs(change[2]))


@dataclass(frozen=True)
class Due:
    """When the mean TCP error of the last calibration reaches a tolerance."""

    tolerance: float  # [m]
    sigma: float  # [m] stated TCP uncertainty of the last calibration
    rates: tuple[float, float]  # [m a month] of the tool over the workspace, 95 % interval
    earliest: date | None  # None: beyond HORIZON
    latest: date | None  # None: where no drift is certain, or beyond HORIZON


def read_history(paths: Sequence[Path]) -> History:
    """The history of one robot from its results, as `dated_results` takes them."""
    results = dated_results(paths)
    return history_of(results, nominal_errors(results))


def nominal_errors(results: Sequence[DatedResult]) -> Array:
    """(N,) [m] mean TCP error of the nominal robot against each result."""
    first = results[0].calibration
    errors = [compare(first, r.calibration).tcp_nominal.mean for r in results]
    return np.array(errors, dtype=np.float64)


def history_of(results: tuple[DatedResult, ...], nominal: Array) -> History:
    """The history of results in order of time.

    nominal : (N,) [m] as `nominal_errors`.
    """
    series = series_of(results)
    least = limit(sum(map(count_of_tests, series)))
    factors = zip(series, scatters(series), strict=True)
    fits = [fit_series(each, factor, least, LITTLE_SHIFT) for each, factor in factors]
    used = [r.calibration for r in results if r.acceptable]
    return History(
        results,
        nominal,
        tuple(fits),
        least,
        bool(used) and repetitions(used),
        tuple(_findings(fits, [r.day for r in results])),
    )


def due(history: History, tolerance: float) -> Due:
    """When the last calibration is due at a tolerance [m] of the mean TCP error.

    Its error is the stated uncertainty and, independent of it, what the axes drifted since. The
    slow end of the rate has the drifts that were named, the fast end all that the results leave
    possible. Steps to come are in neither.
    """
    used = [r for r in history.results if r.acceptable]
    if not used:
        what = "no result is acceptable, so none is in use."
        raise InputError.at("tolerance", what, "Measure again.")
    last = used[-1]
    sigma, rates = last.calibration.tcp_sigma, _rates(history.fits)
    room = np.sqrt(max(0.0, tolerance**2 - sigma**2))
    fast, slow = (room / rate if rate > 0.0 else np.inf for rate in reversed(rates))
    return Due(tolerance, sigma, rates, _after(last.day, fast), _after(last.day, slow))


def _after(day: date, months: float) -> date | None:
    return day + timedelta(days=months * MONTH) if months < HORIZON else None


def _rates(fits: Sequence[SeriesFit]) -> tuple[float, float]:
    """[m a month] mean over the workspace by which the tool drifts, ends of the 95 % interval."""
    if not fits:
        return 0.0, np.inf
    drawn = np.random.default_rng(SEED).standard_normal((DRAWS, len(fits)))
    rate, sigma = np.array([fit.rate for fit in fits]).T
    named = np.array([any(event.drift for event in fit.events) for fit in fits])
    moves = np.stack([fit.series.moves for fit in fits], axis=1)  # (3 G, S)
    quantiles = []
    for share, chosen in ((0.025, named), (0.975, np.ones_like(named))):
        rates = (rate + sigma * drawn)[:, chosen]
        square = np.zeros(DRAWS)
        if chosen.any():
            own = moves[:, chosen]
            square = np.einsum("di,ij,dj->d", rates, own.T @ own, rates) / (len(moves) / 3.0)
        quantiles.append(float(np.sqrt(np.quantile(square, share))))
    return quantiles[0], quantiles[1]


def _findings(fits: Sequence[SeriesFit], days: Sequence[date]) -> Iterator[Finding]:
    """Drifts of each axis, then steps that may be of one day, in order of time."""
    every = [(fit, event) for fit in fits for event in fit.events]
    for axis in sorted({fit.series.axis for fit, event in every if event.drift}):
        own = tuple((f, e) for f, e in every if e.drift and f.series.axis == axis)
        first = min(own, key=lambda pair: pair[0].series.dates[pair[1].at])
        kind: Literal["wear", "change"] = "change" if all(e.either for _, e in own) else "wear"
        span = _days(*first, days)
        yield Finding(kind, (axis,), *span, own)
    groups: list[tuple[date, date, list[tuple[SeriesFit, Event]]]] = []
    steps = [pair for pair in every if not pair[1].drift]
    for fit, event in sorted(steps, key=lambda pair: -pair[1].gain):
        begin, end = _days(fit, event, days)
        for k, (low, high, members) in enumerate(groups):
            if begin < high and low < end:
                groups[k] = max(low, begin), min(high, end), [*members, (fit, event)]
                break
        else:
            groups.append((begin, end, [(fit, event)]))
    for begin, end, members in sorted(groups, key=lambda group: group[:2]):
        yield from _of_one_day(begin, end, members)


def _days(fit: SeriesFit, event: Event, days: Sequence[date]) -> tuple[date, date]:
    """Days between which a step happened, or on which a drift began."""
    dates = fit.series.dates
    early = event.earliest if event.drift else event.earliest - 1
    return days[dates[early]], days[dates[event.latest]]


def _of_one_day(
    begin: date, end: date, members: Sequence[tuple[SeriesFit, Event]]
) -> Iterator[Finding]:
    """Steps of one day: each gear that changed, with its axis, then a collision of the others."""
    gears = sorted({fit.series.axis for fit, _ in members if fit.series.kind in GEAR})
    for axis in gears:
        own = tuple(pair for pair in members if pair[0].series.axis == axis)
        yield Finding(_kind("gear", own), (axis,), begin, end, own)
    rest = tuple(pair for pair in members if pair[0].series.axis not in gears)
    if rest:
        axes = tuple(sorted({fit.series.axis for fit, _ in rest}))
        yield Finding(_kind("collision", rest), axes, begin, end, rest)


def _kind(
    kind: Literal["collision", "gear"], members: Sequence[tuple[SeriesFit, Event]]
) -> Literal["collision", "gear", "change"]:
    return "change" if all(event.either for _, event in members) else kind

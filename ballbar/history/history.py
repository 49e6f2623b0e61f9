"""The history of a robot: what wears, what stepped, and when calibration is due."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.history.events import AxisEvent, SeriesFit, count_of_tests, fit_series, limit, scatters
from ballbar.history.results import MONTH, DatedResult, dated_results, repetitions, series_of
from ballbar.ident.least_sizes import LITTLE_SHIFT
from ballbar.result.compare import compare

GEAR = ("backlash", "compliance", "ripple")  # kinds that are a gear's alone
HORIZON = 120.0  # [months] beyond which no drift is extrapolated
DRAWS, SEED = 2000, 1  # of the rates

Kind = Literal["wear", "collision", "gear", "change"]
Pair = tuple[SeriesFit, AxisEvent]


@dataclass(frozen=True, eq=False)
class AxisFinding:
    """Events with one cause."""

    kind: Kind
    axes: tuple[int, ...]
    begin: date  # the last day on which it was not there yet; of wear, from when on it is seen
    end: date  # the first day on which it was there; of wear, when it began at the latest
    events: tuple[Pair, ...]


@dataclass(frozen=True, eq=False)
class History:
    """The results of one robot in order of time, and what they say together."""

    results: tuple[DatedResult, ...]
    nominal: Array  # (N,) [m] mean TCP error of the nominal robot against each result
    fits: tuple[SeriesFit, ...]
    limit: float  # deviations beyond which a change is named
    repeated: bool  # whether all results are of one path and one instrument
    findings: tuple[AxisFinding, ...]

    def changes(self, first: int, last: int) -> list[tuple[SeriesFit, float, float]]:
        """Quantities that differ between two results, the difference, and its deviations."""
        changed = []
        for fit in self.fits:
            at = [np.flatnonzero(fit.series.dates == k) for k in (first, last)]
            if all(k.size for k in at):
                size = float(fit.series.value[at[1][0]] - fit.series.value[at[0][0]])
                z = size / float(np.hypot(*(fit.sigma[k[0]] for k in at)))
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
    first = results[0].calibration
    errors = [compare(first, r.calibration).tcp_nominal.mean for r in results]
    return history_of(results, np.array(errors))


def history_of(results: tuple[DatedResult, ...], nominal: Array) -> History:
    """The history of results in order of time.

    nominal : (N,) [m] mean TCP error of the nominal robot against each.
    """
    series = series_of(results)
    least = limit(sum(map(count_of_tests, series)))
    factors = zip(series, scatters(series), strict=True)
    fits = tuple(fit_series(each, factor, least, LITTLE_SHIFT) for each, factor in factors)
    repeated = repetitions([r.calibration for r in results if r.acceptable])
    findings = tuple(_findings(fits, [r.day for r in results]))
    return History(results, nominal, fits, least, repeated, findings)


def due(history: History, tolerance: float) -> Due:
    """When the last calibration is due at a tolerance [m] of the mean TCP error.

    Its error is the stated uncertainty and, independent of it, what the axes drifted since. The
    slow end of the rate has the drifts that were named, the fast end all that the results leave
    possible. Steps to come are in neither. Raises InputError where no result is acceptable.
    """
    used = [r for r in history.results if r.acceptable]
    if not used:
        raise InputError.at("results", "none is acceptable, so none is in use.", "Measure again.")
    sigma, slow, fast = used[-1].calibration.tcp_sigma, *_rates(history.fits)
    room = np.sqrt(max(0.0, tolerance**2 - sigma**2))
    months = [room / rate if rate > 0.0 else np.inf for rate in (fast, slow)]
    days = [used[-1].day + timedelta(days=m * MONTH) if m < HORIZON else None for m in months]
    return Due(tolerance, sigma, (slow, fast), days[0], days[1])


def _rates(fits: Sequence[SeriesFit]) -> tuple[float, float]:
    """[m a month] root mean square of the tool's drift over the workspace, ends of the 95 %."""
    if not fits:
        return 0.0, np.inf
    drawn = np.random.default_rng(SEED).standard_normal((DRAWS, len(fits)))
    rate, sigma = np.array([fit.rate for fit in fits]).T
    named = np.array([any(event.drift for event in fit.events) for fit in fits])
    moves = np.stack([fit.series.moves for fit in fits], axis=1)  # (3 G, S)
    square = moves.T @ moves / (len(moves) / 3.0)
    rates = rate + sigma * drawn
    low, high = (np.einsum("di,ij,dj->d", r, square, r) for r in (rates * named, rates))
    return float(np.sqrt(np.quantile(low, 0.025))), float(np.sqrt(np.quantile(high, 0.975)))


def _findings(fits: Sequence[SeriesFit], days: Sequence[date]) -> Iterator[AxisFinding]:
    """Drifts of each axis, then steps that may be of one day, in order of time."""
    every = sorted(((f, e) for f in fits for e in f.events), key=lambda pair: -pair[1].gain)
    for axis in sorted({fit.series.axis for fit, event in every if event.drift}):
        own = tuple((f, e) for f, e in every if e.drift and f.series.axis == axis)
        begin, end = min(_days(*pair, days) for pair in own)
        yield AxisFinding(_kind("wear", own), (axis,), begin, end, own)
    groups: list[tuple[date, date, list[Pair]]] = []
    for pair in (pair for pair in every if not pair[1].drift):
        begin, end = _days(*pair, days)
        for k, (low, high, members) in enumerate(groups):
            if begin < high and low < end:
                groups[k] = max(low, begin), min(high, end), [*members, pair]
                break
        else:
            groups.append((begin, end, [pair]))
    for begin, end, members in sorted(groups, key=lambda group: group[:2]):
        gears = sorted({fit.series.axis for fit, _ in members if fit.series.kind in GEAR})
        for axis in gears:
            own = tuple(pair for pair in members if pair[0].series.axis == axis)
            yield AxisFinding(_kind("gear", own), (axis,), begin, end, own)
        rest = tuple(pair for pair in members if pair[0].series.axis not in gears)
        if axes := tuple(sorted({fit.series.axis for fit, _ in rest})):
            yield AxisFinding(_kind("collision", rest), axes, begin, end, rest)


def _days(fit: SeriesFit, event: AxisEvent, days: Sequence[date]) -> tuple[date, date]:
    """Days between which a step happened, or on which a drift began."""
    dates = fit.series.dates
    return days[dates[event.earliest - (not event.drift)]], days[dates[event.latest]]


def _kind(kind: Kind, members: Sequence[Pair]) -> Kind:
    return "change" if all(event.either for _, event in members) else kind

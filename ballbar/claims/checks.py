"""Results of checks, and whether they lie within their limits."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ballbar.claims.kinds import (
    OF_RUNS,
    AmongLargest,
    Apart,
    Bound,
    Check,
    EqualTable,
    Formula,
    Measure,
    Monotonic,
    Ordered,
    Quotient,
    Ratio,
    TableName,
)
from ballbar.claims.table import Evidence, apart, numbers, places, selected, unit_of
from ballbar.plan.beam import CALCULATIONS
from ballbar.units import MM, UM, URAD
from cell.errors import InputError
from ident.thesis.tables import REMOVED, TABLE_3_2, TABLE_3_3, TABLE_3_4, TABLE_3_5_IDENTIFIED

_PER_SI = {"mm": MM, "um": UM, "urad": URAD}

Entries = Mapping[str, frozenset[str]]  # row of a printed table -> its entries


@dataclass(frozen=True)
class Outcome:
    """Result of one check."""

    met: bool
    result: str  # text with numbers
    limits: str


def judge(check: Check, evidence: Evidence) -> Outcome:
    """Evaluates a check.

    Raises InputError where the check names columns, runs or parameters that the evidence lacks.
    """
    if isinstance(check, Formula):
        return _formula(check)
    if isinstance(check, EqualTable):
        return _equal_table(check, evidence)
    if isinstance(check, OF_RUNS) and evidence.failures:
        return Outcome(False, evidence.failures, "no run fails")
    if isinstance(check, Bound):
        return _bound(check, evidence)
    if isinstance(check, Ratio):
        return _ratio(check, evidence)
    if isinstance(check, Ordered):
        return _ordered(check, evidence)
    if isinstance(check, Monotonic):
        return _monotonic(check, evidence)
    if isinstance(check, Apart):
        return _apart(check, evidence)
    return _among_largest(check, evidence)


def measured(measure: Measure, evidence: Evidence) -> str:
    """A number, or the range of several, with its text before it."""
    if evidence.failures:
        return evidence.failures
    values = numbers(measure, evidence.table).values()
    unit = "" if measure.statistic == "relative_spread" else unit_of(measure.column)
    return f"{measure.what}: {_range(values, unit)}"


def _bound(check: Bound, evidence: Evidence) -> Outcome:
    values = numbers(check, evidence.table).values()
    below = check.kind == "at_most"
    met = all(x <= check.limit if below else x >= check.limit for x in values)
    limits = f"at {'most' if below else 'least'} {check.limit:g}"
    return Outcome(met, measured(check, evidence), limits)


def _ratio(check: Ratio, evidence: Evidence) -> Outcome:
    ratios = _quotients(check, check, evidence)
    if check.than is not None:
        others = _quotients(check, check.than, evidence)
        ratios = {value: ratio / others[value] for value, ratio in ratios.items()}
    least, most = check.at_least, check.at_most
    met = all(
        (least is None or x >= least) and (most is None or x <= most) for x in ratios.values()
    )
    limits = [
        f"at {word} {limit:g}"
        for word, limit in (("least", least), ("most", most))
        if limit is not None
    ]
    return Outcome(met, f"{check.what}: {_range(ratios.values(), ' times')}", ", ".join(limits))


def _quotients(check: Ratio, runs: Quotient, evidence: Evidence) -> dict[Any, float]:
    """The number of `of` over that of `over`, by the values of `each`."""
    above = numbers(check, evidence.table, runs.of)
    below = numbers(check, evidence.table, runs.over)
    if above.keys() != below.keys():
        raise InputError(
            f"{check.each}: the runs of `of` have the values {list(above)}, those of `over` "
            f"{list(below)}. "
            "Make `rows` select the same values for both"
        )
    if not all(below.values()):
        raise InputError(
            f"{check.column}: the runs of `over` have 0, so there is no ratio. "
            "Choose another column, or other runs for `over`"
        )
    return {value: above[value] / below[value] for value in above}


def _ordered(check: Ordered, evidence: Evidence) -> Outcome:
    groups = [numbers(check, evidence.table, {check.by: value}) for value in check.order]
    if any(group.keys() != groups[0].keys() for group in groups):
        raise InputError(
            f"{check.each}: not every group of {check.by} has the same values. "
            "Let `rows` select runs with the same values"
        )
    met = all(
        check.apart * low[value] <= high[value]
        for low, high in itertools.pairwise(groups)
        for value in low
    )
    ranges = ", ".join(
        f"{value} {_range(group.values(), unit_of(check.column))}"
        for value, group in zip(check.order, groups, strict=True)
    )
    apart = f", each {check.apart:g} times the one before" if check.apart > 1.0 else ""
    return Outcome(met, f"{check.what}: {ranges}", f"in this order{apart}")


def _monotonic(check: Monotonic, evidence: Evidence) -> Outcome:
    by_value = check.model_copy(update={"each": check.over})
    values = list(numbers(by_value, evidence.table).values())
    if len(values) < 2:
        raise InputError(
            f"{check.over}: one value alone neither rises nor falls. "
            "Let `rows` select runs with several values"
        )
    ordered = values if check.direction == "rising" else values[::-1]
    met = all((1.0 - check.tolerance) * a <= b for a, b in itertools.pairwise(ordered))
    ends = f"{_number(values[0])} to {_number(values[-1])}{unit_of(check.column)}"
    return Outcome(met, f"{check.what}: {ends}", check.direction)


def _apart(check: Apart, evidence: Evidence) -> Outcome:
    table = selected(evidence.table, check.rows)
    distances = apart(selected(table, check.first), selected(table, check.second), check.each)
    if check.at_most is not None:
        met, limits = max(distances) <= check.at_most, f"at most {check.at_most:g}"
    else:
        limit = check.at_least or 0.0
        met, limits = min(distances) >= limit, f"at least {limit:g}"
    return Outcome(met, f"{check.what}: {_range(distances, ' times their size')}", limits)


def _among_largest(check: AmongLargest, evidence: Evidence) -> Outcome:
    runs = places(selected(evidence.table, check.rows), check.places)
    names = list(itertools.chain.from_iterable(runs))
    share = sum(name.startswith(tuple(check.parameters)) for name in names) / len(names)
    met = check.at_least <= share <= check.at_most
    limits = f"{check.at_least:.0%} to {check.at_most:.0%}"
    return Outcome(met, f"{check.what}: {share:.0%}", limits)


def _formula(check: Formula) -> Outcome:
    value = CALCULATIONS[check.figure]() * _PER_SI[check.unit]
    met = abs(value - check.value) <= check.tolerance * abs(check.value)
    limits = f"{check.value:g} {check.unit} within {check.tolerance:.0%}"
    return Outcome(met, f"{check.what}: {value:.3g} {check.unit}", limits)


def _equal_table(check: EqualTable, evidence: Evidence) -> Outcome:
    """Compares a printed table with ours, entry by entry; exceptions must differ as stated."""
    printed, ours = TABLES[check.table](evidence)
    entries = [*printed, *(entry for entry in ours if entry not in printed)]
    expected = {d.entry: (frozenset(d.thesis), frozenset(d.here)) for d in check.exceptions}
    for entry in expected:
        if entry not in entries:
            raise InputError(
                f"exceptions: table {check.table} has no entry {entry}; it has {', '.join(entries)}"
            )
    none: frozenset[str] = frozenset()
    only = {}  # entry -> (printed alone, ours alone)
    for entry in entries:
        thesis, here = printed.get(entry, none), ours.get(entry, none)
        only[entry] = (thesis - here, here - thesis)
    unexpected = [
        f"{entry}: {_difference(*only[entry])}"
        for entry in entries
        if only[entry] != expected.get(entry, (none, none))
    ]
    items = sum(map(len, printed.values()))
    missing, more = (sum(len(side[k]) for side in only.values()) for k in (0, 1))
    result = f"{check.what}: {items - missing} of {items} printed found here, {more or 'none'} more"
    if unexpected:
        word = "not as stated" if check.exceptions else "not equal"
        result += f"; {word}: {'; '.join(unexpected)}"
    limits = "equal but for the exceptions" if check.exceptions else "equal"
    return Outcome(not unexpected, result, limits)


def _difference(thesis: frozenset[str], here: frozenset[str]) -> str:
    sides = (("in the thesis", thesis), ("here", here))
    parts = [f"only {side} {', '.join(sorted(names))}" for side, names in sides if names]
    return " and ".join(parts) or "equal"


def _table_3_4(evidence: Evidence) -> tuple[Entries, Entries]:
    affected: dict[str, frozenset[str]] = {}
    for _, changes in evidence.studies.values():
        for left_out, names in changes.items():
            affected[left_out] = affected.get(left_out, frozenset()) | names.keys()
    return {name: frozenset(names) for name, names in TABLE_3_4.items()}, affected


def _removed(evidence: Evidence) -> tuple[Entries, Entries]:
    removed = {d.name for study, _ in evidence.studies.values() for d in study.selection.dependent}
    return {"all costs": frozenset(REMOVED)}, {"all costs": frozenset(removed)}


# table -> (printed entries, our entries)
TABLES: Mapping[TableName, Callable[[Evidence], tuple[Entries, Entries]]] = {
    "3.2": lambda evidence: (
        {cost: frozenset(groups) for cost, groups in TABLE_3_2.items()},
        {cost: frozenset(map(str, study.groups)) for cost, (study, _) in evidence.studies.items()},
    ),
    "3.3": lambda evidence: (
        TABLE_3_3,
        {
            cost: frozenset(study.selection.without_effect)
            for cost, (study, _) in evidence.studies.items()
        },
    ),
    "3.4": _table_3_4,
    "3.5": lambda evidence: (
        {"length": TABLE_3_5_IDENTIFIED},
        {"length": frozenset(evidence.studies["length"][0].selection.selected)},
    ),
    "sec. 3.3": _removed,
}


def _range(values: Iterable[float], unit: str) -> str:
    ordered = sorted(values)
    low, high = _number(ordered[0]), _number(ordered[-1])
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"


def _number(x: float) -> str:
    """Three digits; whole numbers below a million without exponent."""
    return f"{x:.0f}" if 1e3 <= abs(x) < 1e6 else f"{x:.3g}"

"""What a check finds, and whether that is within its limits."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from ballbar.claims.kinds import (
    OF_RUNS,
    AmongLargest,
    Bound,
    Check,
    EqualTable,
    Formula,
    Measure,
    Monotonic,
    Ordered,
    Ratio,
    TableName,
)
from ballbar.claims.table import Evidence, numbers, places, selected, unit_of
from ballbar.plan.beam import CALCULATIONS
from cell.errors import InputError
from ident.thesis.tables import REMOVED, TABLE_3_2, TABLE_3_3, TABLE_3_4, TABLE_3_5_IDENTIFIED

_PER_SI = {"mm": 1e3, "um": 1e6, "urad": 1e6}

Entries = Mapping[str, frozenset[str]]  # row of a printed table -> what stands in it


@dataclass(frozen=True)
class Outcome:
    """What a check came to."""

    met: bool
    found: str  # in words and numbers
    asked: str  # the limits


def judge(check: Check, evidence: Evidence) -> Outcome:
    """Looks at the evidence.

    Raises InputError where the check names columns, runs or parameters that the evidence does not have.
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
    return _among_largest(check, evidence)


def measured(measure: Measure, evidence: Evidence) -> str:
    """A number, or the range of several, in words."""
    return (
        evidence.failures
        or f"{measure.what}: {_range(numbers(measure, evidence.table).values(), unit_of(measure.column))}"
    )


def _bound(check: Bound, evidence: Evidence) -> Outcome:
    found = numbers(check, evidence.table)
    below = check.kind == "at_most"
    met = all(x <= check.limit if below else x >= check.limit for x in found.values())
    return Outcome(
        met, measured(check, evidence), f"at {'most' if below else 'least'} {check.limit:g}"
    )


def _ratio(check: Ratio, evidence: Evidence) -> Outcome:
    above, below = (
        numbers(check, evidence.table, check.of),
        numbers(check, evidence.table, check.over),
    )
    if above.keys() != below.keys():
        raise InputError(
            f"{check.each}: the runs of `of` have the values {list(above)}, those of `over` {list(below)}"
        )
    if not all(below.values()):
        raise InputError(f"{check.column}: the runs of `over` have 0, so there is no ratio")
    ratios = [above[value] / below[value] for value in above]
    least, most = check.at_least, check.at_most
    met = all((least is None or x >= least) and (most is None or x <= most) for x in ratios)
    asked = [
        f"at {word} {limit:g}"
        for word, limit in (("least", least), ("most", most))
        if limit is not None
    ]
    return Outcome(met, f"{check.what}: {_range(ratios, ' times')}", ", ".join(asked))


def _ordered(check: Ordered, evidence: Evidence) -> Outcome:
    groups = [numbers(check, evidence.table, {check.by: value}) for value in check.order]
    if any(group.keys() != groups[0].keys() for group in groups):
        raise InputError(f"{check.each}: not every group of {check.by} has the same values")
    met = all(
        check.apart * a[value] <= b[value] for a, b in itertools.pairwise(groups) for value in a
    )
    found = ", ".join(
        f"{value} {_range(group.values(), unit_of(check.column))}"
        for value, group in zip(check.order, groups, strict=True)
    )
    apart = f", each {check.apart:g} times the one before" if check.apart > 1.0 else ""
    return Outcome(met, f"{check.what}: {found}", f"in this order{apart}")


def _monotonic(check: Monotonic, evidence: Evidence) -> Outcome:
    by_value = check.model_copy(update={"each": check.over})
    found = numbers(by_value, evidence.table)
    steps = list(itertools.pairwise(found.values()))
    if not steps:
        raise InputError(f"{check.over}: one value alone neither rises nor falls")
    allowed = 1.0 - check.slack
    met = all(
        (b >= allowed * a) if check.direction == "rising" else (a >= allowed * b) for a, b in steps
    )
    first, last = next(iter(found.values())), steps[-1][1]
    return Outcome(
        met,
        f"{check.what}: {_number(first)} to {_number(last)}{unit_of(check.column)}",
        check.direction,
    )


def _among_largest(check: AmongLargest, evidence: Evidence) -> Outcome:
    taken = list(
        itertools.chain.from_iterable(places(selected(evidence.table, check.rows), check.places))
    )
    known = {column.removeprefix("error.") for column in evidence.table.columns}
    for name in check.parameters:
        if not any(parameter.startswith(name) for parameter in known):
            raise InputError(f"parameters: none of the identified ones is, or begins with, {name}")
    share = sum(parameter.startswith(tuple(check.parameters)) for parameter in taken) / len(taken)
    return Outcome(
        check.at_least <= share <= check.at_most,
        f"{check.what}: {share:.0%}",
        f"{check.at_least:.0%} to {check.at_most:.0%}",
    )


def _formula(check: Formula) -> Outcome:
    found = CALCULATIONS[check.figure]() * _PER_SI[check.unit]
    met = abs(found - check.value) <= check.tolerance * abs(check.value)
    return Outcome(
        met,
        f"{check.what}: {found:.3g} {check.unit}",
        f"{check.value:g} {check.unit} within {check.tolerance:.0%}",
    )


def _equal_table(check: EqualTable, evidence: Evidence) -> Outcome:
    printed, found = TABLES[check.table](evidence)
    entries = [*printed, *(entry for entry in found if entry not in printed)]
    expected = {d.entry: (frozenset(d.thesis), frozenset(d.here)) for d in check.exceptions}
    for entry in expected:
        if entry not in entries:
            raise InputError(
                f"exceptions: table {check.table} has no entry {entry}; it has {', '.join(entries)}"
            )
    none: frozenset[str] = frozenset()
    only = {
        entry: (
            printed.get(entry, none) - found.get(entry, none),
            found.get(entry, none) - printed.get(entry, none),
        )
        for entry in entries
    }
    surprises = [
        f"{entry}: {_difference(*only[entry])}"
        for entry in entries
        if only[entry] != expected.get(entry, (none, none))
    ]
    items, missing, more = (
        sum(map(len, printed.values())),
        *(sum(len(side[k]) for side in only.values()) for k in (0, 1)),
    )
    said = f"{check.what}: {items - missing} of {items} printed found here, {more or 'none'} more"
    if surprises:
        return Outcome(
            False, f"{said}; not as stated: {'; '.join(surprises)}", "equal but for the exceptions"
        )
    return Outcome(True, said, "equal but for the exceptions")


def _difference(thesis: frozenset[str], here: frozenset[str]) -> str:
    parts = [
        f"only {where} {', '.join(sorted(names))}"
        for where, names in (("in the thesis", thesis), ("here", here))
        if names
    ]
    return " and ".join(parts) or "equal"


def _table_3_4(evidence: Evidence) -> tuple[Entries, Entries]:
    found: dict[str, frozenset[str]] = {}
    for _, moved in evidence.studies.values():
        for left_out, affected in moved.items():
            found[left_out] = found.get(left_out, frozenset()) | affected.keys()
    return {name: frozenset(names) for name, names in TABLE_3_4.items()}, found


def _removed(evidence: Evidence) -> tuple[Entries, Entries]:
    found = {d.name for study, _ in evidence.studies.values() for d in study.selection.dependent}
    return {"all costs": frozenset(REMOVED)}, {"all costs": frozenset(found)}


TABLES: Mapping[
    TableName, Callable[[Evidence], tuple[Entries, Entries]]
] = {  # printed, and found here
    "3.2": lambda e: (
        {cost: frozenset(groups) for cost, groups in TABLE_3_2.items()},
        {cost: frozenset(map(str, study.groups)) for cost, (study, _) in e.studies.items()},
    ),
    "3.3": lambda e: (
        TABLE_3_3,
        {cost: frozenset(study.selection.without_effect) for cost, (study, _) in e.studies.items()},
    ),
    "3.4": _table_3_4,
    "3.5": lambda e: (
        {"length": TABLE_3_5_IDENTIFIED},
        {"length": frozenset(e.studies["length"][0].selection.kept)},
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

"""Results of checks, and whether they lie within their limits."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ballbar.cell.errors import InputError
from ballbar.claims import kinds
from ballbar.claims.table import ClaimEvidence, apart, numbers, places, selected, unit_of
from ballbar.ident.thesis.tables import (
    REMOVED,
    TABLE_3_2,
    TABLE_3_3,
    TABLE_3_4,
    TABLE_3_5_IDENTIFIED,
)
from ballbar.plan.beam import CALCULATIONS
from ballbar.units import MM, UM, URAD

_PER_SI = {"mm": MM, "um": UM, "urad": URAD}

Entries = Mapping[str, frozenset[str]]  # row of a printed table -> its entries


@dataclass(frozen=True)
class CheckOutcome:
    """Result of one check."""

    met: bool
    result: str  # text with numbers
    limits: str


def judge(check: kinds.Check, evidence: ClaimEvidence) -> CheckOutcome:
    """Evaluates a check.

    Raises InputError where the check names columns, runs or parameters that the evidence lacks.
    """
    if isinstance(check, kinds.OF_RUNS) and evidence.failures:
        return CheckOutcome(False, evidence.failures, "no run fails")
    match check:
        case kinds.Formula():
            return _formula(check)
        case kinds.Bound():
            values = numbers(check, evidence.table).values()
            return _limited(check, values, _unit(check))
        case kinds.Ratio():
            return _limited(check, _ratios(check, evidence), " times")
        case kinds.Apart():
            table = selected(evidence.table, check.rows)
            first, second = selected(table, check.first), selected(table, check.second)
            return _limited(check, apart(first, second, check.each), " times their size")
        case kinds.AmongLargest():
            return _among_largest(check, evidence)
        case kinds.EqualTable():
            return _equal_table(check, evidence)
        case kinds.Ordered():
            return _ordered(check, evidence)
        case kinds.Monotonic():
            return _monotonic(check, evidence)


def measured(measure: kinds.Measure, evidence: ClaimEvidence) -> str:
    """A number, or the range of several, with its text before it."""
    if evidence.failures:
        return evidence.failures
    return f"{measure.what}: {_range(numbers(measure, evidence.table).values(), _unit(measure))}"


def _unit(measure: kinds.Measure) -> str:
    return "" if measure.statistic == "relative_spread" else unit_of(measure.column)


def _limited(
    check: kinds.Bound | kinds.Limited, values: Iterable[float], unit: str
) -> CheckOutcome:
    """Whether all values lie within the limits of a check."""
    values, met, limits = list(values), True, []
    if check.at_least is not None:
        met = min(values) >= check.at_least
        limits.append(f"at least {check.at_least:g}")
    if check.at_most is not None:
        met &= max(values) <= check.at_most
        limits.append(f"at most {check.at_most:g}")
    return CheckOutcome(met, f"{check.what}: {_range(values, unit)}", ", ".join(limits))


def _formula(check: kinds.Formula) -> CheckOutcome:
    value = CALCULATIONS[check.figure]() * _PER_SI[check.unit]
    met = abs(value - check.value) <= check.tolerance * abs(check.value)
    limits = f"{check.value:g} {check.unit} within {check.tolerance:.0%}"
    return CheckOutcome(met, f"{check.what}: {value:.3g} {check.unit}", limits)


def _among_largest(check: kinds.AmongLargest, evidence: ClaimEvidence) -> CheckOutcome:
    runs = places(selected(evidence.table, check.rows), check.places)
    names = list(itertools.chain.from_iterable(runs))
    share = sum(name.startswith(tuple(check.parameters)) for name in names) / len(names)
    limits = f"{check.at_least:.0%} to {check.at_most:.0%}"
    met = check.at_least <= share <= check.at_most
    return CheckOutcome(met, f"{check.what}: {share:.0%}", limits)


def _ratios(check: kinds.Ratio, evidence: ClaimEvidence) -> list[float]:
    ratios = _quotients(check, check, evidence)
    if check.than is None:
        return list(ratios.values())
    others = _quotients(check, check.than, evidence)
    return [ratio / others[value] for value, ratio in ratios.items()]


def _quotients(
    check: kinds.Ratio, runs: kinds.Quotient, evidence: ClaimEvidence
) -> dict[Any, float]:
    """The number of `of` over that of `over`, by the values of `each`."""
    above = numbers(check, evidence.table, runs.of)
    below = numbers(check, evidence.table, runs.over)
    if above.keys() != below.keys():
        what = f"the runs of `of` have the values {list(above)}, those of `over` {list(below)}."
        raise InputError.at(check.each, what, "Make `rows` select the same values for both")
    if not all(below.values()):
        what = "the runs of `over` have 0, so there is no ratio."
        raise InputError.at(check.column, what, "Choose another column, or other runs for `over`")
    return {value: above[value] / below[value] for value in above}


def _ordered(check: kinds.Ordered, evidence: ClaimEvidence) -> CheckOutcome:
    groups = [numbers(check, evidence.table, {check.by: value}) for value in check.order]
    if any(group.keys() != groups[0].keys() for group in groups):
        what = f"not every group of {check.by} has the same values."
        raise InputError.at(check.each, what, "Let `rows` select runs with the same values")
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
    return CheckOutcome(met, f"{check.what}: {ranges}", f"in this order{apart}")


def _monotonic(check: kinds.Monotonic, evidence: ClaimEvidence) -> CheckOutcome:
    by_value = check.model_copy(update={"each": check.over})
    values = list(numbers(by_value, evidence.table).values())
    if len(values) < 2:
        what = "one value alone neither rises nor falls."
        raise InputError.at(check.over, what, "Let `rows` select runs with several values")
    ordered = values if check.direction == "rising" else values[::-1]
    met = all((1.0 - check.tolerance) * a <= b for a, b in itertools.pairwise(ordered))
    ends = f"{_number(values[0])} to {_number(values[-1])}{unit_of(check.column)}"
    return CheckOutcome(met, f"{check.what}: {ends}", check.direction)


def _equal_table(check: kinds.EqualTable, evidence: ClaimEvidence) -> CheckOutcome:
    """Compares a printed table with ours, entry by entry; exceptions must differ as stated."""
    printed, ours = _tables(check.table, evidence)
    entries = [*printed, *(entry for entry in ours if entry not in printed)]
    expected = {d.entry: (frozenset(d.thesis), frozenset(d.here)) for d in check.exceptions}
    for entry in expected:
        if entry not in entries:
            raise InputError(
                f"exceptions: table {check.table} has no entry {entry}; it has {', '.join(entries)}"
            )
    none: frozenset[str] = frozenset()
    unexpected, missing, more = [], 0, 0
    for entry in entries:
        thesis, here = printed.get(entry, none), ours.get(entry, none)
        only = {"in the thesis": thesis - here, "here": here - thesis}
        missing, more = missing + len(thesis - here), more + len(here - thesis)
        if (thesis - here, here - thesis) != expected.get(entry, (none, none)):
            parts = [
                f"only {side} {', '.join(sorted(names))}" for side, names in only.items() if names
            ]
            unexpected.append(f"{entry}: {' and '.join(parts) or 'equal'}")
    items = sum(map(len, printed.values()))
    result = f"{check.what}: {items - missing} of {items} printed found here, {more or 'none'} more"
    if unexpected:
        word = "not as stated" if check.exceptions else "not equal"
        result += f"; {word}: {'; '.join(unexpected)}"
    limits = "equal but for the exceptions" if check.exceptions else "equal"
    return CheckOutcome(not unexpected, result, limits)


def _tables(name: kinds.TableName, evidence: ClaimEvidence) -> tuple[Entries, Entries]:
    """Printed entries of a table, and ours."""
    studies = {cost: study for cost, (study, _) in evidence.studies.items()}
    match name:
        case "3.2":
            printed = {cost: frozenset(groups) for cost, groups in TABLE_3_2.items()}
            return printed, {cost: frozenset(map(str, s.groups)) for cost, s in studies.items()}
        case "3.3":
            ours = {cost: frozenset(s.selection.without_effect) for cost, s in studies.items()}
            return TABLE_3_3, ours
        case "3.4":
            affected: dict[str, frozenset[str]] = {}
            for _, changes in evidence.studies.values():
                for left_out, names in changes.items():
                    affected[left_out] = affected.get(left_out, frozenset()) | names.keys()
            return {name: frozenset(names) for name, names in TABLE_3_4.items()}, affected
        case "3.5":
            selection = frozenset(studies["length"].selection.selected)
            return {"length": TABLE_3_5_IDENTIFIED}, {"length": selection}
        case "sec. 3.3":
            removed = {d.name for s in studies.values() for d in s.selection.dependent}
            return {"all costs": frozenset(REMOVED)}, {"all costs": frozenset(removed)}


def _range(values: Iterable[float], unit: str) -> str:
    ordered = sorted(values)
    low, high = _number(ordered[0]), _number(ordered[-1])
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"


def _number(x: float) -> str:
    """Three digits; whole numbers below a million without exponent."""
    return f"{x:.0f}" if 1e3 <= abs(x) < 1e6 else f"{x:.3g}"

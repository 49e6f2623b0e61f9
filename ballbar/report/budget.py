"""The uncertainty budget as a table of the page, and as a sentence."""

from __future__ import annotations

from ballbar.ident.robot.budget import COVERAGE, MIXED, Budget, BudgetRow
from ballbar.report.numbers import fixed, millimetres, significant
from ballbar.report.section import Section, machine_row, section
from ballbar.result.run_data import RunData
from ballbar.units import MM

LITTLE = 1e-3  # share of the variance below which rows are added up
NAMED = 3  # rows of the sentence
_UNITS = {"m": (1e6, "µm"), "rad": (1e6, "µrad"), "s": (1e6, "µs")}  # as they are shown


def budget_section(run: RunData) -> list[Section]:
    """The uncertainty budget, where the fit is at hand."""
    budget = run.identification.budget
    if budget is None:
        return []
    large = [row for row in budget.rows if abs(row.share) >= LITTLE]
    others = sum(row.share for row in budget.rows if abs(row.share) < LITTLE)
    return [
        section(
            "budget.html",
            {"budget": "Uncertainty budget"},
            machine_row(run),
            budget=budget,
            rows=[_cells(row) for row in large],
            others=fixed(100.0 * others, 2),
            count=len(budget.rows) - len(large),
            coverage=fixed(100.0 * COVERAGE, 0),
            freedom=_freedom(budget.degrees_of_freedom),
            mm=MM,
        )
    ]


def budget_sentence(budget: Budget | None) -> str:
    """Expanded uncertainty and the largest rows; empty without a budget."""
    if budget is None:
        return ""
    rows = [
        f"{row.what.partition(':')[0]} {100.0 * row.share:.0f} %" for row in budget.rows[:NAMED]
    ]
    usual, worst = map(millimetres, budget.expanded)
    return (
        f"expanded uncertainty of the tool (k = {budget.coverage_factor:.2f}, "
        f"{100.0 * COVERAGE:.0f} %): {usual}, at the worst pose {worst}; "
        f"of its variance {', '.join(rows)}"
    )


def _cells(row: BudgetRow) -> tuple[str, ...]:
    """Source, type, distribution, standard uncertainty, sensitivities, contributions, share and
    degrees of freedom.
    """
    factor, unit = _UNITS.get(row.unit, (1.0, row.unit))
    mixed, size = row.unit == MIXED, row.standard_uncertainty
    sensitivity = row.sensitivity if size else (None, None)
    per = "" if mixed else f" /{unit}"
    return (
        row.what,
        row.evaluated,
        row.distribution,
        "" if mixed else f"{significant(size * factor)} {unit}",
        *("" if v is None else f"{significant(v / factor * MM)}{per}" for v in sensitivity),
        *(significant(value * MM) for value in (row.contribution, row.worst)),
        fixed(100.0 * row.share, 1),
        _freedom(row.degrees_of_freedom),
    )


def _freedom(freedom: float | None) -> str:
    return "∞" if freedom is None else fixed(freedom, 0)

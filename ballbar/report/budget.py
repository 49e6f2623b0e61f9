"""The uncertainty budget as a table of the page, and temperatures as a sentence."""

from __future__ import annotations

from ballbar.ident.robot.budget import MIXED, BudgetRow
from ballbar.ident.robot.coverage import COVERAGE
from ballbar.report.numbers import fixed, listed, significant
from ballbar.report.section import Section, machine_row, section
from ballbar.result.run_data import RunData
from ballbar.result.temperature_entries import TemperatureEntry, temperature_entry
from ballbar.units import MM

LITTLE = 1e-3  # share of the variance below which rows are added up
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
            temperature=temperature_sentence(temperature_entry(run)),
        )
    ]


def temperature_sentence(entry: TemperatureEntry | None) -> str:
    """Temperatures of what was measured, and the factor that refers lengths to 20 degC."""
    if entry is None:
        return "Temperature: not stated, so lengths are not referred to 20 °C."
    pairs = ("robot", entry.robot_C), ("instrument", entry.instrument_C)
    warm = listed([f"{what} {fixed(t, 1)} °C" for what, t in pairs if t is not None])
    sigma = f"± {significant(entry.sigma_K, 2)} K{' (assumed)' * entry.sigma_assumed}"
    out = f"Temperature: {warm} {sigma}. "
    if entry.plate_expansion_per_K is not None:
        ppm = fixed(entry.plate_expansion_per_K * 1e6, 1)
        out += f"The plate was taken as long as it is there, with {ppm} µm/(m K). "
    if entry.instrument_expansion_per_K is not None:
        ppm = fixed(entry.instrument_expansion_per_K * 1e6, 1)
        out += f"Lengths of the instrument were taken as they are there, with {ppm} µm/(m K). "
    if entry.factor_to_20_C is None or entry.factor_sigma is None:
        return out + "The robot's file states no expansion, so its lengths are not those at 20 °C."
    ppm = fixed((entry.robot_expansion_per_K or 0.0) * 1e6, 1)
    return (
        f"{out}Lengths of the robot are those at its temperature; with {ppm} µm/(m K) they are "
        f"times {entry.factor_to_20_C:.6f} ± {entry.factor_sigma:.6f} at 20 °C."
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

"""Evidence of checks: the runs of a sweep or the study of each cost; and statistics of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.schema_errors import nearest
from ballbar.cell.statistics import rms
from ballbar.claims.kinds import Measure, Rows, Scalar, Statistic
from ballbar.ident.thesis.names import ENCODERS_NEEDED
from ballbar.identifiability import Influences, Study, influences, nominal_loop, study
from ballbar.scenario import load_scenario
from ballbar.sweep.chunk import DONE
from ballbar.sweep.table import failures_of

SIZE = "size"
ERROR = "error."  # prefix of the columns with the error of each parameter
IDENTIFIED = "identified."  # and of those with its deviation from nominal
_SAME = 1e-9  # relative difference below which two numbers of YAML are the same
# end of a column's name -> unit
_UNITS = {"_mm_mrad": "mm|mrad", "_mm": "mm", "_um": "um", "_us": "us", "_ppm": "ppm"}


@dataclass(frozen=True, eq=False)
class ClaimEvidence:
    """Runs or studies that the checks of one file look at."""

    table: pd.DataFrame = field(default_factory=pd.DataFrame)  # a row for each run, or each cost
    failures: str = ""  # sentence about failed runs; empty without any
    studies: Mapping[str, tuple[Study, Influences]] = field(default_factory=dict)  # by cost


def runs_evidence(table: Path, size: Sequence[str]) -> ClaimEvidence:
    """The runs of a finished sweep. size : varied keys; the column `size` is their largest."""
    runs = pd.read_parquet(table)
    if size:
        runs[SIZE] = runs[[_known(runs, key) for key in size]].max(axis=1)
    failed, failures = failures_of(table), ""
    if failed.count:
        failures = f"{failed.count} of {len(runs)} runs failed: {failed.reason}"
    return ClaimEvidence(runs[runs["status"] == DONE], failures)


def identifiability_evidence(scenario: Path) -> ClaimEvidence:
    """Parameters that each of the thesis's costs identifies on the nominal mechanism of a scenario.

    Each cost has the encoders that it needs.
    """
    loop = nominal_loop(load_scenario(scenario, moving=True), relative_to=scenario.parent)
    studies: dict[str, tuple[Study, Influences]] = {}
    for cost, encoders in ENCODERS_NEEDED.items():
        result = study(loop, cost, encoders, complete=False)
        studies[cost] = (result, influences(loop, result))
    rows = [
        {
            "cost": cost,
            "directions": result.spectrum.rank,
            "robot_parameters": sum(name.startswith("r") for name in result.selection.selected),
            "condition": result.spectrum.condition,
        }
        for cost, (result, _) in studies.items()
    ]
    return ClaimEvidence(pd.DataFrame(rows), studies=studies)


def selected(table: pd.DataFrame, rows: Rows) -> pd.DataFrame:
    """The rows with these values. Raises InputError where a column is unknown or no row remains."""
    remaining = table
    for column, value in rows.items():
        choices = value if isinstance(value, list) else [value]
        entries = remaining[_known(table, column)]
        remaining = remaining[np.logical_or.reduce([_equal(entries, x) for x in choices])]
    if remaining.empty:
        conditions = ", ".join(f"{column} = {value}" for column, value in rows.items())
        raise InputError(
            f"no run has {conditions}. Correct these values, or run the sweep with them"
        )
    return remaining


def numbers(measure: Measure, table: pd.DataFrame, *also: Rows) -> dict[Any, float]:
    """The statistic of the selected rows, by the values of `each` in rising order.

    A measure without `each` has one number, under None. also : further conditions on the rows.

    Raises InputError where a column is unknown, or some rows lack the value.
    """
    chosen = table
    for rows in (measure.rows, *also):
        chosen = selected(chosen, rows)
    column = _known(chosen, measure.column)
    if measure.each is None:
        return {None: statistic(measure.statistic, _values(chosen, column))}
    if without := int(chosen[_known(chosen, measure.each)].isna().sum()):
        what = f"{without} of the {len(chosen)} selected runs have no such value."
        raise InputError.at(measure.each, what, "Let `rows` select those that have one")
    groups = chosen.groupby(measure.each, sort=True)
    return {value: statistic(measure.statistic, _values(rows, column)) for value, rows in groups}


def statistic(name: Statistic, values: Array) -> float:
    """A statistic of values (N,), in their unit."""
    ways: dict[Statistic, Callable[[Array], Any]] = {
        "median": np.median,
        "mean": np.mean,
        "min": np.min,
        "max": np.max,
        "rms": rms,
        "largest": lambda x: np.max(np.abs(x)),
        "spread": np.std,
        "relative_spread": lambda x: np.std(x) / np.mean(x),
    }
    return float(ways[name](values))


def apart(first: pd.DataFrame, second: pd.DataFrame, each: str) -> list[float]:
    """Distance between the identified errors of two recordings over the mean of their sizes.

    Median over the seeds, for every value of the column `each` in rising order. Raises InputError
    where the two have other runs.
    """
    columns = [name for name in first.columns if name.startswith(IDENTIFIED)]
    a, b = (
        rows.set_index([_known(rows, each), "seed"])[columns].sort_index().fillna(0.0)
        for rows in (first, second)
    )
    if not a.index.is_unique or not a.index.equals(b.index):
        what = "`first` and `second` need one run each of the same values and seeds."
        raise InputError.at(each, what, "Make `rows` select them")
    sizes = 0.5 * (np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1))
    distances = pd.Series(np.linalg.norm(a - b, axis=1) / sizes, index=a.index)
    return [float(x) for x in distances.groupby(level=0).median()]


def unit_of(column: str) -> str:
    """Unit of a column after a space, such as ` mm|mrad`; empty for a column without unit."""
    return next((f" {unit}" for end, unit in _UNITS.items() if column.endswith(end)), "")


def places(table: pd.DataFrame, count: int) -> list[list[str]]:
    """For each run the names of the parameters with the `count` largest errors, largest first."""
    columns = [name for name in table.columns if name.startswith(ERROR)]
    errors = table[columns].abs().fillna(0.0).to_numpy()
    order = np.argsort(-errors, axis=1, kind="stable")[:, :count]
    return [[columns[i].removeprefix(ERROR) for i in row] for row in order]


def _known(table: pd.DataFrame, column: str) -> str:
    if column not in table.columns:
        raise InputError(
            f"no run has a column {column}.{nearest(column, table.columns, noun='column')}"
        )
    return column


def _equal(entries: pd.Series, value: Scalar) -> NDArray[np.bool_]:
    """(N,) whether each entry of a column equals a value of YAML."""
    if value is None:
        return np.asarray(entries.isna())
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if number and pd.api.types.is_numeric_dtype(entries):
        return np.asarray(np.isclose(entries.to_numpy(dtype=float), value, rtol=_SAME, atol=0.0))
    return np.asarray(entries == value)


def _values(rows: pd.DataFrame, column: str) -> Array:
    """(N,) values of a column, in the unit of its name."""
    if without := int(rows[column].isna().sum()):
        what = f"{without} of the {len(rows)} selected runs have no such result."
        raise InputError.at(column, what, "Let `rows` select those that have one")
    return rows[column].to_numpy(dtype=float)

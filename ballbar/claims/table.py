"""The table that checks look at: the runs of a sweep, or what each cost identifies; and numbers out of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ballbar.claims.kinds import Measure, Rows, Scalar, Statistic
from ballbar.identifiability import Influences, Study, influences, nominal_loop, study
from ballbar.scenario import load_scenario
from ballbar.sweep.chunk import DONE
from ballbar.sweep.summary import failures_of
from cell.arrays import Array
from cell.errors import InputError
from cell.schema_errors import nearest
from ident.thesis.costs import ENCODERS_NEEDED

SIZE = "size"
ERROR = "error."  # prefix of the columns with the error of each parameter
_SAME = 1e-9  # relative: two numbers of YAML are the same
_UNITS = {
    "_mm_mrad": "mm|mrad",
    "_mm": "mm",
    "_um": "um",
    "_us": "us",
    "_ppm": "ppm",
}  # by the end of a column's name


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the checks of one file look at."""

    table: pd.DataFrame = field(default_factory=pd.DataFrame)  # one row a run, or a cost
    failures: str = ""  # of the runs, in a sentence
    studies: Mapping[str, tuple[Study, Influences]] = field(default_factory=dict)  # by cost


def runs_evidence(table: Path, size: Sequence[str]) -> Evidence:
    """The runs of a finished sweep. size : varied keys whose largest is the column `size`."""
    runs = pd.read_parquet(table)
    if size:
        runs[SIZE] = runs[[_known(runs, key) for key in size]].max(axis=1)
    failed = failures_of(table)
    said = f"{failed.count} of {len(runs)} runs failed: {failed.reason}" if failed.count else ""
    return Evidence(runs[runs["status"] == DONE], said)


def identifiability_evidence(scenario: Path) -> Evidence:
    """What each of the thesis's costs identifies on the nominal mechanism of a scenario, encoders fitted as the cost needs them."""
    loop = nominal_loop(load_scenario(scenario), relative_to=scenario.parent)
    studies: dict[str, tuple[Study, Influences]] = {}
    for cost, encoders in ENCODERS_NEEDED.items():
        found = study(loop, cost, encoders, complete=False)
        studies[cost] = (found, influences(loop, found))
    rows = [
        {
            "cost": cost,
            "directions": found.spectrum.rank,
            "robot_parameters": sum(name.startswith("r") for name in found.selection.kept),
            "condition": found.spectrum.condition,
        }
        for cost, (found, _) in studies.items()
    ]
    return Evidence(pd.DataFrame(rows), studies=studies)


def selected(table: pd.DataFrame, rows: Rows) -> pd.DataFrame:
    """The rows with these values. Raises InputError where a column is unknown or nothing is left."""
    kept = table
    for column, wanted in rows.items():
        values = wanted if isinstance(wanted, list) else [wanted]
        cells = kept[_known(table, column)]
        kept = kept[np.logical_or.reduce([_equal(cells, value) for value in values])]
    if kept.empty:
        raise InputError(
            f"no run has {', '.join(f'{column} = {value}' for column, value in rows.items())}"
        )
    return kept


def numbers(measure: Measure, table: pd.DataFrame, *also: Rows) -> dict[Any, float]:
    """The statistic of the rows meant, for every value of `each` in rising order; of a measure without `each`, under None.

    Raises InputError where a column is unknown, or some rows lack the figure.
    """
    kept = table
    for rows in (measure.rows, *also):
        kept = selected(kept, rows)
    column = _known(kept, measure.column)
    if measure.each is None:
        return {None: statistic(measure.statistic, _figures(kept, column))}
    if without := int(kept[_known(kept, measure.each)].isna().sum()):
        raise InputError(
            f"{measure.each}: {without} of the {len(kept)} runs meant have no such value"
        )
    groups = kept.groupby(measure.each, sort=True)
    return {value: statistic(measure.statistic, _figures(rows, column)) for value, rows in groups}


def statistic(name: Statistic, values: Array) -> float:
    """One number out of (N,) figures."""
    ways: dict[Statistic, Callable[[Array], Any]] = {
        "median": np.median,
        "mean": np.mean,
        "min": np.min,
        "max": np.max,
        "rms": lambda x: np.sqrt(np.mean(x * x)),
        "largest": lambda x: np.max(np.abs(x)),
        "spread": np.std,
    }
    return float(ways[name](values))


def unit_of(column: str) -> str:
    """` mm|mrad` and the like, with the space before; empty for a column without unit."""
    return next((f" {unit}" for end, unit in _UNITS.items() if column.endswith(end)), "")


def places(table: pd.DataFrame, count: int) -> list[list[str]]:
    """For each run the parameters with the `count` largest errors, largest first."""
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


def _equal(cells: pd.Series, value: Scalar) -> NDArray[np.bool_]:
    if value is None:
        return np.asarray(cells.isna())
    if (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and pd.api.types.is_numeric_dtype(cells)
    ):
        return np.asarray(np.isclose(cells.to_numpy(dtype=float), value, rtol=_SAME, atol=0.0))
    return np.asarray(cells == value)


def _figures(rows: pd.DataFrame, column: str) -> Array:
    figures = rows[column]
    if figures.isna().any():
        raise InputError(
            f"{column}: {int(figures.isna().sum())} of the {len(rows)} runs meant have no such figure"
        )
    return figures.to_numpy(dtype=float)

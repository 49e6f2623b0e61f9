"""A draft from a table of DH rows, as CSV or YAML.

A quantity's name carries its unit: `a_m` or `a_mm`, `d_m` or `d_mm`, `alpha_deg` or `alpha_rad`,
`theta_deg` or `theta_rad`; and where known `lower_deg`, `upper_deg` (or `_rad`) and
`speed_deg_per_s` (or `speed_rad_per_s`). `joint` holds any name; `fixed` marks a last row without a
joint, such as the flange of a modified table. `convention` is `standard`, if nothing is said, or
`modified` (Craig 1989): `Rx(alpha) Tx(a) Rz(theta) Tz(d)`.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.dh_from_axes import DHForm, dh_from_modified
from ballbar.cell.errors import InputError
from ballbar.cell.schema_errors import nearest
from ballbar.cell.strict_yaml import load_yaml
from ballbar.robot_file.draft import RobotDraft, check_rows, read_description, rounded

CONVENTIONS = ("standard", "modified")
_DEG, _MM = np.pi / 180.0, 1e-3
_COLUMNS: dict[str, dict[str, float]] = {  # columns of a quantity, and their unit in SI
    "a": {"a_m": 1.0, "a_mm": _MM},
    "d": {"d_m": 1.0, "d_mm": _MM},
    "alpha": {"alpha_deg": _DEG, "alpha_rad": 1.0},
    "theta": {"theta_deg": _DEG, "theta_rad": 1.0},
    "lower": {"lower_deg": _DEG, "lower_rad": 1.0},
    "upper": {"upper_deg": _DEG, "upper_rad": 1.0},
    "speed": {"speed_deg_per_s": _DEG, "speed_rad_per_s": 1.0},
}
_REQUIRED = ("a", "d", "alpha", "theta")
_WORDS = ("joint", "convention")
_KNOWN = (*(name for columns in _COLUMNS.values() for name in columns), *_WORDS)


@dataclass(frozen=True, eq=False)
class _Table:
    """Rows of a table in SI units."""

    values: dict[str, Array]  # by quantity, (rows,) [m, rad, rad/s]; nan where not stated
    fixed: bool  # whether the last row has no joint
    convention: str

    @property
    def joints(self) -> int:
        return int(self.values["a"].size) - self.fixed

    def tip_poses(self, q: Array) -> Array:
        """(N, 4, 4) [m] product of the rows' elementary transforms at angles q (N, J) [rad]."""
        a, d, alpha, theta = (self.values[key] for key in _REQUIRED)
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        for i in range(a.size):
            turn = theta[i] + (q[:, i] if i < self.joints else np.zeros(len(q)))
            about_z = _moved(2, turn, d[i])
            about_x = _moved(0, np.full(len(q), alpha[i]), a[i])
            steps = (about_z, about_x) if self.convention == "standard" else (about_x, about_z)
            poses = poses @ steps[0] @ steps[1]
        return poses


def draft_from_table(name: str, path: Path) -> RobotDraft:
    """The draft of a robot from a table. Raises InputError if the table cannot be used."""
    table = _read_yaml(path) if path.suffix in (".yaml", ".yml") else _read_csv(path)
    form = rounded(_form(table))
    check_rows(str(path), form.chain)
    limits = {key: table.values[key][: table.joints] for key in ("lower", "upper", "speed")}
    return RobotDraft(
        name=name,
        title=name,
        source=f"{path.name}, {table.convention} DH rows.",
        form=form,
        lower=limits["lower"],
        upper=limits["upper"],
        speed=limits["speed"],
        bodies="a table of DH rows states none",
        tip_poses=table.tip_poses,
    )


def _form(table: _Table) -> DHForm:
    """Standard rows of all joints; a fixed last row is folded into the row before it if it fits."""
    a, d, alpha, theta = (table.values[key] for key in _REQUIRED)
    if table.convention == "modified":
        form = dh_from_modified(a, d, alpha, theta)
    else:
        chain = Chain(a, d, alpha, theta, np.zeros_like(a))
        form = DHForm(chain, np.ones_like(a), np.eye(4), np.eye(4))
    if not table.fixed:
        return form
    rows = np.array([form.chain.a, form.chain.d, form.chain.alpha, form.chain.theta])
    *_, before, last = rows.T
    rows = rows[:, :-1]
    beyond = np.eye(4)
    if before[0] == 0.0 and before[2] == 0.0:  # a and alpha: both turns are about the same axis
        rows[:, -1] = before + last
    else:
        beyond = forward(_chain(last[:, None]), np.zeros((1, 1))).poses()[0]
    joints = rows.shape[1]
    chain = _chain(rows)
    return replace(form, chain=chain, sign=np.ones(joints), T_flange_tip=beyond)


def _chain(rows: Array) -> Chain:
    """The chain of a, d, alpha and theta (4, J) [m, rad]."""
    a, d, alpha, theta = rows
    return Chain(a, d, alpha, theta, np.zeros_like(a))


def _moved(axis: int, angle: Array, shift: float) -> Array:
    """(N, 4, 4) turn by `angle` (N,) [rad] about x (0) or z (2) and shift [m] along it."""
    cos, sin = np.cos(angle), np.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    poses = np.tile(np.eye(4), (angle.size, 1, 1))
    poses[:, j, j] = poses[:, k, k] = cos
    poses[:, j, k], poses[:, k, j] = -sin, sin
    poses[:, axis, 3] = shift
    return poses


def _read_csv(path: Path) -> _Table:
    """The table of a CSV file: comma, semicolon or tab; lines that begin with # are comments."""
    numbered = enumerate(read_description(path).splitlines(), start=1)
    lines = [
        (k, line) for k, line in numbered if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(f"{path}: the table is empty. Write a header and one row for each joint.")
    separator = max(",;\t", key=lines[0][1].count)
    header, *rows = [
        [word.strip() for word in next(csv.reader([line], delimiter=separator))]
        for _, line in lines
    ]
    if len(set(header)) < len(header):
        raise InputError(f"{path}:{lines[0][0]}: a column stands here twice. Remove one.")
    entries: list[tuple[str, Mapping[str, Any]]] = []
    for (number, _), row in zip(lines[1:], rows, strict=True):
        where = f"{path}:{number}"
        if len(row) != len(header):
            what = f"{len(row)} values below {len(header)} columns."
            raise InputError.at(where, what, "Complete the row; numbers have a decimal point.")
        entries.append((where, {k: v for k, v in zip(header, row, strict=True) if v}))
    return _table(entries, str(path), None)


def _read_yaml(path: Path) -> _Table:
    """The table of a YAML file: `convention` and a list `rows`."""
    document = load_yaml(path)
    data = document.data
    if unknown := [key for key in data if key not in ("convention", "rows")]:
        remedy = "A table has `convention` and `rows`."
        raise InputError.at(document.place_of((unknown[0],)), f"unknown key {unknown[0]}.", remedy)
    rows = data.get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(
            f"{path}: expected `rows:` with one line `- {{a_mm: 0, d_mm: 100, alpha_deg: 90, "
            "theta_deg: 0}` for each joint."
        )
    entries = [(str(document.place_of(("rows", i))), row) for i, row in enumerate(rows)]
    return _table(entries, str(path), data.get("convention"))


def _table(rows: list[tuple[str, Mapping[str, Any]]], path: str, convention: Any) -> _Table:
    """The table of rows, each with its place for messages."""
    if not rows:
        raise InputError(f"{path}: the table has no rows. Write one for each joint.")
    for where, row in rows:
        if unknown := [key for key in row if key not in _KNOWN]:
            hint = nearest(unknown[0], _KNOWN, noun="column")
            what = f"unknown column {unknown[0]}.{hint}"
            raise InputError.at(where, what, "The name carries the unit.")
    values = {quantity: _column(quantity, rows) for quantity in _COLUMNS}
    conventions = {str(row["convention"]) for _, row in rows if "convention" in row}
    conventions |= set() if convention is None else {str(convention)}
    if len(conventions) > 1 or not conventions <= set(CONVENTIONS):
        raise InputError(
            f"{path}: convention {', '.join(sorted(conventions))}; expected one of "
            f"{', '.join(CONVENTIONS)} for the whole table."
        )
    fixed = [where for where, row in rows if row.get("joint") == "fixed"]
    if fixed and fixed != [rows[-1][0]]:
        what = "only the last row may be fixed."
        raise InputError.at(fixed[0], what, "Add this one to the row of a joint.")
    return _Table(values, bool(fixed), conventions.pop() if conventions else CONVENTIONS[0])


def _column(quantity: str, rows: list[tuple[str, Mapping[str, Any]]]) -> Array:
    """(rows,) [m, rad, rad/s] values of a quantity; nan where not stated."""
    units = _COLUMNS[quantity]
    values = np.full(len(rows), np.nan)
    for i, (where, row) in enumerate(rows):
        names = [name for name in units if name in row]
        if len(names) > 1:
            raise InputError(f"{where}: {names[0]} and {names[1]} state the same. Remove one.")
        if not names and quantity in _REQUIRED:
            raise InputError(f"{where}: no {' or '.join(units)}. Add it; a zero is written out.")
        if names:
            values[i] = _number(row[names[0]], names[0], where) * units[names[0]]
    return values


def _number(value: Any, name: str, where: str) -> float:
    try:
        number = float("nan") if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not np.isfinite(number):
        raise InputError(f"{where}: {name} = {value!r} is no number. Write it as 89.159 or 0.5.")
    return number

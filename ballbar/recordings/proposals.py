"""Meaning of a table's columns by its head: joint angles, measured values, units, sigma.

Proposals for the person who describes the table; nothing here is used when it is read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ballbar.acquisition.declared_columns import selectors_of
from ballbar.acquisition.faults.nominal_robot import judged, spread_of
from ballbar.acquisition.formats.table_file import FileKind
from ballbar.acquisition.table.header import PREAMBLE
from ballbar.acquisition.table.quantities import header_names, quantities, read_rows, split_unit
from ballbar.acquisition.table.text import SEPARATORS, LogText, is_number, split_fields
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import LogError
from ballbar.cell.file_units import METRES
from ballbar.cell.instruments.base import Kind
from ballbar.cell.rigid_fit import nominal_frames

_SUFFIX = re.compile(r"(.+)_(mm|cm|um|deg|rad|m)")
_JOINT = re.compile(
    r"joint|axis|achse|gelenk|^[ajq][ _]?\d|_q_|^theta|rax|aipos|robax", re.IGNORECASE
)
_UR = (
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
    *("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
)
_SPELT = {"length": r"(?:bar[ _]?)?(?:length|len|dist|distance|l|d)"}  # names of other values
_ROTATIONS = (  # names of the three angles, or four numbers, of a rotation
    ("rx", "ry", "rz"),
    ("roll", "pitch", "yaw"),
    ("a", "b", "c"),
    ("qw", "qx", "qy", "qz"),
    ("qx", "qy", "qz", "qw"),
)
_MEASURED = re.compile(r"meas|actual|ist", re.IGNORECASE)
_SIGMA = ("std_{}", "{}_std", "sigma_{}", "{}_sigma", "s_{}", "sd_{}", "{}_sd")
_SPREAD = 1.6  # times; positions in the right unit spread as the flange does, to about this


@dataclass(frozen=True)
class ColumnNames:
    """The columns of a table: names, or numbers from 1 where it has no header."""

    names: tuple[str, ...]
    counted: bool  # no header

    @property
    def words(self) -> str:
        """The names as one line of text."""
        return f"1 to {len(self.names)}" if self.counted else ", ".join(self.names)


def column_names(text: LogText) -> ColumnNames:
    """Names of the columns of a table; the header is the first line as wide as the last ones."""
    last = text.lines[-1]

    def numbers(separator: str) -> int:
        """How many fields are numbers, if most are."""
        cells = split_fields(last, separator)
        count = sum(map(is_number, cells))
        return count if count * 2 > len(cells) else 0

    separator = max(SEPARATORS, key=lambda s: (numbers(s), s != " "))
    width = len(split_fields(last, separator))
    for line in text.lines[: PREAMBLE + 1]:
        cells = split_fields(line, separator)
        if len(cells) == width and not any(map(is_number, cells)):
            return ColumnNames(tuple(cells), counted=False)
    return ColumnNames(tuple(str(k + 1) for k in range(width)), counted=True)


def joint_columns(columns: ColumnNames, axes: int) -> list[tuple[str, ...]]:
    """Columns that may hold the angles of `axes` axes, the likeliest first."""
    names = columns.names
    if columns.counted:
        return [names[:axes]] if len(names) >= axes else []
    if axes == len(_UR) and set(_UR) <= set(names):
        return [_UR]
    fitting = [
        family
        for form, family in counting(names).items()
        if len(family) == axes and _JOINT.search(form.replace("#", "1"))
    ]
    return sorted(fitting, key=lambda family: not _MEASURED.search(family[0]))


def counting(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Names that differ in one number that counts on, by their form with # in its place."""
    families: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        bare = _bare(name)
        for number in re.finditer(r"\d+", bare):
            form = f"{bare[: number.start()]}#{bare[number.end() :]}"
            families.setdefault(form, []).append((int(number[0]), name))
    ordered = {form: sorted(members) for form, members in families.items()}
    return {
        form: tuple(name for _, name in members)
        for form, members in ordered.items()
        if [n for n, _ in members] == list(range(members[0][0], members[0][0] + len(members)))
    }


def value_columns(columns: ColumnNames, kind: Kind, used: Sequence[str]) -> list[tuple[str, ...]]:
    """Columns that may hold what was measured; used : columns that hold something else."""
    names = [name for name in columns.names if name not in used]
    count = 3 if kind.target_turns else kind.columns
    if columns.counted:
        seen = [tuple(names[:count])] if len(names) >= count else []
    elif kind.names[:3] == ("x", "y", "z"):
        seen = _positions(names)
    else:
        forms = [re.compile(_SPELT.get(n, re.escape(n)), re.IGNORECASE) for n in kind.names]
        fitting = [[name for name in names if form.fullmatch(_bare(name))] for form in forms]
        seen = list(product(*fitting))
    if not kind.target_turns:
        return seen
    return [(*xyz, *turn) for xyz in seen if (turn := _rotation(columns, xyz))]


def _positions(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Triples of names that say x, y and z, those that say `measured` alone if there are any."""
    triples = []
    for name in names:
        for x in re.finditer(r"(?<![A-Za-z])[xX](?![A-Za-z])", name):
            others = [
                name[: x.start()] + other + name[x.end() :]
                for other in ("yz" if x[0] == "x" else "YZ")
            ]
            if all(other in names for other in others):
                triples.append((name, *others))
    triples = [t for t in triples if not re.search(r"std|sigma|goal|target|nominal", t[0], re.I)]
    return [triple for triple in triples if _MEASURED.search(triple[0])] or triples


def _rotation(columns: ColumnNames, position: Sequence[str]) -> tuple[str, ...]:
    """Columns of the rotation that belongs to three columns of a position; empty if not seen."""
    names = columns.names
    if columns.counted:
        behind = [name for name in names if int(name) > int(position[-1])]
        return tuple(behind[: 4 if len(behind) == 4 else 3]) if len(behind) >= 3 else ()
    x = _bare(position[0]).lower()
    bare = {name: _bare(name).lower() for name in names}
    for rotation in _ROTATIONS:
        chosen = []
        for part in rotation:
            spelt = (part, re.sub(r"(?<![A-Za-z])x(?![A-Za-z])", part, x))
            matching = [name for name in names if bare[name] in spelt]
            if len(matching) == 1 and matching[0] not in position:
                chosen.append(matching[0])
        if len(chosen) == len(rotation):
            return tuple(chosen)
    following = names[names.index(position[-1]) + 1 :][:4]  # a quaternion, such as ov_x to ov_w
    order = "".join(name[-1:].lower() for name in following)
    alone = len({name[:-1] for name in following}) == 1  # stem of all names
    return tuple(following) if alone and order in ("xyzw", "wxyz") else ()


def sigma_columns(columns: ColumnNames, values: Sequence[str]) -> tuple[str, ...]:
    """Columns with the standard deviation of each of the values; empty if not seen."""
    for form in _SIGMA:
        chosen = []
        for value in values:
            head, _, tail = value.rpartition("_")
            inside = f"{head}_{form.format(tail)}" if head else form.format(tail)
            spelt = (form.format(value), inside)
            chosen += [name for name in dict.fromkeys(spelt) if name in columns.names][:1]
        if len(chosen) == len(values) and not set(chosen) & set(values):
            return tuple(chosen)
    return ()


def named_column(columns: ColumnNames, pattern: str) -> str | None:
    """The only column whose name matches an expression."""
    if columns.counted:
        return None
    names = [name for name in columns.names if re.search(pattern, name, re.IGNORECASE)]
    return names[0] if len(names) == 1 else None


def stated_unit(names: Sequence[str]) -> str | None:
    """The unit that all names state, as the header writes it or behind an underscore."""
    units = {_parts(name)[1] for name in names}
    return units.pop() if len(units) == 1 else None


def column_values(text: LogText, kind: FileKind, columns: Sequence[str | int]) -> Array:
    """(N, C) numbers of columns in their own units, rows with empty fields left out.

    Raises LogError if they are none.
    """
    chosen = quantities(columns, header_names(text))
    selectors = list(dict.fromkeys(selectors_of(chosen)))
    values = read_rows(text, kind, selectors, selectors).numbers(chosen)
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        raise LogError(f"{text.file}: no row has numbers in {', '.join(map(str, columns))}.")
    return values


def angle_unit(angles: Array) -> tuple[str, bool]:
    """Unit of joint angles (N, J) [rad or deg] by their range, and whether there is no doubt."""
    largest = float(np.abs(angles).max())
    return ("deg", True) if largest > 4.0 * np.pi else ("rad", False)


def length_unit(robot: Robot, q: Array, points: Array) -> str | None:
    """Unit in which points (M, 3) spread as the robot's flange does at angles q (N, J) [rad].

    None if the robot hardly moves, or none fits.
    """
    expected = spread_of(nominal_frames(robot, q[judged(len(q))]).tip.T)
    spread = spread_of(points[judged(len(points))])
    if expected < 0.05 or spread == 0.0:  # [m]
        return None
    ratios = {unit: abs(np.log(spread * scale / expected)) for unit, scale in METRES.items()}
    best = min(ratios, key=ratios.__getitem__)
    return best if ratios[best] < np.log(_SPREAD) else None


def _bare(name: str) -> str:
    return _parts(name)[0]


def _parts(name: str) -> tuple[str, str | None]:
    """A name without its unit, as the header writes it or behind an underscore, and the unit."""
    bare, unit = split_unit(name)
    suffix = _SUFFIX.fullmatch(name) if bare == name else None
    return (suffix[1], suffix[2]) if suffix else (bare, unit)

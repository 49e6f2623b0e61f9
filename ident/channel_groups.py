"""Channels of a log that belong together: coordinates, quaternions, angular rates.

Names show them: `x, y, z`, `pos_x, pos_y, pos_z`, `tx_mm ...`; four that end in x, y, z, w are a
quaternion if their squares add up to one. Three channels beside a quaternion are coordinates
whatever their names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ballbar.cell.errors import LogError
from ballbar.cell.logs import ChannelLog

Names = tuple[str, ...]
Group = tuple[Names, Names]  # channels of A and of B: 1, 3, 4 (a quaternion) or 7 (both)
_PART = re.compile(r"(.*?)[_. ]?([xyzw])(?:[_ \[(]+[a-z/0-9^]+[\])]?)?", re.IGNORECASE)
_RATES = re.compile(r".*(gyro|omega|ang.*vel|angular|rate).*|[wg]", re.IGNORECASE)
_ANGLES = re.compile(r".*(rot|euler|rpy|angle).*|[rabc]", re.IGNORECASE)  # no vectors
UNIT = 0.05  # the norm of a quaternion is 1 to within that
_FITTING = {(1, 1), (3, 3), (4, 4), (7, 7), (7, 3), (3, 7), (4, 3), (3, 4)}


def checked_groups(a: ChannelLog, b: ChannelLog, groups: Sequence[Group]) -> None:
    """Raises LogError unless the channels exist, once each, and each group fits its other."""
    for log, side in ((a, 0), (b, 1)):
        names = [name for group in groups for name in group[side]]
        for name in names:
            if name not in log.names:
                what = f"no channel {name!r}; it has {', '.join(log.names)}."
                raise LogError.at(log.name, what, "Name one of them.")
            if names.count(name) > 1:
                what = f"channel {name!r} is named {names.count(name)} times."
                raise LogError.at(log.name, what, "Pair each channel once.")
    for of_a, of_b in groups:
        if (len(of_a), len(of_b)) not in _FITTING:
            raise LogError(
                f"{','.join(of_a)} of {a.name} and {','.join(of_b)} of {b.name} are no pair: three "
                "coordinates, four numbers of a quaternion (x, y, z, w), three angular rates "
                "against four, or seven against seven or three."
            )


def groups_by_name(a: ChannelLog, b: ChannelLog) -> list[Group]:
    """Coordinates, quaternions and rates that both logs hold, as far as their names show them."""
    (points_a, turns_a, rates_a), (points_b, turns_b, rates_b) = _vectors(a), _vectors(b)
    points, turns = _paired(points_a, points_b), _paired(turns_a, turns_b)
    if len(points) == 1 and len(turns) == 1:
        return [(points[0][0] + turns[0][0], points[0][1] + turns[0][1])]
    if len(points) == 1 and len(turns_a) + len(turns_b) == 1:  # its lever arm turns with one log
        (of_a, of_b), others = points[0], rates_b if turns_a else rates_a
        if not others:
            return [(of_a + (turns_a or [()])[0], of_b + (turns_b or [()])[0])]
    rates = _paired(rates_a, rates_b)
    if not turns and not rates:
        rates = _paired(turns_a, rates_b) + _paired(rates_a, turns_b)
    return points + turns + rates


def _paired(a: list[Names], b: list[Names]) -> list[Group]:
    """Groups of equal names, or the only ones of both logs."""
    equal = [(names, names) for names in a if names in b]
    return equal or (list(zip(a, b, strict=True)) if len(a) == len(b) == 1 else [])


def _vectors(log: ChannelLog) -> tuple[list[Names], list[Names], list[Names]]:
    """The coordinates, quaternions and angular rates of one log."""
    stems: dict[str, dict[str, str]] = {}
    for name in log.names:
        if match := _PART.fullmatch(name):
            stems.setdefault(match[1], {})[match[2].lower()] = name
    points, turns, rates = list[Names](), list[Names](), list[Names]()
    for stem, parts in stems.items():
        if all(axis in parts for axis in "xyz"):
            names = tuple(parts[axis] for axis in "xyz")
            if "w" in parts and is_quaternion(log, (*names, parts["w"])):
                turns.append((*names, parts["w"]))
            elif "w" not in parts and not _ANGLES.fullmatch(stem):
                (rates if _RATES.fullmatch(stem) else points).append(names)
    others = tuple(n for n in log.names if not any(n in names for names in (*turns, *rates)))
    if len(turns) == 1 and not points and len(others) == 3:
        points.append(others)
    return points, turns, rates


def is_quaternion(log: ChannelLog, names: Names) -> bool:
    """Whether the squares of four channels add up to one in most rows."""
    norm = np.linalg.norm(log.values[:, [log.names.index(name) for name in names]], axis=1)
    return bool((np.abs(norm - 1.0) < UNIT).mean() > 0.5)

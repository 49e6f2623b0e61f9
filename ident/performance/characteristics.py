"""Characteristics of a robot as they are listed: measured, predicted, or not stated, and why."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from ballbar.cell.arrays import Array
from ballbar.ident.performance.iso_230_4 import CircularTest

Origin = Literal["measured", "predicted", "not stated"]
ROBOTS = ("nominal", "identified", "corrected")
ISO_9283, ISO_230_4 = "ISO 9283:1998", "ISO 230-4:2005"
CIRCULAR = ("G", "G_cw", "G(b)", "F_max", "F_min", "RONt")  # symbols of a circular test
# Name and source of each symbol, without its index; clauses of drift and circles are not cited
NAMES = {
    "AP": ("pose accuracy", f"{ISO_9283}, 7.2.1"),
    "RP": ("pose repeatability", f"{ISO_9283}, 7.2.2"),
    "vAP": ("multi-directional pose accuracy variation", f"{ISO_9283}, 7.2.3"),
    "AD": ("distance accuracy", f"{ISO_9283}, 7.3"),
    "RD": ("distance repeatability", f"{ISO_9283}, 7.3"),
    "dAP": ("drift of pose accuracy", ISO_9283),
    "dRP": ("drift of pose repeatability", ISO_9283),
    "AT": ("path accuracy", f"{ISO_9283}, 8.2"),
    "RT": ("path repeatability", f"{ISO_9283}, 8.3"),
    "G": ("circular deviation", ISO_230_4),
    "G(b)": ("bi-directional circular deviation", ISO_230_4),
    "F": ("radial deviation", ISO_230_4),
    "RONt": ("roundness about the least-squares circle", "ISO 12181-1"),
}
INDICES = {"a": "about x", "b": "about y", "c": "about z", "cw": "clockwise"}
INDICES |= {"max": "largest", "min": "least"}


@dataclass(frozen=True)
class Statement:
    """A value of one characteristic with its 95 % interval, or why none is stated."""

    origin: Origin
    value: float | None = None  # [m, rad]
    low: float | None = None  # ends of the interval; None: not known
    high: float | None = None
    reason: str = ""  # why it is not stated, or what to mind


Statements = tuple[Statement, ...]  # of the robots in the order of ROBOTS


def not_stated(reason: str) -> Statement:
    """No value, and why."""
    return Statement("not stated", reason=reason)


@dataclass(frozen=True)
class Characteristic:
    """One characteristic at one place, of the robot nominal, identified and corrected."""

    symbol: str  # one of NAMES, and behind an underscore its index
    place: str  # pose, pair of poses, path or circle
    statements: Statements
    cycles: int = 0  # that were measured

    @property
    def order(self) -> tuple[int, str]:
        """By which rows are listed: the order of NAMES, then that of indices."""
        head, _, index = self.symbol.partition("_")
        return list(NAMES).index(head), INDICES.get(index, "")

    @property
    def name(self) -> str:
        """In words, as the standard has it."""
        head, _, index = self.symbol.partition("_")
        return ", ".join(filter(None, (NAMES[head][0], INDICES.get(index))))

    @property
    def clause(self) -> str:
        """The standard, with the clause where it is cited."""
        return NAMES[self.symbol.partition("_")[0]][1]

    @property
    def unit(self) -> Literal["m", "rad"]:
        """Unit of the values."""
        return "rad" if self.symbol[-2:] in ("_a", "_b", "_c") else "m"


@dataclass(frozen=True, eq=False)
class Performance:
    """All that is stated of one robot, and what it was stated at."""

    rows: tuple[Characteristic, ...]
    notes: tuple[str, ...] = ()
    circles: tuple[tuple[str, CircularTest], ...] = ()  # each with its place
    side: float | None = None  # [m] edge of the test cube; None where there is none
    poses: Array | None = None  # (5, 4, 4) P1 to P5, robot base frame
    axes: Array | None = None  # (5, J) [rad] angles of the controller's axes there


def merged(
    measured: Iterable[Characteristic], predicted: Iterable[Characteristic]
) -> tuple[Characteristic, ...]:
    """Measured rows, what they do not state taken from predicted ones of the same place, and the
    other predicted rows, symbol after symbol.

    What was measured anywhere is not listed as not stated once more.
    """
    others, rows = {(row.symbol, row.place): row for row in predicted}, []
    for row in measured:
        other = others.pop((row.symbol, row.place), row).statements
        pairs = zip(row.statements, other, strict=True)
        stated = tuple(b if a.value is None and b.value is not None else a for a, b in pairs)
        rows.append(replace(row, statements=stated))
    symbols = {row.symbol for row in rows}
    for row in others.values():
        if row.symbol not in symbols or any(each.value is not None for each in row.statements):
            rows.append(row)
    return tuple(sorted(rows, key=lambda row: row.order))

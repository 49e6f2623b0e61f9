"""Characteristics of a robot as they are listed: measured, predicted, or not stated, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from ballbar.cell.arrays import Array
from ballbar.ident.performance.iso_230_4 import CircularTest

CIRCULAR = ("G", "G_cw", "G(b)", "F_max", "F_min", "RONt")  # symbols of a circular test
Origin = Literal["measured", "predicted", "not stated"]
Robots = Literal["nominal", "identified", "corrected"]
ROBOTS: tuple[Robots, ...] = ("nominal", "identified", "corrected")
ISO_9283, ISO_230_4 = "ISO 9283:1998", "ISO 230-4:2005"

# Name and clause of each symbol; clauses of the drift and of circular tests are not cited
NAMES = {
    "AP_p": ("pose accuracy, position", f"{ISO_9283}, 7.2.1"),
    "AP_a": ("pose accuracy, orientation about x", f"{ISO_9283}, 7.2.1"),
    "AP_b": ("pose accuracy, orientation about y", f"{ISO_9283}, 7.2.1"),
    "AP_c": ("pose accuracy, orientation about z", f"{ISO_9283}, 7.2.1"),
    "RP_l": ("pose repeatability, position", f"{ISO_9283}, 7.2.2"),
    "RP_a": ("pose repeatability, orientation about x", f"{ISO_9283}, 7.2.2"),
    "RP_b": ("pose repeatability, orientation about y", f"{ISO_9283}, 7.2.2"),
    "RP_c": ("pose repeatability, orientation about z", f"{ISO_9283}, 7.2.2"),
    "vAP_p": ("multi-directional pose accuracy variation", f"{ISO_9283}, 7.2.3"),
    "AD_p": ("distance accuracy", f"{ISO_9283}, 7.3"),
    "RD": ("distance repeatability", f"{ISO_9283}, 7.3"),
    "dAP_p": ("drift of pose accuracy", ISO_9283),
    "dRP_l": ("drift of pose repeatability", ISO_9283),
    "AT_p": ("path accuracy, position", f"{ISO_9283}, 8.2"),
    "RT_p": ("path repeatability, position", f"{ISO_9283}, 8.3"),
    "G": ("circular deviation, counter-clockwise", ISO_230_4),
    "G_cw": ("circular deviation, clockwise", ISO_230_4),
    "G(b)": ("bi-directional circular deviation", ISO_230_4),
    "F_max": ("radial deviation, largest", ISO_230_4),
    "F_min": ("radial deviation, least", ISO_230_4),
    "RONt": ("roundness, least-squares circle", "ISO 12181-1"),
}


@dataclass(frozen=True)
class Statement:
    """A value of one characteristic with its 95 % interval, or why none is stated."""

    origin: Origin
    value: float | None = None  # [m, rad]
    low: float | None = None  # ends of the interval; None: not known
    high: float | None = None
    reason: str = ""  # why it is not stated, or what to mind


def not_stated(reason: str) -> Statement:
    """No value, and why."""
    return Statement("not stated", reason=reason)


@dataclass(frozen=True)
class Characteristic:
    """One characteristic at one place, of the robot nominal, identified and corrected."""

    symbol: str  # a key of NAMES
    place: str  # pose, pair of poses, path or circle
    statements: dict[Robots, Statement]
    cycles: int = 0  # that were measured

    @property
    def name(self) -> str:
        """In words, as the standard has it."""
        return NAMES[self.symbol][0]

    @property
    def clause(self) -> str:
        """The standard, with the clause where it is cited."""
        return NAMES[self.symbol][1]

    @property
    def stated(self) -> bool:
        """Whether there is a value for any of the robots."""
        return any(each.value is not None for each in self.statements.values())

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

    def of(self, symbol: str, place: str = "") -> tuple[Characteristic, ...]:
        """The rows of one symbol, at one place or at all."""
        return tuple(r for r in self.rows if r.symbol == symbol and place in ("", r.place))


def merged(
    measured: Sequence[Characteristic], predicted: Sequence[Characteristic]
) -> tuple[Characteristic, ...]:
    """Measured rows, what they do not state taken from predicted ones of the same place, and the
    other predicted rows, symbol after symbol.

    What was measured anywhere is not listed as not stated once more.
    """
    others = {(row.symbol, row.place): row for row in predicted}
    rows = []
    for row in measured:
        other = others.pop((row.symbol, row.place), row).statements
        stated = {
            robot: other[robot] if each.value is None and other[robot].value is not None else each
            for robot, each in row.statements.items()
        }
        rows.append(replace(row, statements=stated))
    symbols = {row.symbol for row in measured}
    rest = [r for r in others.values() if r.stated or r.symbol not in symbols]
    order = list(NAMES)
    return tuple(sorted((*rows, *rest), key=lambda row: order.index(row.symbol)))


@dataclass
class Listing:
    """Rows as they are gathered."""

    rows: list[Characteristic] = field(default_factory=list)

    def add(
        self, symbol: str, place: str, statements: Sequence[Statement], *, cycles: int = 0
    ) -> None:
        """Add a row; statements : of the nominal, identified and corrected robot."""
        stated = dict(zip(ROBOTS, statements, strict=True))
        self.rows.append(Characteristic(symbol, place, stated, cycles))

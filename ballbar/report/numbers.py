"""Numbers as the report prints them: digits that follow the uncertainty, a true minus sign."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.number_text import significant_text
from ballbar.units import MM, UM

MISSING = "\u2013"
# of a degree: below a hundredth of an encoder step (3600 lines, 12 bits: 2.4e-5 deg)
_MOST_DECIMALS = 7


def decimals_for(sigmas: Iterable[float], *, digits: int) -> int:
    """Decimals that show the smallest of `sigmas` with so many digits; 3 where none is usable."""
    usable = [abs(s) for s in sigmas if math.isfinite(s) and s != 0.0]
    if not usable:
        return 3
    return min(_MOST_DECIMALS, max(0, digits - 1 - math.floor(math.log10(min(usable)))))


def fixed(value: float | None, decimals: int, *, sign: bool = False) -> str:
    """A number with so many decimals; a dash for None or what is no number."""
    if value is None or not math.isfinite(value):
        return MISSING
    rounded = round(value, decimals) + 0.0  # + 0.0: no minus sign before a zero
    text = f"{rounded:{'+' if sign and rounded else ''}.{decimals}f}"
    return text.replace("-", "\u2212")


def significant(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """A number with so many significant digits, without exponent; 0 where it is below rounding."""
    if value is None or not math.isfinite(value):
        return MISSING
    return significant_text(value, digits, sign=sign).replace("-", "\u2212")


def to_sigma(value: float, sigma: float) -> str:
    """A number down to the second digit of its standard deviation."""
    return fixed(value, decimals_for([sigma], digits=2))


def length_scale(largest: float) -> tuple[float, str]:
    """(factor, unit) in which a length [m] up to `largest` is readable: mm, or um below 0.1 mm."""
    return (MM, "mm") if largest >= 1e-4 else (UM, "µm")


def millimetres(length: float) -> str:
    """A length [m] in mm, to three digits."""
    return f"{significant(length * MM)} mm"


def with_and_without(sigma: Array, without_scale: Array, cell: Cell, *, times: float = 1.0) -> str:
    """Mean stated TCP uncertainty with the scale and without it, and where the scale comes from.

    sigma, without_scale : (G,) [m] standard deviations. times : standard deviations to state.
    """
    source = "plate and rod" if cell.ballbar.stroke is None else "the sensed length"
    with_scale, without = (millimetres(times * s.mean()) for s in (sigma, without_scale))
    return f"{with_scale} with the scale of {source}, {without} without it"


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`; empty without names."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1]))) if names else ""


def capitalised(sentence: str) -> str:
    """A sentence with its first letter large, the others as they are."""
    return sentence[:1].upper() + sentence[1:]

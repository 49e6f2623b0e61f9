"""A gear turns further than its logged angle, by one factor: another ratio than the file's.

A ratio of teeth is exact, so a machine needs none of this: the file is of another gear, or the log
scales its angles otherwise. Where an axis turns the wrist's gears through a coupling, the factor is
that of the motor behind the gear.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade

GEAR_RATIO = "gear_ratio"
SPREAD = 1e-3  # of a ratio that is stated with three digits; assumed


@remade
def gear_ratio(
    cell: Cell, encoders: tuple[int, ...], gears: Sequence[int] | None = None
) -> Correction:
    """Relative errors [1] of the ratios of gears, from 0; by default of all."""
    chosen = tuple(range(cell.robot.joints)) if gears is None else tuple(gears)
    coefficients = tuple(Coefficient(f"ratio{i + 1}", "1", 0.0, SPREAD, GEAR + i) for i in chosen)

    def regressors(state: State) -> list[Array]:
        return [state.gears[i] for i in chosen]

    return Correction(GEAR_RATIO, "gear ratios other than stated", coefficients, regressors)


def gears_of(names: Iterable[str]) -> list[int]:
    """The gears, from 0, of coefficients by their names.

    Raises InputError for a name that is none of this correction's.
    """
    gears = []
    for name in names:
        number = name.removeprefix("ratio")
        if number == name or not number.isdecimal() or number.startswith("0"):
            raise InputError(f"corrections.{GEAR_RATIO}.{name}: expected ratio2 or similar")
        gears.append(int(number) - 1)
    return gears

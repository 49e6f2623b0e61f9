"""A gear turns further than its logged angle, by one factor: another ratio than the file's.

A ratio of teeth is exact, so a machine needs none of this: the file is of another gear, or the log
scales its angles otherwise. Where an axis turns the wrist's gears through a coupling, the factor is
that of the motor behind the gear.
"""

from __future__ import annotations

from cell.arrays import Array
from cell.descriptions import Cell
from ident.corrections.base import GEAR, Coefficient, Correction, State, remade

GEAR_RATIO = "gear_ratio"
SPREAD = 1e-3  # of a ratio that is stated with three digits; assumed


@remade
def gear_ratio(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Relative errors [1] of the ratios of all gears."""
    coefficients = tuple(
        Coefficient(f"ratio{i + 1}", "1", 0.0, SPREAD, GEAR + i) for i in range(cell.robot.joints)
    )

    def regressors(state: State) -> list[Array]:
        return list(state.gears)

    return Correction(GEAR_RATIO, "gear ratios other than stated", coefficients, regressors)

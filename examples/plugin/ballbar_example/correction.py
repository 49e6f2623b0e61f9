"""The sensor of axis 1 is not linear: actual angle = shown angle + bend * (shown angle)^2."""

from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction


def bent_scale(_cell: Cell, _encoders: tuple[int, ...]) -> Correction:
    """The correction with its one coefficient."""
    bend = Coefficient("bend1", "1/rad", mean=0.0, sigma=1e-3, channel=GEAR)
    return Correction("bent_scale", "bent scale of axis 1", (bend,), lambda s: [s.gears[0] ** 2])

"""The nominal cell of a scenario, and the instrument in it that measures a length."""

from __future__ import annotations

from pathlib import Path

from cell.descriptions import Cell
from cell.instrument import Instrument
from cell.load import load_cell, load_instrument, load_plate, load_robot, load_telescoping_bar
from sim.settings import CellSettings


def scenario_cell(chosen: CellSettings, *, relative_to: Path | None = None) -> Cell:
    """The descriptions that a scenario names; an instrument as a massless ball-bar.

    relative_to : folder of the scenario. Raises DescriptionError.
    """
    if chosen.ballbar is not None:
        return load_cell(chosen.robot, chosen.ballbar, chosen.plate, relative_to=relative_to)
    return Cell(
        load_robot(chosen.robot, relative_to=relative_to),
        load_telescoping_bar(chosen.measured_by, relative_to=relative_to),
        load_plate(chosen.plate, relative_to=relative_to),
    )


def scenario_instrument(
    chosen: CellSettings, *, relative_to: Path | None = None
) -> Instrument | None:
    """The instrument that measures a length; None for a ball-bar. Raises DescriptionError."""
    if chosen.instrument is None:
        return None
    return load_instrument(chosen.instrument, relative_to=relative_to)

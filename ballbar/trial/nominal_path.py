"""Cell, nominal geometry and reference path of a scenario: all that does not depend on its seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.recording import read_recording
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_geometry
from ballbar.cell.logs import RobotLog
from ballbar.sim.path import ReferencePath
from ballbar.sim.path_files import scenario_path
from ballbar.sim.settings import CellSettings, PathSettings
from ballbar.sim.true_robot import scenario_cell


def recorded_log(path: PathSettings, folder: Path) -> RobotLog | None:
    """Robot log of the recording that a scenario's path repeats; None for every other kind of path.

    folder : folder of the scenario file, to which `path.recording` is relative.

    Raises InputError for a recording that cannot be read.
    """
    return read_recording(folder / path.recording).robot_log if path.kind == "recorded" else None


def nominal_path(
    cell: CellSettings, path: PathSettings, folder: Path
) -> tuple[Cell, Geometry, ReferencePath]:
    """The cell, its nominal geometry, and the path along which the nominal mechanism closes.

    folder : folder of the scenario file, to which the names of other files are relative.

    Raises InputError for a file that cannot be read or a path that the mechanism cannot follow.
    """
    loaded = scenario_cell(cell, relative_to=folder)
    nominal = nominal_geometry(loaded, cell.position)
    log = recorded_log(path, folder)
    return loaded, nominal, scenario_path(path, loaded, nominal, relative_to=folder, recorded=log)


def spread_rows(path: ReferencePath, count: int) -> NDArray[np.intp]:
    """(min(count, N),) rows of a path of N instants, evenly spread from the first to the last."""
    last = path.t.size - 1
    return np.linspace(0, last, min(count, last + 1)).round().astype(np.intp)

"""One short recording for all tests that need one: MuJoCo plant, 60 s, every encoder."""

from __future__ import annotations

import gc
from collections.abc import Generator

import numpy as np
import pytest

from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_geometry
from ballbar.cell.load import load_cell
from tests.helpers.simulated_recordings import Recorded, record


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """No garbage is looked for among half a million objects of the imports: all of them stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("run") / "recording")


@pytest.fixture(scope="session")
def cell() -> Cell:
    return load_cell("irb2400", "lund_600", "plate_250")


@pytest.fixture(scope="session")
def nominal(cell: Cell) -> Geometry:
    return nominal_geometry(cell, np.array([0.70, 0.0, 0.54]))

"""The mechanism of thesis Table 3.1, exactly sampled along the minute."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.sim.errors.static_errors import THESIS_3_1
from ballbar.sim.path import ReferencePath
from tests.helpers.synthetic_recording import NOMINAL, closed, minute


@pytest.fixture(scope="session")
def path() -> ReferencePath:
    return minute(0.01)


@pytest.fixture(scope="session")
def true() -> Geometry:
    return NOMINAL.replaced({name: NOMINAL[name] + e * 1e-3 for name, e in THESIS_3_1.items()})


@pytest.fixture(scope="session")
def exact(path: ReferencePath, true: Geometry) -> dict[str, Array]:
    """400 noise-free samples: q (400, 6) and b (400, 5) [rad]."""
    some = np.linspace(200, path.t.size - 200, 400).round().astype(int)
    return {"q": closed(true, path.b[some], path.q[some]), "b": path.b[some]}

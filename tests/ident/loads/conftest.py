"""The minute's loads, where the robot moves."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.known_loads import Motion, motion_at


@pytest.fixture(scope="session")
def moving() -> Motion:
    """400 instants while the robot moves."""
    return motion_at(np.linspace(3.0, 57.0, 400))

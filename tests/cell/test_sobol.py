"""The Sobol points of the accuracy grid are those of SciPy, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from cell.sobol import MOST, sobol


@pytest.mark.parametrize("dimensions", range(1, MOST + 1))
@pytest.mark.parametrize("seed", [1, 2400])
def test_points_are_those_of_scipy(dimensions: int, seed: int) -> None:
    theirs = qmc.Sobol(d=dimensions, scramble=True, rng=np.random.default_rng(seed)).random(1024)
    assert np.array_equal(sobol(1024, dimensions, np.random.default_rng(seed)), theirs)


def test_each_half_of_every_axis_holds_half_of_the_points() -> None:
    points = sobol(256, 6, np.random.default_rng(3))
    assert ((points < 0.5).sum(axis=0) == 128).all()


def test_more_dimensions_than_there_are_polynomials_are_refused() -> None:
    with pytest.raises(ValueError, match="at most 8 dimensions"):
        sobol(8, MOST + 1, np.random.default_rng(1))

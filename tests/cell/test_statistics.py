"""Quantiles against scipy.stats."""

from __future__ import annotations

import pytest
from scipy.stats import chi2

from ballbar.cell.statistics import chi_square_quantile


@pytest.mark.parametrize("freedom", [1, 2.5, 3, 60])
@pytest.mark.parametrize("probability", [0.001, 0.5, 0.95])
def test_a_quantile_of_chi_square_is_that_of_scipy(probability: float, freedom: float) -> None:
    assert chi_square_quantile(probability, freedom) == chi2.ppf(probability, freedom)

"""Lengths at the temperature of a measurement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.descriptions import Expansion
from ballbar.cell.load import load_cell, load_plate
from ballbar.cell.temperature import Temperature, Temperatures, at_temperature, temperature_of

CELL = load_cell("irb2400", "lund_600", "plate_250")
STEEL = Expansion(11.5e-6, 1e-6)


def test_growth_of_an_end_gauge_by_hand() -> None:
    """50 mm of steel at 19.9 degC, known to 0.5 K: the figures of JCGM 100:2008, H.1, by hand."""
    growth, sigma = Temperature(19.9, 0.5, assumed=False).growth(STEEL)
    assert growth == pytest.approx(-1.15e-6)
    assert sigma == pytest.approx(np.sqrt((11.5e-6 * 0.5) ** 2 + (0.1 * 1e-6) ** 2))
    assert Temperature(20.0, 0.0, assumed=False).growth(STEEL) == (0.0, 0.0)


def test_robot_and_instrument_have_the_temperature_of_the_air_unless_they_state_one() -> None:
    stated = Temperatures(temperature_C=22.0, robot_temperature_C=31.0, temperature_sigma_K=0.3)
    assert temperature_of([stated], robot=True) == Temperature(31.0, 0.3, assumed=False)
    assert temperature_of([stated], robot=False) == Temperature(22.0, 0.3, assumed=False)


def test_a_temperature_that_one_of_two_lacks_is_none_and_is_not_invented() -> None:
    known, nothing = Temperatures(temperature_C=22.0), Temperatures()
    assert temperature_of([known, nothing], robot=True) is None
    assert temperature_of([nothing], robot=False) is None
    assert temperature_of([known], robot=True) == Temperature(22.0, 1.0, assumed=True)


def test_half_the_range_of_two_temperatures_adds_to_their_uncertainty() -> None:
    both = [Temperatures(temperature_C=t, temperature_sigma_K=0.4) for t in (22.0, 22.6)]
    found = temperature_of(both, robot=False)
    assert found is not None
    assert (found.value, found.sigma) == pytest.approx((22.3, 0.5))


def test_plate_and_rod_are_longer_and_less_certain() -> None:
    warm = Temperature(30.0, 0.5, assumed=False)
    bar = replace(CELL.ballbar, expansion=Expansion(0.5e-6, 1e-7))
    cell = at_temperature(replace(CELL, ballbar=bar), warm)
    plate, cold = cell.plate, CELL.plate
    assert plate.length - cold.length == pytest.approx(0.250 * 23.1e-5)
    by_heat = 0.250 * np.hypot(23.1e-6 * 0.5, 10.0 * 1e-6)
    assert plate.thermal_sigma == pytest.approx(by_heat)
    assert plate.length_sigma == pytest.approx(np.hypot(cold.length_sigma, by_heat))
    assert cell.ballbar.length == pytest.approx(0.600 * (1.0 + 5e-6))
    assert np.array_equal(np.delete(cell.ballbar.d, 2), np.delete(CELL.ballbar.d, 2))


def test_without_temperature_or_coefficient_nothing_changes() -> None:
    thin = replace(CELL, plate=load_plate("plate_250_thin"))
    assert at_temperature(CELL, None) is CELL
    warm = at_temperature(thin, Temperature(30.0, 0.5, assumed=False))
    assert (warm.plate.length, warm.plate.length_sigma) == (0.250, thin.plate.length_sigma)
    assert warm.ballbar.length == thin.ballbar.length

"""Temperatures of a measurement, and lengths at them: files state lengths at 20 degC (ISO 1).

A length of linear expansion coefficient alpha is longer by the share `alpha (T - 20 K)`, of
standard uncertainty `hypot(alpha u(T), (T - 20 K) u(alpha))` (JCGM 100:2008, 5.1.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import Annotated

import numpy as np
from pydantic import Field

from ballbar.cell.descriptions import Cell, Expansion
from ballbar.cell.schema import NotNegative, Strict

REFERENCE = 20.0  # [deg C]
ASSUMED = 1.0  # [K] standard uncertainty of a temperature for which none is stated

Celsius = Annotated[float, Field(ge=-50.0, le=100.0)]


class Temperatures(Strict):
    """Temperatures of a measurement, as its file states them."""

    temperature_C: Celsius | None = None
    """Temperature of the air about robot and instrument, and of both where they state none."""
    robot_temperature_C: Celsius | None = None
    """Temperature of the robot's arm."""
    instrument_temperature_C: Celsius | None = None
    """Temperature of plate, rod or instrument: their lengths are taken at it."""
    temperature_sigma_K: NotNegative | None = None
    """Standard uncertainty of the temperatures; 1 K if not stated."""


@dataclass(frozen=True)
class Temperature:
    """Temperature of robot or instrument over all measurements of a fit."""

    value: float  # [deg C]
    sigma: float  # [K] standard uncertainty
    assumed: bool  # whether no file states the latter

    def growth(self, expansion: Expansion) -> tuple[float, float]:
        """Share by which a length is longer than at 20 degC, and its standard uncertainty."""
        warmer = self.value - REFERENCE
        sigma = np.hypot(expansion.per_K * self.sigma, warmer * expansion.sigma)
        return expansion.per_K * warmer, float(sigma)


def temperature_of(stated: Sequence[Temperatures], *, robot: bool) -> Temperature | None:
    """Temperature of the robot, or of the instrument; None unless every measurement states it.

    Where they differ, their mean, and half their range adds to the uncertainty.
    """
    own = [s.robot_temperature_C if robot else s.instrument_temperature_C for s in stated]
    pairs = zip(own, stated, strict=True)
    values = [s.temperature_C if value is None else value for value, s in pairs]
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    sigmas = [s.temperature_sigma_K for s in stated]
    sigma = max(ASSUMED if s is None else s for s in sigmas)
    sigma = float(np.hypot(sigma, 0.5 * np.ptp(known)))
    return Temperature(float(np.mean(known)), sigma, None in sigmas)


def growth_at(temperature: Temperature | None, expansion: Expansion | None) -> tuple[float, float]:
    """Share by which a length is longer than at 20 degC, and its standard uncertainty: 0 where
    temperature or coefficient are not stated.
    """
    if temperature is None or expansion is None:
        return 0.0, 0.0
    return temperature.growth(expansion)


def at_temperature(cell: Cell, temperature: Temperature | None) -> Cell:
    """The cell with plate and rod as long as they are, and as uncertain, at a temperature.

    Unchanged without one, or where their files state no coefficient.
    """
    plate, bar = cell.plate, cell.ballbar
    if temperature is None:
        return cell
    if plate.expansion is not None:
        growth, sigma = temperature.growth(plate.expansion)
        by_heat = plate.length * sigma
        plate = replace(
            plate,
            length=plate.length * (1.0 + growth),
            length_sigma=float(np.hypot(plate.length_sigma, by_heat)),
            thermal_sigma=by_heat,
        )
    if bar.expansion is not None:
        growth, sigma = temperature.growth(bar.expansion)
        d = bar.d * np.where(np.arange(len(bar.d)) == 2, 1.0 + growth, 1.0)
        bar = replace(bar, d=d, length_tolerance=hypot(bar.length_tolerance, bar.length * sigma))
    return replace(cell, plate=plate, ballbar=bar)

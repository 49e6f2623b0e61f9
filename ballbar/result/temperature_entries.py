"""Temperatures in calibration.yaml, and the factor that refers lengths to 20 degC."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.cell.schema import NotNegative, Positive, Strict
from ballbar.cell.temperature import Temperatures, temperature_of
from ballbar.result.recording_entries import GrowthEntry
from ballbar.result.run_data import RunData


def growth_entries(growth: dict[str, tuple[float, float]]) -> dict[str, GrowthEntry] | None:
    """Growth of each link and its standard deviation [m]; None where none was fitted."""
    return {
        link: GrowthEntry.model_construct(length_m=size, sigma_m=sigma)
        for link, (size, sigma) in growth.items()
    } or None


class TemperatureEntry(Strict):
    """Temperatures of what was measured. Lengths of the robot in this file are those at them."""

    robot_C: float | None = None
    instrument_C: float | None = None
    sigma_K: NotNegative  # standard uncertainty
    sigma_assumed: bool  # as no file states one
    robot_expansion_per_K: float | None = None  # of the robot's file
    # times which lengths of the robot are those at 20 degC, and its standard uncertainty
    factor_to_20_C: Positive | None = None
    factor_sigma: NotNegative | None = None
    # with which the plate of the robot's file was as long as at instrument_C
    plate_expansion_per_K: float | None = None
    # with which rod, wire, fixture or board of still poses were
    instrument_expansion_per_K: float | None = None


def temperature_entry(data: RunData) -> TemperatureEntry | None:
    """Temperatures of a run; None where not all that was measured states one."""
    stated: Sequence[Temperatures] = [r.recording.description for r in data.recordings]
    stated = stated or [content.description for _, content in data.tables]
    robot, instrument = (temperature_of(stated, robot=of_robot) for of_robot in (True, False))
    if (known := robot or instrument) is None:
        return None
    described = data.identification.robot.identified.description
    expansion = data.identification.robot.robot.expansion
    plate = described.plate.expansion if isinstance(described, Cell) and instrument else None
    factor, sigma = None, None
    own = next((c.expansion for _, c in data.tables if c.expansion is not None), None)
    # the fit knows what is uncertain of a board and of a fixture, and takes rods as exact
    scaled = [g.measured == "length" for _, c in data.tables for g in c.table.groups]
    if robot is not None and expansion is not None:
        growth, sigma = robot.growth(expansion)
        factor = 1.0 / (1.0 + growth)
        if own is not None and instrument is not None and all(scaled):
            sigma = float(np.hypot(sigma, instrument.growth(own)[1]))
    return TemperatureEntry.model_construct(
        robot_C=None if robot is None else robot.value,
        instrument_C=None if instrument is None else instrument.value,
        sigma_K=known.sigma,
        sigma_assumed=known.assumed,
        robot_expansion_per_K=None if expansion is None else expansion.per_K,
        factor_to_20_C=factor,
        factor_sigma=sigma,
        plate_expansion_per_K=None if plate is None else plate.per_K,
        instrument_expansion_per_K=None if own is None else own.per_K,
    )

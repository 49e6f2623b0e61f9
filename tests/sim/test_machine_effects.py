"""Effects of one simulated machine by themselves: gear errors, backlash, bodies, frozen bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ballbar.cell.load import load_cell
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.errors.sensor_effects import encoder_effects
from ballbar.sim.errors.sensor_errors import SensorErrors
from ballbar.sim.plant.effects import PlantEffects, Ripple, plant_effects, stated_masses

CELL = load_cell("irb2400", "lund_600", "plate_250")
TURN = np.repeat(2.0 * np.pi * np.arange(2000)[:, None] / 2000, 6, axis=1)  # of every gear


def machine(**errors: Any) -> PlantEffects:
    return plant_effects(PlantErrors.model_validate(errors), CELL, 1)


def test_every_axis_may_have_a_cycloid_drive() -> None:
    stated = {"amplitude_rad": 1e-4, "waveform": "harmonic", "axes": [1, 2, 3, 4, 5, 6]}
    error = machine(cycloid_ripple=stated).transmission_error(TURN)
    assert np.ptp(error, axis=0) == pytest.approx(np.full(6, 2e-4), rel=1e-3)


def test_a_cusped_ripple_has_no_mean() -> None:
    """A mean would be an offset of the joint."""
    ripple = machine(cycloid_ripple={"amplitude_rad": 1e-4}).transmission_error(TURN)
    assert np.ptp(ripple, axis=0).max() > 1e-4
    assert np.abs(ripple.mean(axis=0)).max() < 1e-15


def test_gears_whose_motors_show_an_angle_are_where_their_error_puts_them() -> None:
    """To rounding, with a harmonic ten times that of a real gear."""
    effects = PlantEffects(ripples=tuple(Ripple(gear, 60.0, 1e-4, 0.3 * gear) for gear in range(6)))
    gears = effects.gear_outputs(TURN)
    shown = gears - effects.transmission_error(gears)
    assert np.abs(shown - TURN).max() < 1e-12


def test_a_machine_without_backlash_keeps_its_other_effects() -> None:
    errors = {"joint_compliance": {}, "gear_backlash": {}, "rod_backlash": {}}
    rigid = machine(**errors).without_backlash
    assert not rigid.gear_backlash.any()
    assert rigid.rod_backlash == 0.0
    assert rigid.gear_stiffness == pytest.approx(CELL.robot.required("gears").stiffness)


def test_bodies_are_named_from_the_robots_first_link_to_the_ball_bars_last() -> None:
    names = stated_masses(CELL).names
    assert names[:7] == (*(f"link{i}" for i in range(1, 7)), "plate")
    assert names[7:] == tuple(f"bar{i}" for i in range(1, len(CELL.ballbar.links) + 1))


def test_the_finer_a_terminal_interpolates_the_slower_a_signal_freezes_its_bits() -> None:
    errors = SensorErrors.model_validate({"frozen_bits": {}})
    onsets = [
        encoder_effects(errors, 1, lines=3600, bits=bits, seed=0).freezing_onset_Hz
        for bits in range(8, 14)
    ]
    assert onsets == sorted(onsets, reverse=True)  # type: ignore[type-var]
    assert onsets[0] == 9000.0  # notes/log_formats sec. A.3
    assert onsets[-1] == 650.0

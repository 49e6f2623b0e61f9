"""The rod's tension from motor torques and from a force sensor, planted and found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.payload import with_deviations
from ballbar.ident.loads.rod_tension import (
    REVERSAL_SPEED,
    ROUNDS,
    SENSOR_BIAS,
    SENSOR_NOISE,
    TORQUE_SIGMA,
    Tension,
    force_sensor,
    from_motor_torque,
    on_flange,
)
from tests.helpers.known_loads import FRICTION, Motion, tension_at
from tests.helpers.synthetic_recording import CELL, NOMINAL


def from_torque(moving: Motion, torque: Array) -> Tension:
    return from_motor_torque(CELL, torque, moving.carried, moving.speed, moving.acceleration)


def noise(moving: Motion, sigma: Array, seed: int = 61) -> Array:
    return sigma[:, None] * np.random.default_rng(seed).standard_normal((6, moving.t.size))


def test_a_planted_tension_is_found_from_torques_with_friction_and_a_gain_error(
    moving: Motion,
) -> None:
    force = tension_at(moving.t)
    found = from_torque(moving, moving.torque(force, gain=0.01))
    # Where a joint turns back the planted friction jumps more sharply than the model's.
    assert np.sqrt(((found.force - force) ** 2).mean()) < 1.0
    coulomb, viscous = CELL.robot.gears.coulomb, CELL.robot.gears.viscous
    assert found.theta[:6] == pytest.approx(FRICTION[0] * coulomb, rel=0.05)
    assert found.theta[6:12] == pytest.approx(FRICTION[1] * viscous, rel=0.1)
    # the gain of a load's mean and an offset of its axis are alike
    assert found.theta[12:15] == pytest.approx(np.full(3, 0.01), abs=4e-3)
    assert np.abs(found.theta[30:]).max() < 0.1 * coulomb.max()


def test_the_stated_deviations_hold_for_white_noise_of_the_torques(moving: Motion) -> None:
    force = tension_at(moving.t)
    sigma = np.full(6, TORQUE_SIGMA)
    found = from_torque(moving, moving.torque(force) + noise(moving, sigma))
    # Friction, gains and offsets are fitted to the same torques: a little more than sigma is left.
    ratio = np.sqrt((((found.force - force) / found.sigma) ** 2).mean())
    assert ratio == pytest.approx(1.0, abs=0.25)
    assert ((found.theta_sigma > 0.0) & np.isfinite(found.theta_sigma)).all()


def test_a_joint_that_hardly_moves_tells_nothing_of_the_tension(moving: Motion) -> None:
    """Its friction may have either sign: planted the wrong way round, it moves nothing."""
    slow = np.abs(moving.speed) < 0.3 * REVERSAL_SPEED
    assert slow.any()
    force, torque = tension_at(moving.t), moving.torque(tension_at(moving.t))
    wrong = torque - 2.0 * slow * CELL.robot.gears.coulomb[:, None] * np.sign(moving.speed)
    before, after = from_torque(moving, torque), from_torque(moving, wrong)
    assert np.abs(after.force - before.force).max() < 15.0
    moved = torque + ~slow * CELL.robot.gears.coulomb[:, None] * np.sign(moving.speed)
    assert np.abs(from_torque(moving, moved).force - before.force).max() > 0.0
    # All six at rest: the stated deviation says so.
    rest = from_motor_torque(
        CELL, torque, moving.carried, 0.0 * moving.speed, 0.0 * moving.acceleration
    )
    assert (rest.sigma > 2.0 * before.sigma).mean() > 0.9
    assert (before.sigma > 0.0).all()
    assert np.sqrt(((before.force - force) ** 2).mean()) < 1.0


def test_the_friction_of_a_joint_that_never_moves_stays_the_catalogues(moving: Motion) -> None:
    still = replace(moving, speed=moving.speed * np.array([1, 1, 1, 1, 1, 0])[:, None])
    found = from_torque(still, still.torque(tension_at(still.t)))
    assert found.theta[5] == pytest.approx(CELL.robot.gears.coulomb[5])
    assert found.theta[11] == pytest.approx(CELL.robot.gears.viscous[5])
    assert found.theta_sigma[5] == pytest.approx(CELL.robot.gears.coulomb[5])


def test_what_gears_and_plate_carry_is_what_comes_through_the_flange(moving: Motion) -> None:
    """Statics through the arm, which share nothing with the sensor's model, leave no residual."""
    force = tension_at(moving.t)
    sensor = force_sensor(on_flange(CELL, NOMINAL, moving.q, moving.b))
    found, left = sensor(moving.wrench(force), ROUNDS)
    assert found.force == pytest.approx(force, abs=1e-6)
    assert left < 1e-8
    assert np.abs(found.theta).max() < 1e-8


def test_a_sensor_with_biases_and_gain_errors_shows_the_same_tension(moving: Motion) -> None:
    force, rng = tension_at(moving.t), np.random.default_rng(62)
    bias = np.array([8.0, -12.0, 5.0, 0.5, -0.9, 0.3])
    drawn = 0.01 * rng.standard_normal(6)
    gain = 1.0 + drawn - drawn.mean()  # that of all six is the tension's
    averaged = noise(moving, 0.1 * SENSOR_NOISE)  # over a hundred rows
    wrench = (moving.wrench(force) + averaged) * gain[:, None] + bias[:, None]
    found, left = force_sensor(on_flange(CELL, NOMINAL, moving.q, moving.b))(wrench, ROUNDS)
    expected = np.concatenate((bias, gain - 1.0))
    assert (np.abs(found.theta[:12] - expected) < found.theta_sigma[:12]).all()
    assert (found.theta_sigma[:12] < np.repeat([0.01 * SENSOR_BIAS[2], 0.005], 6)).all()
    # 0.1 N of noise, and 80 N times what is left of the gains
    assert np.sqrt(((found.force - force) ** 2).mean()) < 0.15
    # six equations a sample for one tension, and twelve biases and gains
    assert left == pytest.approx(0.1 * np.sqrt(5.0 / 6.0), rel=0.05)


def test_a_tool_heavier_than_its_file_says_is_no_gain_of_the_sensor(moving: Motion) -> None:
    """Gains of the logged signal made of it a tension of the half, and of nothing in the limit."""
    force, load = tension_at(moving.t), on_flange(CELL, NOMINAL, moving.q, moving.b)
    heavier = with_deviations(CELL, np.array([1.5, 0.02, -0.03, 0.05, *np.zeros(24)]))
    more = on_flange(heavier, NOMINAL, moving.q, moving.b).known - load.known
    assert np.abs(more).max() > 10.0
    found, left = force_sensor(load)(moving.wrench(force) + more, ROUNDS)
    assert found.force == pytest.approx(force, rel=0.01, abs=0.3)
    assert np.abs(found.theta[6:12]).max() < 2e-3
    assert left < 0.03


def test_what_is_left_over_grows_where_the_sensor_shows_another_pose(moving: Motion) -> None:
    wrench = moving.wrench(tension_at(moving.t))
    sensor = force_sensor(on_flange(CELL, NOMINAL, moving.q, moving.b))
    left = [sensor(np.roll(wrench, k, axis=1), 1)[1] for k in (0, 1, 3)]
    assert left[0] < left[1] < left[2]

"""Every correction: names and priors, the shape and sign of its regressors, their slopes."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Parameter
from ballbar.ident.corrections import CORRECTIONS, correction_named
from ballbar.ident.corrections.base import (
    BACKLASH_SHARE,
    BAR,
    BEHIND_GEARS,
    GEAR,
    PLATE,
    ROD,
    TENSION_WIDTH,
    Correction,
    State,
    backlash_transition,
    sign_slope,
    smooth_sign,
)
from ballbar.ident.corrections.encoder_harmonics import encoder_harmonics
from ballbar.ident.corrections.gear_backlash import gear_backlash
from ballbar.ident.corrections.gear_ripple import gear_ripple, harmonic_orders
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.corrections.plate_bending import plate_bending
from ballbar.ident.corrections.rod_strain import rod_strain
from ballbar.ident.loads.gear_loads import BEARINGS, Loads
from tests.helpers.synthetic_recording import CELL

ENCODERS = (1, 2, 4, 5)
N = 40


@pytest.fixture(scope="module")
def state() -> State:
    """Loads of some newton metres either way, a tension of some newtons."""
    rng = np.random.default_rng(71)
    return State(
        t=np.arange(N, dtype=float),
        recording=0,
        gears=rng.uniform(-3.0, 3.0, (6, N)),
        bar=rng.uniform(-3.0, 3.0, (5, N)),
        loads=Loads(
            gear=rng.normal(0.0, 5.0, (6, N)),
            gear_per_newton=rng.normal(0.0, 0.3, (6, N)),
            plate=rng.normal(0.0, 2.0, N),
            plate_per_newton=rng.normal(0.0, 0.2, N),
            bearing=rng.normal(0.0, 50.0, (BEARINGS, 2, N)),
            bearing_per_newton=rng.normal(0.0, 0.5, (BEARINGS, 2, N)),
            rubbed=rng.normal(0.0, 1.0, (6, N)),
            on_bar=rng.normal(0.0, 1.0, (6, N)),
        ),
        tension=rng.normal(0.0, 4.0, N),
        width=backlash_transition(CELL.robot),
        gear_speed=rng.normal(0.0, 0.1, (6, N)),
        gear_acceleration=rng.normal(0.0, 0.1, (6, N)),
    )


@pytest.fixture(params=CORRECTIONS)
def correction(request: pytest.FixtureRequest) -> Correction:
    return correction_named(request.param, CELL, ENCODERS)


def regressors(correction: Correction, state: State) -> Array:
    return np.array(list(correction.regressors(state)))


def test_every_coefficient_has_one_regressor_and_a_channel(
    correction: Correction, state: State
) -> None:
    values = regressors(correction, state)
    assert values.shape == (len(correction.coefficients), N)
    assert np.isfinite(values).all()
    names = [c.name for c in correction.coefficients]
    assert len(set(names)) == len(names)
    for c in correction.coefficients:
        if isinstance(c.channel, Parameter):
            assert c.channel.side == "robot"
        else:
            assert -BEHIND_GEARS <= c.channel < 6
        assert c.sigma > 0.0
        assert c.mean >= 0.0


def test_corrections_are_known_by_the_name_they_carry() -> None:
    for name, make in CORRECTIONS.items():
        assert make(CELL, ENCODERS).name == name


def test_a_correction_comes_back_from_another_process(correction: Correction, state: State) -> None:
    again = pickle.loads(pickle.dumps(correction))
    assert again.coefficients == correction.coefficients
    np.testing.assert_array_equal(regressors(again, state), regressors(correction, state))


def test_coefficients_of_different_corrections_have_different_names() -> None:
    names = [c.name for make in CORRECTIONS.values() for c in make(CELL, ENCODERS).coefficients]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("sharpness", [1.0, 0.1])
def test_slopes_are_central_differences_of_the_regressors_with_the_tension(
    correction: Correction, state: State, sharpness: float
) -> None:
    state = replace(state, sharpness=sharpness)
    h = 1e-4  # [N]: of a transition of 0.05 N m the third derivative leaves 1e-5 of the slope
    ahead, behind = (
        regressors(correction, replace(state, tension=state.tension + s * h)) for s in (1, -1)
    )
    numeric = (ahead - behind) / (2.0 * h)
    if correction.slopes is None:
        assert not numeric.any()
        return
    slopes = np.array(list(correction.slopes(state)))
    assert slopes == pytest.approx(numeric, rel=1e-5, abs=1e-8 * np.abs(numeric).max())
    assert np.abs(slopes).max(axis=1).all()


def test_an_elastic_gear_lags_by_its_load(state: State) -> None:
    correction = joint_compliance(CELL.robot)
    load = state.loads.gear + state.loads.gear_per_newton * state.tension
    assert np.array_equal(regressors(correction, state), -load)
    assert [c.channel for c in correction.coefficients] == list(range(GEAR, GEAR + 6))
    for i, c in enumerate(correction.coefficients):
        assert c.mean == pytest.approx(1.0 / CELL.robot.gears.stiffness[i])
        assert (c.name, c.unit) == (f"compliance{i + 1}", "rad/(N m)")


def test_a_gear_with_backlash_lies_on_the_flank_against_its_load(state: State) -> None:
    correction = gear_backlash(CELL.robot)
    load = state.loads.gears(state.tension)
    flank = regressors(correction, state)
    assert (np.sign(flank) == -np.sign(load)).all()
    far = np.abs(load) > 10.0 * state.width[:, None]
    assert np.abs(flank[far]).min() > 0.99
    assert np.abs(flank).max() <= 1.0
    for i, c in enumerate(correction.coefficients):
        assert c.mean == pytest.approx(0.5 * CELL.robot.gears.lost_motion[i])
        assert c.channel == GEAR + i


def test_flanks_that_are_known_are_taken_as_they_are(state: State) -> None:
    known = np.where(np.random.default_rng(72).random((6, N)) < 0.5, -1.0, 1.0)
    held = replace(state, flanks=known)
    assert np.array_equal(regressors(gear_backlash(CELL.robot), held), -known)
    assert np.array_equal(held.load_sign(), known)


def test_ripple_has_the_orders_of_the_file_and_two_of_each_motors_turn(state: State) -> None:
    correction, orders = gear_ripple(CELL.robot), harmonic_orders(CELL.robot)
    values = regressors(correction, state)
    assert len(correction.coefficients) == 2 * len(orders)
    for k, (gear, order, size) in enumerate(orders):
        sine, cosine = values[2 * k], values[2 * k + 1]
        assert sine == pytest.approx(np.sin(order * state.gears[gear]))
        assert cosine == pytest.approx(np.cos(order * state.gears[gear]))
        for c in correction.coefficients[2 * k : 2 * k + 2]:
            assert (c.channel, c.mean) == (GEAR + gear, 0.0)
            assert 2.0 * c.sigma**2 == pytest.approx(size**2)
    for gear, listed in enumerate(CELL.robot.gears.harmonics):
        ratio = 1.0 / abs(CELL.robot.transmission[gear, gear])
        of_gear = {round(order, 6) for g, order, _ in orders if g == gear}
        assert of_gear == {round(o, 6) for o in (*dict(listed), ratio, 2.0 * ratio)}


def test_encoders_err_by_one_to_three_cycles_a_turn_offsets_included(state: State) -> None:
    correction = encoder_harmonics(CELL, (2, 5))
    values = regressors(correction, state)
    assert [c.name for c in correction.coefficients[:3]] == [
        "encoder2_1_sin", "encoder2_1_cos", "encoder2_2_sin",
    ]  # fmt: skip
    assert [c.channel for c in correction.coefficients] == [BAR + 1] * 6 + [BAR + 4] * 6
    for k, joint in ((0, 2), (6, 5)):
        for order in (1, 2, 3):
            angle = order * state.bar[joint - 1]
            assert values[k + 2 * order - 2] == pytest.approx(np.sin(angle))
            assert values[k + 2 * order - 1] == pytest.approx(np.cos(angle))
    sigmas = [c.sigma for c in correction.coefficients[:6:2]]
    assert all(a > b for a, b in pairwise(sigmas))  # higher orders are smaller
    assert encoder_harmonics(CELL, ()).coefficients == ()


def test_a_pulled_rod_is_longer_by_its_compliance_and_its_backlash(state: State) -> None:
    correction = rod_strain(CELL, ENCODERS)
    strain, backlash = regressors(correction, state)
    assert np.array_equal(strain, state.tension)
    assert (np.sign(backlash) == np.sign(state.tension)).all()
    assert backlash == pytest.approx(state.tension / np.hypot(state.tension, TENSION_WIDTH))
    compliance, half = correction.coefficients
    assert compliance.mean == 1.0 / CELL.ballbar.axial_stiffness
    assert half.mean == 0.5 * CELL.ballbar.backlash
    assert {c.channel for c in correction.coefficients} == {ROD}


def test_the_plate_bends_with_its_moment(state: State) -> None:
    correction = plate_bending(CELL, ENCODERS)
    moment = state.loads.plate + state.loads.plate_per_newton * state.tension
    assert np.array_equal(regressors(correction, state)[0], moment)
    (c,) = correction.coefficients
    assert c.channel == PLATE
    # A force at the tip turns the hinge by its moment and so moves the tip by force / stiffness.
    arm = 2.0 / 3.0 * CELL.plate.length
    assert c.mean * (10.0 * arm) * arm == pytest.approx(10.0 / CELL.plate.tip_stiffness)


def test_the_sign_of_a_load_changes_over_a_width() -> None:
    load = np.array([-1e3, -0.577, 0.0, 0.577, 1e3])
    assert smooth_sign(2.0 * load, 2.0) == pytest.approx([-1.0, -0.5, 0.0, 0.5, 1.0], abs=1e-3)
    assert sign_slope(np.zeros(1), 2.0) == pytest.approx(0.5)
    ahead, behind = smooth_sign(load + 1e-6, 2.0), smooth_sign(load - 1e-6, 2.0)
    assert sign_slope(load, 2.0) == pytest.approx((ahead - behind) / 2e-6, abs=1e-9)


def test_a_softer_state_changes_flanks_over_a_wider_load(state: State) -> None:
    soft = replace(state, sharpness=0.1)
    assert (np.abs(soft.load_sign()) < np.abs(state.load_sign())).all()
    assert (np.abs(soft.tension_sign()) < np.abs(state.tension_sign())).all()
    wide = replace(state, width=10.0 * state.width)
    assert soft.load_sign() == pytest.approx(wide.load_sign())


def test_the_transition_is_a_share_of_the_load_that_winds_up_half_the_backlash() -> None:
    gears = CELL.robot.gears
    deflection = backlash_transition(CELL.robot) / gears.stiffness
    assert deflection * BACKLASH_SHARE == pytest.approx(0.5 * gears.lost_motion)
    # as documented
    assert backlash_transition(CELL.robot)[:3] == pytest.approx(np.full(3, 1.5), rel=0.5)

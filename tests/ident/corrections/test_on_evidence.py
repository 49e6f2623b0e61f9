"""Corrections on evidence: their regressors at known states, and names that hold knees."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Parameter
from ballbar.ident.corrections.base import GEAR, ROD, Correction, State
from ballbar.ident.corrections.bearing_tilt import bearing_tilt
from ballbar.ident.corrections.gear_ratio import gear_ratio
from ballbar.ident.corrections.gear_softening import gear_softening, knees_of
from ballbar.ident.corrections.joint_lag import joint_lag
from ballbar.ident.corrections.link_growth import UNIT, link_growth
from ballbar.ident.corrections.remounted_tool import remounted_tool
from ballbar.ident.corrections.rod_elongation import rod_elongation
from ballbar.ident.loads.gear_loads import BEARINGS, no_loads
from tests.helpers.synthetic_recording import CELL

N = 30
RNG = np.random.default_rng(8)
STATE = State(
    t=np.linspace(0.0, 60.0, N),
    recording=0,
    gears=np.zeros((6, N)),
    bar=np.zeros((5, N)),
    loads=replace(
        no_loads(6, N),
        gear=RNG.normal(0.0, 100.0, (6, N)),
        gear_per_newton=RNG.normal(0.0, 0.5, (6, N)),
        bearing=RNG.normal(0.0, 300.0, (BEARINGS, 2, N)),
        bearing_per_newton=RNG.normal(0.0, 0.5, (BEARINGS, 2, N)),
    ),
    tension=RNG.normal(0.0, 50.0, N),
    width=np.ones(6),
    gear_speed=RNG.normal(0.0, 0.2, (6, N)),
    gear_acceleration=RNG.normal(0.0, 0.2, (6, N)),
)


def signals(correction: Correction, state: State = STATE) -> dict[str, Array]:
    names = [c.name for c in correction.coefficients]
    return dict(zip(names, correction.regressors(state), strict=True))


def channels(correction: Correction) -> dict[str, object]:
    return {c.name: c.channel for c in correction.coefficients}


def test_a_bearing_tilts_against_its_moment_but_for_what_a_gear_holds() -> None:
    correction = bearing_tilt(CELL, ())
    assert [c.name for c in correction.coefficients] == [
        "tilt1x",
        "tilt1y",
        "tilt2x",
        "tilt3x",
        "tilt3y",
    ]  # y of joint 2 is parallel to axis 1
    moments = STATE.loads.bearings(STATE.tension)
    assert np.array_equal(signals(correction)["tilt3y"], -moments[2, 1])
    assert channels(correction)["tilt3y"] == Parameter("rbeta2", "robot", "beta", 1)
    assert channels(correction)["tilt1x"] == Parameter("ralpha0", "robot", "alpha", -1)


def test_lags_are_relative_to_the_first_gear() -> None:
    values = signals(joint_lag(CELL.robot))
    assert "lag1" not in values
    assert np.array_equal(values["lag4"], STATE.gear_speed[3])
    assert np.array_equal(values["lag_order2_1"], STATE.gear_acceleration[0])


def test_an_error_of_a_ratio_turns_a_gear_by_a_share_of_its_angle() -> None:
    state = replace(STATE, gears=RNG.normal(0.0, 1.0, (6, N)))
    correction = gear_ratio(CELL, ())
    assert np.array_equal(signals(correction, state)["ratio6"], state.gears[5])
    assert channels(correction)["ratio6"] == GEAR + 5


def test_links_grow_in_their_own_recording_from_a_start_that_the_first_has_not() -> None:
    correction = link_growth(CELL, 2)
    first = signals(correction)
    assert "growth_ra2_start@1" not in first
    assert np.array_equal(first["growth_rd4_line@1"], STATE.t / UNIT)
    assert not first["growth_rd4_line@2"].any()
    second = signals(correction, replace(STATE, recording=1))
    assert np.array_equal(second["growth_ra2_start@2"], np.ones(N))
    assert np.array_equal(second["growth_ra2_square@2"], (STATE.t / UNIT) ** 2)
    assert not second["growth_ra2_line@1"].any()
    assert {name.split("_")[1] for name in first} == {"ra2", "rd4"}  # the long links, no gauge


def test_a_tool_is_remounted_in_all_later_recordings_and_never_in_the_first() -> None:
    correction = remounted_tool(CELL, 3)
    assert len(correction.coefficients) == 10
    assert not any(signal.any() for signal in signals(correction).values())
    third = signals(correction, replace(STATE, recording=2))
    assert third["remount_rbeta6@3"].all()
    assert not third["remount_rbeta6@2"].any()
    assert remounted_tool(CELL, 1).coefficients == ()


def test_below_its_knee_a_gear_yields_with_the_load_and_beyond_it_no_more() -> None:
    correction = gear_softening(CELL.robot, [(1, 54.25)])
    load = STATE.loads.gears(STATE.tension)[1]
    (signal,) = correction.regressors(STATE)
    assert np.array_equal(signal, -np.clip(load, -54.25, 54.25))
    assert correction.slopes is not None
    (slope,) = correction.slopes(STATE)
    beyond = np.abs(load) > 54.25
    assert beyond.any()
    assert not slope[beyond].any()
    assert np.array_equal(slope[~beyond], -STATE.loads.gear_per_newton[1][~beyond])
    assert correction.coefficients[0].channel == GEAR + 1


def test_names_of_softer_gears_hold_their_knees() -> None:
    knees = [(0, 3.125), (2, 118.0)]
    names = [c.name for c in gear_softening(CELL.robot, knees).coefficients]
    assert knees_of(names) == knees
    with pytest.raises(InputError, match=r"gear_softening.soft2: expected soft2_54.2 or similar"):
        knees_of(["soft2"])


def test_a_wandering_rod_has_the_compliance_of_its_file_held() -> None:
    (coefficient,) = rod_elongation(CELL).coefficients
    assert coefficient.channel == ROD
    assert coefficient.mean == 1.0 / CELL.ballbar.axial_stiffness
    assert coefficient.sigma < 0.01 * coefficient.mean
    assert np.array_equal(signals(rod_elongation(CELL))["elongation"], STATE.tension)


def test_a_gear_may_be_about_half_as_stiff_below_its_knee() -> None:
    """The prior of what is added is as wide as the catalogue's compliance itself."""
    (coefficient,) = gear_softening(CELL.robot, [(2, 50.0)]).coefficients
    catalogue = 1.0 / CELL.robot.required("gears").stiffness[2]
    assert coefficient.mean == 0.0
    assert coefficient.sigma == pytest.approx(catalogue, rel=1e-12)


def test_lags_come_back_from_another_process() -> None:
    """The call that made them is pickled: a function within a function cannot be."""
    lags = joint_lag(CELL.robot)
    again = pickle.loads(pickle.dumps(lags))
    assert again.coefficients == lags.coefficients
    for one, other in zip(again.regressors(STATE), lags.regressors(STATE), strict=True):
        np.testing.assert_array_equal(one, other)

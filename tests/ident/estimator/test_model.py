"""The parametric model: its columns, what an evaluation reuses, and the weights of a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Parameter
from ballbar.ident.corrections.base import BAR, BEHIND_GEARS, GEAR, PLATE, ROD
from ballbar.ident.estimator.build_unknowns import kinematic_unknowns
from ballbar.ident.estimator.closure import close_loop, parameter_jacobian
from ballbar.ident.estimator.model import (
    LOADS_CLOCK,
    LOADS_GEOMETRY,
    Evaluation,
    Model,
    gearing,
    joints_as_logged,
)
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.whitening import FLOOR_SIGMA
from ballbar.ident.loads.gear_loads import Loads, loads
from tests.helpers.complete_model import EXCESS, CompleteModel
from tests.helpers.synthetic_recording import CELL, NO_CLOCK_ERROR, NOMINAL, recording

NONE = np.zeros(0, dtype=np.intp)


def kinematic_model(samples: Samples) -> tuple[Model, Array]:
    layout, x = kinematic_unknowns(NOMINAL, NO_CLOCK_ERROR if samples.has_clock else None, NONE)
    return Model(joints_as_logged(6), None, (), layout, (samples,)), x


@pytest.fixture(scope="module")
def no_steps(machine: CompleteModel) -> CompleteModel:
    """The complete model without the clock step, whose regressors may be reused."""
    own = replace(machine.model.unknowns.own[0], steps=None)
    layout = replace(machine.model.unknowns, own=(own,))
    return replace(machine, model=replace(machine.model, unknowns=layout))


def evaluated(
    machine: CompleteModel,
    changes: dict[str, float] | None = None,
    previous: Evaluation | None = None,
    *,
    hold_loads: bool = False,
) -> Evaluation:
    """The recording with some of the unknowns changed."""
    x, names = machine.x.copy(), machine.model.unknowns.names
    for name, change in (changes or {}).items():
        x[names.index(name)] += change
    return machine.model.evaluate(x, 0, machine.ballbar, previous, hold_loads=hold_loads)


def loads_of(point: Evaluation) -> Loads:
    assert point.state is not None
    return point.state.loads


@pytest.mark.slow
def test_every_column_is_the_derivative_of_the_whitened_error(machine: CompleteModel) -> None:
    """Geometry, coefficients, gain, clock, clock step and knots, by central differences.

    Loads are frozen by design but for their tension, so lengths and angles of the arm may differ by
    what moves the loads.
    """
    equations, layout = machine.equations(), machine.model.unknowns
    columns, (weights,), knots = machine.columns(equations), equations.weights, layout.own[0].knots
    assert knots is not None
    ((block,),) = equations.blocks
    assert sorted([*block.index, *range(layout.count)[knots]]) == list(range(layout.count))
    ballbar = equations.evaluations[0].ballbar
    assert {"force_gain", "offset", "skew", "clock_step1", "tension5", "ra2", "bd3", "ox"} < set(
        layout.names
    )
    some = [*range(knots.start), *range(knots.start + 4, knots.stop, 10)]  # knots are equal
    for i, name in ((i, layout.names[i]) for i in some):
        h = 1e-4 * min(layout.sigma[i], 1e-2)
        ahead, behind = (
            weights(
                machine.model.evaluate(
                    machine.x + sign * h * np.eye(layout.count)[i], 0, ballbar
                ).closure.error
            )
            for sign in (1.0, -1.0)
        )
        expected = (ahead - behind) / (2.0 * h)
        scale = max(np.abs(expected).max(), 1e-3 / layout.sigma[i])
        assert np.abs(columns[i] - expected).max() < 5e-3 * scale, name


def test_the_loads_are_those_of_the_arm_as_it_is_bent(machine: CompleteModel) -> None:
    """Soft gears turn the arm by so much that its weight loads them otherwise.

    Loads at the angles as logged left 120 urad in the wrist of an IRB 120 whose gears yield by
    10 mrad, a TCP error of 0.7 mm in place of 0.05.
    """
    soft = {f"compliance{i}": 3e-5 for i in range(1, 7)}
    point = evaluated(machine, soft)
    motion = machine.model.recordings[0].arm_motion(point.robot_time)
    masses, geometry = machine.model.masses, machine.model.unknowns.geometry(machine.x, 0)
    assert masses is not None
    as_logged, as_bent = (
        loads(
            masses,
            geometry,
            q=q,
            b=machine.ballbar,
            speed=motion.speed,
            acceleration=motion.acceleration,
        ).gear
        for q in (motion.q, motion.q + point.bent)
    )
    off = np.abs(loads_of(point).gear - as_bent).max(axis=1)
    assert (off < 0.1 * np.abs(as_logged - as_bent).max(axis=1))[1:].all()
    assert np.abs(as_logged - as_bent).max() > 1.0  # N m


def test_without_corrections_the_error_is_that_of_the_kinematics(noisy: Samples) -> None:
    model, x = kinematic_model(noisy)
    b = noisy.ballbar_angles(NOMINAL, NO_CLOCK_ERROR)
    point = model.evaluate(x, 0, b)
    direct = close_loop(NOMINAL, noisy.robot.spline(noisy.times), b)
    assert np.array_equal(point.closure.error, direct.error)
    assert point.state is None
    assert not model.tension_column(x, point).any()
    assert model.backlash_uncertainty(x, point) == 0.0


def test_corrections_displace_gears_ball_bar_rod_and_plate(machine: CompleteModel) -> None:
    """The error of the displaced angles and of what has no angle, from the regressors by hand."""
    point = evaluated(machine)
    values = iter(machine.x[machine.model.unknowns.coefficients])
    moved = np.zeros((6 + BEHIND_GEARS, 200))
    varied: dict[Parameter, Array] = {}
    for correction, regressors in zip(machine.model.corrections, point.regressors, strict=True):
        for coefficient, regressor in zip(correction.coefficients, regressors, strict=True):
            channel, value = coefficient.channel, next(values)
            if isinstance(channel, Parameter):
                varied[channel] = varied.get(channel, np.zeros(200)) + value * regressor
            else:
                moved[channel] += value * regressor
    q = machine.model.recordings[0].robot.spline(point.robot_time)
    geometry = machine.model.unknowns.geometry(machine.x, 0)
    closure = close_loop(
        geometry,
        q + moved[GEAR:BAR].T @ CELL.robot.gear_to_joint,
        machine.ballbar + moved[BAR:ROD].T,
    )
    beyond = point.closure.error - closure.error
    expected = np.einsum("ckn,cn->kn", point.columns[[ROD, PLATE]], moved[[ROD, PLATE]])
    assert {"ralpha1", "rbeta0"} <= {parameter.name for parameter in varied}
    for parameter, size in varied.items():
        expected += parameter_jacobian(closure, [parameter])[0] * size
    assert beyond == pytest.approx(expected, abs=1e-15)
    assert np.flatnonzero(~moved.any(axis=1)).tolist() == [8]  # b3 has no encoder


@pytest.mark.parametrize("hold", [False, True])
def test_where_nothing_moved_loads_and_ripple_are_those_of_before(
    no_steps: CompleteModel, hold: bool
) -> None:
    before = evaluated(no_steps)
    after = evaluated(no_steps, previous=before, hold_loads=hold)
    assert loads_of(after) is loads_of(before)
    for correction, new, old in zip(
        no_steps.model.corrections, after.regressors, before.regressors, strict=True
    ):
        reused = all(a is b for a, b in zip(new, old, strict=True))
        assert reused == (correction.slopes is None), correction.name
    assert np.array_equal(after.closure.error, before.closure.error)


@pytest.mark.parametrize(
    ("changes", "reused"),
    [
        ({"ra2": 0.9 * LOADS_GEOMETRY}, True),
        ({"ra2": 1.1 * LOADS_GEOMETRY}, False),
        ({"offset": 0.9 * LOADS_CLOCK}, True),
        ({"offset": 1.1 * LOADS_CLOCK}, False),
        ({"skew": 0.9 * LOADS_CLOCK / 54.0}, True),  # over the 54 s of the samples
        ({"skew": 1.1 * LOADS_CLOCK / 54.0}, False),
        ({"backlash1": 1e-3, "tension3": 50.0}, True),
    ],
)
def test_loads_are_computed_anew_only_where_geometry_or_clock_moved(
    no_steps: CompleteModel, changes: dict[str, float], reused: bool
) -> None:
    before = evaluated(no_steps)
    after = evaluated(no_steps, changes, before)
    assert (loads_of(after) is loads_of(before)) == reused
    # However often they are reused, the way that geometry and clock went is counted from there.
    assert (after.loads_at is before.loads_at) == reused


def test_small_steps_add_up_until_the_loads_are_computed_anew(no_steps: CompleteModel) -> None:
    first = evaluated(no_steps)
    second = evaluated(no_steps, {"ra2": 0.6 * LOADS_GEOMETRY}, first)
    third = evaluated(no_steps, {"ra2": 1.2 * LOADS_GEOMETRY}, second)
    assert loads_of(second) is loads_of(first)
    assert loads_of(third) is not loads_of(first)


def test_a_trial_step_holds_the_loads_wherever_the_clocks_are_alike(
    no_steps: CompleteModel,
) -> None:
    before = evaluated(no_steps)
    for changes, held in (({"ra2": 1e-3}, True), ({"ra2": 1e-3, "offset": 1e-3}, False)):
        after = evaluated(no_steps, changes, before, hold_loads=True)
        assert (loads_of(after) is loads_of(before)) == held


@pytest.mark.parametrize(("shift", "reused"), [(1e-5, True), (5e-5, False)])
def test_ripple_is_computed_anew_where_the_clock_moved(
    no_steps: CompleteModel, shift: float, reused: bool
) -> None:
    before = evaluated(no_steps)
    after = evaluated(no_steps, {"offset": shift}, before)
    ripple = [c.name for c in no_steps.model.corrections].index("gear_ripple")
    assert (after.regressors[ripple][0] is before.regressors[ripple][0]) == reused
    assert after.regressors_at == (before.regressors_at if reused else after.clock)


def test_a_clock_step_moves_the_ripple_although_the_clock_is_the_same(
    machine: CompleteModel,
) -> None:
    before = evaluated(machine)
    after = evaluated(machine, {"clock_step1": 1e-2}, before)
    ripple = [c.name for c in machine.model.corrections].index("gear_ripple")
    assert after.regressors[ripple][0] is not before.regressors[ripple][0]
    changed = after.regressors[ripple][0] != before.regressors[ripple][0]
    assert not changed[machine.model.recordings[0].times < 20.0].any()
    assert changed[machine.model.recordings[0].times >= 20.0].any()


def test_an_evaluation_that_reuses_is_as_good_as_a_fresh_one(no_steps: CompleteModel) -> None:
    """Loads of a geometry 9 um and 9 urad away differ by a hundred-thousandth of the largest.

    Of the loop closure that is below the floor of rounding, also where a gear changes its flank.
    """
    changes = {"ra2": 0.9 * LOADS_GEOMETRY, "rtheta3": 0.9 * LOADS_GEOMETRY}
    reused, fresh = evaluated(no_steps, changes, evaluated(no_steps)), evaluated(no_steps, changes)
    old, new = (loads_of(p).gears(no_steps.model.tension(no_steps.x, 0)) for p in (reused, fresh))
    assert 0.0 < np.abs(new - old).max() < 2e-5 * np.abs(new).max()
    assert np.abs(reused.closure.error - fresh.closure.error).max() < FLOOR_SIGMA


def test_the_tension_is_the_measured_one_times_its_gain_plus_the_spline(
    machine: CompleteModel,
) -> None:
    model, x = machine.model, machine.x.copy()
    layout, (samples,) = model.unknowns, model.recordings
    own = layout.own[0]
    assert own.knots is not None
    assert layout.gain is not None
    x[layout.gain] = 0.05
    x[own.knots] = 0.0
    assert model.tension(x, 0) == pytest.approx(1.05 * samples.tension)
    x[own.knots] = 7.0  # B-splines add up to one
    assert model.tension(x, 0) == pytest.approx(1.05 * samples.tension + 7.0)


def test_robot_times_include_clock_steps_and_stay_in_the_log(machine: CompleteModel) -> None:
    model, x = machine.model, machine.x.copy()
    own, (samples,) = model.unknowns.own[0], model.recordings
    assert own.clock is not None
    assert own.steps is not None
    x[own.clock], x[own.steps] = [0.5, 1e-4], 0.02
    expected = 0.5 + (1.0 + 1e-4) * samples.times + 0.02 * (samples.times >= 20.0)
    assert model.evaluate(x, 0, machine.ballbar).robot_time == pytest.approx(expected)
    x[own.clock] = [1e4, 0.0]
    assert (model.evaluate(x, 0, machine.ballbar).robot_time == samples.robot.end).all()


@pytest.mark.parametrize("encoders", [(), (1, 2), (1, 2, 4, 5)])
def test_unmeasured_joints_are_left_where_no_step_of_theirs_absorbs_more(
    encoders: tuple[int, ...],
) -> None:
    """The mechanism is off by millimetres, the joints start at the ideal ones."""
    samples = recording(encoders=encoders, noise=1e-5)
    model, x = kinematic_model(samples)
    off = replace(
        model, unknowns=replace(model.unknowns, fixed=NOMINAL.replaced({"ra2": 0.707, "oz": 0.542}))
    )
    start = samples.ballbar_angles(NOMINAL, NO_CLOCK_ERROR)
    point, weights = off.solved(x, 0, start, EXCESS)
    step = weights.unmeasured_step(point.closure.error)
    # One Gauss-Newton step from 3 mrad leaves 1e-5, two leave the square of that.
    assert np.abs(step).max() < 1e-7
    moved = np.abs(point.ballbar - start)
    assert moved[:, samples.unmeasured].max() > 1e-3
    measured = [j - 1 for j in encoders]
    assert not moved[:, measured].any()


def test_given_weights_are_kept(noisy: Samples) -> None:
    model, x = kinematic_model(noisy)
    b = noisy.ballbar_angles(NOMINAL, NO_CLOCK_ERROR)
    point, weights = model.solved(x, 0, b, EXCESS)
    _, kept = model.solved(x, 0, point.ballbar, ExcessNoise(), weights=weights)
    assert kept is weights


def test_a_small_step_of_unmeasured_joints_moves_the_error_along_their_columns(
    noisy: Samples,
) -> None:
    model, x = kinematic_model(noisy)
    b = noisy.ballbar_angles(NOMINAL, NO_CLOCK_ERROR)
    point = model.evaluate(x, 0, b)
    step = 1e-5 * np.random.default_rng(2).standard_normal((1, noisy.times.size))
    stepped = point.with_ballbar_step(step)
    exact = model.evaluate(x, 0, stepped.ballbar)
    assert np.array_equal(stepped.ballbar[:, 2], b[:, 2] + step[0])
    # second order: (3e-5 rad)^2
    assert np.abs(stepped.closure.error - exact.closure.error).max() < 1e-9
    assert np.array_equal(point.ballbar, b)


def test_channels_of_the_complete_model_are_gears_those_of_kinematics_joints() -> None:
    gears = gearing(CELL.robot)
    assert gears.to_joint @ gears.to_gear == pytest.approx(np.eye(6), abs=1e-12)
    assert (gears.transition > 0.0).all()
    assert np.array_equal(joints_as_logged(6).to_joint, np.eye(6))
    assert not joints_as_logged(6).transition.any()


def test_the_time_column_is_the_derivative_with_the_clock_offset(machine: CompleteModel) -> None:
    """Through the speeds of the gears, which parallel rod and wrist couple to the joints."""
    h, point = 1e-5, evaluated(machine)
    bare = replace(machine.model, corrections=())
    ahead, behind = (
        bare.evaluate(
            machine.x + h * sign * (np.array(bare.unknowns.names) == "offset"), 0, machine.ballbar
        )
        for sign in (1.0, -1.0)
    )
    numeric = (ahead.closure.error - behind.closure.error) / (2.0 * h)
    # The corrections displace the poses by up to a milliradian.
    assert np.abs(point.time_column - numeric).max() < 3e-3 * np.abs(numeric).max()


def test_noise_columns_scale_each_channel_by_its_own_noise(noisy: Samples) -> None:
    noisy = replace(noisy, stamp_noise=2e-5)
    model, x = kinematic_model(noisy)
    point = model.evaluate(x, 0, noisy.ballbar_angles(NOMINAL, NO_CLOCK_ERROR))
    excess = ExcessNoise(gear=3e-5, wrist=4e-5, bar=5e-5, rod=6e-6)
    uncertain = np.zeros((6, noisy.times.size))
    uncertain[2, 7] = 1e-3
    sigma = np.zeros((12, noisy.times.size))
    sigma[:3], sigma[3:6] = np.hypot(1e-5, 3e-5), np.hypot(1e-5, 4e-5)
    sigma[[6, 7, 9, 10]] = np.hypot(1e-5, 5e-5)
    sigma[8] = 0.0  # b3 has no encoder: its motion is eliminated, not weighed
    sigma[11] = 6e-6
    sigma[2, 7] = np.sqrt(1e-10 + 9e-10 + 1e-6)
    expected = np.concatenate(
        (point.columns[:PLATE] * sigma[:, None, :], [2e-5 * point.time_column])
    )
    assert point.noise_columns(excess, uncertain) == pytest.approx(expected, rel=1e-12)


def test_which_flank_a_gear_lies_on_is_uncertain_near_a_reversal_of_its_load(
    machine: CompleteModel,
) -> None:
    point = evaluated(machine)
    assert point.state is not None
    load = point.state.loads.gears(point.state.tension)
    uncertain = np.asarray(machine.model.backlash_uncertainty(machine.x, point))
    first = machine.model.unknowns.names.index("backlash1")
    half = np.abs(machine.x[first : first + 6])[:, None]
    width = point.state.width[:, None]
    assert ((uncertain >= 0.0) & (uncertain <= half)).all()
    assert (uncertain < 0.011 * half)[np.abs(load) > 10.0 * width].all()
    assert (uncertain > 0.9 * half)[np.abs(load) < 0.3 * width].all()
    assert (np.abs(load) < 0.3 * width).any()
    renamed = [
        replace(c, coefficients=tuple(replace(k, name=f"typical_{k.name}") for k in c.coefficients))
        for c in machine.model.corrections
    ]
    typical = replace(machine.model, corrections=tuple(renamed))  # as of a file without gears
    assert np.array_equal(typical.backlash_uncertainty(machine.x, point), uncertain)

"""The joint fit: its columns against central differences, its uncertainty, its events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ident.estimator.events import find_step_fault
from ident.estimator.joint_fit import (
    ExcessNoise,
    JointFit,
    Model,
    Track,
    jacobian,
    make_point,
    minimise,
    settle,
)
from ident.estimator.machine import tension_splines
from ident.estimator.problem import Clock
from scipy.interpolate import make_interp_spline
from scipy.sparse import csr_array

from cell.arrays import Array
from cell.geometry import nominal_geometry
from cell.load import load_cell
from ident.corrections import CORRECTIONS
from ident.estimator.uncertainty import block_widening, correlated_groups, uncertainty
from ident.estimator.unknowns import RecordingShape, unknowns
from ident.loads.gear_loads import mass_model
from ident.signals.smooth_log import Outliers, SmoothLog
from sim.path import reference_path
from sim.simulate import load_lissajous
from tests.helpers.simulated_recordings import SCENARIOS

ENCODERS = (1, 2, 4, 5)
CELL = load_cell("irb2400", "lund_600", "plate_250")
NOMINAL = nominal_geometry(CELL, np.array([0.70, 0.0, 0.54]))
EXCESS = ExcessNoise(3e-6, 3e-6, 5e-6, 1e-6)


def smooth(t: Array, values: Array) -> SmoothLog:
    spline = make_interp_spline(t, values, k=5)
    nothing = Outliers(np.empty(0), np.empty(0, dtype=np.intp), 0, t.size)
    noise, period = np.full(values.shape[1], 2e-6), float(t[1] - t[0])
    return SmoothLog(
        spline,
        spline.derivative(),
        float(t[0]),
        float(t[-1]),
        noise,
        period,
        period,
        np.empty((0, 2)),
        t,
        nothing,
        (),
    )


@pytest.fixture(scope="module")
def model() -> tuple[Model, Array, Array]:
    """Sixty seconds of the nominal cell at 200 samples, every correction, two clock steps; x off its prior."""
    path = reference_path(
        CELL.robot,
        NOMINAL,
        load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml"),
        duration=60.0,
        dwell=2.0,
        stops=0,
        step=0.05,
    )
    columns = [j - 1 for j in ENCODERS]
    times = np.linspace(3.0, 57.0, 200)
    track = Track(
        smooth(path.t, path.q),
        smooth(path.t, path.b[:, columns]),
        ENCODERS,
        np.ones(4),
        times,
        tension_splines(times),
        20.0 * np.sin(times),
        np.full((6, 1), 2e-6),
        np.array([1e-5, 1e-5, 0.0, 1e-5, 1e-5]),
        (20.0,),
    )
    corrections = tuple(make(CELL, ENCODERS) for make in CORRECTIONS.values())
    shape = RecordingShape(ENCODERS, NOMINAL, Clock(0.0, 0.0), track.knots.shape[0], 10.0, 1)
    layout, x = unknowns(CELL, NOMINAL, [shape], corrections, measured_force=True, rod_sigma=None)
    rng = np.random.default_rng(3)
    x = x + 0.1 * np.minimum(layout.sigma, 1e-3) * rng.standard_normal(x.size)
    bar = make_interp_spline(path.t, path.b, k=5)(times)
    return Model(CELL, mass_model(CELL), corrections, layout, (track,)), x, bar


def test_every_column_is_the_derivative_of_the_whitened_mismatch(
    model: tuple[Model, Array, Array],
) -> None:
    """Loads are frozen by design but for their tension, so lengths and angles of the arm may differ by what moves the loads."""
    made, x, bar = model
    point, weights = settle(made, x, 0, bar, EXCESS, None, None)
    (block,) = jacobian(made, x, 0, point, weights)
    layout = made.unknowns
    assert sorted({*block.index, *range(*layout.own[0].knots.indices(layout.count))}) == list(
        range(layout.count)
    )
    full = np.zeros((layout.count, *block.values.shape[1:]))
    full[block.index] = block.values
    full[layout.own[0].knots] = made.tracks[0].knots.toarray()[:, None, :] * block.slope
    for i, name in enumerate(layout.names):
        h = 1e-4 * min(layout.sigma[i], 1e-2)
        there, back = (
            weights(make_point(made, x + sign * h * np.eye(x.size)[i], 0, point.bar).closure.error)
            for sign in (1.0, -1.0)
        )
        expected = (there - back) / (2.0 * h)
        scale = max(np.abs(expected).max(), 1e-3 / layout.sigma[i])
        assert np.abs(full[i] - expected).max() < 5e-3 * scale, name


def test_a_rigid_mechanism_is_found_again_from_values_off_its_prior(
    model: tuple[Model, Array, Array],
) -> None:
    made, _, bar = model
    track = replace(
        made.tracks[0], knots=csr_array((0, 200)), tension=np.zeros(200), clock_steps=()
    )
    layout, x = unknowns(
        CELL,
        NOMINAL,
        [RecordingShape(ENCODERS, NOMINAL, Clock(0.0, 0.0), 0)],
        (),
        measured_force=False,
        rod_sigma=None,
    )
    start = x + 0.2 * np.minimum(layout.sigma, 1e-3) * np.random.default_rng(4).standard_normal(
        x.size
    )
    fit = minimise(Model(CELL, None, (), layout, (track,)), start, [bar], EXCESS)
    assert fit.converged
    assert fit.iterations <= 6
    away = np.abs(fit.x - x) / np.sqrt(np.diag(fit.covariance))
    assert away.max() < 0.05  # the search ends where a step would change the cost by a hundredth


@pytest.mark.slow
def test_a_jump_of_an_encoder_is_found_where_it_is(model: tuple[Model, Array, Array]) -> None:
    """The reading of b4 jumps by one signal period of 3600 lines behind t = 40 s."""
    made, x, bar = model
    period = 2.0 * np.pi / 3600
    jumped = bar.copy()
    jumped[made.tracks[0].times >= 40.0, 3] += period
    event = find_step_fault(minimise(made, x, [jumped], EXCESS))
    assert event is not None
    assert (event.kind, event.joint) == ("encoder", 4)
    assert event.time == pytest.approx(40.0, abs=0.3)
    assert abs(event.size) == pytest.approx(period, rel=0.1)


def test_a_fit_without_a_jump_has_no_event(model: tuple[Model, Array, Array]) -> None:
    made, x, bar = model
    assert find_step_fault(minimise(made, x, [bar], EXCESS)) is None


def test_white_influence_is_not_widened_and_slow_influence_is() -> None:
    times = np.arange(0.0, 120.0, 0.08)
    rng = np.random.default_rng(0)
    white = rng.standard_normal((40, times.size))
    assert np.median(block_widening(np.eye(40), white, times)) == pytest.approx(1.0, abs=0.1)
    slow = np.repeat(
        rng.standard_normal((40, 150)), 10, axis=1
    )  # alike over 0.8 s: ten samples tell as much as one
    assert np.median(block_widening(np.eye(40), slow, times)) == pytest.approx(
        np.sqrt(10.0), rel=0.15
    )


def test_covariance_keeps_the_prior_where_the_data_are_silent(
    model: tuple[Model, Array, Array],
) -> None:
    made, x, bar = model
    fit: JointFit = minimise(made, x, [bar], EXCESS)
    trust = uncertainty(fit)
    sigma = np.sqrt(np.diag(trust.covariance))
    i = made.unknowns.names.index("backlash3")  # the forearm's load never reverses on this path
    assert trust.information_gain[i] < 0.5
    assert sigma[i] == pytest.approx(made.unknowns.sigma[i], rel=0.35)
    assert (np.linalg.eigvalsh(trust.covariance / np.outer(sigma, sigma)) > -1e-9).all()


def test_strongly_correlated_unknowns_are_one_group() -> None:
    correlation = np.eye(4)
    correlation[0, 2] = correlation[2, 0] = -0.95
    assert correlated_groups(correlation, ("a", "b", "c", "d")) == [("a", "c")]

"""The maximum-likelihood fit: a planted mechanism found again, what is reported on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator import fit as module
from ballbar.ident.estimator.fit import Fit, fit, fit_kinematics, thinned
from ballbar.ident.estimator.gauss_newton import SingularError
from ballbar.ident.estimator.identifiability import candidates
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import normal_equations
from ballbar.ident.estimator.samples import Samples
from tests.helpers.complete_model import EXCESS, CompleteModel
from tests.helpers.six_axes import INDEX, NAMES, TABLE
from tests.helpers.synthetic_recording import (
    NO_CLOCK_ERROR,
    NOMINAL,
    UNIVERSAL_AND_GIMBAL,
    recording,
)

ROD = ExcessNoise(rod=1e-6)
GAUGE = ("rd1", "rd3", "rtheta1")
PARAMETERS = np.array([i for i in candidates(TABLE, UNIVERSAL_AND_GIMBAL) if NAMES[i] not in GAUGE])
TRUE_CLOCK = Clock(0.02, 5e-5)


@pytest.fixture(scope="module")
def true() -> Geometry:
    """Thesis-sized errors of a millimetre and a milliradian in every fitted parameter."""
    values = NOMINAL.values.copy()
    values[PARAMETERS] += np.random.default_rng(11).normal(0.0, 1e-3, PARAMETERS.size)
    return NOMINAL.with_values(values)


@pytest.fixture(scope="module")
def planted(true: Geometry) -> Samples:
    return recording(true=true, clock=TRUE_CLOCK, noise=1e-5, seed=12)


@pytest.fixture(scope="module")
def found(planted: Samples) -> Fit:
    return fit_kinematics(planted, NOMINAL, NO_CLOCK_ERROR, PARAMETERS, ROD)


def test_a_planted_mechanism_and_clock_are_found_within_their_stated_noise(
    found: Fit, true: Geometry
) -> None:
    """30 unknowns; chi-square of their normalised errors within three of its deviations."""
    assert found.converged
    layout = found.model.unknowns
    expected = layout.mean.copy()
    for i, name in enumerate(layout.names[:-2]):
        expected[i] = true[name]
    expected[-2:] = TRUE_CLOCK.offset, TRUE_CLOCK.skew
    off = found.x - expected
    normalised = off @ np.linalg.solve(found.covariance, off)
    count = layout.count
    assert abs(normalised - count) < 3.0 * np.sqrt(2.0 * count)
    assert found.clock().offset == pytest.approx(TRUE_CLOCK.offset, abs=1e-5)
    assert found.geometry()["ra3"] == found.x[layout.names.index("ra3")]


def test_samples_count_by_their_noise_at_the_estimate_and_not_at_the_start(found: Fit) -> None:
    again = normal_equations(found.model, found.x, found.ballbars, found.excess)
    assert again.data_cost == pytest.approx(found.linear.data_cost, rel=1e-6)


def test_chi_square_per_degree_of_freedom_is_one_with_the_right_noise(found: Fit) -> None:
    data = 5 * found.model.recordings[0].times.size
    assert found.degrees == data - found.model.unknowns.count  # no prior
    # three standard deviations of chi-square
    assert found.chi2_per_dof == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / found.degrees))


@pytest.mark.parametrize(("name", "value"), [("COARSE_SAMPLES", 60), ("REUSE_BELOW", 0.0)])
def test_a_fit_of_two_stages_or_with_every_jacobian_new_ends_at_the_same_values(
    planted: Samples, found: Fit, monkeypatch: pytest.MonkeyPatch, name: str, value: float
) -> None:
    monkeypatch.setattr(module, name, value)
    other = fit_kinematics(planted, NOMINAL, NO_CLOCK_ERROR, PARAMETERS, ROD)
    sigma = np.sqrt(np.diag(found.covariance))
    assert (np.abs(other.x - found.x) < 0.03 * sigma).all()  # each a hundredth from the minimum
    assert np.sqrt(np.diag(other.covariance)) == pytest.approx(sigma, rel=1e-3)
    assert name == "REUSE_BELOW" or other.iterations >= found.iterations  # both stages count


def test_parameters_that_are_not_fitted_keep_their_values(planted: Samples) -> None:
    start = NOMINAL.replaced({"ra1": 0.123})
    some = np.array([INDEX["ox"], INDEX["oy"]])
    result = fit_kinematics(planted, start, TRUE_CLOCK, some, ROD)
    assert result.model.unknowns.names == ("ox", "oy", "offset", "skew")
    fixed = np.setdiff1d(np.arange(len(NAMES)), some)
    assert np.array_equal(result.geometry().values[fixed], start.values[fixed])


def test_priors_of_no_width_hold_their_parameters_at_the_start(planted: Samples) -> None:
    names, held = [NAMES[i] for i in PARAMETERS], ("ra2", "ra3", "rd4", "rd6", "rtheta3", "rtheta5")
    sigma = np.full(PARAMETERS.size, np.inf)
    sigma[[names.index(name) for name in held]] = 1e-12
    result = fit_kinematics(planted, NOMINAL, NO_CLOCK_ERROR, PARAMETERS, ROD, prior_sigma=sigma)
    for name in held:
        assert result.geometry()[name] == pytest.approx(NOMINAL[name], abs=1e-11)
    # What the priors determine is no degree of freedom that the data lose.
    free = result.model.unknowns.count - len(held)
    data = 5 * planted.times.size
    assert data - result.degrees in (free, free + 1)  # a share of 1e-12 less, rounded down


@pytest.mark.parametrize("encoders", [(), (1, 2)])
def test_joints_without_encoder_are_solved_for_along_with_the_fit(
    true: Geometry, encoders: tuple[int, ...]
) -> None:
    samples = recording(true=true, encoders=encoders, noise=1e-5, seed=13)
    names = [f"btheta{j}" for j in encoders] + ["ox", "oy", "oz", "bd3", "ra2", "ra3", "rtheta3"]
    parameters = np.array([INDEX[name] for name in names])
    begin = true.replaced({name: NOMINAL[name] for name in names})
    result = fit_kinematics(samples, begin, NO_CLOCK_ERROR, parameters, ROD)
    assert result.converged
    assert ("offset" in result.model.unknowns.names) == bool(encoders)
    off = np.array([result.geometry()[name] - true[name] for name in names])
    sigma = np.sqrt(np.diag(result.covariance))[
        [result.model.unknowns.names.index(n) for n in names]
    ]
    assert (np.abs(off) < 4.0 * sigma).all()
    assert result.linear.residuals[0].shape[0] == {(): 1, (1, 2): 3}[encoders]


def test_the_search_stops_after_the_iterations_it_was_given(planted: Samples) -> None:
    result = fit_kinematics(planted, NOMINAL, NO_CLOCK_ERROR, PARAMETERS, ROD, max_iterations=1)
    assert not result.converged
    assert result.iterations == 1


def test_a_start_far_from_any_mechanism_has_no_finite_linearisation(planted: Samples) -> None:
    nowhere = NOMINAL.replaced({"ox": np.nan})
    with pytest.raises(SingularError, match="cannot be linearised"):
        fit_kinematics(planted, nowhere, NO_CLOCK_ERROR, PARAMETERS, ROD)


def test_a_rigid_mechanism_is_found_again_from_values_off_its_prior(rigid: CompleteModel) -> None:
    sigma = rigid.model.unknowns.sigma
    rng = np.random.default_rng(4)
    start = rigid.x + 0.2 * np.minimum(sigma, 1e-3) * rng.standard_normal(rigid.x.size)
    result = fit(rigid.model, start, [rigid.ballbar], EXCESS)
    assert result.converged
    assert result.iterations <= 6
    away = np.abs(result.x - rigid.x) / np.sqrt(np.diag(result.covariance))
    assert away.max() < 0.05  # the search ends where a step would change the cost by a hundredth


def test_a_few_of_the_samples_stand_in_only_where_there_are_many_more(
    machine: CompleteModel,
) -> None:
    model, ballbars = machine.model, [machine.ballbar]
    assert thinned(model, ballbars, samples=60, times=4) is None  # 200 are but three times more
    thin = thinned(model, ballbars, samples=40, times=4)
    assert thin is not None
    assert thin[0].recordings[0].times.size == 40
    assert np.array_equal(thin[1][0], machine.ballbar[::5])
    assert thin[0].unknowns is model.unknowns


def test_the_shortest_recording_decides_how_many_samples_stand_in(machine: CompleteModel) -> None:
    (samples,) = machine.model.recordings
    two = replace(machine.model, recordings=(samples, samples.thinned(2)))
    assert thinned(two, [machine.ballbar, machine.ballbar[::2]], samples=40, times=4) is None

"""A fit that needs what no machine has is not accepted, however well it explains the data."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest

from ballbar.ident.complete_fit import fit_complete
from ballbar.ident.estimates import pulled, unphysical
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.step_faults import MAX_FOUND
from ballbar.ident.loads.payload import PayloadEstimate
from ballbar.ident.options import FitOptions
from ballbar.ident.physical_bounds import FORCE, impossible
from ballbar.ident.recording_fit import fit_recording
from ballbar.ident.signals.steps import StepFault
from tests.helpers.minute_logs import minute_logs
from tests.helpers.synthetic_recording import CELL


@pytest.fixture(scope="module")
def fit() -> Fit:
    options = FitOptions(samples=300)
    recording = fit_recording(CELL, minute_logs(compliance=1.0), options)
    return fit_complete(CELL, [recording], ["joint_compliance", "plate_bending"], options)


def changed(fit: Fit, name: str, value: float) -> Fit:
    x = fit.x.copy()
    x[fit.model.unknowns.names.index(name)] = value
    return replace(fit, linear=replace(fit.linear, x=x))


@pytest.mark.slow
def test_a_sound_fit_needs_nothing_impossible(fit: Fit) -> None:
    assert impossible(fit) == ()


def test_a_rod_that_bears_kilonewtons_is_named(fit: Fit) -> None:
    own = fit.model.unknowns.own[0]
    assert own.knots is not None
    x = fit.x.copy()
    x[own.knots] = -12.7 * 1e3
    (phrase,) = impossible(replace(fit, linear=replace(fit.linear, x=x)))
    assert phrase == "the rod would bear 12.7 kN"
    x[own.knots] = 0.9 * FORCE
    assert impossible(replace(fit, linear=replace(fit.linear, x=x))) == ()


def test_a_gear_that_is_many_times_too_soft_is_named(fit: Fit) -> None:
    layout = fit.model.unknowns
    i = layout.names.index("compliance3")
    wrong = changed(fit, "compliance3", float(layout.mean[i] + 12.0 * layout.sigma[i]))
    assert impossible(wrong) == ("compliance3 would be 12 prior deviations off",)


def test_as_many_steps_as_are_looked_for_are_no_steps(fit: Fit) -> None:
    steps = tuple(StepFault(0, "encoder", 1, 5.0 * k, 1e-3) for k in range(MAX_FOUND))
    assert impossible(replace(fit, step_faults=steps[1:])) == ()
    assert impossible(replace(fit, step_faults=steps)) == (
        f"{MAX_FOUND} steps of encoders and clock would be in it",
    )


@pytest.mark.parametrize(
    ("sigma", "off", "named"), [(1e-6, 4e-6, False), (1e-6, 6e-6, True), (1e-5, 2e-5, False)]
)
def test_a_length_is_pulled_from_its_prior_by_deviations_and_by_a_size_that_matters(
    fit: Fit, sigma: float, off: float, named: bool
) -> None:
    """A rod that is stated to a micrometre is not in doubt for four of them."""
    layout = fit.model.unknowns
    i, sigmas = layout.names.index("bd3"), layout.sigma.copy()
    sigmas[i] = sigma
    model = replace(fit.model, unknowns=replace(layout, sigma=sigmas))
    moved = changed(replace(fit, model=model), "bd3", float(layout.mean[i] + off))
    assert ("bd3" in pulled(moved)) == named


@pytest.mark.parametrize(("mass", "named"), [(-0.3, False), (-1.0, True), (0.2, False)])
def test_a_mass_is_negative_beyond_its_uncertainty(fit: Fit, mass: float, named: bool) -> None:
    """The estimate of an empty flange is as often below zero as above."""
    payload = cast(
        "PayloadEstimate", SimpleNamespace(payload=SimpleNamespace(mass=mass), mass_sigma=0.3)
    )
    assert ("the tool's mass" in unphysical(fit, fit.covariance, payload)) == named

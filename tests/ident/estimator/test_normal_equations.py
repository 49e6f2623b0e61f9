"""Normal equations of the whitened loop closure against dense least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident.estimator import normal_equations as module
from ballbar.ident.estimator.normal_equations import (
    NormalEquations,
    at_trial,
    jacobian,
    normal_equations,
    trial,
)
from tests.helpers.complete_model import EXCESS, CompleteModel


@pytest.fixture(scope="module")
def equations(machine: CompleteModel) -> NormalEquations:
    return machine.equations()


@pytest.fixture(scope="module")
def columns(machine: CompleteModel, equations: NormalEquations) -> Array:
    return machine.columns(equations)


def test_normal_matrix_and_gradient_are_those_of_the_dense_jacobian_and_the_prior(
    machine: CompleteModel, equations: NormalEquations, columns: Array
) -> None:
    layout = machine.model.unknowns
    flat, (residual,) = columns.reshape(layout.count, -1), equations.residuals
    off = (machine.x - layout.mean) / layout.sigma
    unit = np.sqrt(np.diag(equations.normal))
    expected = flat @ flat.T + np.diag(layout.sigma**-2.0)
    assert equations.normal / np.outer(unit, unit) == pytest.approx(
        expected / np.outer(unit, unit), abs=1e-12
    )
    gradient = flat @ residual.ravel() + off / layout.sigma
    assert equations.gradient / unit == pytest.approx(
        gradient / unit, abs=1e-9 * np.abs(gradient / unit).max()
    )
    assert equations.cost == pytest.approx((residual**2).sum() + off @ off)
    assert equations.data_cost == pytest.approx((residual**2).sum())
    # The prior is a small part: of the sum nobody would miss it
    assert equations.cost - equations.data_cost == pytest.approx(off @ off, rel=1e-3)
    assert equations.equations == residual.size == 5 * 200


def test_the_gradient_is_half_the_derivative_of_the_cost_of_a_trial(
    machine: CompleteModel, equations: NormalEquations
) -> None:
    """Weights frozen; along random directions of a thousandth of a standard deviation."""
    rng = np.random.default_rng(6)
    sigma = 1.0 / np.sqrt(np.diag(equations.normal))
    for _ in range(3):
        step = 1e-3 * sigma * rng.standard_normal(sigma.size)
        ahead, behind = (trial(machine.model, equations, s * step).cost for s in (1.0, -1.0))
        slope = 2.0 * equations.gradient @ step
        # Loads are held but for their tension, and the error's curvature cancels.
        assert 0.5 * (ahead - behind) == pytest.approx(slope, rel=1e-3)


def test_blocks_of_samples_add_up_to_the_same_equations(
    machine: CompleteModel, equations: NormalEquations, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "BLOCK_SAMPLES", 64)
    pieces = machine.equations()
    assert [block.samples.start for block in pieces.blocks[0]] == [0, 64, 128, 192]
    unit = np.sqrt(np.diag(equations.normal))
    assert pieces.normal / np.outer(unit, unit) == pytest.approx(
        equations.normal / np.outer(unit, unit), abs=1e-12
    )
    assert pieces.gradient / unit == pytest.approx(equations.gradient / unit, rel=1e-8, abs=1e-6)
    backwards = list(jacobian(machine.model, equations, 0, from_the_end=True))
    assert [block.samples.start for block in backwards] == [192, 128, 64, 0]


def test_scores_are_columns_times_a_vector_sample_by_sample(
    machine: CompleteModel, equations: NormalEquations, columns: Array
) -> None:
    ((block,),) = equations.blocks
    vector = np.random.default_rng(7).standard_normal((5, 200))
    expected = np.einsum("pen,en->pn", columns, vector)
    assert block.scores(vector, machine.model, 0) == pytest.approx(
        expected, abs=1e-12 * np.abs(expected).max()
    )


def test_blocks_are_kept_only_where_they_are_requested(machine: CompleteModel) -> None:
    equations = normal_equations(machine.model, machine.x, [machine.ballbar], EXCESS)
    assert equations.blocks == ()


def test_given_weights_are_kept(machine: CompleteModel, equations: NormalEquations) -> None:
    again = normal_equations(
        machine.model,
        machine.x + 1e-6,
        [machine.ballbar],
        EXCESS,
        weights=equations.weights,
        previous=equations.evaluations,
    )
    assert again.weights[0] is equations.weights[0]


def test_an_accepted_trial_keeps_the_jacobian_and_has_its_own_gradient(
    machine: CompleteModel, equations: NormalEquations, columns: Array
) -> None:
    layout = machine.model.unknowns
    step = 1e-2 * layout.sigma * np.random.default_rng(8).standard_normal(layout.count)
    accepted = trial(machine.model, equations, step)
    reused = at_trial(machine.model, equations, accepted)
    assert np.array_equal(reused.x, layout.moved(equations.x, step))
    assert reused.normal is equations.normal
    assert reused.weights is equations.weights
    assert reused.cost == accepted.cost
    off = (reused.x - layout.mean) / layout.sigma**2
    gradient = columns.reshape(layout.count, -1) @ reused.residuals[0].ravel() + off
    unit = np.sqrt(np.diag(equations.normal))
    assert reused.gradient / unit == pytest.approx(
        gradient / unit, abs=1e-9 * np.abs(gradient / unit).max()
    )


def test_recordings_add_up(machine: CompleteModel) -> None:
    """The same recording twice: the data count twice, the prior once."""
    model = machine.model
    twice = replace(
        model,
        recordings=model.recordings * 2,
        unknowns=replace(model.unknowns, own=model.unknowns.own * 2),
    )
    single = normal_equations(model, machine.x, [machine.ballbar], EXCESS)
    double = normal_equations(twice, machine.x, [machine.ballbar] * 2, EXCESS)
    prior = np.diag(model.unknowns.sigma**-2.0)
    unit = np.sqrt(np.diag(single.normal))
    assert (double.normal - prior) / np.outer(unit, unit) == pytest.approx(
        2.0 * (single.normal - prior) / np.outer(unit, unit), abs=1e-12
    )
    assert double.data_cost == pytest.approx(2.0 * single.data_cost)
    assert double.equations == 2 * single.equations


def test_parameters_of_kinematics_alone_need_no_prior(rigid: CompleteModel) -> None:
    free = replace(
        rigid,
        model=replace(
            rigid.model, unknowns=replace(rigid.model.unknowns, sigma=np.full(rigid.x.size, np.inf))
        ),
    )
    equations = free.equations()
    assert equations.cost == equations.data_cost
    assert np.isfinite(equations.normal).all()
    ((block,),) = equations.blocks
    assert block.slope is None

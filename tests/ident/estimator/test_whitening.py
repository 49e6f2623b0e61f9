"""Weights from the covariance of the loop-closure error, unmeasured joints eliminated."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.closure import (
    Closure,
    bar_joint_jacobian,
    close_loop,
    parameter_jacobian,
    robot_joint_jacobian,
)
from ballbar.ident.estimator.whitening import (
    FLOOR_SIGMA,
    cholesky,
    covariance,
    inverse_lower,
    whitening,
)
from tests.helpers.six_axes import INDEX, PARAMETERS
from tests.helpers.synthetic_recording import Loop

UNMEASURED = [[], [2], [2, 3, 4], [0, 1, 2, 3, 4]]


def noise_columns(closure: Closure, joint: Array, encoder: Array, rod: float) -> Array:
    """(12, 6, N) change of the error for one sigma of each joint, encoder and the rod's length."""
    return np.concatenate(
        (
            joint[:, None, None] * robot_joint_jacobian(closure),
            encoder[:, None, None] * bar_joint_jacobian(closure),
            rod * closure.rod_column[None],
        )
    )


def spread_of(closure: Closure) -> Array:
    return covariance(noise_columns(closure, np.full(6, 2e-5), np.full(5, 1e-5), 3e-6))


@pytest.fixture(scope="module")
def spread(loop: Loop) -> Array:
    return spread_of(loop.closure)


@pytest.mark.parametrize("unmeasured", UNMEASURED)
def test_whitening_equals_dense_least_squares_with_the_unmeasured_joints_eliminated(
    loop: Loop, spread: Array, unmeasured: list[int]
) -> None:
    closure = loop.closure
    columns = bar_joint_jacobian(closure)[unmeasured]
    weights = whitening(spread, columns)
    white = weights(closure.error)
    assert white.shape == (6 - len(unmeasured), loop.q.shape[0])
    step = weights.unmeasured_step(closure.error)
    for n in range(loop.q.shape[0]):
        inverse = np.linalg.inv(spread[:, :, n])
        cost = inverse
        if unmeasured:
            u = columns[:, :, n].T
            normal = u.T @ inverse @ u
            cost = inverse - inverse @ u @ np.linalg.solve(normal, u.T @ inverse)
            best = -np.linalg.solve(normal, u.T @ inverse @ closure.error[:, n])
            assert step[:, n] == pytest.approx(best, rel=1e-6, abs=1e-9)
        expected = float(closure.error[:, n] @ cost @ closure.error[:, n])
        assert float(white[:, n] @ white[:, n]) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("unmeasured", UNMEASURED)
def test_the_whitened_error_has_the_identity_for_its_covariance(
    loop: Loop, spread: Array, unmeasured: list[int]
) -> None:
    matrix = whitening(spread, bar_joint_jacobian(loop.closure)[unmeasured]).matrix
    white = np.einsum("ein,ijn,fjn->efn", matrix, spread, matrix)
    # Rounding: the covariance has a condition number of 1e8.
    assert np.abs(white - np.eye(len(matrix))[:, :, None]).max() < 1e-7


@pytest.mark.parametrize("unmeasured", UNMEASURED[1:])
def test_what_the_unmeasured_joints_move_vanishes(
    loop: Loop, spread: Array, unmeasured: list[int]
) -> None:
    columns = bar_joint_jacobian(loop.closure)
    weights = whitening(spread, columns[unmeasured])
    white = np.abs(weights(columns))
    measured = [j for j in range(5) if j not in unmeasured]
    assert (
        white[unmeasured].max()
        < 1e-7 * np.linalg.norm(whitening(spread, columns[:0])(columns), axis=1).max()
    )
    assert (white[measured].max(axis=(1, 2)) > 1.0).all()


@pytest.mark.parametrize("unmeasured", UNMEASURED[1:])
def test_the_step_of_unmeasured_joints_is_numpys_least_squares_solution(
    loop: Loop, spread: Array, unmeasured: list[int]
) -> None:
    closure = loop.closure
    columns = bar_joint_jacobian(closure)[unmeasured]
    step = whitening(spread, columns).unmeasured_step(closure.error)
    for n in range(closure.error.shape[1]):
        root = np.linalg.inv(np.linalg.cholesky(spread[:, :, n]))
        best = np.linalg.lstsq(root @ columns[:, :, n].T, -root @ closure.error[:, n])[0]
        assert step[:, n] == pytest.approx(best, rel=1e-6, abs=1e-9)


def test_an_unmeasured_joint_that_turns_nothing_at_one_pose_stays_where_it_is(
    loop: Loop, spread: Array
) -> None:
    columns = bar_joint_jacobian(loop.closure)[[2, 3]]
    columns[1, :, 4] = 1e-13 * columns[1, :, 4]
    weights = whitening(spread, columns)
    step = weights.unmeasured_step(loop.closure.error)
    assert np.flatnonzero(weights.singular[1]).tolist() == [4]
    assert step[1, 4] == 0.0
    alone = whitening(spread[..., 4:5], columns[:1, :, 4:5]).unmeasured_step(
        loop.closure.error[:, 4:5]
    )
    assert step[0, 4] == pytest.approx(alone[0, 0], rel=1e-9)


def test_whitened_columns_of_parameters_are_those_of_the_parameter_jacobian(
    loop: Loop, spread: Array
) -> None:
    closure = loop.closure
    weights = whitening(spread, bar_joint_jacobian(closure)[[2]])
    expected = weights(parameter_jacobian(closure, PARAMETERS))
    scale = np.abs(expected).max()
    assert np.abs(weights.jacobian(closure, PARAMETERS) - expected).max() < 1e-12 * scale
    out = np.full((2, 5, 9), np.nan)
    assert weights.jacobian(closure, PARAMETERS[3:5], out) is out
    assert np.abs(out - expected[3:5]).max() < 1e-12 * scale


def test_weights_of_some_samples_are_those_of_all(loop: Loop, spread: Array) -> None:
    closure, some = loop.closure, slice(2, 6)
    weights = whitening(spread, bar_joint_jacobian(closure)[[2, 4]])
    part, error = weights.part(some), closure.error[:, some]
    assert np.array_equal(part(error), weights(closure.error)[:, some])
    assert np.array_equal(
        part.unmeasured_step(error), weights.unmeasured_step(closure.error)[:, some]
    )


def test_without_encoders_the_one_equation_left_is_the_length_of_the_rod(loop: Loop) -> None:
    closure = loop.closure
    columns = noise_columns(closure, np.full(6, 1e-5), np.zeros(5), 0.0)
    weights = whitening(covariance(columns), bar_joint_jacobian(closure))
    names = ("btheta1", "btheta3", "btheta5", "bd3")
    moved = weights(parameter_jacobian(closure, [PARAMETERS[INDEX[name]] for name in names]))
    assert np.abs(moved[:3]).max() < 1e-6 * np.abs(moved[3]).min()


def test_noise_propagates_to_the_covariance_that_samples_of_the_error_show(
    nominal: Geometry, loop: Loop
) -> None:
    rng = np.random.default_rng(21)
    n, joint, encoder, rod = (
        20000,
        np.array([1, 2, 3, 4, 5, 6]) * 1e-5,
        np.array([2, 1, 3, 1, 2]) * 1e-5,
        4e-6,
    )
    many_q, many_b = (np.repeat(x[:1], n, axis=0) for x in (loop.q, loop.b))
    closure = close_loop(
        nominal,
        many_q + rng.normal(0, joint, many_q.shape),
        many_b + rng.normal(0, encoder, many_b.shape),
    )
    stretched = closure.error + close_loop(nominal, many_q, many_b).rod_column * rng.normal(
        0, rod, n
    )
    exact = close_loop(nominal, loop.q[:1], loop.b[:1])
    stated = covariance(noise_columns(exact, joint, encoder, rod))[:, :, 0]
    seen = stretched @ stretched.T / n
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    # 20000 samples: 1 % of sampling noise, five deviations
    assert np.abs((seen - stated) / scale).max() < 0.05


def test_the_covariance_without_any_noise_is_the_floor_of_rounding() -> None:
    bare = covariance(np.zeros((3, 6, 2)))
    assert bare / FLOOR_SIGMA**2 == pytest.approx(np.eye(6)[:, :, None] * np.ones(2))


def test_factors_and_their_inverses_are_numpys(spread: Array) -> None:
    lower = cholesky(spread)
    dense = np.linalg.cholesky(spread.transpose(2, 0, 1))
    assert lower.transpose(2, 0, 1) == pytest.approx(dense, rel=1e-9, abs=1e-20)
    inverse = np.linalg.inv(dense)
    assert inverse_lower(lower).transpose(2, 1, 0) == pytest.approx(inverse, rel=1e-8, abs=1e-6)

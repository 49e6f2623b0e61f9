"""The loop-closure residual: its derivatives, its weights, and what joints without encoder take away."""

from __future__ import annotations

import numpy as np
import pytest

from cell.geometry import INDEX, NAMES, PARAMETERS, Geometry, bar_frames
from cell.inverse import refine
from ident.estimator.closure import (
    bar_joint_jacobian,
    close_loop,
    complete_bar_angles,
    covariance,
    parameter_jacobian,
    robot_joint_jacobian,
    rod_jacobian,
    whitening,
)
from tests.helpers.simulated_recordings import perturbed

STEP = 1e-6  # central differences: truncation 1e-12, cancellation 1e-10
TOLERANCE = (
    2e-8  # the mismatch may be tenths of a radian here, so the third derivatives are of order 10
)


@pytest.fixture(scope="module")
def loop(nominal: Geometry) -> tuple[Geometry, np.ndarray, np.ndarray]:
    """A mechanism that is off by centimetres, and angles that nearly close it."""
    rng = np.random.default_rng(20)
    b = rng.uniform(-0.5, 0.5, (9, 5)) + np.array([-0.4, -0.9, 0.3, -2.2, 2.4])
    start = np.array([-0.13, 0.4, 0.16, -0.17, -1.0, 2.3]) + np.zeros((9, 6))
    q = refine(nominal.robot, start, bar_frames(nominal, b).poses(), iterations=60)
    return perturbed(nominal, rng, 0.02), q, b


def test_the_mismatch_is_zero_where_both_chains_meet(
    nominal: Geometry, loop: tuple[Geometry, np.ndarray, np.ndarray]
) -> None:
    assert np.abs(close_loop(nominal, *loop[1:]).error).max() < 1e-12


def test_parameter_jacobian_is_the_central_difference_of_the_signed_mismatch(
    loop: tuple[Geometry, np.ndarray, np.ndarray],
) -> None:
    geometry, q, b = loop
    columns = parameter_jacobian(close_loop(geometry, q, b), PARAMETERS)
    for k, name in enumerate(NAMES):
        ahead = close_loop(geometry.replaced({name: geometry[name] + STEP}), q, b).error
        behind = close_loop(geometry.replaced({name: geometry[name] - STEP}), q, b).error
        assert np.abs(columns[k] - (ahead - behind) / (2 * STEP)).max() < TOLERANCE, name


def test_joint_jacobians_are_central_differences_too(
    loop: tuple[Geometry, np.ndarray, np.ndarray],
) -> None:
    geometry, q, b = loop
    closure = close_loop(geometry, q, b)
    for j in range(6):
        nudge = STEP * np.eye(6)[j]
        numeric = (
            close_loop(geometry, q + nudge, b).error - close_loop(geometry, q - nudge, b).error
        ) / (2 * STEP)
        assert np.abs(robot_joint_jacobian(closure)[j] - numeric).max() < TOLERANCE
    for j in range(5):
        nudge = STEP * np.eye(5)[j]
        numeric = (
            close_loop(geometry, q, b + nudge).error - close_loop(geometry, q, b - nudge).error
        ) / (2 * STEP)
        assert np.abs(bar_joint_jacobian(closure)[j] - numeric).max() < TOLERANCE
    ahead, behind = (
        close_loop(geometry.replaced({"bd3": geometry["bd3"] + s * STEP}), q, b).error
        for s in (1, -1)
    )
    assert np.abs(rod_jacobian(closure) - (ahead - behind) / (2 * STEP)).max() < TOLERANCE


@pytest.mark.parametrize("free", [[], [2], [2, 3, 4], [0, 1, 2, 3, 4]])
def test_whitening_equals_dense_least_squares_with_the_free_joints_eliminated(
    loop: tuple[Geometry, np.ndarray, np.ndarray], free: list[int]
) -> None:
    geometry, q, b = loop
    closure = close_loop(geometry, q, b)
    spread = covariance(closure, np.full(6, 2e-5), np.full(5, 1e-5), 3e-6)
    columns = bar_joint_jacobian(closure)[free]
    weights = whitening(spread, columns)
    white = weights(closure.error)
    assert white.shape == (6 - len(free), q.shape[0])
    step = weights.free_step(closure.error)
    for n in range(q.shape[0]):
        inverse = np.linalg.inv(spread[:, :, n])
        cost = inverse
        if free:
            u = columns[:, :, n].T
            normal = u.T @ inverse @ u
            cost = inverse - inverse @ u @ np.linalg.solve(normal, u.T @ inverse)
            best = -np.linalg.solve(normal, u.T @ inverse @ closure.error[:, n])
            assert step[:, n] == pytest.approx(best, rel=1e-6, abs=1e-9)
        expected = float(closure.error[:, n] @ cost @ closure.error[:, n])
        assert float(white[:, n] @ white[:, n]) == pytest.approx(expected, rel=1e-7)


def test_without_encoders_the_one_equation_left_is_the_length_of_the_rod(
    loop: tuple[Geometry, np.ndarray, np.ndarray],
) -> None:
    geometry, q, b = loop
    closure = close_loop(geometry, q, b)
    weights = whitening(
        covariance(closure, np.full(6, 1e-5), np.zeros(5), 0.0), bar_joint_jacobian(closure)
    )
    moved = weights(
        parameter_jacobian(
            closure, [PARAMETERS[INDEX[n]] for n in ("btheta1", "btheta3", "btheta5", "bd3")]
        )
    )
    assert np.abs(moved[:3]).max() < 1e-6 * np.abs(moved[3]).min()


def test_noise_propagates_to_the_covariance_that_samples_of_the_mismatch_show(
    nominal: Geometry, loop: tuple[Geometry, np.ndarray, np.ndarray]
) -> None:
    _, q, b = loop
    rng = np.random.default_rng(21)
    n, joint, encoder, rod = (
        20000,
        np.array([1, 2, 3, 4, 5, 6]) * 1e-5,
        np.array([2, 1, 3, 1, 2]) * 1e-5,
        4e-6,
    )
    many_q, many_b = (np.repeat(x[:1], n, axis=0) for x in (q, b))
    closure = close_loop(
        nominal,
        many_q + rng.normal(0, joint, many_q.shape),
        many_b + rng.normal(0, encoder, many_b.shape),
    )
    stretched = closure.error + rod_jacobian(close_loop(nominal, many_q, many_b)) * rng.normal(
        0, rod, n
    )
    stated = covariance(close_loop(nominal, q[:1], b[:1]), joint, encoder, rod)[:, :, 0]
    seen = stretched @ stretched.T / n
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    assert (
        np.abs((seen - stated) / scale).max() < 0.05
    )  # 20000 samples: 1 % of sampling noise, five deviations


@pytest.mark.parametrize("joints", [(), (1, 2), (1, 2, 4, 5), (4, 5)])
def test_unmeasured_joints_of_an_ideal_ball_bar_follow_from_the_robot(
    nominal: Geometry, loop: tuple[Geometry, np.ndarray, np.ndarray], joints: tuple[int, ...]
) -> None:
    _, q, b = loop
    measured = b[:, [j - 1 for j in joints]]
    filled = complete_bar_angles(nominal, q, measured, joints)
    assert np.abs(close_loop(nominal, q, filled).error).max() < 1e-10

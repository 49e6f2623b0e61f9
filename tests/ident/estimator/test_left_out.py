"""Terms that a fit left out stay candidates: its covariance is that of both models."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.estimator.left_out import held_tilts, left_out

NAMES = ("ra2", "compliance1", "tilt1x", "tilt1y")
GONE = np.array([2, 3])


def posterior(truth: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate and covariance with the two tilts, and the covariance without them."""
    columns = np.random.default_rng(4).standard_normal((30, 4))
    columns[:, 3] += 3.0 * columns[:, 1]  # hardly told from the gear
    normal = columns.T @ columns + np.eye(4)
    covariance = np.linalg.inv(normal)
    x = covariance @ columns.T @ (columns[:, 3] * truth)
    return x, covariance, np.linalg.inv(normal[:2, :2])


def test_terms_that_come_out_zero_leave_the_covariance_of_the_fit_with_them() -> None:
    _, whole, without = posterior()
    part = left_out(NAMES, np.zeros(4), whole, GONE, 1.0)
    assert part.names == NAMES[:2]
    assert without + part.shifts @ part.shifts.T == pytest.approx(whole[:2, :2], rel=1e-9)


def test_a_term_that_is_there_counts_as_far_as_the_estimate_moves_without_it() -> None:
    x, whole, without = posterior(truth=0.5)
    size = np.sqrt(np.diag(whole))[3]
    part = left_out(NAMES, x, whole, GONE, 1.0)
    columns = np.linalg.inv(whole)
    alone = without @ columns[:2] @ x  # the same data, fitted without
    moved = (alone - x[:2])[1]
    assert abs(moved) > 2.0 * np.sqrt(without[1, 1])  # or the test would say nothing
    stated = np.sqrt((part.shifts**2).sum(axis=1))[1]
    assert stated == pytest.approx(np.hypot(moved, np.sqrt(whole[1, 1] - without[1, 1])), rel=1e-6)
    assert part.sizes["tilt1y"] == pytest.approx(np.hypot(x[3], size))


def test_unknowns_that_came_later_are_not_moved() -> None:
    x, whole, _ = posterior()
    part = left_out(NAMES, x, whole, GONE, 4.0)
    moved = part.of(("new", "compliance1"))
    assert not moved[0].any()
    assert moved[1] == pytest.approx(part.shifts[1])


def test_a_gear_holds_the_tilt_about_its_own_axis_of_the_bearing_behind_it() -> None:
    """y of joint 2 has no coefficient; it is taken to be as soft as the others."""
    names = ("ra2", "compliance1", "compliance2", "compliance3")
    tilts = {"tilt1x": 1e-8, "tilt1y": 2e-8, "tilt2x": 9e-8, "tilt3x": 4e-8, "tilt3y": 3e-8}
    held = held_tilts(names, {"ra2": 1e-3, **tilts})
    assert held.tolist() == [0.0, 3e-8, 0.0, 0.0]
    assert not held_tilts(names, {"compliance1": 1e-6}).any()
    assert not held_tilts(names, {**tilts, "tilt2y": 1e-8}).any()

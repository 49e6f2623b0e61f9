"""Where the ball-bar stands, from points of the tool alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from ballbar.ident.start.sphere import FIT_SIGMA, RADIUS_SIGMA, sphere_candidates


def test_the_sphere_is_found_from_points_on_a_patch_of_it() -> None:
    rng = np.random.default_rng(4)
    u = rng.normal(0, 1, (400, 3)) * np.array([1, 1, 0.4]) + np.array([0, 0, 1.5])
    points = (
        np.array([0.7, -0.2, 0.5])
        + 0.602 * u / np.linalg.norm(u, axis=1)[:, None]
        + rng.normal(0, 1e-3, (400, 3))
    )
    found = sphere_candidates(points, 0.6)
    assert len(found) == 1
    assert found[0].centre == pytest.approx([0.7, -0.2, 0.5], abs=2e-3)
    assert found[0].radius == pytest.approx(0.602, abs=2e-3)


def test_points_on_a_circle_leave_two_centres() -> None:
    angle = np.linspace(0, 2 * np.pi, 200)
    points = np.stack((0.4 * np.cos(angle), 0.4 * np.sin(angle), np.zeros(200)), axis=1)
    heights = sorted(s.centre[2] for s in sphere_candidates(points, 0.5))
    assert heights == pytest.approx([-0.3, 0.3], abs=1e-3)


def test_a_standing_tool_shows_no_sphere() -> None:
    with pytest.raises(ValueError, match="moves less than a hundredth"):
        sphere_candidates(np.zeros((50, 3)) + 0.001, 0.6)


def test_a_rod_shorter_than_the_catalogues_is_found_against_its_prior() -> None:
    """An octant of a sphere says more about its radius than the prior of 10 mm."""
    rng = np.random.default_rng(5)
    u = np.abs(rng.normal(0, 1, (400, 3)))
    points = np.array([0.1, 0.2, 0.3]) + 0.590 * u / np.linalg.norm(u, axis=1)[:, None]
    best = sphere_candidates(points, 0.6)[0]
    # 400 points of 2 mm in an octant: a millimetre of the radius, a hundredth of the prior
    assert best.radius == pytest.approx(0.590, abs=2e-4)
    assert best.centre == pytest.approx([0.1, 0.2, 0.3], abs=2e-4)
    # exact points: the cost is that of the radius, one standard deviation from its prior
    assert best.cost == pytest.approx(1.0, abs=0.02)


def test_moving_the_points_moves_the_centre_with_them() -> None:
    rng = np.random.default_rng(6)
    u = rng.normal(0, 1, (200, 3)) + np.array([0, 0, 2.0])
    points = 0.6 * u / np.linalg.norm(u, axis=1)[:, None]
    shift = np.array([3.0, -1.0, 0.5])
    there, here = (sphere_candidates(p, 0.6)[0].centre for p in (points + shift, points))
    assert there - here == pytest.approx(shift, abs=1e-6)


def test_the_centre_is_that_of_least_squares_also_on_a_small_cap() -> None:
    """There the algebraic fit alone takes noise for curvature, and comes out millimetres off."""
    rng = np.random.default_rng(7)
    u = rng.normal(0, 0.2, (300, 3)) + np.array([0, 0, 1.0])
    points = 0.6 * u / np.linalg.norm(u, axis=1)[:, None] + rng.normal(0, 2e-3, (300, 3))

    def residual(x: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(points - x[:3], axis=1)
        return np.append((distance - x[3]) / FIT_SIGMA, (x[3] - 0.6) / RADIUS_SIGMA)

    expected = least_squares(residual, [0.0, 0.0, 0.0, 0.6], xtol=1e-12, ftol=1e-12).x
    best = sphere_candidates(points, 0.6)[0]
    assert best.centre == pytest.approx(expected[:3], abs=1e-6)

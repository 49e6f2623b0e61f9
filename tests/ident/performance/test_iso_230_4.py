"""Circular tests of ISO 230-4 against examples that were computed with pencil and paper."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.performance import iso_230_4 as iso
from ballbar.ident.performance.iso_230_4 import CircularTest

COUNT = 720
TURN = np.linspace(0.0, 2.0 * np.pi, COUNT + 1)  # multiples of half a degree, the first twice


def points(angle: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    """(N, 2) at polar coordinates."""
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))


def test_the_circle_through_four_points() -> None:
    """(4, 2), (2, 4), (0, 2), (2, 0) lie 2 from (2, 2)."""
    given = np.array([[4.0, 2.0], [2.0, 4.0], [0.0, 2.0], [2.0, 0.0]])
    centre, radius = iso.least_squares_circle(given)
    assert centre == pytest.approx(np.array([2.0, 2.0]), abs=1e-9)
    assert radius == pytest.approx(2.0, abs=1e-9)


def test_the_least_squares_circle_of_an_ellipse_by_symmetry() -> None:
    """Four points 3 and 5 from the centre on the axes: radius 4, each 1 away."""
    given = np.array([[5.0, 0.0], [0.0, 3.0], [-5.0, 0.0], [0.0, -3.0]])
    centre, radius = iso.least_squares_circle(given)
    assert centre == pytest.approx(np.zeros(2), abs=1e-9)
    assert radius == pytest.approx(4.0, abs=1e-9)


def test_two_lobes_are_twice_their_amplitude() -> None:
    """Radius 100 + 0.03 cos 2t: orthogonal to centre and radius, so G = RONt = 0.06 about 100; the
    nominal radius of 99.95 makes F_max = 0.05 + 0.03 and F_min = 0.05 - 0.03.
    """
    test = iso.circular_test(points(TURN, 100.0 + 0.03 * np.cos(2.0 * TURN))[:-1], 99.95)
    assert test.radius == pytest.approx(100.0, abs=1e-7)
    assert iso.circular_deviation(test, counter_clockwise=True) == pytest.approx(0.06, abs=1e-7)
    assert test.roundness == pytest.approx(0.06, abs=1e-7)
    assert test.radial_deviation == pytest.approx((0.08, 0.02), abs=1e-7)
    assert iso.circular_deviation(test, counter_clockwise=False) is None
    assert iso.bidirectional_deviation(test) is None


def test_four_rays_to_a_billionth() -> None:
    """Radii 10, 10, 8, 8 every 90 degrees, twice about: the centre of the least-squares circle is
    nowhere but on the bisector x = y = c. By symmetry both pairs are equally off the circle: with
    a = sqrt((10 - c)^2 + c^2), b = sqrt((8 + c)^2 + c^2) all deviations vanish where a = b, at
    c = 1: 9 and 1 squared make 82.
    """
    angle = np.deg2rad([0.0, 90.0, 180.0, 270.0, 360.0])
    test = iso.circular_test(points(angle, np.array([10.0, 10.0, 8.0, 8.0, 10.0])), 9.0)
    assert test.eccentricity == pytest.approx(np.array([1.0, 1.0]), abs=1e-9)
    assert test.radius == pytest.approx(9.055385138137417, abs=1e-9)
    assert test.roundness == pytest.approx(0.0, abs=1e-9)
    assert test.radial_deviation == pytest.approx((0.055385138137417,) * 2, abs=1e-9)


def test_g_and_f_of_eight_points_to_a_billionth() -> None:
    """Radii 5, 3, 5, 3 ... every 45 degrees have their least-squares circle about the centre with
    radius 4, by symmetry: G = 2, and about a nominal radius of 4.5 F_max = 0.5, F_min = -1.5.
    """
    angle = np.deg2rad(np.arange(0.0, 361.0, 45.0))
    radii = np.array([5.0, 3.0] * 4)
    test = iso.circular_test(np.vstack([points(angle[:-1], radii)] * 2), 4.5)
    assert test.radius == pytest.approx(4.0, abs=1e-9)
    assert iso.circular_deviation(test, counter_clockwise=True) == pytest.approx(2.0, abs=1e-9)
    assert test.roundness == pytest.approx(2.0, abs=1e-9)
    assert test.radial_deviation == pytest.approx((0.5, -1.5), abs=1e-9)


def both_ways(backlash: float) -> CircularTest:
    """A circle of 100 there and back, whose radius is larger by `backlash` on the way back."""
    path = np.vstack([points(TURN, 100.0), points(TURN[::-1], 100.0 + backlash)])
    return iso.circular_test(path, 100.0)


def test_both_directions_differ_by_the_backlash() -> None:
    """Each direction is a circle, so G = 0; together they lie 0.01 either side of 100.01."""
    test = both_ways(0.02)
    for way in (True, False):
        assert iso.circular_deviation(test, counter_clockwise=way) == pytest.approx(0.0, abs=1e-9)
    assert iso.bidirectional_deviation(test) == pytest.approx(0.02, abs=1e-9)
    assert test.radius == pytest.approx(100.01, abs=1e-6)
    assert test.counter_clockwise[: COUNT - 10].all()
    assert not test.counter_clockwise[COUNT + 12 :].any()


def test_a_set_up_error_leaves_no_deviation() -> None:
    """A bar whose seat is 0.2 off the centre of a true circle of 150: lengths vary by 0.4."""
    path = points(TURN, 150.0) - np.array([0.2, 0.0])
    length = np.linalg.norm(path, axis=1)
    test = iso.circular_test(points(np.arctan2(path[:, 1], path[:, 0]), length), 150.0)
    assert np.ptp(length) == pytest.approx(0.4, abs=1e-9)
    assert test.roundness < 1e-9
    assert test.eccentricity == pytest.approx(np.array([-0.2, 0.0]), abs=1e-9)


def test_part_of_a_circle_is_refused() -> None:
    with pytest.raises(ValueError, match="180 deg of a circle were passed, not all"):
        iso.circular_test(points(TURN[: COUNT // 2 + 1], 100.0), 100.0)


def test_the_plane_of_a_tilted_circle() -> None:
    """A circle about (1, 2, 3) in a plane whose normal is (0, -3, 4) / 5; counted about +z."""
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, 0.6]])
    given = np.array([1.0, 2.0, 3.0]) + points(TURN[:-1], 7.0) @ axes
    centre, found = iso.plane_of(given)
    assert centre == pytest.approx(np.array([1.0, 2.0, 3.0]), abs=1e-9)
    assert np.cross(*found) == pytest.approx(np.array([0.0, -0.6, 0.8]), abs=1e-9)


def test_the_mean_path_is_of_all_laps_and_keeps_the_directions_apart() -> None:
    """Two laps there with radii 99.9 and 100.1 and one back with 100.3: means 100 and 100.3; rows
    at half degrees lie in pairs in arcs of a degree, whose chord's middle is 1 - 5e-6 as far off.
    """
    one = TURN[:-1] + np.deg2rad(0.25)
    path = np.vstack(
        [points(one, 99.9), points(one, 100.1), points(one[::-1], 100.3), points(one[:1], 100.3)]
    )
    means = iso.mean_path(iso.circular_test(path, 100.0))
    radii = np.linalg.norm(means, axis=1)
    assert len(means) == 720
    assert np.median(radii[:360]) == pytest.approx(100.0, abs=2e-3)
    assert np.median(radii[360:]) == pytest.approx(100.3, abs=2e-3)

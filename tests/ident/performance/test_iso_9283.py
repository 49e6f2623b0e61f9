"""Characteristics of ISO 9283:1998 against examples that were computed with pencil and paper.

Lengths are written in mm as the examples have them; the laws do not mind the unit.
"""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.performance import iso_9283 as iso

EXACT = pytest.approx
# Barycentre (10, 0, 0); distances from it 5, 5, 5, 5
CROSS = np.array([[13.0, 4.0, 0.0], [7.0, -4.0, 0.0], [14.0, -3.0, 0.0], [6.0, 3.0, 0.0]])
# Barycentre (0, 0, 0); distances from it 1, 1, 3, 3
LINES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, -3.0, 0.0]])


def test_pose_accuracy_is_the_distance_of_the_barycentre_from_the_command() -> None:
    """The barycentre (10, 0, 0) is 3, 4 and 12 off (7, -4, -12): sqrt(9 + 16 + 144) = 13."""
    assert iso.pose_accuracy(CROSS, np.array([7.0, -4.0, -12.0])) == EXACT(13.0, abs=1e-9)


def test_orientation_accuracies_are_signed_means_without_full_turns() -> None:
    """Means of a are (0.02 + 0.04 + 0.06) / 3 = 0.04; c passes half a turn: 0.03, not 2 pi less."""
    half = np.pi - 0.01
    attained = np.array([[0.02, -0.5, half], [0.04, -0.5, half + 0.03], [0.06, -0.8, half + 0.06]])
    attained[1:, 2] -= 2.0 * np.pi  # as a controller shows them
    accuracy = iso.orientation_accuracy(attained, np.array([0.01, -0.5, half]))
    assert accuracy == EXACT(np.array([0.03, -0.1, 0.03]), abs=1e-9)


def test_pose_repeatability_is_the_mean_distance_and_three_deviations() -> None:
    """Distances 1, 1, 3, 3: mean 2, S = sqrt(4 / 3) = 1.154700538379252; 2 + 3 S."""
    assert iso.pose_repeatability(LINES) == EXACT(5.464101615137755, abs=1e-9)


def test_equal_distances_from_the_barycentre_leave_their_mean_as_repeatability() -> None:
    assert iso.pose_repeatability(CROSS) == EXACT(5.0, abs=1e-9)


def test_orientation_repeatabilities_are_three_deviations() -> None:
    """Angles 1, 2, 3, 6 mrad: mean 3, squares 4 + 1 + 0 + 9 = 14, S = sqrt(14 / 3)."""
    angles = np.array([[1.0, 0.0, 1.0], [2.0, 0.0, 3.0], [3.0, 0.0, 1.0], [6.0, 0.0, 3.0]]) * 1e-3
    expected = np.array([6.480740698407860, 0.0, 3.464101615137755]) * 1e-3
    assert iso.orientation_repeatability(angles) == EXACT(expected, abs=1e-12)


def test_a_turn_at_half_a_turn_does_not_spread_orientations() -> None:
    angles = np.array([[np.pi - 0.001, 0.0, 0.0], [-np.pi + 0.001, 0.0, 0.0]])
    expected = 3.0 * np.sqrt(2.0) * 1e-3
    assert iso.orientation_repeatability(angles)[0] == EXACT(expected, abs=1e-12)


def test_multi_directional_variation_is_the_longest_of_three_distances() -> None:
    """Barycentres (0, 0, 0), (3, 4, 0), (0, 0, 12): distances 5, 12 and 13."""
    means = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 12.0]])
    assert iso.pose_accuracy_variation(means) == EXACT(13.0, abs=1e-9)
    turns = np.array([[0.1, 0.0, 0.0], [0.3, 0.0, -0.1], [0.2, 0.0, 0.4]])
    assert iso.orientation_accuracy_variation(turns) == EXACT(np.array([0.2, 0.0, 0.5]), abs=1e-9)


FIRST = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
SECOND = np.array([[3.0, 4.0, 0.0], [6.0, 8.0, 0.0], [0.0, 9.0, 0.0]])  # 5, 10 and 9 away


def test_distance_accuracy_is_positive_where_the_robot_moves_too_far() -> None:
    """Mean of 5, 10 and 9 is 8; the command is sqrt(4 + 9 + 36) = 7."""
    commanded = np.array([[1.0, 1.0, 1.0], [3.0, 4.0, 7.0]])
    assert iso.distance_accuracy(FIRST, SECOND, commanded) == EXACT(1.0, abs=1e-9)
    assert iso.distance_accuracy(SECOND, FIRST, 2.0 * commanded) == EXACT(-6.0, abs=1e-9)


def test_distance_repeatability_is_three_deviations_of_the_distances() -> None:
    """Distances 5, 10, 9 about 8: squares 9 + 4 + 1 = 14, S = sqrt(7) = 2.645751311064591."""
    assert iso.distance_repeatability(FIRST, SECOND) == EXACT(7.937253933193772, abs=1e-9)


def test_drift_is_the_largest_change_from_the_first_value() -> None:
    values = np.array([0.10, 0.13, 0.06, 0.11])
    assert iso.drift(values) == EXACT(0.04, abs=1e-12)
    turns = np.array([[0.1, -0.2, 0.0], [0.3, -0.2, -0.1]])
    assert iso.drift(turns) == EXACT(np.array([0.2, 0.0, 0.1]), abs=1e-12)


# Two paths of three points; barycentres (0, 1, 0), (1, 3, 4), (2, 0, 0)
PATHS = np.array(
    [
        [[0.0, 0.0, 0.0], [1.0, 3.0, 3.0], [2.0, 0.0, -1.0]],
        [[0.0, 2.0, 0.0], [1.0, 3.0, 5.0], [2.0, 0.0, 1.0]],
    ]
)
COMMANDED = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])


def test_path_accuracy_is_the_farthest_barycentre() -> None:
    """Distances from the command: 1, sqrt(9 + 16) = 5, and 0."""
    assert iso.path_accuracy(PATHS, COMMANDED) == EXACT(5.0, abs=1e-9)


def test_path_repeatability_is_the_largest_of_the_points() -> None:
    """Two paths are equally far from their barycentre, here 1 at every point, so S is 0."""
    assert iso.path_repeatability(PATHS) == EXACT(1.0, abs=1e-9)
    four = np.stack([LINES, CROSS], axis=1)  # RP of the points 5.464101615137755 and 5
    assert iso.path_repeatability(four) == EXACT(5.464101615137755, abs=1e-9)


def test_path_characteristics_of_orientation() -> None:
    """Means of a: 0.02 and -0.03 off; angles 0.01 either side: S = 0.01 sqrt(2)."""
    turns = np.zeros((2, 2, 3))
    turns[:, :, 0] = [[0.01, -0.04], [0.03, -0.02]]
    accuracy = iso.orientation_path_accuracy(turns, np.zeros((2, 3)))
    assert accuracy == EXACT(np.array([0.03, 0.0, 0.0]), abs=1e-12)
    repeatability = iso.orientation_path_repeatability(turns)
    assert repeatability == EXACT(np.array([0.042426406871193, 0.0, 0.0]), abs=1e-12)


def test_an_attained_path_counts_where_it_passes_the_normal_planes() -> None:
    """The command runs along x. The attained path is late, at y = 1 + x / 10, and its samples lie
    at x = -1, 0.5, 1.5 and 2.5, so it passes the planes x = 0, 1, 2 at y = 1.0, 1.1 and 1.2.
    """
    x = np.array([-1.0, 0.5, 1.5, 2.5])
    path = np.column_stack((x, 1.0 + 0.1 * x, np.zeros(4)))
    points = iso.in_normal_planes(path, COMMANDED)
    assert points == EXACT(np.array([[0.0, 1.0, 0.0], [1.0, 1.1, 0.0], [2.0, 1.2, 0.0]]), abs=1e-12)
    assert np.isnan(iso.in_normal_planes(path[:3], COMMANDED)[2]).all()  # ends before x = 2


def test_a_plane_that_is_passed_twice_counts_where_the_path_is_nearest() -> None:
    path = np.array([[-1.0, 50.0, 0.0], [1.0, 50.0, 0.0], [-1.0, 3.0, 0.0], [1.0, 3.0, 0.0]])
    assert iso.in_normal_planes(path, COMMANDED)[0] == EXACT(np.array([0.0, 3.0, 0.0]), abs=1e-12)


def test_intervals_by_tables_of_student_and_chi_square() -> None:
    """n = 4: t = 3.182446305284263, quantiles of chi-square 0.215795282623898 and
    9.348403604496149 with 3 degrees of freedom.
    """
    assert iso.mean_half_width(np.array([1.0, 2.0, 3.0, 6.0])) == EXACT(
        3.182446305284263 * np.sqrt(14.0 / 3.0) / 2.0, abs=1e-9
    )
    low, high = iso.deviation_interval(4)
    assert low == EXACT(np.sqrt(3.0 / 9.348403604496149), abs=1e-9)
    assert high == EXACT(np.sqrt(3.0 / 0.215795282623898), abs=1e-9)
    # deviation along x, of 13, 7, 14, 6: S = sqrt(50 / 3)
    along = iso.accuracy_half_width(CROSS, np.zeros(3))
    assert along == EXACT(3.182446305284263 * np.sqrt(50.0 / 3.0) / 2.0, abs=1e-9)


@pytest.mark.parametrize("n", [5, 30])
@pytest.mark.parametrize(
    ("shape", "mean", "deviation"),
    [  # of a Maxwell and of a half-normal distribution: sqrt(8 / pi), sqrt(3 - 8 / pi), ...
        ([1.0, 1.0, 1.0], 1.5957691216057308, 0.6734396116428515),
        ([1.0, 0.0, 0.0], 0.7978845608028654, 0.6028102749890869),
    ],
)
def test_intervals_hold_what_is_true(
    n: int, shape: list[float], mean: float, deviation: float
) -> None:
    """AP by Student's t is exact along the deviation; that of RP_l holds 93 of 100 or more."""
    rng, factors = np.random.default_rng(3), iso.deviation_interval(n)
    accuracy = repeatability = 0
    for _ in range(2000):
        attained = np.array([100.0, 0.0, 0.0]) + shape * rng.standard_normal((n, 3))
        width = iso.accuracy_half_width(attained, np.zeros(3))
        accuracy += abs(iso.pose_accuracy(attained, np.zeros(3)) - 100.0) <= width
        low, high = iso.pose_repeatability(attained) * np.array(factors)
        repeatability += low <= mean + 3.0 * deviation <= high
    assert 0.935 < accuracy / 2000 < 0.965
    assert repeatability / 2000 > 0.92

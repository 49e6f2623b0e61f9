"""Motion of a seat from reference points: drift is followed, noise is not, faults do no harm."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ballbar.acquisition.reference_fit import Knock, _Normal, fit_references, fit_with_knocks
from ballbar.cell.arrays import Array
from ballbar.cell.statistics import rms
from tests.helpers.reference_points import (
    COUNT,
    POINTS,
    SIGMA,
    errors,
    errors_of_single_measurements,
    fitted,
    motion,
    moved,
    readings,
)

SEEDS = range(3)
every_number_of_points = pytest.mark.parametrize(
    "points", [3, *(pytest.param(more, marks=pytest.mark.long) for more in (4, 6))]
)


@cache
def undisturbed(kind: str, points: int, seed: int) -> tuple[Array, Array]:
    """Errors of `helpers.reference_points.errors`, and those of single measurements."""
    read = readings(kind, points, seed)
    return errors(fitted(read), kind, seed)[0], errors_of_single_measurements(read, kind, seed)


@pytest.mark.parametrize(
    ("kind", "share"),
    [
        ("rest", 0.15),
        ("linear", 0.15),
        ("warming up", 0.5),
        ("swinging", 0.85),
        ("jolted", 0.25),
        ("walking", 0.9),
        ("shaken", 1.05),  # there is nothing to average
    ],
)
@every_number_of_points
def test_motion_is_followed_closer_than_single_measurements_show_it(
    kind: str, share: float, points: int
) -> None:
    left, single = zip(*(undisturbed(kind, points, seed) for seed in SEEDS), strict=True)
    assert rms(left) < share * rms(single)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["linear", "swinging", "walking", "shaken"])
@pytest.mark.parametrize("declared", [SIGMA / 3.0, SIGMA, 3.0 * SIGMA])
def test_the_stated_deviation_is_that_of_the_error_whatever_was_declared(
    kind: str, declared: float
) -> None:
    ratios, scales = [], []
    for seed in range(8):
        fit = fitted(readings(kind, 4, seed), declared)
        left, stated = errors(fit, kind, seed)
        ratios.append(left / stated)
        scales.append(fit.scale * declared / SIGMA)
    assert 0.5 < rms(ratios) < 1.15  # a straight drift is easier than a random walk
    assert np.mean(scales) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("size", [2e-4, 2e-2])
@pytest.mark.parametrize("kind", ["linear", "swinging", "jolted"])
@every_number_of_points
def test_disturbed_readings_do_no_harm(size: float, kind: str, points: int) -> None:
    left, without = [], []
    for seed in SEEDS:
        read, rng = readings(kind, points, seed), np.random.default_rng([seed, 4])
        without.append(undisturbed(kind, points, seed)[0])
        wrong = rng.uniform(size=read.shape[:2]) < 0.03
        away = rng.standard_normal((int(wrong.sum()), 3))
        read[wrong] += size * away / np.linalg.norm(away, axis=1, keepdims=True)
        fit = fitted(read)
        left.append(errors(fit, kind, seed)[0])
        if size > 1e-3:
            np.testing.assert_array_equal(fit.length > 8.0, wrong)
    assert rms(left) < 1.2 * rms(without)


def test_points_that_are_not_read_and_measurements_without_any_are_bridged() -> None:
    rng = np.random.default_rng(7)
    for seed in range(2):
        read = readings("linear", 4, seed)
        read[rng.uniform(size=read.shape[:2]) < 0.3] = np.nan
        read[rng.uniform(size=COUNT) < 0.3] = np.nan
        left, stated = errors(fitted(read), "linear", seed)
        assert rms(left) < 6e-6
        assert rms(left / stated) < 1.2


def test_time_between_measurements_counts() -> None:
    """Twelve hours without a measurement: the seat may move there, and not elsewhere."""
    pause, read = 60, readings("rest", 4, 1)
    read[pause:] = moved(POINTS[:4], np.full((COUNT - pause, 6), 1e-5)) + (
        read[pause:] - POINTS[:4]
    )
    elapsed = np.where(np.arange(COUNT - 1) == pause - 1, 43200.0, 10.0)
    fit = fit_references(read, np.full((COUNT, 4), SIGMA), elapsed)
    steps = np.linalg.norm(np.diff(fit.motion[:, :3], axis=0), axis=1)
    assert steps.argmax() == pause - 1
    assert steps[pause - 1] > 100.0 * np.delete(steps, pause - 1).max()


@pytest.mark.parametrize(
    ("points", "point", "kind"),
    [
        (5, 0, "linear"),
        (6, 5, "jolted"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((5, 3, "linear"), (5, 3, "jolted"))
        ),
    ],
)
def test_a_knocked_point_is_told_from_the_others(points: int, point: int, kind: str) -> None:
    """Every time with five points or more; with fewer another one may explain as much."""
    read, at = readings(kind, points, 3), 47
    read[at:, point] += [1.2e-4, -1.5e-4, 0.6e-4]
    fit, knocks = fit_with_knocks(read, np.full(read.shape[:2], SIGMA), np.ones(COUNT - 1))
    (knock,) = knocks
    assert knock == Knock(point, knock.measurement, knock.size)
    assert abs(knock.measurement - at) <= 1
    assert knock.size == pytest.approx(2.01e-4, rel=0.15)
    assert rms(errors(fit, kind, 3)[0]) < 5e-6


def test_a_point_that_is_knocked_twice_is_three_points() -> None:
    read = readings("linear", 6, 4)
    read[40:, 1, 0] += 2e-4
    read[80:, 1, 2] -= 3e-4
    fit, knocks = fit_with_knocks(read, np.full(read.shape[:2], SIGMA), np.ones(COUNT - 1))
    assert sorted((k.point, k.measurement) for k in knocks) == [(1, 40), (1, 80)]
    assert sorted(k.size for k in knocks) == pytest.approx([2e-4, 3e-4], rel=0.1)
    assert fit.points.shape == (8, 3)


@pytest.mark.parametrize("kind", ["rest", "linear", "swinging", "jolted", "walking"])
@every_number_of_points
def test_no_point_is_said_to_be_knocked_that_was_not(kind: str, points: int) -> None:
    for seed in SEEDS:
        read = readings(kind, points, seed, count=40)
        read[11, 0] += 1e-3  # a single disturbed reading is no knock
        assert not fit_with_knocks(read, np.full(read.shape[:2], SIGMA), np.ones(39))[1]


def test_the_banded_system_is_that_of_all_unknowns() -> None:
    rng, count = np.random.default_rng(2), 7
    roots = rng.standard_normal((count, 9, 6))
    normal = _Normal(
        np.einsum("nki,nkj->nij", roots, roots), rng.standard_normal((count, 6)), 100.0
    )
    precision = rng.uniform(0.5, 2.0, (count - 1, 6))
    dense = np.zeros((6 * count + 6, 6 * count + 6))
    for n in range(count):
        dense[6 * n : 6 * n + 6, 6 * n : 6 * n + 6] = normal.blocks[n]
    pace = rng.uniform(0.5, 2.0, (count - 1, 1))
    # the last six unknowns are the trend
    step = np.kron(np.diff(np.eye(count), axis=0), np.eye(6))
    step = np.hstack((step, -np.kron(pace, np.eye(6))))
    dense += step.T @ np.diag(precision.ravel()) @ step
    motion, deviance = normal.solved(precision, pace)
    right = np.concatenate((normal.right.ravel(), np.zeros(6)))
    solved = np.linalg.solve(dense, right)
    np.testing.assert_allclose(motion.ravel(), solved[:-6], rtol=1e-9)
    expected = np.linalg.slogdet(dense)[1] - right @ solved
    assert deviance == pytest.approx(expected, rel=1e-9)
    inverse = np.linalg.inv(dense)[:-6, :-6].reshape(count, 6, count, 6)
    every = np.arange(count)
    np.testing.assert_allclose(
        normal.covariance(precision, pace), inverse[every, :, every], rtol=1e-8
    )


def test_readings_without_noise_leave_no_error() -> None:
    read = moved(POINTS[:4], motion("swinging", 1))
    left, _ = errors(fitted(read), "swinging", 1)
    assert rms(left) < 1e-6  # noise of a tenth of the declared one is assumed


def test_the_stated_uncertainty_of_a_walk_is_that_of_its_steps_and_of_its_readings() -> None:
    """A walk of steps q that is read with r each time: 1 / sqrt(1 / r^2 + 4 / (r q))."""
    stated, expected = [], []
    for seed in range(6):
        rng = np.random.default_rng([seed, 7])
        step, count = 2.0 * SIGMA, 200
        walk = np.zeros((count, 6))
        walk[:, :3] = np.cumsum(step * rng.standard_normal((count, 3)), axis=0)
        read = moved(POINTS, walk) + rng.normal(0.0, SIGMA, (count, 6, 3))
        fit = fitted(read)
        stated.append(np.median(fit.covariance[20:-20, 0, 0]))
        r, q = SIGMA**2 / 6.0, step**2
        expected.append(1.0 / np.sqrt(1.0 / r**2 + 4.0 / (r * q)))
    assert np.mean(stated) == pytest.approx(np.mean(expected), rel=0.15)

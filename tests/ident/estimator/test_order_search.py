"""Joint errors are found by evidence, and only where there is some."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.ident.corrections.joint_harmonics import PRIOR
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.order_search import (
    SLOPE,
    left_out,
    of_few,
    peak_orders,
    search_orders,
    whole_orders,
)
from ballbar.ident.estimator.regions import REGIONS, joint_regions
from tests.helpers.joint_error_models import EQUATIONS, JOINTS, POSES, linear_model, uniform_angles


def test_orders_that_are_there_are_found_the_strongest_first() -> None:
    angles = uniform_angles()
    errors = np.zeros_like(angles)
    errors[1] += 3e-4 * np.cos(17.0 * angles[1] + 0.3)
    errors[3] += 1e-4 * np.sin(8.0 * angles[3])
    search = search_orders(linear_model(angles, errors), PRIOR)
    assert search.pairs == [(1, 17), (3, 8)]
    assert search.spectrum_before[1, 16] == search.spectrum_before.max()
    assert search.spectrum_after.max() < 25.0
    assert search.orders[0].gain > search.orders[1].gain > 0.005


def test_white_noise_has_none() -> None:
    angles = uniform_angles()
    for seed in range(5):
        assert search_orders(linear_model(angles, np.zeros_like(angles), seed), PRIOR).orders == ()


def test_a_smooth_error_of_poses_that_is_no_order_of_a_joint_is_not_taken_for_many() -> None:
    """A product of two angles' sines can be no sum of orders of single joints."""
    angles = uniform_angles()
    errors = np.zeros_like(angles)
    errors[0] += 1e-4 * np.sin(angles[1]) * np.sin(angles[2])
    assert len(search_orders(linear_model(angles, errors), PRIOR).orders) <= 1


def test_orders_that_a_grid_of_angles_does_not_tell_apart_are_listed() -> None:
    """On steps of 10 degrees 11 cycles a turn are the same as 25, with the sine turned round."""
    angles = uniform_angles()
    angles[2] = np.deg2rad(10.0) * np.round(angles[2] / np.deg2rad(10.0))
    errors = np.zeros_like(angles)
    errors[2] += 3e-4 * np.cos(11.0 * angles[2])
    (found, *_) = search_orders(linear_model(angles, errors), PRIOR).orders
    assert {found.order, *found.aliases} >= {11, 25}


def test_a_wrong_ratio_stands_against_few_cycles_a_turn_and_wins() -> None:
    """Over a part of a turn a slope of 4e-4 is nearly a wave of one cycle, and the reverse."""
    angles = uniform_angles() / 1.5
    pairs = [*whole_orders(JOINTS), *((joint, SLOPE) for joint in range(JOINTS))]
    errors = np.zeros_like(angles)
    errors[2] += 4e-4 * (angles[2] - angles[2].mean())  # no unknown here is an offset
    assert search_orders(linear_model(angles, errors), PRIOR, pairs).pairs == [(2, SLOPE)]
    errors[2] = 3e-4 * np.cos(7.0 * angles[2])
    assert (2, SLOPE) not in search_orders(linear_model(angles, errors), PRIOR, pairs).pairs


@pytest.mark.parametrize("order", [12.4, 57.3, 131.6])
def test_an_order_that_is_no_integer_is_a_peak_of_the_residual(order: float) -> None:
    angles = uniform_angles()
    errors = np.zeros_like(angles)
    errors[1] += 3e-4 * np.cos(order * angles[1] + 0.5)
    model, pairs = linear_model(angles, errors), whole_orders(JOINTS)
    peaks = peak_orders(model, pairs)
    assert min(abs(o - order) for joint, o in peaks if joint == 1) < 0.03
    (found, *_) = search_orders(model, PRIOR, [*pairs, *peaks]).pairs
    assert found == (1, pytest.approx(order, abs=0.03))


@pytest.mark.parametrize("count", [17, 100, 1001])
def test_regions_are_contiguous_and_of_about_equal_size(count: int) -> None:
    q = np.random.default_rng(1).normal(size=(count, 6)) * [3.0, 2.0, 1.5, 1.0, 0.5, 0.2]
    region = joint_regions(q)
    sizes = np.bincount(region)
    assert region.min() == 0
    assert sizes.size == REGIONS
    assert sizes.max() - sizes.min() <= REGIONS
    first = q[np.isin(region, range(REGIONS // 2))][:, 0]  # the widest direction is cut first
    second = q[~np.isin(region, range(REGIONS // 2))][:, 0]
    assert abs(first.mean() - second.mean()) > 3.0


BLOCKS = 24  # of a recording of little more than a minute


def in_blocks(model: LinearModel) -> LinearModel:
    samples = model.residual.shape[1]
    return replace(model, groups=np.arange(samples) * BLOCKS // samples, few=True)


def along_a_path(seed: int) -> LinearModel:
    """Smooth motion, and a residual that is the same error over many neighbouring samples."""
    rng = np.random.default_rng([seed, 8])
    t = np.linspace(0.0, 2.0 * np.pi, POSES)
    angles = np.stack([np.sin(n * t + n) for n in range(1, JOINTS + 1)])
    model = linear_model(angles, np.zeros_like(angles), seed)
    # slopes of a machine change with its posture, not from sample to sample
    joints = 1e4 * np.cos(angles[:, None] + np.arange(EQUATIONS)[:, None] + 1.0)
    steps = np.repeat(rng.normal(size=(EQUATIONS, BLOCKS * 2)), POSES // BLOCKS // 2 + 1, axis=1)
    return replace(model, joints=joints, residual=steps[:, :POSES])


def test_an_error_that_neighbouring_samples_share_is_no_evidence() -> None:
    alone, together = 0, 0
    for seed in range(10):
        model = along_a_path(seed)
        before = search_orders(model, PRIOR).spectrum_before
        alone += int((before > 25.0).sum())
        together += int((search_orders(in_blocks(model), PRIOR).spectrum_before > 25.0).sum())
    assert alone > 100  # of 1600 candidates, where chance alone gives none
    assert together <= 2


def test_an_order_is_found_in_few_blocks_whose_size_differs() -> None:
    """The plain statistic of 24 blocks cannot exceed 24, and 23 are asked for."""
    angles = uniform_angles()
    errors = np.zeros_like(angles)
    errors[1] += 3e-4 * np.cos(17.0 * angles[1] + 0.3)
    model = in_blocks(linear_model(angles, errors))
    assert search_orders(model, PRIOR).pairs == [(1, 17)]
    assert search_orders(replace(model, few=False), PRIOR).spectrum_before.max() <= BLOCKS


def test_the_statistic_of_few_blocks_is_exceeded_as_often_as_chi_square() -> None:
    """Scores of 20 equal blocks: of chi-square with two degrees 1 % exceed 9.21."""
    rng, blocks, trials = np.random.default_rng(4), 20, 20000
    scores = rng.normal(size=(trials, 2, blocks))
    equal = np.broadcast_to(np.eye(2)[:, :, None], (trials, 2, 2, blocks))
    each = left_out(scores, equal, prior=1e9)
    variance = np.einsum("cig,cjg->cij", each, each)
    total = scores.sum(axis=2)
    plain = np.einsum("ci,cij,cj->c", total, np.linalg.inv(variance), total)
    share = float((of_few(plain, blocks) > 9.21).mean())
    assert share == pytest.approx(0.01, abs=0.003)  # of 200 +- 14 trials


def test_candidates_may_be_any_orders() -> None:
    angles = uniform_angles()
    errors = np.zeros_like(angles)
    errors[2] += 3e-4 * np.sin(52.6 * angles[2])
    model = linear_model(angles, errors)
    search = search_orders(model, PRIOR, [*whole_orders(JOINTS), (2, 52.6)])
    assert search.pairs == [(2, 52.6)]
    assert search.spectrum_before.shape == (JOINTS, 40)
    without = [pair for pair in whole_orders(JOINTS) if pair != (1, 17)]
    assert search_orders(model, PRIOR, without).spectrum_before[1, 16] == 0.0

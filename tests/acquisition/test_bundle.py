"""The bundle of a board's pictures: its slopes, its squares, and where its adjustment ends."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.acquisition.bundle import Bundle, Pictures, adjusted, counted, prior_of
from ballbar.acquisition.picture_start import _agreeing, _angles, _focused, _posed, bundle
from ballbar.cell.arrays import Array
from ballbar.cell.board import BoardFile, board_of
from ballbar.cell.camera import Camera, Lens

LENS = np.array([800.0, 810.0, 640.0, 480.0, -0.1, 0.03, 1e-3, -1e-3, 0.01])
PRIOR = np.diag(np.array([20.0, 20.0, 10.0, 10.0, 0.05, 0.05, 5e-3, 5e-3, 0.05]) ** 2)
NOISE = 0.2  # [px]
COUNT = 9


@cache
def drawn() -> Bundle:
    """A bundle at the truth: pictures with noise, of which one corner was not seen."""
    rng = np.random.default_rng(12)
    grid = np.stack(np.meshgrid(np.arange(7), np.arange(5)), axis=-1).reshape(-1, 2)
    values = {"schema": "ballbar-board/1", "kind": "points", "points_m": 0.03 * grid,
              "sigma_m": 1e-5, "flat_m": 1e-4}  # fmt: skip
    board = board_of("board", BoardFile.model_validate(values))
    camera = Camera((1280, 960), Lens("brown", LENS + rng.normal(size=9) * 1e-3), PRIOR, NOISE)
    turns = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (COUNT, 3))).as_matrix()
    origin = np.array([-0.09, -0.06, 0.4]) + rng.uniform(-0.03, 0.03, (COUNT, 3))
    shape = np.array([1e-4, -1e-4, 5e-5, -3e-5, 4e-5])
    points = board.bent(shape)[0] @ turns.transpose(0, 2, 1) + origin[:, None]
    pixels = Lens("brown", LENS).image(points)[0]
    pixels += NOISE * rng.standard_normal(pixels.shape)
    pixels[2, 5] = np.nan
    pictures = Pictures(camera, board, pixels, np.tile(np.eye(3), (COUNT, 1, 1)))
    return Bundle(pictures, LENS, shape, turns, origin, pictures.seen, NOISE)


def with_pixels(bundle: Bundle, pixels: Array) -> Bundle:
    """The bundle of other pictures, which counts what they show."""
    pictures = replace(bundle.pictures, pixels=pixels)
    return replace(bundle, pictures=pictures, counting=pictures.seen)


def test_slopes_are_the_central_differences_of_the_residual() -> None:
    bundle = drawn()
    by_pose, by_values = bundle.slopes
    for k in range(6):
        step = np.zeros((COUNT, 6))
        step[:, k] = 1e-6
        ends = bundle.moved(-step).residual - bundle.moved(step).residual
        assert by_pose[..., k] == pytest.approx(ends / 2e-6, rel=1e-6, abs=1e-3)
    none = np.zeros((COUNT, 6))
    for k, value in enumerate(bundle.values):
        step = np.zeros(bundle.values.size)
        step[k] = 1e-6 * max(1.0, abs(value))
        ends = bundle.moved(none, -step).residual - bundle.moved(none, step).residual
        assert by_values[..., k] == pytest.approx(ends / (2.0 * step[k]), rel=1e-6, abs=1e-3)


def test_a_corner_that_was_not_seen_has_no_residual_and_no_slope() -> None:
    bundle = drawn()
    assert not bundle.residual[2, 5].any()
    assert not bundle.slopes[0][2, 5].any()
    assert bundle.counting.sum() == COUNT * 35 - 1


def test_squares_and_cost_are_those_of_corners_that_count_and_of_the_priors() -> None:
    bundle = drawn()
    bundle = replace(bundle, counting=bundle.counting & (np.arange(35) < 30))
    square = (bundle.residual[:, :30] ** 2).sum(axis=(1, 2))
    assert bundle.square == pytest.approx(square)
    mean, prior = prior_of(bundle.pictures)
    sigmas = [*np.sqrt(np.diag(PRIOR)), *[bundle.pictures.board.scale_sigma] * 2, *[1e-4] * 3]
    assert prior == pytest.approx(np.diag(np.array(sigmas) ** -2.0))
    assert mean[9:] == pytest.approx(np.zeros(5))
    assert mean[:9] == pytest.approx(bundle.pictures.camera.lens.values)
    off = (bundle.values - mean) / sigmas
    assert bundle.cost == pytest.approx(square.sum() / NOISE**2 + off @ off)


def test_the_noise_of_a_picture_is_its_own_as_far_as_its_corners_tell_it() -> None:
    bundle = drawn()
    free = 2.0 * bundle.counting.sum(axis=1) - 6.0
    expected = (bundle.square + 10.0 * NOISE**2) / (free + 10.0)
    assert bundle.picture_noise == pytest.approx(np.sqrt(expected))
    none = replace(bundle, counting=np.zeros_like(bundle.counting))
    assert none.picture_noise == pytest.approx(NOISE)
    assert not none.used.any()


def test_an_adjustment_from_far_off_ends_where_no_small_step_gains() -> None:
    bundle, rng = drawn(), np.random.default_rng(3)
    far = bundle.moved(rng.normal(size=(COUNT, 6)) * [*[5e-3] * 3, *[0.03] * 3])
    ended = adjusted(far)
    assert ended.cost < bundle.cost < far.cost
    mean, prior = prior_of(bundle.pictures)
    _, _, of_poses, of_values = ended.reduced
    slope = of_values / NOISE**2 + prior @ (mean - ended.values)
    # in standard deviations: steps ended once they gained a millionth of the squares
    assert np.abs(slope * np.sqrt(np.diag(ended.covariance))).max() < 0.05
    assert np.abs(of_poses / NOISE**2 * [*[1e-4] * 3, *[1e-3] * 3]).max() < 1.0
    again = adjusted(ended)
    assert again.cost == pytest.approx(ended.cost, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_steps_that_overshoot_are_damped_until_the_boards_stand_where_they_are(seed: int) -> None:
    """From boards turned by up to half a radian about each axis."""
    bundle, rng = drawn(), np.random.default_rng(seed)
    far = bundle.moved(rng.uniform(-1.0, 1.0, (COUNT, 6)) * [*[0.05] * 3, *[0.5] * 3])
    assert adjusted(far).cost == pytest.approx(adjusted(bundle).cost, rel=1e-4)


def test_information_is_what_the_whole_normal_matrix_leaves_without_the_poses() -> None:
    bundle = drawn()
    by_pose, by_values = bundle.slopes
    whole = np.zeros((COUNT, 35, 2, 6 * COUNT + 14))
    for k in range(COUNT):
        whole[k, ..., 6 * k : 6 * k + 6] = by_pose[k]
    whole[..., 6 * COUNT :] = by_values
    rows = whole.reshape(-1, 6 * COUNT + 14) / NOISE
    normal = rows.T @ rows
    normal[6 * COUNT :, 6 * COUNT :] += prior_of(bundle.pictures)[1]
    covariance = np.linalg.inv(normal)[6 * COUNT :, 6 * COUNT :]
    assert bundle.covariance == pytest.approx(covariance, rel=1e-6, abs=1e-12)
    determined = 14.0 - np.trace(covariance @ prior_of(bundle.pictures)[1])
    assert bundle.freedom == pytest.approx(2 * (COUNT * 35 - 1) - 6 * COUNT - determined)


def test_a_corner_that_is_far_off_is_left_out_and_the_noise_is_that_of_the_others() -> None:
    bundle = drawn()
    pixels = bundle.pictures.pixels.copy()
    pixels[4, 7] += 5.0
    pixels[6, :20] += 30.0 * np.random.default_rng(5).standard_normal((20, 2))  # a blurred one
    pictures = replace(bundle.pictures, pixels=pixels)
    ended = counted(replace(bundle, pictures=pictures))
    assert not ended.counting[4, 7]
    assert ended.used.tolist() == [k != 6 for k in range(COUNT)]
    assert ended.counting[[0, 1, 3, 5, 7, 8]].all()
    assert ended.sigma == pytest.approx(NOISE, rel=0.1)


def test_corners_that_lie_elsewhere_do_not_agree_with_the_plane_of_a_picture() -> None:
    """6 of 35 are elsewhere by a tenth of the board and more; a row of corners shows no plane."""
    true, rng = drawn(), np.random.default_rng(7)
    pixels = true.pictures.pixels.copy()
    wrong = [3, 8, 13, 18, 23, 28]
    pixels[1, wrong] += rng.uniform(40.0, 200.0, (6, 2))
    pixels[4, 7:] = np.nan
    agreeing = {n: agree for n, agree, _ in _agreeing(with_pixels(true, pixels))}
    assert sorted(set(range(35)) - set(agreeing[1])) == wrong
    assert sorted(agreeing) == [k for k in range(COUNT) if k != 4]


def test_one_of_the_two_poses_of_a_flat_board_is_the_true_one() -> None:
    """Within what 0.2 px do to a board of 0.2 m at 0.4 m; its bend and the lens are known."""
    true = drawn()
    poses = _posed(true)
    turned = [
        Rotation.from_matrix(b.rotation @ true.rotation.transpose(0, 2, 1)).magnitude()
        for b in poses
    ]
    assert np.minimum(*turned).max() < 5e-3
    nearest = np.where((turned[1] < turned[0])[:, None], poses[1].origin, poses[0].origin)
    assert np.linalg.norm(nearest - true.origin, axis=1).max() < 1e-3
    assert all(b.origin[:, 2].min() > 0.0 for b in poses), "before the camera"


@pytest.mark.parametrize(("off", "found"), [(0.93, 1.0), (1.05, 1.0), (0.5, 0.5 * 1.15)])
def test_focal_lengths_follow_from_the_boards_axes_within_their_prior(
    off: float, found: float
) -> None:
    """Both times the same share, and never further than three standard deviations."""
    true = drawn()
    lens = true.lens.copy()
    lens[:2] *= off
    covariance = PRIOR.copy()
    covariance[0, 0] = (0.05 * lens[0]) ** 2
    camera = replace(true.pictures.camera, covariance=covariance)
    start = replace(true, lens=lens, pictures=replace(true.pictures, camera=camera))
    assert _focused(start).lens[:2] == pytest.approx(found * LENS[:2], rel=0.02)
    assert _focused(start).lens[2:] == pytest.approx(lens[2:])


def test_a_bundle_starts_where_an_adjustment_of_the_truth_ends() -> None:
    true = drawn()
    pixels = true.pictures.pixels.copy()
    pixels[4, 7] += 25.0  # a wrong corner
    begun = bundle(replace(true.pictures, pixels=pixels))
    assert not begun.counting[4, 7]
    assert begun.counting.sum() == COUNT * 35 - 2
    turned = Rotation.from_matrix(begun.rotation @ true.rotation.transpose(0, 2, 1))
    assert turned.magnitude().max() < 0.01
    assert begun.sigma == pytest.approx(NOISE, rel=0.15)


def test_which_of_two_poses_a_small_board_has_is_told_by_the_flange() -> None:
    """From far away a board and its mirror image look alike; turns of the flange do not."""
    true = drawn()
    rng = np.random.default_rng(4)
    turns = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (COUNT, 3))).as_matrix()
    origin = np.array([0.0, 0.0, 6.0]) + rng.uniform(-0.3, 0.3, (COUNT, 3))
    pixels = true.pictures.camera.lens.image(
        true.pictures.board.points @ turns[..., :2].transpose(0, 2, 1) + origin[:, None]
    )[0]
    pixels += NOISE * rng.standard_normal(pixels.shape)
    pictures = replace(true.pictures, pixels=pixels, flange=turns)
    begun = bundle(pictures)
    off = Rotation.from_matrix(begun.rotation @ turns.transpose(0, 2, 1)).magnitude()
    assert np.median(off) < 0.1
    assert (off < 0.25).sum() >= COUNT - 1


def test_angles_between_orientations_are_those_of_their_turn() -> None:
    """From none to half a turn, about any axis."""
    turns = np.deg2rad([0.0, 30.0, 90.0, 150.0, 180.0])
    rotated = Rotation.from_rotvec(turns[:, None] * np.array([0.6, 0.0, 0.8])).as_matrix()
    expected = np.abs(turns[:, None] - turns)
    np.testing.assert_allclose(_angles(rotated, rotated), expected, atol=1e-7)

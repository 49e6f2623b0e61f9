"""Pictures that contradict the board's file, the robot or each other are named, and none of them
makes a good result that is wrong.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import import_poses
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.ident.cameras import cameras_of
from ballbar.ident.estimates import result_at_rest
from ballbar.ident.options import FitOptions
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_fit import fit_table
from ballbar.ident.verdict import Status
from tests.helpers.pictures import LENS, Drawn, draw, position_errors, shaped, workspace, write

CENTRE = np.array([655.0, 352.0])
Change = Callable[[Array, np.random.Generator], Array]


def estimated(drawn: Drawn, folder: Path, square: float | None = None) -> TableEstimate:
    return fit_table(import_poses(write(drawn, folder, square=square)).table)


def within(estimate: TableEstimate, drawn: Drawn) -> float:
    """Error of the tool over what is stated of it, root mean squares within the fitted ranges."""
    q, robot = workspace(drawn), estimate.identified_robot()
    q = q[robot.covered(q)]
    error, stated = position_errors(robot.tool(q), drawn.tcp(q)), robot.sigma(q)
    return float(np.sqrt((error**2).mean() / (stated**2).mean()))


def test_pictures_that_agree_make_a_good_result(tmp_path: Path) -> None:
    drawn = draw(20, board=lambda points: shaped(points, sag=3e-4))
    estimate = estimated(drawn, tmp_path)
    verdict = result_at_rest(estimate).verdict
    assert verdict.status is Status.GOOD
    assert not verdict.warnings
    assert within(estimate, drawn) < 2.0


@pytest.mark.parametrize("carried", [False, True])
def test_a_board_bent_by_a_millimetre_is_measured_and_named(
    tmp_path: Path, *, carried: bool
) -> None:
    drawn = draw(20, carried=carried, board=lambda points: shaped(points, sag=1e-3))
    estimate = estimated(drawn, tmp_path)
    verdict = result_at_rest(estimate).verdict
    assert verdict.status is Status.GOOD
    (named,) = verdict.warnings
    assert "is bent by 1.0 mm over half of its size (sag_xx)" in named
    assert "its file states 0.5 mm" in named
    assert within(estimate, drawn) < 2.0
    (camera,) = estimate.cameras.values()
    values = dict(zip(camera.errors.names, camera.values, strict=True))
    assert values["sag_xx"] == pytest.approx(1e-3, abs=1e-4)


@pytest.mark.parametrize(("share", "named"), [(0.04, r"\+4.0\d% along x and \+4.0\d% along y")])
def test_a_board_of_another_size_is_named(tmp_path: Path, share: float, named: str) -> None:
    drawn = draw(20)
    estimate = estimated(drawn, tmp_path, square=0.025 / (1.0 + share))
    verdict = result_at_rest(estimate).verdict
    assert verdict.status is Status.SUSPECT
    assert any("differs from its file" in warning for warning in verdict.warnings)
    assert re.search(named, verdict.sentence)
    assert within(estimate, drawn) < 2.0  # the robot's catalogue lengths tell the scale


@pytest.mark.parametrize("share", [0.01, 0.04])
@pytest.mark.parametrize("seed", [31, 32])
def test_a_carried_camera_s_board_of_another_size_is_not_good(
    tmp_path: Path, seed: int, share: float
) -> None:
    """The robot's lengths may take the size up in place of the board's: all in one proportion."""
    drawn = draw(seed, carried=True)
    estimate = estimated(drawn, tmp_path, square=0.025 / (1.0 + share))
    verdict = result_at_rest(estimate).verdict
    assert verdict.status is Status.SUSPECT
    assert any("measure the board again" in warning for warning in verdict.warnings)


def rolling(pixels: Array, rng: np.random.Generator) -> Array:
    """Rows read one after another in 30 ms, the board moving by some 15 cm/s."""
    time = np.nan_to_num(pixels[..., 1:] - 360.0) / 720.0 * 0.03
    return pixels + time * 70.0 * rng.standard_normal((len(pixels), 1, 2))


def focused(pixels: Array, rng: np.random.Generator) -> Array:
    """Another focal length in each picture, by 0.3 %."""
    share = 1.0 + 3e-3 * rng.standard_normal((len(pixels), 1, 1))
    return (pixels - CENTRE) * share + CENTRE


def warming(pixels: Array, rng: np.random.Generator) -> Array:
    """A focal length that grows by 0.6 % from the first picture to the last."""
    del rng
    share = 1.0 + 3e-3 * np.linspace(-1.0, 1.0, len(pixels))[:, None, None]
    return (pixels - CENTRE) * share + CENTRE


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (rolling, "the robot moved while pictures were taken"),
        (
            focused,
            r"changes by 0\.(2[5-9]|3[0-7])% \(1 sigma\) between the pictures of webcam_720p, ",
        ),
        (warming, r"webcam_720p, steadily from the first to the last, which explains [89]\d%"),
    ],
)
@pytest.mark.parametrize("carried", [False, True])
def test_pictures_that_contradict_each_other_are_named(
    tmp_path: Path, change: Change, named: str, *, carried: bool
) -> None:
    """Not by the cause of the others: a shutter or the joints are no lens, nor a lens them."""
    drawn = draw(20, carried=carried)
    wrong = replace(drawn, pixels=change(drawn.pixels, np.random.default_rng(3)))
    estimate = estimated(wrong, tmp_path)
    verdict = result_at_rest(estimate).verdict
    assert verdict.status is not Status.GOOD
    assert len(verdict.warnings) == 1
    assert re.search(named, verdict.warnings[0])
    assert within(estimate, drawn) < 2.0


def test_joints_that_err_are_no_change_of_the_lens(tmp_path: Path) -> None:
    """Errors of 1 mrad, three cycles a turn, which are not searched for."""
    drawn = draw(20)
    wrong = replace(drawn, q=drawn.q + 1e-3 * np.sin(3.0 * drawn.q))
    table = import_poses(write(wrong, tmp_path)).table
    estimate = fit_table(table, FitOptions(joint_errors="none"))
    assert not any("focal" in said for said in estimate.doubts)


def test_a_board_that_is_no_plane_is_named(tmp_path: Path) -> None:
    def wavy(points: Array) -> Array:
        return points + np.outer(1e-3 * np.sin(points[:, 0] / 0.03), [0.0, 0.0, 1.0])

    verdict = result_at_rest(estimated(draw(20, board=wavy), tmp_path)).verdict
    assert verdict.status is Status.SUSPECT
    assert "in all pictures the same" in verdict.sentence


@pytest.mark.parametrize("of", ["picture", "numbering"])
def test_a_mirror_image_is_refused(tmp_path: Path, of: str) -> None:
    drawn = draw(20, 12)
    pixels = drawn.pixels.copy()
    if of == "picture":
        pixels[..., 0] = 1279.0 - pixels[..., 0]
    else:
        pixels = pixels.reshape(len(pixels), 6, 8, 2)[:, :, ::-1].reshape(pixels.shape)
    with pytest.raises(LogError, match="those of a mirror image"):
        import_poses(write(replace(drawn, pixels=pixels), tmp_path))


@pytest.mark.parametrize(("axes", "carried"), [((3, 4), False), ((1, 2), True)])
def test_exchanged_joint_columns_are_not_good(
    tmp_path: Path, axes: tuple[int, int], *, carried: bool
) -> None:
    drawn = draw(20, carried=carried)
    q = drawn.q.copy()
    q[:, list(axes)] = q[:, list(axes[::-1])]
    estimate = estimated(replace(drawn, q=q), tmp_path)
    verdict = result_at_rest(estimate).verdict
    assert verdict.status is Status.IMPLAUSIBLE
    assert "the order, signs and units of the joint columns" in verdict.sentence
    assert estimate.identified_robot().sigma(drawn.q[:0]).shape == (0,)  # of no pose there is none


@pytest.mark.parametrize(("other", "carried"), [(11, False), (30, True)])
def test_two_exchanged_pictures_are_named_and_do_no_harm(
    tmp_path: Path, other: int, *, carried: bool
) -> None:
    drawn = draw(20, carried=carried)
    q = drawn.q.copy()
    q[[10, other]] = q[[other, 10]]
    estimate = estimated(replace(drawn, q=q), tmp_path)
    warnings = result_at_rest(estimate).verdict.warnings
    pair = f"joints.csv:12 and joints.csv:{other + 2}; exchange their angles"
    assert any(f"fit each other's joint angles: {pair}" in warning for warning in warnings)
    assert within(estimate, drawn) < 2.0


@pytest.mark.parametrize("carried", [False, True])
def test_a_picture_out_of_order_is_named_by_whose_angles_it_fits_or_has(
    tmp_path: Path, *, carried: bool
) -> None:
    """One row has another's angles; or three do in turn, the first those of a fourth."""
    drawn, row = draw(20, carried=carried), "joints.csv:{}".format
    for source in ([10], [10, 11, 12]):
        q = drawn.q.copy()
        q[source] = drawn.q[np.roll([*source, 30], 1)[: len(source)]]
        estimate = estimated(replace(drawn, q=q), tmp_path / str(len(source)))
        warnings = result_at_rest(estimate).verdict.warnings
        assert any("far from the model" in warning for warning in warnings)
        assert not any("each other's" in warning for warning in warnings)
        same = f"whose values are others: {row(12)} as {row(32)}"
        assert any(same in warning for warning in warnings) == (len(source) == 1)
        fits = f"{row(12)} that of {row(13)}, {row(13)} that of {row(14)}"
        assert any(fits in warning for warning in warnings) == (len(source) == 3)
        assert within(estimate, drawn) < 2.0


@pytest.mark.parametrize("seed", [20, 21])
def test_a_wrong_picture_is_not_said_to_fit_the_angles_of_another_row(
    tmp_path: Path, seed: int
) -> None:
    """Three of 60 have angles of no other row."""
    drawn = draw(seed)
    q = drawn.q.copy()
    q[[5, 17, 40]] += np.random.default_rng(seed).uniform(-0.5, 0.5, (3, 6))
    warnings = result_at_rest(estimated(replace(drawn, q=q), tmp_path)).verdict.warnings
    assert any("3 poses far from the model" in warning for warning in warnings)
    assert not any("joint angles of another row" in warning for warning in warnings)


def test_the_noise_of_depth_does_not_widen_the_stated_regions(tmp_path: Path) -> None:
    """The factor over chi-square is 1.5 where one scatter stands for all directions, else 1."""
    factors = [
        estimated(draw(seed, carried=True), tmp_path / str(seed)).cross_validation.factor
        for seed in (20, 100, 102)
    ]
    assert 1.0 <= np.mean(factors) < 1.3


def test_a_fit_knows_lens_and_board_better_than_the_pictures_alone(tmp_path: Path) -> None:
    """The lens is the true one within its deviation, and the robot's lengths tell of the board."""
    estimate = estimated(draw(21), tmp_path)
    (camera,) = cameras_of(estimate.fit).values()
    names = camera.errors.names
    off = [
        (value - LENS[name]) / sigma
        for name, value, sigma in zip(names, camera.values, camera.sigma, strict=True)
        if name in LENS
    ]
    assert len(off) == len(LENS)
    assert np.abs(off).max() < 4.0
    alone = np.sqrt((camera.errors.root**2).sum(axis=1))
    assert (camera.sigma <= alone * (1.0 + 1e-9)).all()
    assert (camera.sigma < 0.9 * alone)[[names.index("fx"), names.index("fy")]].all()
    assert "corners to 0.15 px; fx 10" in camera.sentence

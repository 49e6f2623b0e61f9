"""Pictures of a board in the one model: lens, poses, and the robot from files of corners."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import import_poses
from ballbar.cell.arrays import Array
from ballbar.cell.camera import Lens
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.geometry import robot_geometry
from ballbar.ident.estimator.build_unknowns import still_unknowns
from ballbar.ident.estimator.model import still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.observations import rounding_noise
from ballbar.ident.start.placements import start_of_poses
from ballbar.ident.table_fit import fit_table
from tests.helpers.pictures import (
    LENS,
    NOMINAL,
    Drawn,
    brown,
    draw,
    position_errors,
    workspace,
    write,
)

BROWN = Lens("brown", np.array(list(LENS.values())))
FISHEYE = Lens("fisheye", np.array([500.0, 502.0, 640.0, 360.0, 0.03, -0.01, 0.004, -0.001]))
POINTS = np.random.default_rng(1).uniform(-0.4, 0.4, (9, 3)) + np.array([0.0, 0.0, 0.7])


def test_lenses_are_those_of_opencv() -> None:
    cv2 = pytest.importorskip("cv2")
    zero = np.zeros(3)
    for lens, project in ((BROWN, cv2.projectPoints), (FISHEYE, cv2.fisheye.projectPoints)):
        fx, fy, cx, cy = lens.values[:4]
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        pixels = project(POINTS[:, None], zero, zero, matrix, lens.values[4:])[0].reshape(-1, 2)
        assert np.allclose(lens.image(POINTS)[0], pixels, atol=1e-9)


@pytest.mark.parametrize("carried", [False, True], ids=["camera in the cell", "on the flange"])
def test_a_robot_is_found_from_corners(tmp_path: Path, *, carried: bool) -> None:
    """Lens, noise and board as drawn, and the tool many times better than the nominal one."""
    drawn = draw(3, carried=carried)
    imported = import_poses(write(drawn, tmp_path))
    assert not imported.report.findings
    group = imported.table.groups[0]
    assert group.common is not None
    assert group.common.noise == pytest.approx(0.15, rel=0.05)
    lens = group.common.values[:9]
    sigma = np.sqrt((group.common.root**2).sum(axis=1))[:9]
    assert (np.abs(lens - BROWN.values) < 4.0 * sigma).all()
    estimate = fit_table(imported.table)
    q = workspace(drawn)
    before = position_errors((NOMINAL.flange(q) @ drawn.target)[:, :3, 3], drawn.tcp(q))
    robot = estimate.identified_robot()
    after = position_errors(robot.tool(q), drawn.tcp(q))
    assert after.mean() < 0.15 * before.mean()
    assert np.sqrt((after**2).mean()) < 2.0 * np.sqrt((robot.sigma(q) ** 2).mean())


def test_a_robot_whose_joints_are_off_by_five_degrees_is_found(tmp_path: Path) -> None:
    drawn = draw(4, zeros=np.deg2rad(5.0))
    estimate = fit_table(import_poses(write(drawn, tmp_path)).table)
    q = workspace(drawn)
    assert position_errors(estimate.identified_robot().tool(q), drawn.tcp(q)).mean() < 4e-4


def test_columns_of_lens_and_board_are_those_of_the_error(tmp_path: Path) -> None:
    """By central differences of the loop-closure error, at unknowns off their start."""
    table = import_poses(write(draw(5, 12), tmp_path)).table
    start = start_of_poses(table, robot_geometry(table.robot).robot)
    layout = still_unknowns(robot_geometry(table.robot), start, ())
    model = still_model(table, layout, (), rounding_noise(table.q))
    rng = np.random.default_rng(2)
    x = layout.mean + 0.02 * np.minimum(layout.sigma, 1.0) * rng.standard_normal(layout.count)
    (common,) = layout.placed.common.values()
    x[common] = 0.0  # to first order in them the errors are as stated
    point = model.evaluate(x, 0, np.zeros((0, 0)))
    weights = model.weights(x, point, ExcessNoise(position=1e-4, rotation=1e-4))
    jacobian = whole_jacobian(model, x, 0, point, weights)
    for i in (*range(common.start, common.stop), layout.seats["camera"].start + 4):
        step = 1e-4 * np.eye(layout.count)[i]
        ahead, back = (
            weights(model.evaluate(x + s, 0, np.zeros((0, 0))).closure.error) for s in (step, -step)
        )
        change = (ahead - back) / 2e-4
        assert np.allclose(change, jacobian[i], atol=1e-4 * np.abs(change).max() + 1e-6)


def with_wrong_corners(drawn: Drawn, rng: np.random.Generator) -> tuple[Drawn, list[int]]:
    """One corner of every sixth picture is off by up to 300 px."""
    pixels, pictures = drawn.pixels.copy(), list(range(0, len(drawn.q), 6))
    for n in pictures:
        corner = np.flatnonzero(np.isfinite(pixels[n, :, 0]))[5]
        pixels[n, corner] += rng.uniform(5.0, 300.0, 2) * rng.choice([-1.0, 1.0], 2)
    return replace(drawn, pixels=np.clip(pixels, 0.0, 1280.0)), pictures


def test_single_wrong_corners_are_left_out_and_named(tmp_path: Path) -> None:
    drawn = draw(6)
    wrong, pictures = with_wrong_corners(drawn, np.random.default_rng(1))
    imported = import_poses(write(wrong, tmp_path))
    (found,) = imported.report.findings
    assert found.kind == "corner left out"
    assert found.count == len(pictures)
    clean = import_poses(write(drawn, tmp_path / "clean")).table.groups[0]
    assert np.abs(imported.table.groups[0].values - clean.values).max() < 2e-3


def test_a_camera_without_calibration_is_found_from_a_wrong_field_of_view(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(
        "schema: ballbar-instrument/1\ntitle: Mine\n"
        "camera: {image_px: [1280, 720], field_of_view_deg: 76}\n"
    )
    group = import_poses(write(draw(7), tmp_path, instrument="mine.yaml")).table.groups[0]
    assert group.common is not None
    assert group.common.values[:2] == pytest.approx([1050.0, 1048.0], abs=8.0)
    assert group.common.noise == pytest.approx(0.15, rel=0.05)


def changed(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("poses.yaml", "webcam_720p", "tracker_pose", "tracker_pose is no camera"),
        ("board.yaml", "squares_x: 9", "squares_x: 8", "has corners 0 to 41"),
        ("corners.csv", "image_", "picture_", "no picture has a name of column image"),
        ("joints.csv", "image_001.png", "image_002.png", "names picture image_002.png in two rows"),
        ("corners.csv", "image_000.png,1,", "image_000.png,0,", "corner 0 of this picture"),
    ],
)
def test_files_that_contradict_each_other_are_refused(
    tmp_path: Path, file: str, old: str, new: str, message: str
) -> None:
    write(draw(8, 8, cut=0.0), tmp_path)
    changed(tmp_path / file, old, new)
    with pytest.raises((DescriptionError, LogError), match=message):
        import_poses(tmp_path)


def test_pictures_of_a_rolled_numbering_are_refused(tmp_path: Path) -> None:
    """Column by column instead of row by row: no picture lies as on the board."""

    def by_columns(points: Array) -> Array:
        return points.reshape(6, 8, 3).transpose(1, 0, 2).reshape(-1, 3)

    drawn = draw(9, 12, board=by_columns)
    with pytest.raises(LogError, match="Are they numbered from 0, row by row"):
        import_poses(write(drawn, tmp_path))


def test_the_generator_images_as_opencv() -> None:
    cv2 = pytest.importorskip("cv2")
    fx, fy, cx, cy, *distortion = LENS.values()
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    pixels = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), matrix, np.array(distortion))[0]
    assert np.allclose(brown(POINTS), pixels[:, 0], atol=1e-9)


def test_a_warm_board_is_larger_in_the_same_pictures(tmp_path: Path) -> None:
    """At 35 degC a board of aluminium has grown by 15 * 23e-6, and the target is as much further
    off. Its scale is less certain by u(T) = 2 K and u(per_K) = 2e-6.
    """
    folder = write(draw(3, carried=False), tmp_path)
    (cold,) = import_poses(folder).table.groups
    board = folder / "board.yaml"
    board.write_text(board.read_text() + "expansion: {per_K: 23.0e-6, sigma_per_K: 2.0e-6}\n")
    poses = folder / "poses.yaml"
    stated = "temperature_C: 35.0\ntemperature_sigma_K: 2.0\n"
    poses.write_text(poses.read_text() + stated)
    read = import_poses(folder)
    (warm,) = read.table.groups
    longer = (1.0 + 15.0 * 23e-6) * cold.values[:, :3]  # but for the prior of the board's sag
    assert warm.values[:, :3] == pytest.approx(longer, rel=1e-6, abs=1e-7)
    assert warm.common is not None
    assert cold.common is not None
    scale = warm.common.names.index("scale_x")
    before, after = (float(g.common.declared[scale, 1]) for g in (cold, warm))
    thermal = np.hypot(23e-6 * 2.0, 15.0 * 2e-6)
    assert after == pytest.approx(np.hypot(before, thermal), rel=1e-6)
    assert read.expansion is not None

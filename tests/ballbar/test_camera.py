"""`ballbar camera`: boards to print, and their corners in drawn pictures."""

from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from ballbar.acquisition.pose_tables import import_poses  # noqa: E402
from ballbar.camera.corner_files import CORNERS, SHEET, write_corners  # noqa: E402
from ballbar.camera.detect import detect  # noqa: E402
from ballbar.camera.print_board import write_board  # noqa: E402
from ballbar.cell.arrays import Array  # noqa: E402
from ballbar.cell.board import BoardFile, load_board  # noqa: E402
from ballbar.cell.board_pattern import Pattern  # noqa: E402
from ballbar.cell.camera import Lens  # noqa: E402
from ballbar.cell.errors import DescriptionError, InputError  # noqa: E402
from ballbar.cell.placement import Placement  # noqa: E402
from tests.helpers.command_line import ballbar, refusal  # noqa: E402
from tests.helpers.drawn_boards import Exposure, dark, draw  # noqa: E402
from tests.helpers.pictures import draw as sighted  # noqa: E402
from tests.helpers.pictures import write  # noqa: E402

SIZE = (640, 480)
LENS = Lens("brown", np.array([700.0, 705.0, 322.0, 236.0, -0.15, 0.05, 5e-4, -3e-4, 0.0]))
SQUARE = 0.03


def board_of(kind: str, squares: tuple[int, int] = (8, 7)) -> BoardFile:
    marked = {"marker_m": 0.72 * SQUARE, "dictionary": "DICT_4X4_50"} if kind == "charuco" else {}
    return BoardFile.model_validate(
        {
            "schema": "ballbar-board/1",
            "kind": kind,
            "squares_x": squares[0],
            "squares_y": squares[1],
            "square_m": SQUARE,
            "sigma_m": 1e-5,
            **marked,
        }
    )


def seen_at(turn: Array, distance: float = 0.45) -> Placement:
    """A board whose middle stands before the camera."""
    rotation = np.asarray(cv2.Rodrigues(turn)[0])
    middle = 0.5 * SQUARE * np.array([8.0, 7.0, 0.0])
    return Placement(rotation, np.array([0.01, -0.02, distance]) - rotation @ middle)


def picture(pattern: Pattern, stand: Placement, seed: int = 0) -> Array:
    return draw(pattern, LENS, SIZE, stand, Exposure(0.8, 2.0), np.random.default_rng(seed))


def true_corners(stand: Placement) -> Array:
    """(C, 2) [px] by OpenCV's projection."""
    grid = np.array([[x, y, 0.0] for y in range(1, 7) for x in range(1, 8)]) * SQUARE
    fx, fy, cx, cy = LENS.values[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    turn = cv2.Rodrigues(stand.rotation)[0]
    pixels, _ = cv2.projectPoints(grid, turn, stand.origin, matrix, LENS.values[4:])
    return np.asarray(pixels).reshape(-1, 2)


TURNS = [(0.2, -0.5, 0.1), (-0.5, 0.3, 1.5), (0.4, 0.3, 3.0), (-0.3, -0.4, -1.4)]


@pytest.mark.parametrize("kind", ["charuco", "checkerboard"])
@pytest.mark.parametrize("turn", TURNS, ids=str)
def test_corners_are_where_the_lens_images_them_and_have_their_numbers(
    tmp_path: Path, kind: str, turn: tuple[float, float, float]
) -> None:
    pattern, stand = Pattern(board_of(kind)), seen_at(np.array(turn))
    cv2.imwrite(str(tmp_path / "a.png"), picture(pattern, stand))
    (found,) = detect([tmp_path / "a.png"], pattern)
    assert found.used
    assert len(found.numbers) >= 40
    off = found.pixels - true_corners(stand)[found.numbers]
    assert np.sqrt((off**2).mean()) < 0.08
    if kind == "checkerboard":  # no marker is near its corners: the drawing has no shift either
        assert np.abs(off.mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("squares", [(8, 7), (9, 6), (8, 6), (7, 7)])
def test_the_print_is_that_of_opencv(squares: tuple[int, int]) -> None:
    pattern, cell = Pattern(board_of("charuco", squares)), 50
    image = pattern.charuco.generateImage((squares[0] * cell, squares[1] * cell))
    y, x = SQUARE / cell * (np.mgrid[0 : squares[1] * cell, 0 : squares[0] * cell] + 0.5)
    printed = dark(pattern, x, y)
    assert np.array_equal(printed, image < 128)
    covered = np.zeros_like(printed)
    for left, top, width, height in pattern.rectangles():
        covered |= (x > left) & (x < left + width) & (y > top) & (y < top + height)
    assert np.array_equal(covered, printed)


def folder_of_pictures(folder: Path) -> Path:
    """Two good pictures, and one of each kind that cannot be used."""
    pattern = Pattern(board_of("charuco"))
    good = [picture(pattern, seen_at(np.array(turn)), k) for k, turn in enumerate(TURNS[:2])]
    grey = np.random.default_rng(1).normal(120.0, 3.0, SIZE[::-1])
    images = {
        "a.png": good[0],
        "b.png": good[1],
        "blank.png": np.asarray(grey, dtype=np.uint8),
        "blurred.png": cv2.GaussianBlur(good[1], (0, 0), 12.0),
        "half.png": cv2.resize(good[0], (320, 240)),
        "mirrored.png": np.ascontiguousarray(good[0][:, ::-1]),
        "twice.png": good[0],
        "unnamed.png": picture(pattern, seen_at(np.array(TURNS[3])), 3),
    }
    (folder / "pictures").mkdir(parents=True)
    for name, image in images.items():
        cv2.imwrite(str(folder / "pictures" / name), image)
    rows = "\n".join(f"{name},0,0,0,0,0,0" for name in images if name != "unnamed.png")
    (folder / "joints.csv").write_text(f"image,J1,J2,J3,J4,J5,J6\n{rows}\n")
    (folder / "board.yaml").write_text(
        "schema: ballbar-board/1\nkind: charuco\nsquares_x: 8\nsquares_y: 7\nsquare_m: 0.03\n"
        "marker_m: 0.0216\ndictionary: DICT_4X4_50\nsigma_m: 1.0e-5\n"
    )
    return folder


def test_every_picture_that_cannot_be_used_is_named_with_its_reason(tmp_path: Path) -> None:
    folder = folder_of_pictures(tmp_path)
    found = write_corners(
        folder / "found", [folder / "pictures"], folder / "board.yaml", folder / "joints.csv"
    )
    assert {p.name: p.unused for p in found} == {
        "a.png": None,
        "b.png": None,
        "blank.png": "no board seen",
        "blurred.png": "blurred",
        "half.png": "320 x 240 px, others 640 x 480",
        "mirrored.png": "the board is mirrored",
        "twice.png": "the same picture as a.png",
        "unnamed.png": "no row of joint angles names it",
    }
    rows = (folder / "found" / CORNERS).read_text().splitlines()
    assert rows[0] == "image,corner,u,v"
    assert {row.split(",")[0] for row in rows[1:]} == {"a.png", "b.png"}
    sheet = cv2.imread(str(folder / "found" / SHEET))
    assert sheet is not None
    assert sheet.shape[1] > 5 * 360


def test_a_folder_without_one_good_picture_is_refused_and_nothing_written(tmp_path: Path) -> None:
    folder = folder_of_pictures(tmp_path)
    blank = folder / "pictures" / "blank.png"
    with pytest.raises(InputError, match="none of 1 pictures can be used: no board seen"):
        write_corners(folder / "found", [blank], folder / "board.yaml", folder / "joints.csv")
    assert not (folder / "found").exists()


def test_a_file_that_is_no_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("text")
    with pytest.raises(InputError, match=r"a\.png: is no picture"):
        detect([tmp_path / "a.png"], Pattern(board_of("charuco")))


def test_a_checkerboard_that_looks_the_same_after_half_a_turn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="looks the same after half a turn"):
        detect([tmp_path / "a.png"], Pattern(board_of("checkerboard", (8, 6))))
    with pytest.raises(InputError, match=r"Take 8x7, or --kind charuco"):
        write_board(tmp_path / "b.pdf", "checkerboard", (8, 6), None, "A4")
    assert not list(tmp_path.iterdir())


def test_a_printed_board_has_its_true_size(tmp_path: Path) -> None:
    """The area of an A4 page, the board in its middle, and a description that is read."""
    description, board = write_board(tmp_path / "board.pdf", "charuco", (9, 7), None, "A4")
    assert load_board(description).file == board
    assert board.square_m == pytest.approx(0.026)
    page = (tmp_path / "board.pdf").read_bytes()
    width, height = 297.0 / 25.4 * 72.0, 210.0 / 25.4 * 72.0
    box = page.split(b"/MediaBox [")[1].split(b"]")[0].split()
    assert [float(side) for side in box[2:]] == pytest.approx([width, height], abs=0.01)
    with pytest.raises(InputError, match="do not fit on A4"):
        write_board(tmp_path / "large.pdf", "charuco", (9, 7), 40.0, "A4")


def test_a_dictionary_that_opencv_does_not_have_is_named() -> None:
    board = board_of("charuco").model_copy(update={"dictionary": "DICT_3X3_50"})
    with pytest.raises(DescriptionError, match="OpenCV has no DICT_3X3_50"):
        Pattern(board).charuco  # noqa: B018


def test_a_folder_of_poses_is_made_from_corners_and_joint_angles(tmp_path: Path) -> None:
    """By `ballbar new`; the poses are those of a poses.yaml written by hand."""
    given = write(sighted(3, 12), tmp_path / "given")
    made = tmp_path / "made"
    options = ["--robot", "ur5e", "--instrument", "webcam_720p", "--joint-unit", "deg"]
    files = ["--corners", given / "corners.csv", "--board", given / "board.yaml"]
    ballbar("new", made, "--poses", given / "joints.csv", *files, "--camera", "cell", *options)
    assert sorted(p.name for p in (made / "raw").rglob("*.csv")) == ["corners.csv", "joints.csv"]
    one, other = (import_poses(folder).table.groups[0] for folder in (given, made))
    assert np.array_equal(one.values, other.values)


def test_without_corners_a_table_of_pictures_is_asked_for_them(tmp_path: Path) -> None:
    given = write(sighted(3, 12), tmp_path / "given")
    options = ["--robot", "ur5e", "--instrument", "webcam_720p", "--joint-unit", "deg"]
    text = refusal("new", tmp_path / "made", "--poses", given / "joints.csv", *options)
    assert "which file holds the corners" in text
    assert not (tmp_path / "made").exists()

"""`ballbar camera`: boards to print, and their corners in drawn pictures."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from ballbar.acquisition.bundle import FEWEST  # noqa: E402
from ballbar.acquisition.pose_tables import import_poses  # noqa: E402
from ballbar.camera import corner_files  # noqa: E402
from ballbar.camera.contact_sheet import _cell, contact_sheet  # noqa: E402
from ballbar.camera.corner_files import CORNERS, SHEET, write_corners  # noqa: E402
from ballbar.camera.detect import Picture, _compared, _from_the_first, _on_a_plane, detect  # noqa: E402
from ballbar.camera.print_board import PAPERS, _described, _drawn, _text, _title, write_board  # noqa: E402
from ballbar.cell.arrays import Array  # noqa: E402
from ballbar.cell.board import BoardFile, BoardKind, load_board  # noqa: E402
from ballbar.cell.board_pattern import Pattern  # noqa: E402
from ballbar.cell.camera import Lens  # noqa: E402
from ballbar.cell.errors import DescriptionError, InputError  # noqa: E402
from ballbar.cell.placement import Placement  # noqa: E402
from ballbar.figure_style import BLUE, RED, rgb  # noqa: E402
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


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good pictures, and one of each kind that cannot be used."""
    folder = tmp_path_factory.mktemp("pictured")
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


def test_every_picture_that_cannot_be_used_is_named_with_its_reason(
    pictured: Path, tmp_path: Path
) -> None:
    folder = pictured
    found = write_corners(
        tmp_path / "found", [folder / "pictures"], folder / "board.yaml", folder / "joints.csv"
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
    rows = (tmp_path / "found" / CORNERS).read_text().splitlines()
    assert rows[0] == "image,corner,u,v"
    assert {row.split(",")[0] for row in rows[1:]} == {"a.png", "b.png"}
    sheet = cv2.imread(str(tmp_path / "found" / SHEET))
    assert sheet is not None
    assert sheet.shape[1] > 5 * 360


def test_a_folder_without_one_good_picture_is_refused_and_nothing_written(
    pictured: Path, tmp_path: Path
) -> None:
    folder = pictured
    blank = folder / "pictures" / "blank.png"
    with pytest.raises(InputError, match="none of 1 pictures can be used: no board seen"):
        write_corners(tmp_path / "found", [blank], folder / "board.yaml", folder / "joints.csv")
    assert not (tmp_path / "found").exists()


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


def printed(kind: BoardKind, squares: tuple[int, int], paper: str) -> Array:
    """(R, 4) [mm] left, top, width and height of each line and area of the page."""
    pattern = Pattern(_described(kind, squares, None, paper))
    with matplotlib.rc_context({"pdf.compression": 0}):
        page = _drawn(pattern, PAPERS[paper]).decode("latin-1")
    mm, high = 25.4 / 72.0, PAPERS[paper][1]
    boxes = []
    for outline in re.findall(r"\S+ \S+ m\n(?:\S+ \S+ l\n)+", page):
        points = np.array([p.split()[:2] for p in outline.splitlines()], dtype=float) * mm
        low, high_ = points.min(axis=0), points.max(axis=0)
        boxes.append((low[0], high - high_[1], *(high_ - low)))
    return np.array(boxes)


def test_both_rulers_are_100_mm_long_beside_the_board_with_a_long_tick_each_centimetre() -> None:
    """4 mm below the board and 4 mm left of it; ticks of 1.5 and 3 mm away from it."""
    boxes = printed("charuco", (9, 7), "A4")
    left, top = (297.0 - 9 * 26.0) / 2.0, (210.0 - 7 * 26.0) / 2.0
    dark = boxes[(np.abs(boxes[:, 2:] - 26.0) < 2e-3).all(axis=1)]
    squares = [
        (left + 26 * i, top + 26 * j) for j in range(7) for i in range(9) if (i + j) % 2 == 0
    ]
    np.testing.assert_allclose(dark[:, :2], squares, atol=2e-3)
    upright = boxes[(boxes[:, 2] < 1e-3) & (boxes[:, 3] < 3.1)]
    across = boxes[(boxes[:, 3] < 1e-3) & (boxes[:, 2] < 3.1)]
    for ticks, axis, begin, edge in (
        (upright, 0, left, top + 182.0 + 4.0),
        (across, 1, top, left - 4.0),
    ):
        assert len(ticks) == 101
        order = np.argsort(ticks[:, axis])
        np.testing.assert_allclose(ticks[order, axis], begin + np.arange(101), atol=2e-3)
        expected = np.where(np.arange(101) % 10 == 0, 3.0, 1.5)
        size = ticks[order, 3 - axis]
        np.testing.assert_allclose(size, expected, atol=2e-3)
        near = ticks[order, 1] if axis == 0 else ticks[order, 0] + size
        np.testing.assert_allclose(near, edge, atol=2e-3)
    long = boxes[(boxes[:, 2] > 99.0) ^ (boxes[:, 3] > 99.0)]
    lines = long[(long[:, 2] < 1e-3) | (long[:, 3] < 1e-3)]
    np.testing.assert_allclose(
        sorted(lines.round(2).tolist()),
        [[left - 4.0, top, 0.0, 100.0], [left, top + 186.0, 100.0, 0.0]], atol=0.011,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("squares", "paper", "side", "markers"),
    [((9, 7), "A4", 26.0, 50), ((6, 9), "A4", 20.0, 50), ((20, 14), "A3", 19.0, 250),
     ((10, 10), "A1", 56.0, 50), ((9, 8), "A5", 15.0, 50)],
)  # fmt: skip
def test_squares_are_the_largest_whole_millimetres_within_margins_of_14_mm(
    squares: tuple[int, int], paper: str, side: float, markers: int
) -> None:
    board = _described("charuco", squares, None, paper)
    assert board.square_m == pytest.approx(side * 1e-3)
    assert board.marker_m == pytest.approx(0.72 * side * 1e-3, abs=5e-5)
    assert board.dictionary == f"DICT_4X4_{markers}"
    assert board.sigma_m == pytest.approx(0.003 * side * 1e-3, abs=1e-6)
    room = np.array(PAPERS[paper]) - 28.0
    assert (side * np.array(squares) <= room).all()
    assert ((side + 1.0) * np.array(squares) > room).any()


def test_a_board_that_just_fits_is_taken_and_one_with_too_many_markers_is_not() -> None:
    exact = (297.0 - 28.0) / 10.0
    assert _described("charuco", (10, 6), exact, "A4").square_m == pytest.approx(exact * 1e-3)
    with pytest.raises(InputError, match=r"269\.1 x 161\.46 mm do not fit on A4.*; 26\.9 mm would"):
        _described("charuco", (10, 6), exact + 0.01, "A4")
    with pytest.raises(InputError, match="do not fit"):
        _described("charuco", (10, 6), 0.0, "A4")
    fits = _described("charuco", (50, 40), 10.0, "A1")
    assert fits.dictionary == "DICT_4X4_1000"
    with pytest.raises(InputError, match="1001 markers; OpenCV has 1000 of a kind"):
        _described("charuco", (77, 26), 5.0, "A1")
    plain = _described("checkerboard", (77, 26), 5.0, "A1")
    assert plain.marker_m is plain.dictionary is None


def test_the_description_says_what_is_to_be_measured() -> None:
    text = _text(_described("charuco", (9, 7), None, "A4"))
    assert "Measure a whole row of 9 squares, here 234 mm," in text
    assert "0.1 mm over the row is 1e-05 m" in text
    assert "square_m: 0.026\nmarker_m: 0.0187\ndictionary: DICT_4X4_50\nsigma_m: 7.8e-05" in text
    plain = _text(_described("checkerboard", (9, 8), None, "A5"))
    assert "marker" not in plain
    assert "dictionary" not in plain
    title = _title(Pattern(_described("charuco", (9, 7), None, "A4")))
    assert title.startswith("charuco, 9 x 7 squares of 26 mm, DICT_4X4_50 of 18.7 mm. Print at")


def a_picture(**given: Any) -> Picture:
    whole: dict[str, Any] = {
        "name": "a.png", "size": (720, 480), "numbers": np.arange(3),
        "pixels": np.array([[100.0, 60.0], [400.0, 300.0], [600.0, 400.0]]),
        "thumbnail": np.full((240, 360), 128, dtype=np.uint8), "sharpness": 1.0, "digest": "a",
    }  # fmt: skip
    return Picture(**whole | given)


def test_a_sheet_has_five_pictures_in_a_row_with_gaps_round_each() -> None:
    for count, (rows, columns) in ((1, (1, 1)), (5, (1, 5)), (6, (2, 5)), (11, (3, 5))):
        sheet = cv2.imdecode(
            np.frombuffer(contact_sheet([a_picture()] * count), np.uint8), cv2.IMREAD_COLOR
        )
        assert sheet.shape == (rows * (240 + 40 + 8) + 8, columns * (360 + 8) + 8, 3)
        grey = (sheet == 128).all(axis=2)
        inside = [
            grey[8 + 288 * (k // 5) :, 8 + 368 * (k % 5) :][100:200, 200:300].mean()
            for k in range(count)
        ]
        assert min(inside) > 0.8
        assert not grey[:8].any()
        assert not grey[:, :8].any()


def test_corners_are_ringed_where_they_are_and_the_first_is_filled() -> None:
    """At half the size of the picture; blue where it is used, red and thick where it is not."""
    cell = _cell(a_picture(numbers=np.array([7, 2, 9])))
    blue, red = (np.array(rgb(colour)[::-1]) for colour in (BLUE, RED))
    assert cell.shape == (280, 360, 3)
    assert (cell[150, 200] == blue).all(), "the one of the lowest number"
    assert (cell[30, 50] == 128).all()
    assert (cell[200, 300] == 128).all()
    for u, v in ((50, 30), (300, 200)):
        ring = np.abs(cell[v - 4 : v + 5, u - 4 : u + 5].astype(int) - blue).sum(axis=2)
        assert (ring < 60).sum() >= 8
    assert (cell[0] == blue).all()
    assert (cell[239, :] == blue).all()
    assert (cell[2, 2:-2] == 128).all()
    bad = _cell(
        a_picture(unused="no board seen", numbers=np.zeros(0, dtype=int), pixels=np.zeros((0, 2)))
    )
    assert (bad[1, 1:-1] == red).all()
    assert (bad[150, 200] == 128).all()


@pytest.mark.parametrize(("good", "code"), [(1, 0), (2, 0), (0, 1)])
def test_less_than_half_of_the_pictures_is_a_failure(
    good: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = [a_picture(), a_picture(name="b.png", numbers=np.arange(5))][:good]
    pictures += [a_picture(name="c.png", unused="blurred")] * (2 - good or 1)
    monkeypatch.setattr(corner_files, "write_corners", lambda *_: tuple(pictures))
    words = ["camera", "detect", tmp_path, "--board", "board.yaml", "--joints", "j.csv"]
    got, said, error = ballbar(*words, "--out", tmp_path / "found")
    assert got == code
    corners = 3 * (good > 0) + 5 * (good > 1)
    expected = (
        f"{corners} corners in {good} of {len(pictures)} pictures: {tmp_path}/found/corners.csv."
    )
    assert expected in said
    assert f"Look at {tmp_path}/found/contact_sheet.png." in said
    assert "c.png: blurred" in said
    assert ("can be used" in error) == bool(code)
    data = json.loads(ballbar(*words, "--out", tmp_path / "found", "--json")[1])
    assert data["corners"] == {p.name: len(p.numbers) for p in pictures[:good]}
    assert data["unused"] == {"c.png": "blurred"}


def test_the_command_writes_the_board_that_is_asked_for(tmp_path: Path) -> None:
    said = ballbar("camera", "board", "--out-file", tmp_path / "b.pdf", "--squares", "6 x 5")
    if said[0]:
        said = ballbar("camera", "board", "--out", tmp_path / "b.pdf", "--squares", "6x5")
    assert said[0] == 0, said[2]
    assert "b.pdf and" in said[1]
    board = load_board(tmp_path / "b.yaml").file
    assert (board.squares_x, board.squares_y, board.kind) == (6, 5, "charuco")
    assert "expected two whole numbers such as 9x7" in refusal("camera", "board", "--squares", "9")


def test_pictures_that_differ_repeat_or_are_blurred_are_left_out_by_those_that_are_used() -> None:
    """Blurred is what has no board and a quarter of the others' sharpness."""
    unseen = {"unused": "no board seen", "digest": "x"}
    pictures = [
        a_picture(name="one", digest="1"), a_picture(name="two", digest="2", sharpness=3.0),
        a_picture(name="again", digest="1"), a_picture(name="small", digest="3", size=(360, 240)),
        a_picture(name="soft", sharpness=0.49, **unseen),
        a_picture(name="sharp", sharpness=0.51, **(unseen | {"digest": "y"})),
        a_picture(name="few", sharpness=0.1, digest="z", unused="only 3 corners seen"),
    ]  # fmt: skip
    pictures[2] = replace(pictures[2], sharpness=3.0)
    out = {p.name: p.unused for p in _compared(pictures)}
    assert out == {
        "one": None, "two": None, "again": "the same picture as one",
        "small": "360 x 240 px, others 720 x 480", "soft": "blurred", "sharp": "no board seen",
        "few": "only 3 corners seen",
    }  # fmt: skip


def test_corners_off_the_plane_of_the_others_are_no_picture_of_the_board() -> None:
    """A board seen at an angle; mirrored, or with every other corner elsewhere, it is none."""
    pattern = Pattern(board_of("charuco"))
    numbers = np.arange(42)
    places = np.stack((numbers % 7, numbers // 7), axis=1) * 40.0
    shear = np.array([[1.0, 0.2], [-0.1, 0.9]])
    seen = places @ shear.T + 50.0
    kept, pixels = _on_a_plane(numbers, seen, pattern)
    assert kept.size == 42
    assert pixels is seen
    assert not _on_a_plane(numbers, seen * [-1.0, 1.0], pattern)[0].size
    rng = np.random.default_rng(1)
    for share, count in ((0.2, 42), (0.4, 0)):
        off = seen.copy()
        wrong = rng.permutation(42)[: int(share * 42)]
        off[wrong] += rng.choice([-1.0, 1.0], (wrong.size, 2)) * rng.uniform(
            15.0, 60.0, (wrong.size, 2)
        )
        assert _on_a_plane(numbers, off, pattern)[0].size == count
    few = numbers[: FEWEST - 1]
    assert not _on_a_plane(few, seen[: FEWEST - 1], pattern)[0].size


def test_the_first_square_of_a_checkerboard_is_the_dark_one() -> None:
    """A grid that was found from the other end is turned about by half a turn."""
    grey = np.full((200, 260), 255, dtype=np.uint8)
    for row in range(5):
        for column in range(6):
            if (row + column) % 2 == 0:
                grey[20 + 30 * row : 50 + 30 * row, 20 + 30 * column : 50 + 30 * column] = 0
    y, x = np.mgrid[50:171:30, 50:201:30][:, :4, :5]
    grid = np.stack((x, y), axis=2).astype(float)
    assert np.array_equal(_from_the_first(grey, grid), grid)
    assert np.array_equal(_from_the_first(grey, grid[::-1, ::-1]), grid)

"""The print of a board against OpenCV's own picture of it."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.board import BoardFile
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.errors import DescriptionError
from tests.helpers.drawn_boards import dark

cv2 = pytest.importorskip("cv2")
SQUARE, MARKER = 0.03, 0.018  # [m] a cell of a marker is 3 mm: 3 px of the picture below


def pattern(kind: str, squares: tuple[int, int] = (5, 4), **changes: object) -> Pattern:
    marks = {"marker_m": MARKER, "dictionary": "DICT_4X4_50"} if kind == "charuco" else {}
    values = {
        "schema": "ballbar-board/1", "kind": kind, "squares_x": squares[0],
        "squares_y": squares[1], "square_m": SQUARE, "sigma_m": 1e-5,
    }  # fmt: skip
    return Pattern(BoardFile.model_validate(values | marks | changes))


@pytest.mark.parametrize("squares", [(5, 4), (6, 3)])
def test_a_charuco_board_is_dark_where_opencv_prints_it_dark(squares: tuple[int, int]) -> None:
    made = pattern("charuco", squares)
    image = made.charuco.generateImage((30 * squares[0], 30 * squares[1]))
    v, u = (np.arange(n) + 0.5 for n in image.shape)  # middles of pixels of a millimetre
    x, y = np.meshgrid(1e-3 * u, 1e-3 * v)
    assert np.array_equal(dark(made, x, y), image < 128)


@pytest.mark.parametrize("kind", ["charuco", "checkerboard"])
def test_the_dark_parts_are_rectangles_and_nothing_outside_the_board_is_dark(kind: str) -> None:
    made = pattern(kind)
    x, y = np.random.default_rng(6).uniform(-0.02, 0.17, (2, 20_000))
    covered = np.zeros(x.size, dtype=bool)
    for left, top, width, height in made.rectangles():
        covered |= (x >= left) & (x < left + width) & (y >= top) & (y < top + height)
    assert np.array_equal(dark(made, x, y), covered)
    outside = (x < 0.0) | (x > 5 * SQUARE) | (y < 0.0) | (y > 4 * SQUARE)
    assert outside.any()
    assert not dark(made, x, y)[outside].any()


def test_the_first_square_is_dark_and_its_neighbours_are_light() -> None:
    made, middle = pattern("checkerboard"), 0.5 * SQUARE
    at = middle + SQUARE * np.array([0.0, 1.0, 0.0, 1.0])
    down = middle + SQUARE * np.array([0.0, 0.0, 1.0, 1.0])
    assert dark(made, at, down).tolist() == [True, False, False, True]
    assert len(made.rectangles()) == 10


@pytest.mark.parametrize(
    ("kind", "squares", "turns"),
    [
        ("checkerboard", (6, 4), True),
        ("checkerboard", (5, 7), True),
        ("checkerboard", (6, 5), False),
        ("charuco", (6, 4), False),
    ],
)
def test_a_checkerboard_of_equal_parity_looks_the_same_after_half_a_turn(
    kind: str, squares: tuple[int, int], *, turns: bool
) -> None:
    assert pattern(kind, squares).turns is turns


@pytest.mark.parametrize(
    ("changes", "squares", "why"),
    [
        ({"dictionary": "DICT_9X9"}, (5, 4), "OpenCV has no DICT_9X9"),
        ({"dictionary": "CORNER_REFINE_NONE"}, (5, 4), "OpenCV has no CORNER"),
        ({}, (11, 10), "dictionary: 55 markers, but DICT_4X4_50 has 50. Take a larger one"),
        ({"marker_m": 0.03}, (5, 4), "marker_m: a marker is smaller than its square"),
    ],
)
def test_a_board_that_opencv_cannot_print_is_refused(
    changes: dict[str, object], squares: tuple[int, int], why: str
) -> None:
    with pytest.raises(DescriptionError, match=why):
        _ = pattern("charuco", squares, **changes).charuco


def test_as_many_markers_as_the_dictionary_has_are_enough() -> None:
    assert len(pattern("charuco", (10, 10)).cells) == 50


def test_a_board_of_points_has_no_squares() -> None:
    points = [[0.1 * k, 0.02 * k * k] for k in range(6)]
    values = {"schema": "ballbar-board/1", "kind": "points", "points_m": points, "sigma_m": 1e-5}
    board = Pattern(BoardFile.model_validate(values))
    assert board.marker == board.square == 0.0
    with pytest.raises(DescriptionError, match="a board of points has no squares"):
        _ = board.squares

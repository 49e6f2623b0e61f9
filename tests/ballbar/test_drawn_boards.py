"""Drawn pictures: grey levels where the lens images the board, its paper and the table."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.board import BoardFile
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.camera import Lens
from ballbar.cell.placement import Placement
from ballbar.cell.rotation import matrix_from_rotvec
from tests.helpers.drawn_boards import Exposure, _window, draw

SQUARE, SIZE = 0.03, (320, 240)
CENTRE = np.array([159.5, 119.5])  # [px] of the optical axis
PATTERN = Pattern(
    BoardFile.model_validate(
        {
            "schema": "ballbar-board/1", "kind": "checkerboard", "squares_x": 5, "squares_y": 4,
            "square_m": SQUARE, "sigma_m": 1e-5,
        }
    )
)  # fmt: skip
LENS = Lens("brown", np.array([400.0, 400.0, *CENTRE, -0.2, 0.05, 1e-3, -1e-3, 0.0]))
TURN = np.asarray(matrix_from_rotvec(np.array([[0.2], [-0.1], [0.3]]))[..., 0])
BOARD = Placement(rotation=TURN, origin=np.array([-0.06, -0.06, 0.4]))
STILL = Exposure(blur=0.0, noise=0.0)


@cache
def picture(exposure: Exposure = STILL, board: Placement = BOARD, seed: int = 1) -> Array:
    rng = np.random.default_rng(seed)
    return draw(PATTERN, LENS, SIZE, board, exposure, rng).astype(float)


def imaged(x: float, y: float) -> tuple[int, int]:
    """Row and column of the pixel at which a point of the board [squares] is seen."""
    point = TURN @ (SQUARE * np.array([x, y, 0.0])) + BOARD.origin
    u, v = LENS.image(point)[0]
    return round(float(v)), round(float(u))


def light(column: int) -> float:
    """Factor on grey levels: 0.075 less on the left, as much more on the right."""
    return float(1.0 + 0.075 * (2.0 * column / (SIZE[0] - 1) - 1.0))


@pytest.mark.parametrize(
    ("x", "y", "grey"),
    [
        (0.5, 0.5, 35.0), (1.5, 0.5, 215.0), (2.5, 1.5, 215.0), (3.5, 2.5, 215.0),
        (4.5, 3.5, 215.0), (2.5, 2.5, 35.0), (-0.3, 1.5, 215.0), (5.3, 2.0, 215.0),
        (2.5, -0.3, 215.0), (2.5, 4.3, 215.0), (-0.8, 1.5, 120.0), (2.5, 4.8, 120.0),
    ],
)  # fmt: skip
def test_squares_paper_and_table_have_their_grey_levels(x: float, y: float, grey: float) -> None:
    row, column = imaged(x, y)
    dark = (int(np.floor(x)) + int(np.floor(y))) % 2 == 0 and 0 < x < 5 and 0 < y < 4
    grey = 35.0 if dark else grey
    assert picture()[row, column] == pytest.approx(grey * light(column), abs=0.51)


def test_an_edge_through_a_pixel_shows_the_share_on_either_side() -> None:
    """A board that stands square to the axis: its first column of squares ends at 100.25 px."""
    flat = Placement(rotation=np.eye(3), origin=np.zeros(3))
    lens = replace(LENS, values=np.array([400.0, 400.0, *CENTRE, *np.zeros(5)]))
    depth = SQUARE * 400.0 / 40.0  # a square takes 40 px
    left = (60.25 - CENTRE[0]) * depth / 400.0
    board = replace(flat, origin=np.array([left, -0.06, depth]))
    made = draw(PATTERN, lens, SIZE, board, STILL, np.random.default_rng(1)).astype(float)
    row = round(float(CENTRE[1] + 400.0 * (-0.06 + 0.5 * SQUARE) / depth))
    across = made[row, 98:103] / np.array([light(c) for c in range(98, 103)])
    share = (across[2] - across[0]) / (across[4] - across[0])
    assert across[[0, 4]] == pytest.approx([35.0, 215.0], abs=1.0)
    assert share == pytest.approx(0.25, abs=0.06)  # pixel 100 reaches from 99.5 to 100.5


def test_noise_and_blur_are_those_of_the_exposure() -> None:
    noisy = picture(replace(STILL, noise=3.0)) - picture()
    table = np.s_[:20, :20]
    assert noisy[table].std() == pytest.approx(3.0, rel=0.12)
    assert abs(noisy[table].mean()) < 0.5
    assert (picture(replace(STILL, noise=3.0), seed=2) != picture(replace(STILL, noise=3.0))).any()
    blurred = picture(replace(STILL, blur=2.0))
    assert np.abs(np.diff(blurred)).max() < 0.5 * np.abs(np.diff(picture())).max()


def test_a_board_behind_the_camera_or_beside_it_is_not_seen() -> None:
    for origin in ([-0.06, -0.06, -0.4], [5.0, 0.0, 0.4]):
        board = replace(BOARD, origin=np.array(origin))
        made = picture(board=board)
        assert np.abs(made - np.rint(120.0 * np.array([light(c) for c in range(320)]))).max() <= 1.0
    columns, rows = _window(PATTERN, LENS, SIZE, replace(BOARD, origin=np.array([0, 0, -0.4])))
    assert (columns.size, rows.size) == (0, 0)


def test_the_window_holds_all_of_the_paper() -> None:
    columns, rows = _window(PATTERN, LENS, SIZE, BOARD)
    corners = [imaged(x, y) for x in (-0.5, 5.5) for y in (-0.5, 4.5)]
    for row, column in corners:
        assert rows[0] <= max(row, 0) <= rows[-1] + 1 or row >= SIZE[1]
        assert columns[0] <= max(column, 0) <= columns[-1] + 1 or column >= SIZE[0]
    assert columns[-1] < SIZE[0]
    assert rows[-1] < SIZE[1]

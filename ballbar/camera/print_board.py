"""`ballbar camera board`: a board to print at its true size, and its description to correct."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib
import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D

from ballbar.cell.arrays import Array
from ballbar.cell.board import BoardFile, BoardKind
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.errors import InputError
from ballbar.cell.files import write_new_together
from ballbar.figure_style import QUIET
from ballbar.units import MM

PAPERS = {
    "A4": (297.0, 210.0),
    "A5": (210.0, 148.0),
    "A3": (420.0, 297.0),
    "A2": (594.0, 420.0),
    "A1": (841.0, 594.0),
}
_MARGIN = 14.0  # [mm] round the board, for rulers and text
_MARKER = 0.72  # of a square
_SCALE = 3e-3  # relative standard deviation of the scale of a printer
_RULER, _TICK, _LONG_TICK = 100, 1.5, 3.0  # [mm]
_POINTS_PER_MM = 72.0 / 25.4
_SIZES = (50, 100, 250, 1000)  # markers of OpenCV's dictionaries of one kind


def write_board(
    file: Path, kind: BoardKind, squares: tuple[int, int], square: float | None, paper: str
) -> tuple[Path, BoardFile]:
    """Writes the PDF, and beside it the board's description, whose path it gives.

    square : [mm] side; the largest whole number that fits on the paper if None. Raises InputError
    for a board that does not fit, or whose corners could not be numbered.
    """
    described = _described(kind, squares, square, paper)
    pattern = Pattern(described)
    if pattern.turns:
        nx, ny = squares
        raise InputError(
            f"--squares {nx}x{ny}: such a checkerboard looks the same after half a turn, so its "
            f"corners have no number. Take {nx}x{ny + 1}, or --kind charuco."
        )
    description = file.with_suffix(".yaml")
    text = _text(described)
    write_new_together({file: _drawn(pattern, PAPERS[paper]), description: text.encode()})
    return description, described


def _described(
    kind: BoardKind, squares: tuple[int, int], square: float | None, paper: str
) -> BoardFile:
    room = np.array(PAPERS[paper]) - 2.0 * _MARGIN
    side = float(np.floor((room / squares).min())) if square is None else square
    if (side * np.array(squares) > room).any() or side <= 0.0:
        width, height = (side * np.array(squares)).tolist()
        what = f"{width:g} x {height:g} mm do not fit on {paper} with margins of {_MARGIN:g} mm"
        raise InputError(f"--square-mm: {what}; {(room / squares).min():.1f} mm would.")
    marked = kind == "charuco"
    count = squares[0] * squares[1] // 2
    size = next((n for n in _SIZES if n >= count), None)
    if marked and size is None:
        raise InputError(f"--squares: {count} markers; OpenCV has {_SIZES[-1]} of a kind.")
    return BoardFile.model_validate(
        {
            "schema": "ballbar-board/1",
            "kind": kind,
            "squares_x": squares[0],
            "squares_y": squares[1],
            "square_m": round(side / MM, 7),
            "marker_m": round(_MARKER * side / MM, 4) if marked else None,
            "dictionary": f"DICT_4X4_{size}" if marked else None,
            "sigma_m": round(_SCALE * side / MM, 6),
        }
    )


def _text(board: BoardFile) -> str:
    """The description, with what has to be measured."""
    nx, _ = Pattern(board).squares
    row = nx * (board.square_m or 0.0)
    return f"""\
# Fix the print flat on a stiff plate. Measure a whole row of {nx} squares, here {row * MM:g} mm,
# and a column; divide by the number of squares, and write the mean below with its standard
# deviation: 0.1 mm over the row is {1e-4 / nx:.1g} m; what stands there is that of a printer. All
# lengths of the result have this scale.
""" + yaml.safe_dump(
        board.model_dump(mode="json", by_alias=True, exclude_defaults=True), sort_keys=False
    )


def _drawn(pattern: Pattern, paper: tuple[float, float]) -> bytes:
    """The page as a PDF, lines and areas at their true size."""
    with matplotlib.rc_context({"pdf.fonttype": 42, "font.size": 7.0}):
        figure = Figure(figsize=(paper[0] / 25.4, paper[1] / 25.4))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), frame_on=False)
        axes.set(xlim=(0.0, paper[0]), ylim=(paper[1], 0.0), xticks=[], yticks=[])
        size = MM * pattern.square * np.array(pattern.squares)
        corner = (np.array(paper) - size) / 2.0
        dark = MM * pattern.rectangles() + np.array([*corner, 0.0, 0.0])
        # one outline: between areas of their own a viewer shows seams
        boxes = [_box(*sides) for sides in dark]
        axes.add_patch(PathPatch(Outline.make_compound_path(*boxes), fc="black", ec="none"))
        _ruler(axes, corner + np.array([0.0, size[1] + 4.0]), (1.0, 0.0))
        _ruler(axes, corner - np.array([4.0, 0.0]), (0.0, 1.0))
        axes.text(corner[0], corner[1] - 3.0, _title(pattern), color=QUIET, va="bottom")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="pdf", metadata={"CreationDate": None, "Creator": None})
    return buffer.getvalue()


def _box(x: float, y: float, width: float, height: float) -> Outline:
    return Outline.unit_rectangle().transformed(Affine2D().scale(width, height).translate(x, y))


def _title(pattern: Pattern) -> str:
    board, (nx, ny) = pattern.board, pattern.squares
    markers = "" if not pattern.marker else f", {board.dictionary} of {pattern.marker * MM:g} mm"
    return (
        f"{board.kind}, {nx} x {ny} squares of {pattern.square * MM:g} mm{markers}. Print at 100 %,"
        " not fitted to the page; both rulers are 100 mm long."
    )


def _ruler(axes: Axes, origin: Array, along: tuple[float, float]) -> None:
    """Draws a ruler away from the board, from its origin (2,) [mm] along an axis."""
    step = np.array(along)
    out = np.array([0.0, 1.0]) if step[0] else np.array([-1.0, 0.0])
    at = np.arange(_RULER + 1)
    tick = np.where(at % 10 == 0, _LONG_TICK, _TICK)
    begin = origin + at[:, None] * step
    lines = [*np.stack((begin, begin + tick[:, None] * out), axis=1), begin[[0, -1]]]
    axes.add_collection(LineCollection(lines, colors="black", linewidths=0.1 * _POINTS_PER_MM))

"""Corners of a board in pictures, read from a table of image, corner, u, v."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.bundle import FEWEST
from ballbar.acquisition.declared_columns import TableContext, selectors_of
from ballbar.acquisition.formats.table_file import pose_text
from ballbar.acquisition.report import FileSummary, Finding, finding
from ballbar.acquisition.table.quantities import PoseRows, header_names, quantities, read_rows
from ballbar.cell.arrays import Array
from ballbar.cell.board import Board, load_board
from ballbar.cell.errors import LogError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.pose_file import PictureColumns

_BEYOND = 0.5  # of the picture's size, outside which no corner is


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a board in N pictures."""

    instrument: Instrument
    board: Board
    carried: bool  # whether the camera is on the flange
    file: str
    images: tuple[str, ...]  # (N,) names of the pictures
    pixels: Array  # (N, C, 2) [px]; NaN where a corner was not seen

    @property
    def enough(self) -> NDArray[np.bool_]:
        """(N,) whether a picture shows corners enough for a pose."""
        return np.asarray(np.isfinite(self.pixels[..., 0]).sum(axis=1) >= FEWEST)

    def take(self, chosen: NDArray[np.bool_]) -> Corners:
        """The corners of the chosen pictures (N,)."""
        images = tuple(np.array(self.images, dtype=object)[chosen])
        return replace(self, images=images, pixels=self.pixels[chosen])


def read_corners(
    context: TableContext, declared: PictureColumns, images: Sequence[str]
) -> tuple[Corners, FileSummary, tuple[Finding, ...]]:
    """The corners of the pictures (N,) that the rows of a table name; and of what was read.

    Raises LogError for corners that the board does not have, that lie outside the picture or that
    stand there twice, and where two rows name one picture.
    """
    folder, instrument = context.path.parent, context.instrument
    assert instrument.camera is not None  # checked with the declaration
    board = load_board(folder / declared.board)
    text, kind = pose_text(folder / declared.corners, declared.corners)
    columns = quantities(declared.columns, header_names(text))
    names = selectors_of(columns)
    rows = read_rows(text, kind, names, names)
    number, *pixel = rows.numbers(columns[1:]).T
    _refuse_twice(images, declared.image)
    _refuse_unknown(rows, board, number, np.stack(pixel), instrument.camera.image)
    place = {image: n for n, image in enumerate(images)}
    at = np.array([place.get(image, -1) for image in rows.text(names[0])], dtype=np.intp)
    known = (at >= 0) & np.isfinite(number) & np.isfinite(pixel).all(axis=0)
    pixels = np.full((len(images), len(board.points), 2), np.nan)
    corner = number[known].astype(np.intp)
    if twice := _twice(at[known], corner):
        what = f"corner {corner[twice]} of this picture stands there twice."
        raise LogError.at(rows.location(np.flatnonzero(known)[twice]), what, "Remove one.")
    pixels[at[known], corner] = np.stack(pixel, axis=1)[known]
    if not known.any():
        what = f"no picture has a name of column {declared.image} of the table, such as {images[0]}"
        raise LogError.at(
            declared.corners, f"{what}.", "Give the pictures the same names in both files."
        )
    unnamed = len({image for image in rows.text(names[0]) if image not in place})
    findings = list(rows.findings)
    if unnamed:
        sentence = f"{unnamed} pictures have no row of joint angles; not used."
        findings.append(finding("picture without joints", rows.file, sentence, count=unnamed))
    summary = FileSummary(
        rows.file, "poses", rows.kind, rows_kept=int(known.sum()), time="no time", **vars(rows.form)
    )
    carried = declared.camera == "flange"
    return (
        Corners(instrument, board, carried, rows.file, tuple(images), pixels),
        summary,
        tuple(findings),
    )


def _refuse_twice(images: Sequence[str], column: int | str) -> None:
    if twice := [image for image in images if images.count(image) > 1]:
        raise LogError(
            f"column {column} names picture {twice[0]} in two rows. Give each picture one row."
        )


def _refuse_unknown(
    rows: PoseRows, board: Board, number: Array, pixel: Array, size: tuple[int, int]
) -> None:
    """Raises LogError for a corner that is none of the board, or lies far outside the picture."""
    count, given = len(board.points), np.isfinite(number)
    wrong = given & ((number < 0) | (number >= count) | (number != np.round(number)))
    if wrong.any():
        k = int(wrong.argmax())
        what = f"corner {number[k]:g}, but board {board.name} has corners 0 to {count - 1}."
        raise LogError.at(rows.location(k), what, "Correct squares_x and squares_y of the board.")
    width = np.array(size)[:, None]
    outside = (np.abs(pixel / width - 0.5) > 0.5 + _BEYOND).any(axis=0)
    if outside.any():
        k = int(outside.argmax())
        what = f"pixel {pixel[0, k]:g}, {pixel[1, k]:g} of pictures of {size[0]} x {size[1]}."
        raise LogError.at(rows.location(k), what, "Correct image_px of the camera's file.")


def _twice(at: NDArray[np.intp], corner: NDArray[np.intp]) -> int:
    """Place of a pair that stands there before; 0 where there is none."""
    _, first = np.unique(np.stack((at, corner)), axis=1, return_index=True)
    again = np.setdiff1d(np.arange(at.size), first)
    return int(again[0]) if again.size else 0

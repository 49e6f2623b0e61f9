"""The dark parts of a board: the squares of a checkerboard, and markers in the light ones.

Metres in the board's frame as of ballbar.cell.board: x along a row, y down a column. The first
square is dark. Markers are those of OpenCV, which numbers them row by row (Garrido-Jurado et al.
2014).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.board import BoardFile
from ballbar.cell.errors import DescriptionError

if TYPE_CHECKING:
    import cv2


@dataclass(frozen=True)
class Pattern:
    """The print of a board with squares."""

    board: BoardFile

    @property
    def squares(self) -> tuple[int, int]:
        """In a row, and in a column. Raises DescriptionError for a board of points."""
        nx, ny = self.board.squares_x, self.board.squares_y
        if nx is None or ny is None:
            raise DescriptionError("kind: a board of points has no squares that can be found.")
        return nx, ny

    @property
    def square(self) -> float:
        """[m] side of a square."""
        return self.board.square_m or 0.0  # the schema has it where there are squares

    @property
    def marker(self) -> float:
        """[m] side of a marker; 0 where there are none."""
        return self.board.marker_m or 0.0 if self.board.kind == "charuco" else 0.0

    @property
    def turns(self) -> bool:
        """Whether the print looks the same after half a turn, so that its corners have no number.

        That of a checkerboard does where squares in a row and in a column are both odd or even.
        """
        return self.board.kind == "checkerboard" and sum(self.squares) % 2 == 0

    @cached_property
    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board of this print. Raises DescriptionError where it knows no such board."""
        import cv2  # noqa: PLC0415  the extra camera

        number = getattr(cv2.aruco, self.board.dictionary or "", None)
        if not (self.board.dictionary or "").startswith("DICT_") or not isinstance(number, int):
            what = f"dictionary: OpenCV has no {self.board.dictionary}."
            raise DescriptionError(f"{what} Write one such as DICT_4X4_50.")
        dictionary = cv2.aruco.getPredefinedDictionary(number)
        nx, ny = self.squares
        if (needed := nx * ny // 2) > len(dictionary.bytesList):
            what = f"dictionary: {needed} markers, but {self.board.dictionary} has"
            raise DescriptionError(f"{what} {len(dictionary.bytesList)}. Take a larger one.")
        if not 0.0 < self.marker < self.square:
            raise DescriptionError("marker_m: a marker is smaller than its square.")
        return cv2.aruco.CharucoBoard((nx, ny), self.square, self.marker, dictionary)

    @cached_property
    def cells(self) -> NDArray[np.bool_]:
        """(M, B, B) whether each cell of each marker is dark, frame included."""
        import cv2  # noqa: PLC0415  the extra camera

        dictionary = self.charuco.getDictionary()
        side = dictionary.markerSize + 2
        ids = np.array(self.charuco.getIds()).ravel()
        made = [cv2.aruco.generateImageMarker(dictionary, int(k), side) for k in ids]
        return np.stack(made) < 128

    def rectangles(self) -> Array:
        """(R, 4) [m] x, y, width and height of the dark parts."""
        nx, ny = self.squares
        parts = [
            (i * self.square, j * self.square, self.square, self.square)
            for j in range(ny)
            for i in range(nx)
            if (i + j) % 2 == 0
        ]
        if not self.marker:
            return np.array(parts)
        size, edge = self.marker / self.cells.shape[1], 0.5 * (self.square - self.marker)
        places = [(i, j) for j in range(ny) for i in range(nx) if (i + j) % 2]
        for (i, j), cells in zip(places, self.cells, strict=True):
            for row, line in enumerate(cells):
                ends = np.flatnonzero(np.diff(np.concatenate(([0], line, [0]))))
                for first, last in ends.reshape(-1, 2):
                    x, y = i * self.square + edge + first * size, j * self.square + edge
                    parts.append((x, y + row * size, (last - first) * size, size))
        return np.array(parts)

"""board.yaml: points of a flat board that a camera sees (schema `ballbar-board/1`).

The corners of a checkerboard or ChArUco board are numbered as OpenCV numbers them: row by row of
the corners between squares, from 0. x of the board's frame is along a row, y along a column, and z
away from who looks at its face; the origin is the outer corner of the first square.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.description_files import ExpansionFile, Length
from ballbar.cell.schema import Line, Positive, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import load_model

BoardKind = Literal["charuco", "checkerboard", "points"]
SCALES = ("scale_x", "scale_y")
SHAPE = (*SCALES, "sag_xx", "sag_xy", "sag_yy")
FLAT = 5e-4  # [m] of a print on stiff board: standard deviation of its sag over half its size
Squares = Annotated[int, Field(ge=3, le=200)]


class BoardFile(Strict):
    """Description of a flat board."""

    schema_: Annotated[Literal["ballbar-board/1"], Field(alias="schema")]
    title: Line = "board"
    kind: BoardKind
    """Corners of a `charuco` board or `checkerboard`, or `points` by their positions."""
    squares_x: Squares | None = Field(default=None)
    """Squares in a row."""
    squares_y: Squares | None = Field(default=None)
    """Squares in a column."""
    square_m: Positive | None = Field(default=None)
    """Side of a square as measured: the length of a whole row over its number of squares."""
    marker_m: Positive | None = Field(default=None)
    """Side of a marker of a ChArUco board."""
    dictionary: Line | None = Field(default=None)
    """Its markers by OpenCV's name, such as `DICT_4X4_50`."""
    points_m: tuple[tuple[Length, Length], ...] = Field(default=(), max_length=10000)
    """x and y of each point, where the kind is `points`."""
    sigma_m: Positive
    """Standard deviation of `square_m`; of `points`, of their largest distance."""
    expansion: ExpansionFile | None = None
    """Thermal expansion of `square_m` and `points_m`."""
    flat_m: Positive = FLAT
    """Standard deviation of how far the board sags over half of its size."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "points":
            if len(self.points_m) < 6:
                raise wrong_key("points_m", message="give x and y of 6 points or more")
            return self
        for key in ("squares_x", "squares_y", "square_m"):
            if getattr(self, key) is None:
                raise wrong_key(key, message=f"missing: a {self.kind} has it")
        if self.kind == "charuco" and (self.marker_m is None or self.dictionary is None):
            raise wrong_key("marker_m", message="give marker_m and dictionary of a charuco board")
        return self


@dataclass(frozen=True, eq=False)
class Board:
    """A flat board: its points, and how well their scale and flatness are known."""

    name: str
    kind: BoardKind
    points: Array  # (C, 2) [m]
    scale_sigma: float  # relative, along x and along y
    flat: float  # [m]
    file: BoardFile

    def grown(self, share: float, sigma: float) -> Board:
        """The board longer by a share of standard uncertainty sigma."""
        scale_sigma = float(np.hypot(self.scale_sigma, sigma))
        return replace(self, points=(1.0 + share) * self.points, scale_sigma=scale_sigma)

    def bent(self, shape: Array) -> tuple[Array, Array]:
        """Points (C, 3) [m] of the board as it is, and their derivatives (C, 3, 5) by `shape`.

        shape : (5,) relative errors of scale along x and y, and sags [m] over half of its size: of
        xx, xy and yy.
        """
        middle, half = self.points.mean(axis=0), 0.5 * np.ptp(self.points, axis=0).max()
        x, y = ((self.points - middle) / half).T
        sags = np.stack((x * x - (x * x).mean(), x * y, y * y - (y * y).mean()), axis=1)
        by_shape = np.zeros((len(self.points), 3, 5))
        by_shape[:, 0, 0], by_shape[:, 1, 1] = self.points.T
        by_shape[:, 2, 2:] = sags
        flat = np.column_stack((self.points, np.zeros(len(self.points))))
        return flat + by_shape @ shape, by_shape


def load_board(path: Path) -> Board:
    """The board of a file. Raises DescriptionError naming file, line and key."""
    return board_of(path.stem, load_model(path, BoardFile))


def board_of(name: str, file: BoardFile) -> Board:
    """The board that a checked file describes."""
    if file.kind == "points":
        points = np.array(file.points_m)
        size = float(np.linalg.norm(points[:, None] - points, axis=2).max())
    else:
        size = file.square_m or 0.0  # checked by the schema
        along = (np.arange(1, file.squares_x or 0), np.arange(1, file.squares_y or 0))
        points = size * np.column_stack([part.ravel() for part in np.meshgrid(*along)])
    return Board(name, file.kind, points, file.sigma_m / size, file.flat_m, file)

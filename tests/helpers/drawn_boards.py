"""Drawn pictures of a board: a lens, blur, noise and light, with corners known exactly.

Each pixel is the mean of points of the board's plane at which it looks. Their lattice (Niederreiter
1992, sec. 5.1) has no two points in a row or column of the pixel, so that edges are where the lens
images them, to some hundredths of a pixel in any direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from ballbar.cell.arrays import Array
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.camera import Lens
from ballbar.cell.placement import Placement

_POINTS, _STEP = 13, 8  # of the lattice in a pixel
_SPACING = 8  # [px] between points at which the lens is inverted; between them it is smooth
_MARGIN = 0.5  # squares of white paper round the squares
_WHITE, _BLACK, _TABLE = 215.0, 35.0, 120.0  # grey levels
_SHADE = 0.15  # of the light, from one side of the picture to the other


@dataclass(frozen=True)
class Exposure:
    """How a picture is taken."""

    blur: float = 0.5  # [px] standard deviation of a Gaussian
    noise: float = 2.0  # grey levels, standard deviation


def draw(
    pattern: Pattern,
    lens: Lens,
    size: tuple[int, int],
    board: Placement,
    exposure: Exposure,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """(H, W) picture of a board that stands at `board` in the camera's frame.

    size : [px] width and height. rng : of the noise.
    """
    width, height = size
    grey = np.full((height, width), _TABLE)
    columns, rows = _window(pattern, lens, size, board)
    if columns.size and rows.size:
        grey[np.ix_(rows, columns)] = _seen(pattern, lens, columns, rows, board)
    side = np.linspace(-1.0, 1.0, width)
    grey *= 1.0 + 0.5 * _SHADE * side
    out = gaussian_filter(grey, exposure.blur, mode="nearest") if exposure.blur else grey
    out += exposure.noise * rng.standard_normal(out.shape)
    return np.asarray(np.clip(np.rint(out), 0, 255), dtype=np.uint8)


def _window(
    pattern: Pattern, lens: Lens, size: tuple[int, int], board: Placement
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Columns and rows of the picture that the paper may reach."""
    low, high = -_MARGIN * pattern.square, (np.array(pattern.squares) + _MARGIN) * pattern.square
    along = np.linspace(0.0, 1.0, 20)
    x, y = (low + along * (top - low) for top in high)
    edge = np.concatenate(
        [np.stack(np.broadcast_arrays(a, b), axis=1) for a, b in ((x, y[0]), (x, y[-1]))]
        + [np.stack(np.broadcast_arrays(a, b), axis=1) for a, b in ((x[0], y), (x[-1], y))]
    )
    points = np.column_stack((edge, np.zeros(len(edge)))) @ board.rotation.T + board.origin
    if points[:, 2].min() <= 0.0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    pixels = lens.image(points)[0]
    return tuple(  # type: ignore[return-value]  # of two
        np.arange(max(0, int(part.min()) - 2), min(count, int(part.max()) + 3))
        for part, count in zip(pixels.T, size, strict=True)
    )


def _seen(
    pattern: Pattern,
    lens: Lens,
    columns: NDArray[np.intp],
    rows: NDArray[np.intp],
    board: Placement,
) -> Array:
    """(h, w) grey levels of pixels, each the mean over the points of a lattice in it."""
    coarse = [np.arange(part[0] - 1, part[-1] + _SPACING + 2, _SPACING) for part in (columns, rows)]
    grid = np.stack(np.meshgrid(*(part.astype(float) for part in coarse)), axis=-1)
    known = lens.tangents(grid)
    to_plane = np.linalg.inv(np.column_stack((board.rotation[:, :2], board.origin)))
    total = np.zeros((rows.size, columns.size))
    for k in range(_POINTS):
        within = (np.array([k, k * _STEP % _POINTS]) + 0.5) / _POINTS - 0.5
        at = [
            (part + shift - begin[0]) / _SPACING
            for part, shift, begin in zip((columns, rows), within, coarse, strict=True)
        ]
        where = np.stack(np.meshgrid(at[1], at[0], indexing="ij"))
        tangents = [map_coordinates(known[..., i], where, order=3) for i in (0, 1)]
        total += _grey(pattern, np.stack((*tangents, np.ones_like(total)), axis=-1) @ to_plane.T)
    return total / _POINTS


def _grey(pattern: Pattern, ray: Array) -> Array:
    """Grey levels where lines of sight (..., 3), in terms of the plane's axes and origin, end."""
    x, y = (ray[..., k] / ray[..., 2] for k in (0, 1))
    nx, ny = pattern.squares
    edge = _MARGIN * pattern.square
    paper = (x > -edge) & (x < nx * pattern.square + edge)
    paper &= (y > -edge) & (y < ny * pattern.square + edge)
    grey = np.where(paper, _WHITE, _TABLE)
    grey[dark(pattern, x, y)] = _BLACK
    return grey


def dark(pattern: Pattern, x: Array, y: Array) -> NDArray[np.bool_]:
    """Whether a print is dark at points [m] of its board; no point outside it is."""
    nx, ny = pattern.squares
    column, row = (np.floor(part / pattern.square).astype(np.intp) for part in (x, y))
    inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
    odd = (column + row) % 2 == 1
    out = np.asarray(inside & ~odd)
    if not pattern.marker:
        return out
    edge = 0.5 * (pattern.square - pattern.marker)
    places = [(part - at * pattern.square - edge) for part, at in ((x, column), (y, row))]
    count = pattern.cells.shape[1]
    cell_x, cell_y = (np.floor(part / pattern.marker * count).astype(np.intp) for part in places)
    within = inside & odd & (cell_x >= 0) & (cell_x < count) & (cell_y >= 0) & (cell_y < count)
    marker = ((row * nx + column) // 2)[within]
    out[within] = pattern.cells[marker, cell_y[within], cell_x[within]]
    return out

"""Corners of a board in pictures, by OpenCV, and why a picture shows none.

Pictures are taken as the sensor saw them: a turn that a phone notes beside them is not applied,
since it would move the principal point.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.bundle import FEWEST
from ballbar.cell.arrays import Array
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.errors import InputError

Pixels = NDArray[np.uint8]
_THREADS = 2
_BLUR = 0.25  # of the others' sharpness, below which a picture without board is blurred
_WINDOW, _MAX_WINDOW = 0.3, 11  # of the corners' distance, and [px]: half a window to refine one
_PLANE = 0.2  # squares that a corner may lie off the plane of the others, by the lens
_MOST = 0.7  # share of the corners that have to lie there
_THUMBNAIL = 360  # [px] width


@dataclass(frozen=True, eq=False)
class Picture:
    """Corners of one picture, and why it is not used."""

    name: str
    size: tuple[int, int]  # [px] width and height
    numbers: NDArray[np.intp]  # (M,) of the corners, as the board counts them
    pixels: Array  # (M, 2) [px]
    thumbnail: Pixels  # grey
    sharpness: float  # relative strength of its edges
    digest: str
    unused: str | None = None  # why it is not used

    @property
    def used(self) -> bool:
        return self.unused is None


def detect(files: Sequence[Path], pattern: Pattern) -> list[Picture]:
    """Every picture with its corners, in their order.

    Raises InputError for a file that is no picture, for two of one name, and for a board whose
    corners cannot be numbered.
    """
    if pattern.turns:
        nx, ny = pattern.squares
        raise InputError(
            f"a checkerboard of {nx} x {ny} squares looks the same after half a turn, so its "
            f"corners have no number. Print one of {nx} x {ny + 1}, or a ChArUco board."
        )
    names = [file.name for file in files]
    if twice := next((n for n in names if names.count(n) > 1), None):
        raise InputError(f"two pictures are called {twice}; rename one.")
    with ThreadPoolExecutor(_THREADS) as threads:
        pictures = list(threads.map(lambda file: _picture(file, pattern), files))
    return _compared(pictures)


def _picture(file: Path, pattern: Pattern) -> Picture:
    """One picture with its corners."""
    content = np.fromfile(file, dtype=np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(content, flags) if content.size else None
    if image is None:
        raise InputError.at(file, "is no picture that OpenCV reads.", "Leave it out.")
    grey = np.asarray(image, dtype=np.uint8)
    height, width = grey.shape
    numbers, pixels = _corners(grey, pattern)
    unused = None if len(numbers) >= FEWEST else _why_none(grey, pattern, len(numbers))
    small = cv2.resize(
        grey, (_THUMBNAIL, max(1, _THUMBNAIL * height // width)), interpolation=cv2.INTER_AREA
    )
    return Picture(
        name=file.name,
        size=(width, height),
        numbers=numbers,
        pixels=pixels,
        thumbnail=np.asarray(small, dtype=np.uint8),
        sharpness=float(cv2.Laplacian(grey, cv2.CV_32F).var() / max(float(grey.var()), 1.0)),
        digest=hashlib.sha256(grey.tobytes()).hexdigest(),
        unused=unused,
    )


def _corners(grey: Pixels, pattern: Pattern) -> tuple[NDArray[np.intp], Array]:
    """Numbers (M,) and pixels (M, 2) of the corners that a picture shows."""
    if pattern.marker:
        parameters = cv2.aruco.CharucoParameters()
        # of the two markers beside a corner one is enough; others are sought where they must be
        parameters.minMarkers, parameters.tryRefineMarkers = 1, True
        detector = cv2.aruco.CharucoDetector(pattern.charuco, parameters)
        corners, numbers, _, _ = detector.detectBoard(grey)
        if numbers is None or len(numbers) == 0:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
        pixels = np.array(corners, dtype=float).reshape(-1, 2)
        return _on_a_plane(np.array(numbers, dtype=np.intp).ravel(), pixels, pattern)
    nx, ny = pattern.squares[0] - 1, pattern.squares[1] - 1
    for thorough in (0, cv2.CALIB_CB_EXHAUSTIVE):  # many times slower, and rarely needed
        seen, corners = cv2.findChessboardCornersSB(grey, (nx, ny), flags=thorough)
        if seen:
            break
    else:
        return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
    pixels = _refined(grey, np.array(corners, dtype=float).reshape(-1, 2))
    return np.arange(nx * ny), _from_the_first(grey, pixels.reshape(ny, nx, 2)).reshape(-1, 2)


def _on_a_plane(
    numbers: NDArray[np.intp], pixels: Array, pattern: Pattern
) -> tuple[NDArray[np.intp], Array]:
    """The corners, or none where they are no picture of the board's face: some markers were read
    where there are none.
    """
    if len(numbers) >= FEWEST:
        nx = pattern.squares[0] - 1
        places = np.stack((numbers % nx, numbers // nx), axis=1).astype(float)
        size = np.ptp(pixels, axis=0).max() / np.ptp(places, axis=0).max()  # [px] of a square
        plane, inliers = cv2.findHomography(places, pixels, cv2.RANSAC, _PLANE * size)
        if plane is not None and np.linalg.det(plane) > 0.0 and inliers.mean() > _MOST:
            return numbers, pixels
    return np.zeros(0, dtype=np.intp), np.zeros((0, 2))


def _refined(grey: Pixels, pixels: Array) -> Array:
    """(M, 2) corners between four squares, where the edges of their neighbourhood meet."""
    apart = np.linalg.norm(pixels[:, None] - pixels, axis=2) + np.diag(np.full(len(pixels), np.inf))
    half = int(np.clip(_WINDOW * apart.min(), 2, _MAX_WINDOW))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-4)
    start = pixels.astype(np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=float).reshape(-1, 2)


def _from_the_first(grey: Pixels, grid: Array) -> Array:
    """A grid of corners (ny, nx, 2) as numbered from the first square, which is dark.

    The square between the first corners continues the first one along the diagonal, so it is dark,
    and after half a turn of the board a light one stands there.
    """
    ny, nx = grid.shape[:2]
    middles = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    column, row = np.rint(middles).astype(np.intp).reshape(-1, 2).T
    level = grey[row, column].astype(float).reshape(ny - 1, nx - 1)
    sign = np.where(np.add.outer(np.arange(ny - 1), np.arange(nx - 1)) % 2 == 0, 1.0, -1.0)
    return grid if (sign * level).sum() < 0.0 else grid[::-1, ::-1]


def _why_none(grey: Pixels, pattern: Pattern, count: int) -> str:
    """Why a picture gives no pose."""
    if count:
        return f"only {count} corners seen, {FEWEST} are needed"
    if pattern.marker:
        mirrored = np.ascontiguousarray(grey[:, ::-1])
        if len(_corners(mirrored, pattern)[0]) >= FEWEST:
            return "the board is mirrored"
    return "no board seen"


def _compared(pictures: Sequence[Picture]) -> list[Picture]:
    """The pictures, those left out that differ in size, repeat another, or are blurred."""
    sizes = [p.size for p in pictures]
    usual = max(dict.fromkeys(sizes), key=sizes.count)
    sharp = np.median([p.sharpness for p in pictures if p.used] or [0.0])
    first = dict[str, str]()
    out = list[Picture]()
    for p in pictures:
        why = p.unused
        if p.size != usual:
            why = f"{p.size[0]} x {p.size[1]} px, others {usual[0]} x {usual[1]}"
        elif (same := first.setdefault(p.digest, p.name)) != p.name:
            why = f"the same picture as {same}"
        elif why == "no board seen" and p.sharpness < _BLUR * sharp:
            why = "blurred"
        out.append(replace(p, unused=why))
    return out

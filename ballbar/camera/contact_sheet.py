"""One picture of all pictures: the corners that were found, and why a picture is not used."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbar.camera.detect import Picture
from ballbar.figure_style import BLUE, INK, RED, rgb

_COLUMNS, _TEXT, _GAP = 5, 40, 8  # [px] text below each picture, and gap between them
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LETTERS = 46  # on a line below a picture


def contact_sheet(pictures: Sequence[Picture]) -> bytes:
    """PNG of the pictures in their order."""
    cells = [_cell(picture) for picture in pictures]
    columns = min(_COLUMNS, len(cells))
    rows = math.ceil(len(cells) / columns)
    height, width = (max(cell.shape[k] for cell in cells) + _GAP for k in (0, 1))
    sheet = np.full((rows * height + _GAP, columns * width + _GAP, 3), 255, dtype=np.uint8)
    for k, cell in enumerate(cells):
        y, x = _GAP + height * (k // columns), _GAP + width * (k % columns)
        sheet[y : y + cell.shape[0], x : x + cell.shape[1]] = cell
    return cv2.imencode(".png", sheet)[1].tobytes()


def _cell(picture: Picture) -> NDArray[np.uint8]:
    """A picture with its corners, its name and what became of it."""
    small = picture.thumbnail
    height, width = small.shape
    out = np.full((height + _TEXT, width, 3), 255, dtype=np.uint8)
    out[:height] = small[..., None]
    scale = width / picture.size[0]
    ink = _bgr(BLUE if picture.used else RED)
    for u, v in picture.pixels * scale:
        cv2.circle(out, (round(u), round(v)), 3, ink, 1, cv2.LINE_AA)
    if len(picture.pixels):  # where the count begins
        u, v = picture.pixels[picture.numbers.argmin()] * scale
        cv2.circle(out, (round(u), round(v)), 5, ink, -1, cv2.LINE_AA)
    cv2.rectangle(out, (0, 0), (width - 1, height - 1), ink, 1 if picture.used else 3)
    text = f"{len(picture.numbers)} corners" if picture.used else f"not used: {picture.unused}"
    for k, (line, colour) in enumerate(((picture.name, _bgr(INK)), (text, ink))):
        shown = line.encode("ascii", "replace").decode()
        shown = shown if len(shown) <= _LETTERS else f"{shown[: _LETTERS - 3]}..."
        at = (4, height + 15 + 17 * k)
        cv2.putText(out, shown, at, _FONT, 0.42, colour, 1, cv2.LINE_AA)
    return out


def _bgr(colour: str) -> tuple[int, int, int]:
    red, green, blue = rgb(colour)
    return blue, green, red

"""Corners of a board in the pictures of a camera: what a detector of corners would write."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.board import BoardFile, board_of
from ballbar.cell.camera import Lens
from ballbar.cell.errors import InputError
from ballbar.cell.files import write_whole, write_yaml
from ballbar.cell.instruments.base import Instrument, TrueStand, View
from ballbar.sim.settings import PictureSettings, SimulationSettings
from ballbar.sim.streams import stream

CORNERS, BOARD = "corners.csv", "board.yaml"


def board_file(pictures: PictureSettings) -> BoardFile:
    """The board of a scenario as its file describes it."""
    return BoardFile.model_validate(
        {"schema": "ballbar-board/1", "kind": "checkerboard"}
        | pictures.model_dump(include={"squares_x", "squares_y", "square_m", "sigma_m"})
    )


def view_of(pictures: PictureSettings) -> View:
    """How a scenario's camera sees its board."""
    board, tilt = board_of("board", board_file(pictures)), np.deg2rad(pictures.tilt_max_deg)
    return View(board, pictures.camera == "flange", float(tilt))


def pictured(
    instrument: Instrument, stand: TrueStand, settings: SimulationSettings, rng: np.random.Generator
) -> Array:
    """(N, C, 2) [px] corners of a board as it stands, with noise.

    The lens is drawn about the camera's file, and the scale and the sag of the board about its own.
    rng : of the noise of the corners. Raises InputError for another instrument.
    """
    camera, view, stated = instrument.camera, instrument.view, settings.needed_poses.pictures
    if camera is None or view is None or stated is None:
        raise InputError(f"{instrument.name}: not a camera before a board.")
    root = stated.lens_scale * np.linalg.cholesky(camera.covariance)
    z = stream(settings.seed, "lens").standard_normal(len(root))
    lens = Lens(camera.lens.model, camera.lens.values + root @ z)
    sigma = np.array([view.board.scale_sigma] * 2 + [view.board.flat] * 3)
    shape = sigma * stream(settings.seed, "board").standard_normal(sigma.size)
    pixels = lens.image(view.corners(stand, view.board.bent(shape)[0]))[0]
    noise = settings.errors.instrument_noise
    size = camera.sigma * (noise.scale if noise else 0.0)
    pixels += size * rng.standard_normal(pixels.shape)
    outside = (pixels < 0.0) | (pixels > np.array(camera.image) - 1.0)
    return np.where(outside.any(axis=2, keepdims=True), np.nan, pixels)


def image_name(picture: int) -> str:
    """Name of a picture, counted from 0."""
    return f"picture_{picture + 1:03d}"


def write_pictures(pictures: PictureSettings, pixels: Array, folder: Path) -> dict[str, object]:
    """Write corners (N, C, 2) [px] and board; returns their entry in poses.yaml."""
    lines = ["image,corner,u,v"]
    for n, corner in np.argwhere(np.isfinite(pixels[..., 0])).tolist():
        u, v = pixels[n, corner]
        lines.append(f"{image_name(n)},{corner},{u:.4f},{v:.4f}")
    write_whole(folder / CORNERS, ("\n".join(lines) + "\n").encode())
    write_yaml(
        folder / BOARD,
        board_file(pictures).model_dump(mode="json", by_alias=True, exclude_defaults=True),
    )
    return {"corners": CORNERS, "board": BOARD, "camera": pictures.camera}

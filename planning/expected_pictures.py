"""Planned pictures of a board: poses with the covariance they will have, and lens and board."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballbar.acquisition.bundle import Bundle, Pictures
from ballbar.acquisition.pictures import common_errors, pose_values
from ballbar.cell.board import SHAPE
from ballbar.cell.instruments.base import Instrument, TrueStand
from ballbar.cell.poses import CommonErrors, PoseGroup


def expected_common(instrument: Instrument, stand: TrueStand) -> CommonErrors | None:
    """Errors of lens and board that as many pictures as planned leave.

    stand : of random poses. None for another instrument than a camera.
    """
    if instrument.view is None:
        return None
    return common_errors(instrument.name, _bundle(instrument, stand))


def with_pictures(
    group: PoseGroup, instrument: Instrument, stand: TrueStand, common: CommonErrors | None
) -> PoseGroup:
    """The group with the covariance of its poses in pictures; as it is for another instrument."""
    if instrument.view is None:
        return group
    fitted, rows = _bundle(instrument, stand), np.arange(group.size)
    values, sigma, factor, by_values = pose_values(fitted, rows, carried=instrument.view.carried)
    out = replace(group, values=values, sigma=sigma, factor=factor)
    if common is None:
        return out
    return replace(out, common=common, by_common=by_values @ common.root)


def _bundle(instrument: Instrument, stand: TrueStand) -> Bundle:
    """Pictures as they are expected, adjusted."""
    camera, view = instrument.camera, instrument.view
    assert camera is not None  # the callers' condition, as the next
    assert view is not None
    rotation, origin = stand.rotation.transpose(2, 0, 1), stand.rod.T
    if view.carried:
        rotation = rotation.transpose(0, 2, 1)
        origin = -(rotation @ origin[..., None])[..., 0]
    shape = np.zeros(len(SHAPE))
    points = view.corners(stand, view.board.bent(shape)[0])
    pixels = camera.lens.image(points)[0]
    return Bundle(
        Pictures(camera, view.board, pixels, rotation),
        lens=camera.lens.values,
        shape=shape,
        rotation=rotation,
        origin=origin,
        counting=np.ones(pixels.shape[:2], dtype=bool),
        sigma=camera.sigma,
    )

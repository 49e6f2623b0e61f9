"""Start of a bundle adjustment: the pose of the board in each picture, by OpenCV.

A flat board allows two poses; which of them it is follows from the corners, and where these leave
it open from the robot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.bundle import Bundle, Pictures, counted
from ballbar.cell.arrays import Array
from ballbar.cell.board import SHAPE
from ballbar.cell.camera import Lens

_PLANE = 0.02  # of the size of the board in a picture: corners further off its plane are wrong
_DOUBTFUL = 4.0  # ratio of squares up to which the robot tells which of two poses a picture shows


def bundle(pictures: Pictures) -> Bundle:
    """The bundle of pictures with FEWEST corners or more each, single wrong corners left out."""
    n, camera = len(pictures.pixels), pictures.camera
    start = Bundle(
        pictures,
        lens=camera.lens.values,
        shape=np.zeros(len(SHAPE)),
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        origin=np.tile([0.0, 0.0, 1.0], (n, 1)),
        counting=pictures.seen,
        sigma=camera.sigma,
    )
    starts = [_chosen(start), _chosen(_focused(start))]
    best = min(starts, key=lambda each: float(np.median(each.square)))
    return counted(_chosen(counted(best)))  # again with the lens that the first one found


def _mixed(first: Bundle, second: Bundle, chosen: NDArray[np.bool_]) -> Bundle:
    """The first bundle with the chosen pictures' poses of the second."""
    return replace(
        first,
        rotation=np.where(chosen[:, None, None], second.rotation, first.rotation),
        origin=np.where(chosen[:, None], second.origin, first.origin),
    )


def _chosen(start: Bundle) -> Bundle:
    """The bundle with the better of the two poses that the picture of a flat board allows.

    Turned about its line of sight by half a turn a small board looks nearly the same (Schweighofer
    & Pinz 2006). Where the corners leave it open the robot tells: the angle between two pictures'
    orientations is that between the flange's.
    """
    first, second = _posed(start)
    ratio = (second.square + 1e-12) / (first.square + 1e-12)
    best = _mixed(first, second, ratio < 1.0)
    doubtful = (ratio < _DOUBTFUL) & (ratio > 1.0 / _DOUBTFUL)
    flange = start.pictures.flange
    off = [_disagreement(b.rotation, best.rotation, flange) for b in (first, second)]
    return _mixed(best, _mixed(first, second, off[1] < off[0]), doubtful)


def _posed(start: Bundle) -> tuple[Bundle, Bundle]:
    """The bundle with either pose of each picture, lens and board as they are.

    A picture whose corners show none keeps its own.
    """
    points = start.pictures.board.bent(start.shape)[0]
    rotation, origin = (np.stack([part, part]) for part in (start.rotation, start.origin))
    for n, agree, tangents in _agreeing(start):
        flat = points[agree] * [1.0, 1.0, 0.0]
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            flat, tangents, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        for k, (turn, shift) in enumerate(zip(turns, shifts, strict=True)):
            if np.isfinite((turn, shift)).all():
                nearest = cv2.solvePnPRefineLM(
                    points[agree], tangents, np.eye(3), None, turn, shift
                )
                rotation[k, n], origin[k, n] = cv2.Rodrigues(nearest[0])[0], nearest[1].ravel()
    first, second = (replace(start, rotation=rotation[k], origin=origin[k]) for k in (0, 1))
    return first, second


def _agreeing(start: Bundle) -> Iterator[tuple[int, NDArray[np.intp], Array]]:
    """Yields, of each picture that shows a plane, its number, corners (M,) that agree on it, and
    tangents (M, 2) of their lines of sight.
    """
    pictures, lens = start.pictures, Lens(start.pictures.camera.lens.model, start.lens)
    for n, seen in enumerate(pictures.seen):
        corners = np.flatnonzero(seen)
        tangents = lens.tangents(pictures.pixels[n, corners])
        limit = _PLANE * float(np.ptp(tangents, axis=0).max(initial=0.0))
        points = pictures.board.points[corners]
        plane, agree = cv2.findHomography(points, tangents, cv2.RANSAC, limit)
        if plane is not None:
            close = agree.ravel() > 0
            yield n, corners[close], tangents[close]


def _disagreement(rotation: Array, others: Array, flange: Array) -> Array:
    """(N,) [rad] median difference of the angles between orientations, pictures and flange."""
    off = np.abs(_angles(rotation, others) - _angles(flange, flange))
    return np.asarray(np.median(off, axis=1))


def _angles(first: Array, second: Array) -> Array:
    """(N, K) [rad] angles between orientations (N, 3, 3) and (K, 3, 3)."""
    cosine = 0.5 * (np.einsum("nij,kij->nk", first, second) - 1.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _focused(start: Bundle) -> Bundle:
    """The bundle with the focal lengths that the pictures' planes show (Zhang 2000, sec. 3.1),
    within the prior, the principal point and the ratio of the focal lengths as declared.
    """
    points = start.pictures.board.bent(start.shape)[0] * [1.0, 1.0, 0.0]
    sights = [(points[agree], tangents) for _, agree, tangents in _agreeing(start)]
    if not sights:
        return start
    parts = zip(*sights, strict=True)
    planes, images = ([values.astype(np.float32) for values in part] for part in parts)
    share = cv2.initCameraMatrix2D(planes, images, (1, 1), 1.0)[0, 0]
    wide = 3.0 * np.sqrt(start.pictures.camera.covariance[0, 0]) / start.lens[0]
    share = np.clip(np.nan_to_num(share, nan=1.0), max(0.2, 1.0 - wide), 1.0 + wide)
    return replace(start, lens=start.lens * [share, share, *np.ones(start.lens.size - 2)])

"""Start of a bundle adjustment: the pose of the board in each picture, from its homography.

A flat board allows two poses; which of them it is follows from the corners, and where these leave
it open from the robot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.bundle import DAMPING, FAR, FEWEST, Bundle, Pictures, counted
from ballbar.cell.arrays import Array
from ballbar.cell.board import SHAPE
from ballbar.cell.camera import Lens
from ballbar.cell.rigid_fit import nearest_rotation

_STEPS = 25  # of a pose with lens and board given
_DOUBTFUL = 4.0  # ratio of squares up to which the robot tells which of two poses a picture shows
_SAMPLES = 30  # of a homography


def bundle(pictures: Pictures) -> Bundle:
    """The bundle of pictures with FEWEST corners or more each, single wrong corners left out."""
    n, camera = len(pictures.pixels), pictures.camera
    start = Bundle(
        pictures,
        lens=camera.lens.values,
        shape=np.zeros(len(SHAPE)),
        rotation=np.zeros((n, 3, 3)),
        origin=np.zeros((n, 3)),
        counting=pictures.seen,
        sigma=camera.sigma,
    )
    plane = _started(start)
    starts = [_chosen(each, robust=True) for each in (plane, _started(_focused(plane)))]
    fitted = min(starts, key=lambda each: float(np.median(each.square)))
    for _ in range(2):  # the second time with the lens that the first one found
        fitted = counted(fitted)
        chosen = _chosen(fitted, robust=False)
        if np.allclose(chosen.rotation, fitted.rotation, atol=0.05):
            break
        fitted = chosen
    return fitted


def _posed(start: Bundle, *, robust: bool) -> Bundle:
    """The bundle with each picture's pose at its least squares, lens and board as they are.

    robust : whether corners far off count less (Geman & McClure 1987).
    """
    current = start
    damping = np.full(len(start.origin), DAMPING)
    for _ in range(_STEPS):
        weight = _weights(current) if robust else np.ones(current.counting.shape)
        root = np.sqrt(weight)
        a = (current.slopes[0] * root[..., None, None]).reshape(len(root), -1, 6)
        own = a.transpose(0, 2, 1) @ a
        own[~current.used] = np.eye(6)
        rest = (current.residual * root[..., None]).reshape(len(root), -1, 1)
        right = (a.transpose(0, 2, 1) @ rest)[..., 0]
        own += damping[:, None, None] * own * np.eye(6)
        tried = current.moved(np.asarray(np.linalg.solve(own, right[..., None])[..., 0]))
        before, after = (
            (b.residual**2 * (weight * b.counting)[..., None]).sum(axis=(1, 2))
            for b in (current, tried)
        )
        better = after < before
        damping = np.where(better, 0.1 * damping, 10.0 * np.maximum(damping, DAMPING))
        if not better.any():
            break
        current = _mixed(current, tried, better)
    return current


def _weights(current: Bundle) -> Array:
    """(N, C) of corners by their distances from the prediction, each picture's own scale."""
    length = np.linalg.norm(current.residual, axis=2)
    masked = np.where(current.counting, length, np.nan)
    scale = np.maximum(np.nanmedian(masked, axis=1), current.sigma)
    return np.asarray(1.0 / (1.0 + (length / (3.0 * scale[:, None])) ** 2) ** 2)


def _mixed(first: Bundle, second: Bundle, chosen: NDArray[np.bool_]) -> Bundle:
    """The first bundle with the chosen pictures' poses of the second."""
    return replace(
        first,
        rotation=np.where(chosen[:, None, None], second.rotation, first.rotation),
        origin=np.where(chosen[:, None], second.origin, first.origin),
    )


def _chosen(start: Bundle, *, robust: bool) -> Bundle:
    """The bundle with the better of the two poses that the picture of a flat board allows.

    Turned about its line of sight by half a turn a small board looks nearly the same (Schweighofer
    & Pinz 2006). Where the corners leave it open the robot tells: the angle between two pictures'
    orientations is that between the flange's.
    """
    first = _posed(start, robust=robust)
    middle = start.pictures.board.points.mean(axis=0)
    centre = first.rotation[..., :2] @ middle + first.origin
    along = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    half_turn = 2.0 * along[:, :, None] * along[:, None] - np.eye(3)
    rotation = half_turn @ first.rotation * np.array([-1.0, -1.0, 1.0])
    other = replace(first, rotation=rotation, origin=centre - rotation[..., :2] @ middle)
    second = _posed(other, robust=robust)
    ratio = (second.square + 1e-12) / (first.square + 1e-12)
    best = _mixed(first, second, ratio < 1.0)
    doubtful = (ratio < _DOUBTFUL) & (ratio > 1.0 / _DOUBTFUL)
    flange = start.pictures.flange
    off = [_disagreement(b.rotation, best.rotation, flange) for b in (first, second)]
    return _mixed(best, _mixed(first, second, off[1] < off[0]), doubtful)


def _disagreement(rotation: Array, others: Array, flange: Array) -> Array:
    """(N,) [rad] median difference of the angles between orientations, pictures and flange."""
    off = np.abs(_angles(rotation, others) - _angles(flange, flange))
    return np.asarray(np.median(off, axis=1))


def _angles(first: Array, second: Array) -> Array:
    """(N, K) [rad] angles between orientations (N, 3, 3) and (K, 3, 3)."""
    cosine = 0.5 * (np.einsum("nij,kij->nk", first, second) - 1.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _started(start: Bundle) -> Bundle:
    """The bundle with the poses of each picture's homography."""
    points = start.pictures.board.points
    rotation, origin = start.rotation.copy(), start.origin.copy()
    for n, (matrix, seen) in enumerate(zip(_planes(start), start.pictures.seen, strict=True)):
        size = 0.5 * (np.linalg.norm(matrix[:, 0]) + np.linalg.norm(matrix[:, 1]))
        middle = matrix @ np.array([*points[seen].mean(axis=0), 1.0])
        x, y, shift = (matrix / (size if middle[2] > 0.0 else -size)).T
        rotation[n] = nearest_rotation(np.column_stack((x, y, np.cross(x, y))))
        origin[n] = shift
    return replace(start, rotation=rotation, origin=origin)


def _planes(start: Bundle) -> Array:
    """(N, 3, 3) maps of board coordinates [m] to tangents of the lines of sight."""
    pictures, points = start.pictures, start.pictures.board.points
    lens, scale = Lens(pictures.camera.lens.model, start.lens), np.abs(points).max()
    out = []
    for pixels, seen in zip(pictures.pixels, pictures.seen, strict=True):
        matrix = homography(points[seen] / scale, lens.tangents(pixels[seen]))
        out.append(matrix / np.array([scale, scale, 1.0]))
    return np.stack(out)


def _focused(start: Bundle) -> Bundle:
    """The bundle with the focal lengths that the pictures' homographies show, within the prior.

    Images of the board's axes are at right angles and equally long (Zhang 2000, sec. 3.1), the
    principal point and the ratio of the focal lengths as declared.
    """
    planes = _planes(start)
    x, y = planes[..., 0], planes[..., 1]
    size = (x * x).sum(axis=1) + (y * y).sum(axis=1)
    product, difference = x * y / size[:, None], (x * x - y * y) / size[:, None]
    rows = np.concatenate((product, difference))
    flat, deep = rows[:, :2].sum(axis=1), rows[:, 2]
    square = -float(flat @ flat) / min(float(flat @ deep), -np.finfo(float).tiny)
    wide = 3.0 * np.sqrt(start.pictures.camera.covariance[0, 0]) / start.lens[0]
    share = np.clip(np.sqrt(square), max(0.2, 1.0 - wide), 1.0 + wide)
    lens = start.lens.copy()
    lens[:2] *= share
    return replace(start, lens=lens)


def homography(points: Array, images: Array) -> Array:
    """(3, 3) projective map of points (M, 2) to images (M, 2); a few may be wrong.

    Direct linear transformation (Abdel-Aziz & Karara 1971) of the points near the best of
    some random samples.
    """
    known = np.column_stack((points, np.ones(len(points))))
    zero = np.zeros_like(known)
    u, v = images.T[..., None]
    rows = np.stack((np.hstack((known, zero, -u * known)), np.hstack((zero, known, -v * known))), 1)
    rng = np.random.default_rng(0)
    few = np.argsort(rng.random((_SAMPLES, len(points))), axis=1)[:, :FEWEST]
    matrices = np.linalg.svd(rows[few].reshape(_SAMPLES, -1, 9))[2][:, -1].reshape(-1, 3, 3)
    off = np.stack([_off(matrix, known, images) for matrix in matrices])
    off = off[np.median(off, axis=1).argmin()]
    for _ in range(3):
        closest = off <= max(FAR * float(np.median(off)), np.sort(off)[FEWEST - 1])
        matrix = np.linalg.svd(rows[closest].reshape(-1, 9), full_matrices=False)[2][-1].reshape(
            3, 3
        )
        off = _off(matrix, known, images)
    return np.asarray(matrix)


def _off(matrix: Array, known: Array, images: Array) -> Array:
    """(M,) distances of mapped points (M, 3) from their images (M, 2)."""
    image = known @ matrix.T
    depth = np.where(np.abs(image[:, 2]) < 1e-9, 1e-9, image[:, 2])
    return np.asarray(np.linalg.norm(image[:, :2] / depth[:, None] - images, axis=1))

"""Arrays as a caller passes them: numbers of the right shape, or an error that says what is off."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cell.arrays import Array
from cell.errors import InputError

ROUNDED = 1e-3  # [-] largest deviation of a rotation matrix that rounding may have left
_TO_RIGID = 2  # steps, each of which squares the deviation


def finite_rows(values: ArrayLike, row: tuple[int, ...], what: str, unit: str) -> Array:
    """(N, *row) numbers. Raises InputError for another shape, and for rows that are not finite."""
    expected = f"Give an array ({', '.join(('N', *map(str, row)))}) {unit}."
    try:
        if np.iscomplexobj(values):
            raise TypeError
        rows = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: these are no real numbers. {expected}") from None
    if rows.shape[1:] != row or rows.ndim != 1 + len(row):
        raise InputError(f"{what}: of shape {rows.shape}. {expected}")
    finite = np.isfinite(rows).all(axis=tuple(range(1, rows.ndim)))
    if not finite.all():
        raise InputError(
            f"{what}: row {int((~finite).argmax())} of {len(rows)} (counted from 0) is not finite. "
            "Leave such rows out."
        )
    return rows


def rigid_poses(values: ArrayLike) -> Array:
    """(N, 4, 4) poses [m], with rotations that are rotations to rounding of double precision.

    Raises InputError for what is no pose, which a matrix rounded to three digits still is.
    """
    poses = finite_rows(values, (4, 4), "poses", "[m]").copy()
    rotation, identity = poses[:, :3, :3], np.eye(3)
    square = rotation.transpose(0, 2, 1) @ rotation
    bad = (np.abs(square - identity) > ROUNDED).any(axis=(1, 2)) | (np.linalg.det(rotation) < 0.0)
    bad |= (poses[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1)
    if bad.any():
        raise InputError(
            f"poses: row {int(bad.argmax())} of {len(poses)} (counted from 0) is no rotation and "
            "position: [[R, p], [0, 0, 0, 1]] with R orthonormal and right-handed."
        )
    for _ in range(_TO_RIGID):  # Newton-Schulz, to the nearest rotation (Higham 1986)
        square = rotation.transpose(0, 2, 1) @ rotation
        rotation = 0.5 * rotation @ (3.0 * identity - square)
    poses[:, :3, :3] = rotation
    return poses

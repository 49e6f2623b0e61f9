"""Float arrays: the type, the shapes that descriptions declare, write-protected copies, rows given.

An array that a caller passes in remains the caller's: descriptions and logs keep a copy that nobody
can write to, so that neither side can change what the other one holds. Rows that a caller passes to
a function are numbers of the right shape, or an error says what is off.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbar.cell.errors import InputError

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
        wrong = f"row {int((~finite).argmax())} of {len(rows)} (counted from 0) is not finite."
        raise InputError.at(what, wrong, "Leave such rows out.")
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


Array = NDArray[np.float64]


class Shape(tuple[int | str, ...]):
    """Shape of an array field of a dataclass, as in `Annotated[Array, Shape((3, 3))]`.

    A letter stands for a size that all fields of the dataclass share, such as J joints.
    """


Vector3 = Annotated[Array, Shape((3,))]
Vector5 = Annotated[Array, Shape((5,))]
VectorJ = Annotated[Array, Shape(("J",))]
Matrix3 = Annotated[Array, Shape((3, 3))]
MatrixJ = Annotated[Array, Shape(("J", "J"))]


def read_only(values: ArrayLike, dtype: type[np.generic] = np.float64) -> NDArray[Any]:
    """Write-protected copy of an array of any shape, its memory layout kept.

    An array of this type that is write-protected already is returned as it is, so that objects
    made from one another by `dataclasses.replace` share their arrays.
    """
    if isinstance(values, np.ndarray) and values.dtype == dtype and _is_protected(values):
        return values
    copy = np.array(values, dtype=dtype)
    copy.flags.writeable = False
    return copy


def protect_fields(description: object) -> None:
    """Replace every field annotated with a `Shape` by a write-protected float64 copy.

    An optional field may be None. Raises ValueError if the values of a field are not finite or not
    of its shape.
    """
    sizes: dict[int | str, int] = {}
    kind: type = type(description)
    for name, shape in _shapes(kind).items():
        if getattr(description, name) is None:
            continue
        values = read_only(getattr(description, name))
        for letter, size in zip(shape, values.shape, strict=False):
            if isinstance(letter, str):
                sizes.setdefault(letter, size)
        expected = tuple(sizes.get(size, size) for size in shape)
        if values.shape != expected or not np.isfinite(values).all():
            raise ValueError(
                f"{type(description).__name__}.{name}: expected finite numbers of shape "
                f"{expected}, got shape {values.shape}"
            )
        object.__setattr__(description, name, values)


def _is_protected(array: NDArray[Any]) -> bool:
    """Whether neither the array nor any array that it is a view of can be written to."""
    if array.flags.writeable:
        return False
    return array.base is None or (isinstance(array.base, np.ndarray) and _is_protected(array.base))


@cache
def _shapes(description: type) -> dict[str, Shape]:
    """Shape by field name of the annotated fields of a dataclass, those of `... | None` too."""
    hints = get_type_hints(description, include_extras=True)
    return {
        name: mark
        for name, hint in hints.items()
        for member in (hint, *get_args(hint))
        for mark in getattr(member, "__metadata__", ())
        if isinstance(mark, Shape)
    }

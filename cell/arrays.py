"""Float arrays: the type, the shapes that descriptions declare, and write-protected copies.

An array that a caller passes in remains the caller's: descriptions and logs keep a copy that nobody
can write to, so that neither side can change what the other one holds.
"""

from __future__ import annotations

from typing import Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Shape(tuple[int, ...]):
    """Shape of an array field of a dataclass, as in `Annotated[Array, Shape((3, 3))]`."""


Vector3 = Annotated[Array, Shape((3,))]
Vector5 = Annotated[Array, Shape((5,))]
Vector6 = Annotated[Array, Shape((6,))]
Matrix3 = Annotated[Array, Shape((3, 3))]
Matrix6 = Annotated[Array, Shape((6, 6))]


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

    Raises ValueError if the values of a field are not finite or not of its shape.
    """
    for name, shape in _shapes(type(description)).items():
        values = read_only(getattr(description, name))
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(
                f"{type(description).__name__}.{name}: expected finite numbers of shape {shape}, "
                f"got shape {values.shape}"
            )
        object.__setattr__(description, name, values)


def _is_protected(array: NDArray[Any]) -> bool:
    """Whether neither the array nor any array that it is a view of can be written to."""
    if array.flags.writeable:
        return False
    return array.base is None or (isinstance(array.base, np.ndarray) and _is_protected(array.base))


def _shapes(description: type) -> dict[str, tuple[int, ...]]:
    """Shape by field name of the annotated fields of a dataclass."""
    hints = get_type_hints(description, include_extras=True)
    marks = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: tuple(m) for name, ms in marks.items() for m in ms if isinstance(m, Shape)}

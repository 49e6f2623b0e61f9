"""Float arrays: the type, the shapes that descriptions declare, and write-protected copies.

An array that a caller passes in remains the caller's: descriptions and logs keep a copy that nobody
can write to, so that neither side can change what the other one holds.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

"""Names of parameters in the order and the notation of the thesis, sec. 3.3 and Table 3.2."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import groupby

from ballbar.cell.geometry import BAR_ROWS, ParameterTable

ENCODER_OFFSETS = tuple(f"btheta{row + 1}" for row in range(BAR_ROWS))
BAR_PARAMETERS = tuple(
    name
    for name in (f"b{kind}{row + 1}" for kind in ("a", "d", "alpha") for row in range(BAR_ROWS))
    if name != "bd3"
)
_TILT = ("otx", "oty")


def thesis_parameters(table: ParameterTable) -> tuple[str, ...]:
    """The parameters of the thesis in the order of sec. 3.3; 47 for six axes."""
    return (*ENCODER_OFFSETS, "ox", "oy", "oz", *table.robot, "bd3", *BAR_PARAMETERS)


def extra_parameters(table: ParameterTable) -> tuple[str, ...]:
    """Parameters that the thesis does not have; they come after all others."""
    return (*table.hayati, *_TILT)


def order_of_the_thesis(table: ParameterTable) -> Callable[[str], int]:
    """Key that sorts names as the thesis writes them."""
    origin = ("ox", "oy", "oz")
    return (
        *table.robot,
        *table.hayati,
        *origin,
        *_TILT,
        "bd3",
        *BAR_PARAMETERS,
        *ENCODER_OFFSETS,
    ).index


def shortened(names: Iterable[str]) -> list[str]:
    """Neighbours of one kind written together: `ba1, ba2, ba3, bd1, bd2` as `ba1-3`, `bd1,2`."""
    return [
        stem + _run([name[-1] for name in items])
        for stem, items in groupby(names, key=lambda name: name[:-1])
    ]


def joined_names(names: Iterable[str]) -> str:
    """Names that move together; only the origin's coordinates are written as one (thesis)."""
    parts = [
        shortened(items) if of_origin else list(items)
        for of_origin, items in groupby(names, key=lambda name: name[:-1] == "o")
    ]
    return " + ".join(name for items in parts for name in items)


def _run(indices: Sequence[str]) -> str:
    numbers = [ord(i) for i in indices]
    consecutive = (
        len(numbers) > 2
        and indices[0].isdigit()
        and numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    )
    return f"{indices[0]}-{indices[-1]}" if consecutive else ",".join(indices)

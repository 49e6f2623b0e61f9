"""How a dialect finds a column in a header: by name, by regular expression, or by number.

`re:robot_0.*posRawAbs` is an expression, `#3` the third column. One expression may stand for
several columns, such as the six joints: their names differ by one number that counts on
from one to the next and gives the order (joint 2 before joint 10). Names that do not are refused: a
damaged header would otherwise change the order unseen.

Expressions come from files of users. An unlucky one can take forever (nested repetition), so
repeated groups are refused and the rest is bounded.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ballbar.cell.errors import DescriptionError

_REGEX, _NUMBER = "re:", re.compile(r"#([1-9][0-9]{0,3})")
# The k-th of n columns that one expression finds.
_PICK = re.compile(r"(re:.*)\[(\d)/(\d)\]", re.DOTALL)
LONGEST_NAME = 300  # characters; the lines of a PLC have at most 255
_MOST_REPEATS = 3  # unbounded ones in one expression
_SLOW = (
    f"repeated groups and more than {_MOST_REPEATS} of `*` and `+` are refused: they can take "
    "forever"
)


def checked(selector: str) -> str:
    """The selector itself.

    Raises ValueError if it is empty, or an expression that is wrong or could take too long.
    """
    if not selector.strip():
        raise ValueError("a column name is empty")
    if selector.startswith("#") and not _NUMBER.fullmatch(selector):
        raise ValueError(f"{selector!r} is no column number; write #1 for the first column")
    if selector.startswith(_REGEX):
        pattern = selector[len(_REGEX) :]
        bare = re.sub(r"\\.|\[\^?\]?[^\]]*\]", "c", pattern)
        repeats = len(re.findall(r"[*+]|\{\d+,\}", bare))
        nested = re.search(r"\)[*+?{]", bare)
        if nested or repeats > _MOST_REPEATS or len(pattern) > LONGEST_NAME:
            raise ValueError(f"{selector!r}: {_SLOW}")
        try:
            re.compile(pattern)
        except (re.error, OverflowError, RecursionError) as error:
            raise ValueError(f"{selector!r} is no regular expression: {error}") from None
    return selector


def spread(selectors: Sequence[str], count: int) -> tuple[str, ...]:
    """`count` selectors: those given, or one for each column that a single expression finds.

    Names that count on from 1, as `q1` to `q6`, are continued or cut to the count.
    """
    if len(selectors) == 1 and selectors[0].startswith(_REGEX):
        return tuple(f"{selectors[0]}[{k}/{count}]" for k in range(count))
    if selectors and selectors[0].endswith("1"):
        stem = selectors[0][:-1]
        if list(selectors) == [f"{stem}{k + 1}" for k in range(len(selectors))]:
            return tuple(f"{stem}{k + 1}" for k in range(count))
    return tuple(selectors)


def find(selector: str, names: Sequence[str]) -> list[int]:
    """Positions in the header that a selector means: none, one, or all that it finds."""
    if number := _NUMBER.fullmatch(selector):
        return [int(number[1]) - 1] if int(number[1]) <= len(names) else []
    if not selector.startswith(_REGEX):
        return [i for i, name in enumerate(names) if name == selector]
    pick = _PICK.fullmatch(selector)
    positions = _matching(pick[1] if pick else selector, names)
    if pick is None:
        return positions
    counted = _counted(positions, names) if len(positions) == int(pick[3]) else []
    return [counted[int(pick[2])]] if counted else []


def why_not(selector: str, names: Sequence[str]) -> str:
    """The columns that an expression for several finds instead; empty for other selectors."""
    pick = _PICK.fullmatch(selector)
    if pick is None:
        return ""
    matching = [names[i] for i in _matching(pick[1], names)]
    if len(matching) != int(pick[3]):
        return f" {pick[1]} finds {len(matching)} columns, not {pick[3]}."
    unlike = "columns that are not equal but for one number that counts on"
    return f" {pick[1]} finds {unlike}: {', '.join(matching)}."


def _matching(selector: str, names: Sequence[str]) -> list[int]:
    """Positions of the names that an expression matches."""
    pattern = re.compile(selector[len(_REGEX) :])
    return [i for i, n in enumerate(names) if len(n) <= LONGEST_NAME and pattern.search(n)]


def _counted(positions: Sequence[int], names: Sequence[str]) -> list[int]:
    """Positions in the order of the one number by which their names differ, if they do so."""
    parts = [re.split(r"([0-9]+)", names[i]) for i in positions]
    if len({len(part) for part in parts}) != 1:
        return []
    differing = [k for k in range(len(parts[0])) if len({part[k] for part in parts}) > 1]
    if len(differing) != 1 or differing[0] % 2 == 0:
        return []
    numbers = [int(part[differing[0]]) for part in parts]
    if sorted(numbers) != list(range(min(numbers), min(numbers) + len(numbers))):
        return []
    return [positions[k] for k in sorted(range(len(numbers)), key=numbers.__getitem__)]


def by_position(selectors: Sequence[str]) -> bool:
    """Whether all selectors are numbers, so that no header is needed."""
    return all(_NUMBER.fullmatch(selector) for selector in selectors)


def require(selectors: Sequence[str], location: str) -> None:
    """Raises DescriptionError naming `location` for a selector that cannot be used."""
    for selector in selectors:
        try:
            checked(selector)
        except ValueError as error:
            raise DescriptionError(f"{location}: {error}") from None

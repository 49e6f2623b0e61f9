"""How a dialect finds a column in a header: by name, by regular expression (`re:robot_0.*posRawAbs`), by number (`#3`, from 1).

One expression may stand for several columns, such as the six joints: their names are alike but for one number, which counts
on from one to the next and gives the order (joint 2 before joint 10). Names that do not are refused: a damaged header would
otherwise change the order unseen.

Expressions come from files of users. An unlucky one can take forever (nested repetition), so repeated groups are refused
and the rest is bounded.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from cell.errors import DescriptionError

_REGEX, _NUMBER = "re:", re.compile(r"#([1-9][0-9]{0,3})")
_PICK = re.compile(
    r"(re:.*)\[(\d)/(\d)\]", re.DOTALL
)  # k-th of n columns that one expression finds
LONGEST_NAME = 300  # characters; the lines of a PLC have at most 255
_MOST_REPEATS = 3  # unbounded ones in one expression


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
        if (
            re.search(r"\)[*+?{]", bare)
            or len(re.findall(r"[*+]|\{\d+,\}", bare)) > _MOST_REPEATS
            or len(pattern) > LONGEST_NAME
        ):
            raise ValueError(
                f"{selector!r}: repeated groups and more than {_MOST_REPEATS} of `*` and `+` are refused: they can take forever"
            )
        try:
            re.compile(pattern)
        except (re.error, OverflowError, RecursionError) as error:
            raise ValueError(f"{selector!r} is no regular expression: {error}") from None
    return selector


def spread(selectors: Sequence[str], count: int) -> tuple[str, ...]:
    """`count` selectors: those given, or the columns that one expression finds."""
    if len(selectors) == 1 and selectors[0].startswith(_REGEX):
        return tuple(f"{selectors[0]}[{k}/{count}]" for k in range(count))
    return tuple(selectors)


def find(selector: str, names: Sequence[str]) -> list[int]:
    """Positions in the header that a selector means: none, one, or the several among which it cannot choose."""
    if number := _NUMBER.fullmatch(selector):
        return [int(number[1]) - 1] if int(number[1]) <= len(names) else []
    if not selector.startswith(_REGEX):
        return [i for i, name in enumerate(names) if name == selector]
    pick = _PICK.fullmatch(selector)
    pattern = re.compile((pick[1] if pick else selector)[len(_REGEX) :])
    found = [
        i for i, name in enumerate(names) if len(name) <= LONGEST_NAME and pattern.search(name)
    ]
    if pick is None:
        return found
    return (
        [_counted(found, names)[int(pick[2])]]
        if len(found) == int(pick[3]) and _counted(found, names)
        else []
    )


def why_not(selector: str, names: Sequence[str]) -> str:
    """What an expression for several columns finds instead, in words; empty for other selectors."""
    pick = _PICK.fullmatch(selector)
    if pick is None:
        return ""
    found = [
        name
        for name in names
        if len(name) <= LONGEST_NAME and re.search(pick[1][len(_REGEX) :], name)
    ]
    if len(found) != int(pick[3]):
        return f" {pick[1]} finds {len(found)} columns, not {pick[3]}."
    return f" {pick[1]} finds columns that are not alike but for one number that counts on: {', '.join(found)}."


def _counted(found: Sequence[int], names: Sequence[str]) -> list[int]:
    """Positions in the order of the one number by which their names differ; empty if they differ otherwise."""
    parts = [re.split(r"([0-9]+)", names[i]) for i in found]
    if len({len(one) for one in parts}) != 1:
        return []
    differing = [k for k in range(len(parts[0])) if len({one[k] for one in parts}) > 1]
    if len(differing) != 1 or differing[0] % 2 == 0:
        return []
    numbers = [int(one[differing[0]]) for one in parts]
    order = sorted(range(len(found)), key=lambda k: numbers[k])
    counts_on = sorted(numbers) == list(range(min(numbers), min(numbers) + len(numbers)))
    return [found[k] for k in order] if counts_on else []


def by_position(selectors: Sequence[str]) -> bool:
    """Whether all selectors are numbers, so that no header is needed."""
    return all(_NUMBER.fullmatch(one) for one in selectors)


def require(selectors: Sequence[str], place: str) -> None:
    """Raises DescriptionError naming `place` for a selector that cannot be used."""
    for one in selectors:
        try:
            checked(one)
        except ValueError as error:
            raise DescriptionError(f"{place}: {error}") from None

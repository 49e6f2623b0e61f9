"""Constant values of RAPID data: targets, tools and work objects from their lists of numbers.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types,
3HAC050917-001.
"""

from __future__ import annotations

import numpy as np

from ballbar.compensation.frames import payload_of, pose_of_quaternion
from ballbar.compensation.program_text import Number, ProgramError, Reader
from cell.arrays import Array
from cell.errors import InputError
from cell.payload import Payload

AXES = 6
NESTED = 12  # lists in one another, of targets in an array of three dimensions five
NO_VALUE = 9e8  # from here on a number, 9E9, stands for an axis that does not exist


def constant_value(reader: Reader, what: str, depth: int = 0) -> object:
    """A constant value: numbers, words TRUE and FALSE, strings, and lists of them."""
    if reader.take("["):
        if depth == NESTED:
            raise ProgramError(reader.token.line, f"{what}: lists more than {NESTED} deep")
        values = [constant_value(reader, what, depth + 1)]
        while reader.take(","):
            values.append(constant_value(reader, what, depth + 1))
        reader.expect("]", f"in the value of {what}")
        return values
    if reader.token.isword("true", "false") or reader.token.kind == "string":
        return reader.next().text.lower()
    return reader.number(f"value of {what}")


def list_of(value: object) -> list[object]:
    """The parts of a value that is a list, none of another."""
    return value if isinstance(value, list) else []


def elements(value: object, dimensions: int) -> list[object]:
    """The elements of an array of so many dimensions, of none the value itself."""
    if dimensions == 0 or not isinstance(value, list):
        return [value]
    return [element for part in value for element in elements(part, dimensions - 1)]


def jointtarget_of(value: object, name: str, line: int) -> tuple[Number, ...]:
    """The axis angles of [[axes],[external axes]]."""
    axes, _ = _parts(value, name, line, "[axes]", "[external]")
    return _numbers(axes, AXES, name, line)


def robtarget_of(
    value: object, name: str, line: int
) -> tuple[tuple[Number, ...], tuple[Number, ...]]:
    """Position and quaternion, and configuration, of a target without external axes."""
    place, turn, configuration, external = _parts(
        value, name, line, "[position]", "[q]", "[confdata]", "[external]"
    )
    numbers = _numbers(place, 3, name, line) + _numbers(turn, 4, name, line)
    quadrants = _numbers(configuration, 4, name, line)
    if any(number.value % 1.0 for number in quadrants):
        raise ProgramError(line, f"{name}: confdata are whole numbers")
    for k, number in enumerate(list_of(external) or [external]):
        # one of them may carry the robot or the work object
        if not isinstance(number, Number) or abs(number.value) < NO_VALUE:
            text = number.text if isinstance(number, Number) else "no number"
            raise ProgramError(
                line,
                f"{name}: external axis {k + 1} stands at {text}, not 9E9; whether it moves the "
                "robot's base or the work object is not known: state a jointtarget",
            )
    return numbers, quadrants


def tool_of(value: object, name: str, line: int) -> tuple[Array, Payload | None]:
    """(4, 4) frame and load of [held,[frame],[mass,[centre],...]]; a mass below 0 is not known."""
    held, frame, load = _parts(value, name, line, "held", "[frame]", "[load]")
    if held != "true":
        raise ProgramError(line, f"tool {name} is stationary, which is not accounted for")
    mass, *others = list_of(load) or [load]
    what = f"load of {name}"
    (kilograms,) = _numbers([mass], 1, what, line)
    centre = _numbers(next(iter(others), None), 3, what, line)
    if kilograms.value < 0.0:
        return _pose(frame, name, line), None
    try:
        payload = payload_of(kilograms.value, [number.value for number in centre])
    except InputError as error:
        raise ProgramError(line, f"{what}: {error}") from None
    return _pose(frame, name, line), payload


def work_object_of(value: object, name: str, line: int) -> Array:
    """(4, 4) object frame in the robot's base frame of [held,fixed,unit,[user],[object]]."""
    held, fixed, _, user, placed = _parts(
        value, name, line, "held", "fixed", "unit", "[user]", "[object]"
    )
    if held != "false" or fixed != "true":
        raise ProgramError(
            line, f"work object {name} is held by a robot or moves, which is not accounted for"
        )
    return np.asarray(_pose(user, name, line) @ _pose(placed, name, line))


def _parts(value: object, name: str, line: int, *form: str) -> list[object]:
    """The parts of a value, as many as its form has."""
    items = list_of(value)
    if len(items) != len(form):
        raise ProgramError(line, f"{name}: expected [{','.join(form)}]")
    return items


def _pose(value: object, name: str, line: int) -> Array:
    """(4, 4) frame of [[x,y,z],[q1,q2,q3,q4]]."""
    place, turn = _parts(value, name, line, "[x,y,z]", "[q1,q2,q3,q4]")
    try:
        return pose_of_quaternion(
            [number.value for number in _numbers(place, 3, name, line)],
            [number.value for number in _numbers(turn, 4, name, line)],
        )
    except ValueError as error:
        raise ProgramError(line, f"{name}: {error}") from None


def _numbers(value: object, count: int, name: str, line: int) -> tuple[Number, ...]:
    """So many numbers of a list, each of an axis or quantity that exists."""
    items = list_of(value)
    numbers = tuple(part for part in items if isinstance(part, Number))
    if len(numbers) != count or len(items) != count:
        raise ProgramError(
            line, f"{name}: {len(items)} values where {count} are expected; decimals have a point"
        )
    if any(abs(number.value) >= NO_VALUE for number in numbers):
        raise ProgramError(line, f"{name}: 9E9 stands for an axis or value that does not exist")
    return numbers

"""Constant values of KRL: points and frames from the components of their aggregates.

Source: KUKA System Software 8.3, Operating and Programming Instructions for System Integrators.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ballbar.compensation.frames import pose_of_angles
from ballbar.compensation.program_source import MoveSetup, ProgramTarget
from ballbar.compensation.program_text import Number, ProgramError, Reader, Token
from cell.arrays import Array
from cell.foreign_text import one_line

AXES, POSE = tuple(f"a{i}" for i in range(1, 7)), ("x", "y", "z", "a", "b", "c")
EXTERNAL_AXES = tuple(f"e{i}" for i in range(1, 7))
_INTEGER = re.compile(r"'[bB][01]+'|'[hH][0-9A-Fa-f]+'|\d+")  # of S and T


@dataclass(frozen=True, eq=False)
class KrlPoint:
    """A constant value of a point, and where it stands."""

    name: str
    line: int
    fields: dict[str, Number]
    is_target: bool = True  # a FRAME may be a base

    @property
    def joints(self) -> bool:
        """Whether it is of axis angles."""
        return "a1" in self.fields

    def target(self, setup: MoveSetup) -> ProgramTarget:
        """The target of the point. Raises ProgramError for other components than its type has."""
        fields, line, name = self.fields, self.line, self.name
        needed, allowed = (AXES, ()) if self.joints else (POSE, ("s", "t"))
        if not set(needed) <= set(fields) <= {*needed, *allowed, *EXTERNAL_AXES}:
            expected, stated = (", ".join(keys).upper() for keys in (needed, fields))
            raise ProgramError(line, f"{name}: expected {expected}, there are {stated}")
        if ("s" in fields) is not ("t" in fields):
            raise ProgramError(line, f"{name}: S and T are both needed, or neither")
        return ProgramTarget(
            name=name,
            line=line,
            numbers=tuple(fields[key] for key in needed),
            rotation=None if self.joints else "zyx",
            setup=setup,
            configuration=tuple(fields[key] for key in allowed if key in fields),
        )


@dataclass(frozen=True, eq=False)
class KrlFrame:
    """A tool or base: its number where it has one, its pose (4, 4) where it is constant."""

    number: str = ""
    pose: Array | None = None


def fields_of(reader: Reader, what: str) -> dict[str, Number]:
    """Components of an aggregate of numbers, by lower-case name."""
    reader.expect("{", what)
    if reader.token.kind == "word" and reader.tokens[reader.place + 1].issymbol(":"):
        reader.place += 2  # the type before the components
    fields: dict[str, Number] = {}
    while True:
        component = reader.next()
        key, text = component.text.lower(), component.text
        if component.kind != "word" or key in fields:
            fault = f"{text} stands twice"
            if component.kind != "word":
                fault = f"{one_line(text)!r} where a component is expected; decimals have a point"
            raise ProgramError(component.line, f"{what}: {fault}")
        literal = reader.token
        if key not in ("s", "t"):
            fields[key] = reader.number(f"{what}, {text}")
        elif _INTEGER.fullmatch(reader.next().text):
            fields[key] = Number(literal.text, literal.start, literal.end, literal.line)
        else:
            raise ProgramError(
                literal.line,
                f"{what}: {text} {one_line(literal.text)} is no whole number; expected digits as "
                "2, 'B010' or 'H2'",
            )
        if reader.take("}"):
            return fields
        reader.expect(",", what)


def constant_frame(fields: dict[str, Number], token: Token) -> KrlFrame:
    """The frame of X, Y, Z, A, B, C; token : names it in messages."""
    if set(fields) != set(POSE):
        raise ProgramError(token.line, f"{token.text}: expected X, Y, Z, A, B, C")
    return KrlFrame("", pose_of_angles([fields[key].value for key in POSE]))


def numbered_frame(number: str) -> KrlFrame:
    """A tool or base of the controller; number 0 is the flange and the robot's base."""
    return KrlFrame(number, np.eye(4) if number == "0" else None)


def words_of(reader: Reader) -> list[tuple[str, str]]:
    """Components of an aggregate of any type, and the first words of their values."""
    words, depth = list[tuple[str, str]](), 0
    while reader.token.kind != "end":
        token = reader.next()
        depth += token.issymbol("{") - token.issymbol("}")
        if depth == 0:
            break
        if depth == 1 and token.kind == "word":
            reader.take("#")  # of an enumeration
            words.append((token.text.lower(), reader.token.text.lower()))
    return words

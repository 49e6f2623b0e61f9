"""Targets of a RAPID module: jointtarget and robtarget, declared or written in the instruction.

Read are declarations with constant values (CONST, PERS, VAR) of targets, tools and work objects,
and the move instructions of `MOVES`. Whatever else goes to a target, or computes with one, is
refused with its line; so are robtargets whose axes the text does not tell, since external axes have
values, or the controller chooses the configuration (`ConfL\\Off`, `ConfJ\\Off`, `SingArea\\Wrist`).
The robot's base frame is taken for the world frame.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types,
3HAC050917-001. No result was loaded into a controller.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.compensation.frames import FrameOptions
from ballbar.compensation.program_source import (
    MoveSetup,
    ProgramSource,
    ProgramTarget,
    RobotProgram,
    computed,
    not_stated,
    used_elsewhere,
)
from ballbar.compensation.program_text import Number, ProgramError, Reader, Token, parts
from ballbar.compensation.rapid_values import (
    AXES,
    constant_value,
    elements,
    jointtarget_of,
    list_of,
    robtarget_of,
    tool_of,
    work_object_of,
)
from cell.arrays import Array
from cell.foreign_text import one_line
from cell.payload import Payload

# instruction: arguments that are targets, and the one that is the tool, from 0
MOVES: dict[str, tuple[tuple[int, ...], int]] = {
    "moveabsj": ((0,), 3),
    **{f"move{kind}{more}": ((0,), 3) for kind in "jl" for more in ("", "do", "ao", "go", "sync")},
    **{f"movec{more}": ((0, 1), 4) for more in ("", "do", "ao", "go", "sync")},
    "triggj": ((0,), 4),
    "triggl": ((0,), 4),
    "triggc": ((0, 1), 5),
}
# begin like motions, but set something up, or move external axes alone
_NO_MOTION = re.compile(r"triggio|triggequip|triggint|triggcheckio|triggspeed|triggrampao|moveextj")
_MOTION = re.compile(r"(move|trigg|search|arc|spot|paint|disp|cap|laser|cut|glue)\w*")
# change what every later target means
_SHIFTS = {
    "pdispon": "a program displacement",
    "pdispset": "a program displacement",
    "gripload": "the load",
}
# the one argument with which the controller goes by the configuration of a target
_GOES_BY_CONFIGURATION = {"confl": "on", "confj": "on", "singarea": "off"}
_TAKES_A_FRAME = (["\\", "tool", ":="], ["\\", "wobj", ":="])
_TARGETS = ("jointtarget", "robtarget")


@dataclass(frozen=True, eq=False)
class _Data:
    """A declaration."""

    kind: str
    name: str
    line: int
    values: tuple[object, ...]  # one aggregate, or as many as the array has
    failure: ProgramError | None = None  # why its value is not constant

    def one_value(self) -> object:
        """The value of a tool or work object; raises ProgramError where it is not constant."""
        if self.failure is not None:
            raise self.failure
        if len(self.values) != 1:
            raise ProgramError(self.line, f"{self.name} is an array where one is expected")
        return self.values[0]


def read_rapid(path: Path, options: FrameOptions) -> list[RobotProgram]:
    """The targets of a module. Raises InputError naming the lines that are not understood."""
    module = _Module(path, options)
    for read in (module.declaration, module.instruction, module.elsewhere):
        module.guarded(read, range(len(module.tokens)))
    targets = [data for data in module.data.values() if data.kind in _TARGETS]
    module.guarded(module.declared_target, targets)
    if any(target.rotation for target in module.targets):
        module.faults += [
            (
                token.line,
                f"after {token.text} the robot takes the nearest configuration, not the one that a "
                "robtarget states, so its axes there are not known; take the line out if the "
                "stated ones are right, or state jointtargets",
            )
            for token in module.choices
        ]
    return [module.program()]


class _Module(ProgramSource):
    """The module while it is read."""

    def __init__(self, path: Path, options: FrameOptions) -> None:
        super().__init__(path, options, comments=r"![^\n]*", words=r"[A-Za-z_]\w*", lines=False)
        self.data: dict[str, _Data] = {}
        self.choices: list[Token] = []  # instructions that leave the configuration to the robot
        pairs = list(pairwise(self.tokens))
        self.routines = {b.text.lower() for a, b in pairs if a.isword("proc", "func", "trap")}
        self.parameters = {  # tools and work objects that routines are given
            b.text.lower()
            for (a, b), (_, c) in pairwise(pairs)
            if a.isword("tooldata", "wobjdata") and c.issymbol(",", ")", "|")
        }

    def declaration(self, i: int) -> None:
        """A declaration of a target, tool or work object that begins at a token."""
        if not self.tokens[i].isword("const", "pers", "var"):
            return
        reader = Reader(self.tokens, self.text, i + 1)
        kind, name = reader.next(), reader.next()
        declared = kind.isword(*_TARGETS, "tooldata", "wobjdata") and name.kind == "word"
        if not declared or reader.token.issymbol(",", ")"):
            return  # of another type, or a parameter of a routine
        key, sizes, values = name.text.lower(), 0, list[object]()
        if key in self.data:
            raise ProgramError(
                name.line, f"{name.text} is declared twice, so it is not clear which a move means"
            )
        if reader.take("{"):
            while not reader.take("}"):
                if reader.token.kind == "end":
                    raise ProgramError(name.line, f"the size of {name.text} does not end")
                sizes += reader.next().kind != "symbol"
        failure: ProgramError | None = ProgramError(name.line, f"{name.text} has no constant value")
        try:
            if reader.take(":="):
                values = elements(constant_value(reader, name.text), sizes)
                failure = None
                reader.expect(";", f"after the value of {name.text}")
        except ProgramError as fault:
            failure = fault
        self.placed |= {token.start for token in self.tokens[i : reader.place]}
        self.data[key] = _Data(kind.text.lower(), name.text, name.line, tuple(values), failure)

    def instruction(self, i: int) -> None:
        """An instruction that begins at a token, or a name that stands there."""
        token, word = self.tokens[i], self.tokens[i].text.lower()
        before = self.tokens[i - 1]  # of the first token the last, which is the end
        if token.kind != "word" or token.start in self.placed or before.issymbol(".", "\\"):
            return
        following = self.tokens[i + 1]
        if (data := self.data.get(word)) is not None:
            self._reference(i, data)
        elif following.issymbol(":=", "(", ".", ",", "{") or (
            before.isword("proc", "func", "trap", "module")
        ):
            return
        elif word in MOVES:
            self._move(i)
        elif word in _GOES_BY_CONFIGURATION:
            after = [part.text.lower() for part in self.tokens[i + 1 : i + 4]]
            if after != ["\\", _GOES_BY_CONFIGURATION[word], ";"]:
                self.choices.append(token)
        elif word in _SHIFTS and not (word == "gripload" and self.options.payloads):
            raise ProgramError(
                token.line,
                f"{token.text} changes {_SHIFTS[word]} of what follows, which is not accounted for"
                + (": state it by --payload" if word == "gripload" else ""),
            )
        elif _MOTION.fullmatch(word) and not _NO_MOTION.fullmatch(word):
            if word in self.routines:
                return
            if following.issymbol(";"):
                self.notes.append(f"{token.text} is not in the file: its targets stay as they are")
                return
            raise ProgramError(
                token.line, f"{token.text} is no move instruction that is understood; understood "
                f"are MoveAbsJ, MoveJ, MoveL, MoveC, TriggJ, TriggL, TriggC",
            )  # fmt: skip

    def elsewhere(self, i: int) -> None:
        """Refuses a value outside of declarations and moves that has the form of a target."""
        token = self.tokens[i]
        inner = self.tokens[i - 1].issymbol("[")
        if not token.issymbol("[") or inner or token.start in self.placed:
            return
        try:
            value = constant_value(Reader(self.tokens, self.text, i), "")
        except ProgramError:
            return  # an index or a computed list; names of targets in it are refused by themselves
        sizes = [len(part) if isinstance(part, list) else 0 for part in list_of(value)]
        if sizes[:3] == [3, 4, 4] or (len(sizes) == 2 and sizes[0] == AXES):
            raise ProgramError(
                token.line,
                "a target is written where no move is understood to go there; declare it, and move "
                "to it by MoveAbsJ, MoveJ, MoveL or MoveC",
            )

    def _reference(self, i: int, data: _Data) -> None:
        """A name of a target, tool or work object outside of declarations and moves."""
        token = self.tokens[i]
        if data.kind in _TARGETS:
            raise used_elsewhere(token, "a move instruction")
        if self.tokens[i + 1].issymbol(":="):
            raise ProgramError(token.line, f"{token.text} is changed by the program")
        before = self.tokens[max(i - 3, 0) : i]
        if [part.text.lower() for part in before] not in _TAKES_A_FRAME:
            raise ProgramError(
                token.line,
                f"{token.text} is used outside of a move instruction, where its value may change "
                "or another be meant by the name",
            )

    def _move(self, i: int) -> None:
        name, end = self.tokens[i], i + 1
        while not self.tokens[end].issymbol(";") and self.tokens[end].kind != "end":
            end += 1
        self.placed |= {token.start for token in self.tokens[i:end]}
        arguments = [parts(argument, "\\") for argument in parts(self.tokens[i + 1 : end], ",")]
        while arguments and not arguments[0][0]:
            arguments.pop(0)  # \Conc
        places, tool_at = MOVES[name.text.lower()]
        if len(arguments) <= tool_at:
            raise ProgramError(
                name.line, f"{name.text} has {len(arguments)} arguments, expected {tool_at + 1}"
            )
        joints = name.text.lower() == "moveabsj"
        setup = self._setup(arguments[tool_at], name, joints=joints)
        for place in places:
            self._goal(arguments[place][0], name, setup, joints=joints)

    def _goal(self, tokens: list[Token], move: Token, setup: MoveSetup, *, joints: bool) -> None:
        """The target of a move: a name, an element of an array, or an aggregate."""
        reader, what, value = self.reader(tokens), f"target of {move.text}", None
        name = reader.token
        if name.issymbol("["):
            value = constant_value(reader, what)
        elif name.kind != "word" or reader.tokens[1].issymbol("("):
            raise computed(move.line, what, reader.shown)
        else:
            reader.name("{}")
        if reader.token.kind != "end":
            raise computed(move.line, what, reader.shown)
        if value is not None:
            self._add(move.text, move.line, value, setup, joints=joints)
            return
        data = self.data.get(name.text.lower())
        declared = data is not None and data.kind in _TARGETS
        if not self.named_target(move.text, name.text, move.line, declared=declared):
            return
        assert data is not None
        if (data.kind == "jointtarget") is not joints:
            raise ProgramError(
                move.line, f"{name.text} is a {data.kind}, which {move.text} does not take"
            )
        self.uses.setdefault(name.text.lower(), []).append((move.line, setup))

    def _setup(self, given: list[list[Token]], move: Token, *, joints: bool) -> MoveSetup:
        """Tool, work object and payload of a move."""
        tool_name = _name(given[0], f"tool of {move.text}", move)
        named = {switch[0].text.lower(): switch[1:] for switch in given[1:] if switch}
        if "tload" in named and not self.options.payloads:
            raise ProgramError(move.line, "\\TLoad replaces the tool's load: state it by --payload")
        tool, payload = self._tool(tool_name, move, needed=not joints)
        frame = np.eye(4)
        if not joints and "wobj" in named:
            if not (value := named["wobj"]) or not value[0].issymbol(":="):
                raise ProgramError(move.line, "\\WObj is not given by :=, so it is not known")
            frame = self._work_object(_name(value[1:], f"work object of {move.text}", move), move)
        return MoveSetup(tool, frame, payload, tool_name)

    def _tool(self, name: str, move: Token, *, needed: bool) -> tuple[Array, Payload | None]:
        stated = self.options.payload(name)
        if name.lower() == "tool0":
            return np.eye(4), stated
        data = self._declared_frame("tooldata", name, move, self.options.tools)
        if data is not None:
            tool, declared = tool_of(data.one_value(), name, data.line)
            return tool, stated or declared
        other = self.options.tool(name)
        if other is None and needed:
            raise not_stated(move.line, f"tool {name}", "tool", name)
        return np.eye(4) if other is None else other, stated

    def _work_object(self, name: str, move: Token) -> Array:
        if name.lower() == "wobj0":
            return np.eye(4)
        data = self._declared_frame("wobjdata", name, move, self.options.frames)
        if data is not None:
            return work_object_of(data.one_value(), name, data.line)
        if (frame := self.options.frame(name)) is not None:
            return frame
        raise not_stated(move.line, f"work object {name}", "frame", name)

    def _declared_frame(
        self, kind: str, name: str, move: Token, stated: Mapping[str, object]
    ) -> _Data | None:
        """A declared tool or work object; a routine's parameter has to be stated by its name."""
        data = self.data.get(name.lower())
        if data is not None and data.kind == kind:
            return data
        if name.lower() in self.parameters and name.lower() not in stated:
            raise ProgramError(
                move.line, f"{name} is given to the routine by its caller, so it is not known"
            )
        return None

    def declared_target(self, data: _Data) -> None:
        """The targets of a declaration, by the moves that go there."""
        if data.failure is not None:
            raise data.failure
        joints = data.kind == "jointtarget"
        setup = self.setup_of(data.name, data.line, joints=joints)
        count = len(data.values)
        for k, value in enumerate(data.values):
            name = data.name if count == 1 else f"{data.name}{{{k + 1}}}"
            self._add(name, data.line, value, setup, joints=joints)

    def _add(self, name: str, line: int, value: object, setup: MoveSetup, *, joints: bool) -> None:
        configuration: tuple[Number, ...] = ()
        if joints:
            numbers = jointtarget_of(value, name, line)
        else:
            numbers, configuration = robtarget_of(value, name, line)
        rotation: Literal["quaternion"] | None = None if joints else "quaternion"
        target = ProgramTarget(name, numbers[0].line, numbers, rotation, setup, configuration)
        self.targets.append(target)


def _name(tokens: Sequence[Token], what: str, move: Token) -> str:
    """The name that an argument consists of."""
    if len(tokens) == 1 and tokens[0].kind == "word":
        return tokens[0].text
    text = one_line("".join(token.text for token in tokens))
    raise ProgramError(move.line, f"{what} is no name of a declaration ({text}); name one")

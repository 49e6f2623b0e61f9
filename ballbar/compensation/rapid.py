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
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.foreign_text import one_line
from ballbar.cell.payload import Payload
from ballbar.compensation.frames import FrameOptions, payload_of, pose_of_quaternion
from ballbar.compensation.program_source import (
    MoveSetup,
    ProgramSource,
    ProgramTarget,
    RobotProgram,
    not_stated,
    numbers_of,
    positional,
)
from ballbar.compensation.program_text import Number, ProgramError, Token, Value, parts

# instruction: arguments that are targets, and the one that is the tool, from 0
MOVES: dict[str, tuple[tuple[int, ...], int]] = {
    "moveabsj": ((0,), 3),
    **{f"move{kind}{more}": ((0,), 3) for kind in "jl" for more in ("", "do", "ao", "go", "sync")},
    **{f"movec{more}": ((0, 1), 4) for more in ("", "do", "ao", "go", "sync")},
    "triggj": ((0,), 4),
    "triggl": ((0,), 4),
    "triggc": ((0, 1), 5),
}
# other motions, but for words that begin so and set something up, or move external axes alone
_MOTION = re.compile(
    r"(?!triggio|triggequip|triggint|triggcheckio|triggspeed|triggrampao|moveextj)"
    r"(move|trigg|search|arc|spot|paint|disp|cap|laser|cut|glue)\w*"
)
# change what every later target means
_SHIFTS = {
    "pdispon": "a program displacement",
    "pdispset": "a program displacement",
    "gripload": "the load",
}
# the one argument with which the controller goes by the configuration of a target
_GOES_BY_CONFIGURATION = {"confl": "on", "confj": "on", "singarea": "off"}
_FRAMES = {"tooldata": ("tool", "tool"), "wobjdata": ("work object", "frame")}  # shown, option
_TARGETS = ("jointtarget", "robtarget")
_ROUTINES = ("proc", "func", "trap")
AXES = 6
NO_VALUE = 9e8  # from here on a number, 9E9, stands for an axis that does not exist


def read_rapid(path: Path, options: FrameOptions) -> list[RobotProgram]:
    """The targets of a module. Raises InputError naming the lines that are not understood."""
    module = _Module(path, options)
    module.guarded(module.declaration, module.statements)
    module.guarded(module.instructions, module.statements)
    module.guarded(module.declared_targets, module.points)
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

    COMMENTS, WORDS, END = r"![^\n]*", r"[A-Za-z_]\w*", ";"
    MOVES = "a move instruction (MoveAbsJ, MoveJ, MoveL, MoveC, TriggJ, TriggL, TriggC)"

    def __init__(self, path: Path, options: FrameOptions) -> None:
        super().__init__(path, options)
        self.choices: list[Token] = []  # instructions that leave the configuration to the robot
        pairs = [pair for statement in self.statements for pair in pairwise(statement)]
        self.routines = {b.text.lower() for a, b in pairs if a.isword(*_ROUTINES)}
        self.parameters = {  # tools and work objects that routines are given
            b.text.lower()
            for (a, b), (_, c) in pairwise(pairs)
            if a.isword(*_FRAMES) and c.issymbol(",", ")", "|")
        }

    def declaration(self, tokens: list[Token]) -> None:
        """The declaration of a target, tool or work object that a statement ends with."""
        begins = [k for k, token in enumerate(tokens) if token.isword("const", "pers", "var")]
        reader = self.reader(tokens, at=begins[-1] + 1 if begins else len(tokens))
        kind, name = reader.next(), reader.next()
        known = kind.isword(*_TARGETS, *_FRAMES) and name.kind == "word"
        if not known or reader.token.issymbol(",", ")", "|"):
            return  # of another type, or a parameter of a routine
        dimensions, line = 0, name.line
        self.once(name.text, line)
        if reader.take("{"):
            dimensions += 1
            while reader.token.kind != "end" and not reader.take("}"):
                dimensions += reader.next().issymbol(",")
        if not reader.take(":="):
            if kind.isword(*_FRAMES):
                return
            raise ProgramError(line, f"{name.text} has no constant value; write it there")
        value = self.declared(reader, name.text)
        self.placed |= {token.start for token in tokens[begins[-1] :]}
        if kind.isword(*_FRAMES):
            self.frames[name.text.lower()] = kind.text.lower(), line, value
            self.names.add(name.text.lower())
            return
        values, targets = _elements(value, dimensions), list[ProgramTarget]()
        for k, each in enumerate(values, start=1):
            shown = name.text if dimensions == 0 else f"{name.text}{{{k}}}"
            targets.append(self.target(each, shown, line))
            if (targets[-1].rotation is None) is not kind.isword("jointtarget"):
                raise ProgramError(line, f"{shown}: the value is not that of a {kind.text}")
        self.declare(name.text, targets)

    def target(self, value: Value, name: str, line: int) -> ProgramTarget:
        """The target of [[axes],[external]] or [[position],[q],[confdata],[external]]."""
        if not isinstance(value, dict) or len(value) == 2:
            axes, _ = positional(value, name, line, "[axes]", "[external]")
            numbers = _numbers(axes, AXES, name, line)
            return ProgramTarget(name, numbers[0].line, numbers, None)
        place, turn, configuration, external = positional(
            value, name, line, "[position]", "[q]", "[confdata]", "[external]"
        )
        numbers = _numbers(place, 3, name, line) + _numbers(turn, 4, name, line)
        quadrants = _numbers(configuration, 4, name, line)
        if any(number.value % 1.0 for number in quadrants):
            raise ProgramError(line, f"{name}: confdata are whole numbers")
        stated = external.values() if isinstance(external, dict) else [external]
        for k, number in enumerate(numbers_of(stated, name, line), start=1):
            if abs(number.value) < NO_VALUE:  # it may carry the robot or the work object
                raise ProgramError(
                    line,
                    f"{name}: external axis {k} stands at {number.text}, not 9E9; whether it moves "
                    "the robot's base or the work object is not known: state a jointtarget",
                )
        return ProgramTarget(name, numbers[0].line, numbers, "quaternion", configuration=quadrants)

    def begins_target(self, tokens: Sequence[Token], k: int) -> bool:
        """Whether a list has the form of a target."""
        if not tokens[k].issymbol("[") or (k and tokens[k - 1].issymbol("[")):
            return False
        try:
            value = self.reader(tokens, at=k).value("")
        except ProgramError:
            return False  # an index, or computed; names of targets in it are refused by themselves
        inner = value.values() if isinstance(value, dict) else ()
        sizes = [len(part) if isinstance(part, dict) else 0 for part in inner]
        return sizes[:3] == [3, 4, 4] or (len(sizes) == 2 and sizes[0] == AXES)

    def instructions(self, tokens: list[Token]) -> None:
        """The instruction of a statement; whatever else names targets and tools is refused."""
        for k, token in enumerate(tokens):
            before = tokens[k - 1].text.lower() if k else ""
            if token.kind != "word" or token.start in self.placed:
                continue
            if before in (".", "\\"):  # a component, or a switch; \Tool:= and \WObj:= only read
                reads = token.isword("tool", "wobj") and tokens[k + 1 : k + 2]
                of_value = 2 if reads and reads[0].issymbol(":=") else 0
                self.placed |= {part.start for part in tokens[k : k + 1 + of_value]}
            elif before not in (*_ROUTINES, "module"):
                self._instruction(tokens[k:])
        self.elsewhere(tokens)

    def _instruction(self, tokens: list[Token]) -> None:
        token, word = tokens[0], tokens[0].text.lower()
        after = [following.text.lower() for following in tokens[1:]]
        if after and after[0] in (":=", "(", ".", ",", "{"):
            return
        if word in MOVES:
            self._move(tokens)
        elif word in _GOES_BY_CONFIGURATION and after != ["\\", _GOES_BY_CONFIGURATION[word]]:
            self.choices.append(token)
        elif word in _SHIFTS and not (word == "gripload" and self.options.payloads):
            remedy = ": state it by --payload" if word == "gripload" else ""
            raise ProgramError(
                token.line,
                f"{token.text} changes {_SHIFTS[word]} of what follows, which is not accounted for"
                f"{remedy}",
            )
        elif _MOTION.fullmatch(word) and word not in self.routines:
            if after:
                raise ProgramError(token.line, f"{token.text} is not {self.MOVES}")
            self.notes.append(f"{token.text} is not in the file: its targets stay as they are")

    def _move(self, tokens: list[Token]) -> None:
        move, joints = tokens[0], tokens[0].isword("moveabsj")
        self.placed |= {token.start for token in tokens}
        arguments = [parts(argument, "\\") for argument in parts(tokens[1:], ",")]
        while arguments and not arguments[0][0]:
            arguments.pop(0)  # \Conc
        places, tool_at = MOVES[move.text.lower()]
        if len(arguments) <= tool_at:
            wrong = f"{move.text} has {len(arguments)} arguments, expected {tool_at + 1}"
            raise ProgramError(move.line, wrong)
        setup = self._setup(arguments[tool_at], move, joints=joints)

        def checked(of_joints: bool) -> MoveSetup:
            if of_joints is not joints:
                kind = "jointtarget" if of_joints else "robtarget"
                wrong = f"the target is a {kind}, which {move.text} does not take"
                raise ProgramError(move.line, wrong)
            return setup

        for place in places:
            self.go(self.reader(arguments[place][0], move.line), move, checked)

    def _setup(self, given: list[list[Token]], move: Token, *, joints: bool) -> MoveSetup:
        """Tool, work object and payload of a move."""
        switches = {switch[0].text.lower(): switch[1:] for switch in given[1:] if switch}
        if "tload" in switches and not self.options.payloads:
            raise ProgramError(move.line, "\\TLoad replaces the tool's load: state it by --payload")
        tool, (pose, load) = self._frame("tooldata", given[0], move, needed=not joints)
        frame = np.eye(4)
        if not joints and "wobj" in switches:
            value = switches["wobj"]
            if not value or not value[0].issymbol(":="):
                raise ProgramError(move.line, "\\WObj is not given by :=, so it is not known")
            _, (frame, _) = self._frame("wobjdata", value[1:], move, needed=True)
        return MoveSetup(pose, frame, self.options.payload(tool) or load, tool)

    def _frame(
        self, kind: str, tokens: Sequence[Token], move: Token, *, needed: bool
    ) -> tuple[str, tuple[Array, Payload | None]]:
        """Name, frame (4, 4) and load of a tool or work object that a move names."""
        what, option = _FRAMES[kind]
        text = one_line("".join(token.text for token in tokens))
        if len(tokens) != 1 or tokens[0].kind != "word":
            raise ProgramError(
                move.line, f"{what} of {move.text} is no name of a declaration ({text}); name one"
            )
        key = text.lower()
        if key in ("tool0", "wobj0"):
            return text, (np.eye(4), None)
        declared, line, value = self.frames.get(key, ("", 0, {}))
        if declared == kind:
            read = _tool_of if kind == "tooldata" else _work_object_of
            return text, read(value, text, line)
        stated = self.options.tools if kind == "tooldata" else self.options.frames
        if key in self.parameters and key not in stated:
            raise ProgramError(
                move.line, f"{text} is given to the routine by its caller, so it is not known"
            )
        pose = stated.get(key, stated.get(""))
        if pose is None and needed:
            raise not_stated(move.line, f"{what} {text}", option, text)
        return text, (np.eye(4) if pose is None else pose, None)


def _elements(value: Value, dimensions: int) -> list[Value]:
    """The elements of an array of so many dimensions, of none the value itself."""
    if dimensions == 0 or not isinstance(value, dict):
        return [value]
    return [element for part in value.values() for element in _elements(part, dimensions - 1)]


def _tool_of(value: Value, name: str, line: int) -> tuple[Array, Payload | None]:
    """Frame and load of [held,[frame],[mass,[centre],...]]; a mass below 0 is not known."""
    held, frame, load = positional(value, name, line, "held", "[frame]", "[load]")
    if not _is(held, "true"):
        raise ProgramError(line, f"tool {name} is stationary, which is not accounted for")
    form = ("mass", "[centre]", "[aom]", "ix", "iy", "iz")
    what = f"load of {name}"
    mass, centre, *_ = positional(load, what, line, *form)
    (kilograms,) = numbers_of([mass], what, line)
    place = [number.value for number in _numbers(centre, 3, what, line)]
    if kilograms.value < 0.0:
        return _pose(frame, name, line), None
    try:
        return _pose(frame, name, line), payload_of(kilograms.value, place)
    except InputError as error:
        raise ProgramError(line, f"{what}: {error}") from None


def _work_object_of(value: Value, name: str, line: int) -> tuple[Array, None]:
    """Object frame in the robot's base frame of [held,fixed,unit,[user],[object]]."""
    held, fixed, _, user, placed = positional(
        value, name, line, "held", "fixed", "unit", "[user]", "[object]"
    )
    if not _is(held, "false") or not _is(fixed, "true"):
        raise ProgramError(
            line, f"work object {name} is held by a robot or moves, which is not accounted for"
        )
    return np.asarray(_pose(user, name, line) @ _pose(placed, name, line)), None


def _is(value: Value, word: str) -> bool:
    return isinstance(value, Token) and value.isword(word)


def _pose(value: Value, name: str, line: int) -> Array:
    """(4, 4) frame of [[x,y,z],[q1,q2,q3,q4]]."""
    place, turn = positional(value, name, line, "[x,y,z]", "[q1,q2,q3,q4]")
    values = _numbers(place, 3, name, line) + _numbers(turn, 4, name, line)
    numbers = [number.value for number in values]
    try:
        return pose_of_quaternion(numbers[:3], numbers[3:])
    except ValueError as error:
        raise ProgramError(line, f"{name}: {error}") from None


def _numbers(value: Value, count: int, name: str, line: int) -> tuple[Number, ...]:
    """So many numbers of a list, each of an axis or quantity that exists."""
    numbers = numbers_of(positional(value, name, line, *["number"] * count), name, line)
    if any(abs(number.value) >= NO_VALUE for number in numbers):
        raise ProgramError(line, f"{name}: 9E9 stands for an axis or value that does not exist")
    return numbers

"""Targets of a RAPID module: jointtarget and robtarget, declared or written in the instruction.

Read are declarations with constant values (CONST, PERS, VAR) of targets, tools and work objects,
and the move instructions of `MOVES`. Whatever else goes to a target, or reckons with one, is
refused with its line; so are robtargets whose axes the text does not tell, since external axes have
values, or the controller chooses the configuration (`ConfL\\Off`, `ConfJ\\Off`, `SingArea\\Wrist`).
The robot's base frame is taken for the world frame.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types,
3HAC050917-001. No result was loaded into a controller.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.compensation.frames import FrameOptions, payload_of, pose_of_quaternion
from ballbar.compensation.program_text import (
    Number,
    Program,
    ProgramError,
    ProgramTarget,
    Reader,
    Setup,
    Token,
    read_program_text,
    refuse,
    same_setup,
    tokens_of,
)
from cell.arrays import Array
from cell.errors import InputError
from cell.foreign_text import one_line
from cell.payload import Payload

AXES = 6
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
NESTED = 12  # lists in one another, of targets in an array of three dimensions five
_TAKES_A_FRAME = (["\\", "tool", ":="], ["\\", "wobj", ":="])
_DECLARED = ("jointtarget", "robtarget", "tooldata", "wobjdata")


@dataclass(frozen=True, eq=False)
class _Data:
    """A declaration."""

    kind: str
    name: str
    line: int
    values: tuple[object, ...]  # one aggregate, or as many as the array has
    failure: ProgramError | None = None  # why its value is not constant


def read_rapid(path: Path, options: FrameOptions) -> Program:
    """The targets of a module. Raises InputError naming the lines that are not understood."""
    text = read_program_text(path)
    module = _Module(text, options)
    module.read()
    refuse(path, module.faults)
    return Program(path, text, tuple(module.targets), tuple(dict.fromkeys(module.notes)))


class _Module:
    """The module while it is read."""

    def __init__(self, text: str, options: FrameOptions) -> None:
        self.text, self.options = text, options
        self.tokens = tokens_of(text, r"![^\n]*", lines=False, words=r"[A-Za-z_]\w*")
        self.faults: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self.targets: list[ProgramTarget] = []
        self.data: dict[str, _Data] = {}
        self.routines = self._routines()
        self.parameters = self._parameters()
        self.choices: list[Token] = []  # instructions that leave the configuration to the robot
        self.uses: dict[str, list[tuple[int, bool, Setup]]] = {}
        self.parsed = np.zeros(len(self.tokens), dtype=bool)  # tokens of declarations and moves

    def read(self) -> None:
        """Declarations, then instructions, then what the uses make of the declared targets."""
        for i, token in enumerate(self.tokens):
            if token.isword("const", "pers", "var"):
                self._guard(self._declaration, i)
        for i, token in enumerate(self.tokens):
            if token.kind == "word" and not self.parsed[i]:
                self._guard(self._instruction, i)
        for i, token in enumerate(self.tokens):
            if token.issymbol("[") and not self.parsed[i] and not self.tokens[i - 1].issymbol("["):
                self._guard(self._loose, i)
        for name, data in self.data.items():
            if data.kind in ("jointtarget", "robtarget"):
                self._guard(self._declared_target, name)
        if any(target.rotation for target in self.targets):
            for token in self.choices:
                self._guard(self._chosen_by_the_robot, token)

    def _guard(self, read: Callable[..., None], what: object) -> None:
        try:
            read(what)
        except ProgramError as fault:
            self.faults.append((fault.line, fault.why))

    def _routines(self) -> set[str]:
        pairs = zip(self.tokens, self.tokens[1:], strict=False)
        return {b.text.lower() for a, b in pairs if a.isword("proc", "func", "trap")}

    def _parameters(self) -> set[str]:
        """Tools and work objects that routines are given."""
        threes = zip(self.tokens, self.tokens[1:], self.tokens[2:], strict=False)
        return {
            b.text.lower()
            for a, b, c in threes
            if a.isword("tooldata", "wobjdata") and c.issymbol(",", ")", "|")
        }

    def _chosen_by_the_robot(self, token: Token) -> None:
        raise ProgramError(
            token.line,
            f"after {token.text} the robot takes the nearest configuration, not the one that a "
            "robtarget states, so its axes there are not known; take the line out if the stated "
            "ones are right, or state jointtargets",
        )

    def _declaration(self, i: int) -> None:
        reader = Reader(self.tokens, self.text, i + 1)
        kind, name = reader.next(), reader.next()
        if not kind.isword(*_DECLARED) or name.kind != "word" or reader.token.issymbol(",", ")"):
            return  # of another type, or a parameter of a routine
        key, sizes, values = name.text.lower(), 0, []
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
                values = _flat(_aggregate(reader, name.text), sizes)
                failure = None
                reader.expect(";", f"after the value of {name.text}")
        except ProgramError as fault:
            failure = fault
        self.parsed[i : reader.at] = True
        self.data[key] = _Data(kind.text.lower(), name.text, name.line, tuple(values), failure)

    def _instruction(self, i: int) -> None:
        token, following = self.tokens[i], self.tokens[i + 1]
        word, data = token.text.lower(), self.data.get(token.text.lower())
        before = self.tokens[i - 1] if i else None
        if before is not None and before.issymbol(".", "\\"):
            return
        if data is not None:
            self._reference(i, data)
        elif following.issymbol(":=", "(", ".", ",", "{") or (
            before is not None and before.isword("proc", "func", "trap", "module")
        ):
            return
        elif word in MOVES:
            self._move(i)
        elif word in _GOES_BY_CONFIGURATION:
            after = self.tokens[i + 1 : i + 4]
            texts = [part.text.lower() for part in after]
            if texts != ["\\", _GOES_BY_CONFIGURATION[word], ";"]:
                self.choices.append(token)
        elif word in _SHIFTS and not (word == "gripload" and self.options.payloads):
            raise ProgramError(
                token.line,
                f"{token.text} changes {_SHIFTS[word]} of what follows, which is not reckoned with"
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

    def _loose(self, i: int) -> None:
        """Refuses a value outside of declarations and moves that has the form of a target."""
        reader = Reader(self.tokens, self.text, i)
        try:
            value = _aggregate(reader, "")
        except ProgramError:
            return  # an index or a computed list; names of targets in it are refused by themselves
        parts = value if isinstance(value, list) else []
        sizes = [len(part) if isinstance(part, list) else 0 for part in parts]
        if sizes[:3] == [3, 4, 4] or (len(sizes) == 2 and sizes[0] == AXES):
            raise ProgramError(
                self.tokens[i].line,
                "a target is written where no move is understood to go there; declare it, and move "
                "to it by MoveAbsJ, MoveJ, MoveL or MoveC",
            )

    def _reference(self, i: int, data: _Data) -> None:
        """A name of a target, tool or work object outside of declarations and moves."""
        token = self.tokens[i]
        if data.kind in ("jointtarget", "robtarget"):
            raise ProgramError(
                token.line,
                f"{token.text} is assigned or used outside of a move instruction, so the target is "
                "computed; write it with constant values",
            )
        if self.tokens[i + 1].issymbol(":="):
            raise ProgramError(token.line, f"{token.text} is changed by the program")
        given = self.tokens[max(i - 3, 0) : i]
        if [part.text.lower() for part in given] not in _TAKES_A_FRAME:
            raise ProgramError(
                token.line,
                f"{token.text} is used outside of a move instruction, where its value may change "
                "or another be meant by the name",
            )

    def _move(self, i: int) -> None:
        name, first, end = self.tokens[i], i + 1, i + 1
        while not self.tokens[end].issymbol(";") and self.tokens[end].kind != "end":
            end += 1
        self.parsed[i:end] = True
        given = list(_arguments(self.tokens[first:end]))
        while given and given[0] and given[0][0].issymbol("\\"):
            given.pop(0)  # \Conc
        places, tool_at = MOVES[name.text.lower()]
        if len(given) <= tool_at:
            raise ProgramError(
                name.line, f"{name.text} has {len(given)} arguments, expected {tool_at + 1}"
            )
        joints = name.text.lower() == "moveabsj"
        setup = self._setup(given[tool_at], name, joints=joints)
        for place in places:
            self._goal(given[place], name, setup, joints=joints)

    def _goal(self, tokens: list[Token], move: Token, setup: Setup, *, joints: bool) -> None:
        """The target of a move: a name, an element of an array, or an aggregate."""
        end = Token("end", "", 0, 0, move.line)
        reader, what = Reader([*tokens, end], self.text), f"target of {move.text}"
        if reader.token.issymbol("["):
            value = _aggregate(reader, what)
            self._rest(reader, what)
            self._add(f"{move.text}", move.line, value, setup, joints=joints)
            return
        name = reader.next()
        key = name.text.lower()
        data = self.data.get(key)
        if name.kind != "word" or reader.token.issymbol("("):
            raise ProgramError(
                move.line,
                f"{what} is computed ({one_line(name.text)}); write it with constant values",
            )
        if data is None or data.kind not in ("jointtarget", "robtarget"):
            if key in self.options.keep:
                self.notes.append(f"{name.text} stays as it is (--keep)")
                return
            raise ProgramError(
                move.line,
                f"{what}, {name.text}, is not declared in this file; correct the modules as one "
                f"file, or leave it as it is by --keep {name.text}",
            )
        if reader.take("{"):
            while not reader.take("}") and reader.token.kind != "end":
                reader.next()
        self._rest(reader, what)
        if (data.kind == "jointtarget") is not joints:
            raise ProgramError(
                move.line, f"{name.text} is a {data.kind}, which {move.text} does not take"
            )
        self.uses.setdefault(key, []).append((move.line, joints, setup))

    def _rest(self, reader: Reader, what: str) -> None:
        if reader.token.kind != "end" and not reader.token.issymbol("\\"):
            raise ProgramError(
                reader.token.line,
                f"{what} is computed ({reader.shown}); write it with constant values",
            )

    def _setup(self, tokens: list[Token], move: Token, *, joints: bool) -> Setup:
        """Tool, work object and payload of a move."""
        given, *switches = _switches(tokens)
        tool_name = _name(given, f"tool of {move.text}", move)
        named = {switch[0].text.lower(): switch[1:] for switch in switches if switch}
        if "tload" in named and not self.options.payloads:
            raise ProgramError(move.line, "\\TLoad replaces the tool's load: state it by --payload")
        tool, payload = self._tool(tool_name, move, needed=not joints)
        frame = np.eye(4)
        if not joints and "wobj" in named:
            if not (value := named["wobj"]) or not value[0].issymbol(":="):
                raise ProgramError(move.line, "\\WObj is not given by :=, so it is not known")
            name = _name(value[1:], f"work object of {move.text}", move)
            frame = frame if name.lower() == "wobj0" else self._work_object(name, move)
        return Setup(tool, frame, payload, tool_name)

    def _tool(self, name: str, move: Token, *, needed: bool) -> tuple[Array, Payload | None]:
        stated, data = self.options.payload(name), self.data.get(name.lower())
        if name.lower() == "tool0":
            return np.eye(4), stated
        if data is None or data.kind != "tooldata":
            self._not_given(name, move, self.options.tools)
            tool = self.options.tool(name)
            if tool is None and needed:
                raise ProgramError(
                    move.line, f"tool {name} is not declared in this file; state it by "
                    f"--tool {name}=X,Y,Z,A,B,C",
                )  # fmt: skip
            return np.eye(4) if tool is None else tool, stated
        held, frame, load = _constant(data, 3)
        if held != "true":
            raise ProgramError(data.line, f"tool {name} is stationary, which is not reckoned with")
        values = _numbers(load, 4, f"load of {name}", data.line)
        try:
            declared = payload_of(values[0], values[1:4]) if values[0] >= 0.0 else None
        except InputError as error:
            raise ProgramError(data.line, f"load of {name}: {error}") from None
        return _pose(frame, name, data.line), stated or declared

    def _not_given(self, name: str, move: Token, stated: Mapping[str, object]) -> None:
        """Refuses a parameter of a routine that no option states by its name."""
        if name.lower() in self.parameters and name.lower() not in stated:
            raise ProgramError(
                move.line, f"{name} is given to the routine by whoever calls it, so it is not known"
            )

    def _work_object(self, name: str, move: Token) -> Array:
        data = self.data.get(name.lower())
        if data is None or data.kind != "wobjdata":
            self._not_given(name, move, self.options.frames)
            if (frame := self.options.frame(name)) is not None:
                return frame
            raise ProgramError(
                move.line, f"work object {name} is not declared in this file; state it by "
                f"--frame {name}=X,Y,Z,A,B,C",
            )  # fmt: skip
        held, fixed, _, user, own = _constant(data, 5)
        if held != "false" or fixed != "true":
            raise ProgramError(
                data.line,
                f"work object {name} is held by a robot or moves, which is not reckoned with",
            )
        return np.asarray(_pose(user, name, data.line) @ _pose(own, name, data.line))

    def _declared_target(self, key: str) -> None:
        data, uses = self.data[key], self.uses.get(key, [])
        joints = data.kind == "jointtarget"
        if data.failure is not None:
            raise data.failure
        if not uses and not joints:
            raise ProgramError(
                data.line, f"{data.name}: no move of this file goes there, so its tool is not known"
            )
        setup = uses[0][2] if uses else Setup(payload=self.options.payload(""))
        for line, _, other in uses[1:]:
            if not same_setup(setup, other, joints=joints):
                raise ProgramError(
                    line,
                    f"{data.name} is reached with {other.tool_name} here and otherwise in line "
                    f"{uses[0][0]}; declare a target for each",
                )
        count = len(data.values)
        for k, value in enumerate(data.values):
            name = data.name if count == 1 else f"{data.name}{{{k + 1}}}"
            self._add(name, data.line, value, setup, joints=joints)

    def _add(self, name: str, line: int, value: object, setup: Setup, *, joints: bool) -> None:
        parts = value if isinstance(value, list) else []
        if len(parts) != (2 if joints else 4):
            kind = "[[axes],[external]]" if joints else "[[position],[q],[confdata],[external]]"
            raise ProgramError(line, f"{name}: expected {kind}")
        if joints:
            numbers = _number_list(parts[0], AXES, name, line)
            self.targets.append(ProgramTarget(name, numbers[0].line, numbers, None, setup))
            return
        place, turn = _number_list(parts[0], 3, name, line), _number_list(parts[1], 4, name, line)
        configuration = _number_list(parts[2], 4, name, line)
        if any(number.value % 1.0 for number in configuration):
            raise ProgramError(line, f"{name}: confdata are whole numbers")
        _require_no_external_axes(parts[3], name, line)
        self.targets.append(
            ProgramTarget(name, place[0].line, place + turn, "quaternion", setup, configuration)
        )


def _aggregate(reader: Reader, what: str, depth: int = 0) -> object:
    """A constant value: numbers, words TRUE and FALSE, strings, and lists of them."""
    if reader.take("["):
        if depth == NESTED:
            raise ProgramError(reader.token.line, f"{what}: lists more than {NESTED} deep")
        items = [_aggregate(reader, what, depth + 1)]
        while reader.take(","):
            items.append(_aggregate(reader, what, depth + 1))
        reader.expect("]", f"in the value of {what}")
        return items
    if reader.token.isword("true", "false") or reader.token.kind == "string":
        return reader.next().text.lower()
    return reader.number(f"value of {what}")


def _flat(value: object, sizes: int) -> list[object]:
    """The elements of an array of so many dimensions."""
    if sizes == 0 or not isinstance(value, list):
        return [value]
    return [element for part in value for element in _flat(part, sizes - 1)]


def _arguments(tokens: Sequence[Token]) -> Iterator[list[Token]]:
    """Arguments of an instruction, split at commas outside of brackets."""
    part: list[Token] = []
    depth = 0
    for token in tokens:
        depth += token.issymbol("[", "(", "{") - token.issymbol("]", ")", "}")
        if token.issymbol(",") and depth == 0:
            yield part
            part = []
        else:
            part.append(token)
    yield part


def _switches(tokens: Sequence[Token]) -> list[list[Token]]:
    """An argument, and the optional ones after it such as \\WObj:=table."""
    parts: list[list[Token]] = [[]]
    for token in tokens:
        if token.issymbol("\\"):
            parts.append([])
        else:
            parts[-1].append(token)
    return parts


def _name(tokens: Sequence[Token], what: str, move: Token) -> str:
    """The name that an argument consists of."""
    if len(tokens) == 1 and tokens[0].kind == "word":
        return tokens[0].text
    shown = one_line("".join(token.text for token in tokens))
    raise ProgramError(move.line, f"{what} is no name of a declaration ({shown}); name one")


def _require_no_external_axes(value: object, name: str, line: int) -> None:
    """Refuses values of external axes: one of them may carry the robot or the work object."""
    numbers = value if isinstance(value, list) else [value]
    for k, number in enumerate(numbers):
        if not isinstance(number, Number) or abs(number.value) < 9e8:
            text = number.text if isinstance(number, Number) else "no number"
            raise ProgramError(
                line,
                f"{name}: external axis {k + 1} stands at {text}, not 9E9; whether it moves the "
                "robot's base or the work object is not known: state a jointtarget",
            )


def _constant(data: _Data, count: int) -> list[object]:
    """The parts of a declared tool or work object."""
    if data.failure is not None:
        raise data.failure
    if len(data.values) != 1:
        raise ProgramError(data.line, f"{data.name} is an array where one is expected")
    value = data.values[0]
    if not isinstance(value, list) or len(value) != count:
        raise ProgramError(data.line, f"{data.name}: expected {count} parts")
    return value


def _pose(value: object, name: str, line: int) -> Array:
    parts = value if isinstance(value, list) else []
    if len(parts) != 2:
        raise ProgramError(line, f"{name}: expected a frame [[x,y,z],[q1,q2,q3,q4]]")
    place, turn = _numbers(parts[0], 3, name, line), _numbers(parts[1], 4, name, line)
    try:
        return pose_of_quaternion(place[:3], turn[:4])
    except ValueError as error:
        raise ProgramError(line, f"{name}: {error}") from None


def _numbers(value: object, least: int, name: str, line: int) -> list[float]:
    """Numbers of a list, those of lists in it included."""
    flat: list[float] = []
    for part in value if isinstance(value, list) else []:
        flat += _numbers(part, 0, name, line) if isinstance(part, list) else []
        flat += [part.value] if isinstance(part, Number) else []
    if len(flat) < least:
        raise ProgramError(line, f"{name}: expected {least} numbers, there are {len(flat)}")
    if not np.isfinite(flat).all():
        raise ProgramError(line, f"{name}: a number is too large")
    return flat


def _number_list(value: object, count: int, name: str, line: int) -> tuple[Number, ...]:
    parts = value if isinstance(value, list) else []
    numbers = tuple(part for part in parts if isinstance(part, Number))
    if len(numbers) != count or len(parts) != count:
        raise ProgramError(
            line, f"{name}: {len(parts)} values where {count} are expected; decimals have a point"
        )
    if any(abs(number.value) >= 9e8 for number in numbers):
        raise ProgramError(line, f"{name}: 9E9 stands for an axis or value that does not exist")
    return numbers

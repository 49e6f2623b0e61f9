"""Targets of a KRL program: E6AXIS and AXIS, E6POS, POS and FRAME, declared or in the motion.

A .src file and the .dat file of the same name are one program. Read are aggregates with constant
values, in declarations, in assignments to points, and in PTP, LIN, CIRC, SPTP, SLIN, SCIRC and SPL.
Tools and bases come from assignments of constant frames to $TOOL and $BASE outside of branches,
or after WITH for a motion, else from the options by the number in FDAT, TOOL_DATA or BASE_DATA.
Whatever else goes to a target is refused with its line, and so is a target where the tool or base
depends on the way that the program takes. $BASE is taken to be stated in the robot's base frame.

Source: KUKA System Software 8.3, Operating and Programming Instructions for System Integrators,
and the KRL reference. No result was loaded into a controller.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.compensation.frames import FrameOptions, payload_of, pose_of_angles
from ballbar.compensation.krl_flow import (
    BRANCHES,
    CLOSE,
    EVERY,
    LOOPS,
    assigned,
    bas_command,
    calls,
    flow_of,
    is_label,
    opens,
    routine_name,
)
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

AXES, POSE = tuple(f"a{i}" for i in range(1, 7)), ("x", "y", "z", "a", "b", "c")
POINTS = ("e6axis", "axis", "e6pos", "pos", "frame")
MOVES = {"ptp": 1, "lin": 1, "sptp": 1, "slin": 1, "spl": 1, "circ": 2, "scirc": 2}
_RELATIVE = (*(f"{move}_rel" for move in MOVES), "brake")
_HERE = ("$axis_act", "$pos_act", "$axis_int", "$pos_int")  # where the robot stands already
_SET = ("$tool", "$base", "$load", "$ipo_mode")  # what a line, or WITH in a motion, sets
_STORED = ("tool_data", "base_data")  # frames of the controller by number
_NUMBERED = {  # forms of a frame by its number
    "tool": re.compile(r"tool_data\[(\d+)\]"),
    "base": re.compile(r"base_data\[(\d+)\]"),
}
_OF_DATA = {  # and by the number in a data set (FDAT)
    "tool": re.compile(r"stool2?\((\w+)(?:\.tool_no)?\)"),
    "base": re.compile(r"sbase\((\w+)\.base_no\)"),
    "ipo_mode": re.compile(r"sipo_mode\((\w+)\.ipo_frame\)"),
}
_INTEGER = re.compile(r"'[bB][01]+'|'[hH][0-9A-Fa-f]+'|\d+")  # of S and T
_ROOT = ("$nullframe", "$robroot", "$world")
_EXTERNAL = (
    "a tool that stands in the cell, or a base that an external axis moves, is not understood; "
    "state the targets as axis angles in a program without it"
)
_WORDS = r"'[bBhH][0-9A-Fa-f]+'|[$A-Za-z_][$\w]*"


@dataclass(frozen=True, eq=False)
class _Point:
    """A constant value of a point, and where it stands."""

    name: str
    line: int
    fields: dict[str, Number]


@dataclass(frozen=True, eq=False)
class _Frame:
    """A tool or base: its number where it has one, its pose (4, 4) where it is constant."""

    number: str = ""
    pose: Array | None = None
    doubt: str = ""  # why it is not known, whatever the options state


@dataclass(frozen=True, eq=False)
class _InForce:
    """What motions are stated in."""

    tool: _Frame = field(default_factory=_Frame)
    base: _Frame = field(default_factory=_Frame)
    load: Payload | None = None  # None: not known

    def having(self, what: str, frame: _Frame) -> _InForce:
        return replace(self, tool=frame) if what == "tool" else replace(self, base=frame)

    def in_doubt(self, changed: Iterable[str], why: str) -> _InForce:
        """Without what may or may not have been set."""
        out = self
        for what in changed:
            out = (
                replace(out, load=None)
                if what == "load"
                else out.having(what, _Frame("", None, why))
            )
        return out


class _Krl:
    """A .src or .dat file while it is read; points and data sets of both are shared."""

    def __init__(self, text: str, options: FrameOptions, shared: _Krl | None = None) -> None:
        self.text, self.options = text, options
        self.tokens = tokens_of(text, r";[^\n]*|(?m:^)&[^\n]*", lines=True, words=_WORDS)
        self.faults: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self.targets: list[ProgramTarget] = []
        self.points: dict[str, list[tuple[_Krl, _Point]]] = shared.points if shared else {}
        self.data: dict[str, dict[str, str]] = shared.data if shared else {}  # FDAT by name
        self.uses: dict[str, list[tuple[int, Setup]]] = shared.uses if shared else {}
        self.frames: set[str] = shared.frames if shared else set()  # points that are tools or bases
        self.external: dict[str, int] = {}  # external axes off zero in poses, with the first line
        self.read: set[int] = set()  # places of the braces of aggregates that were read
        self.flow = flow_of(self.statements())
        self.blocks: list[tuple[int, _InForce]] = []  # first line, and what was in force there
        self.now = _InForce()

    def statements(self) -> list[list[Token]]:
        """Tokens of every line."""
        out: list[list[Token]] = [[]]
        for token in self.tokens:
            if token.kind == "end":
                out.append([])
            else:
                out[-1].append(token)
        return [tokens for tokens in out if tokens]

    def guarded(self, read: Callable[[list[Token]], None]) -> None:
        for tokens in self.statements():
            try:
                read(tokens)
            except ProgramError as fault:
                self.faults.append((fault.line, fault.why))

    def reader(self, tokens: Sequence[Token], at: int = 0) -> Reader:
        end = Token("end", "", tokens[-1].end, tokens[-1].end, tokens[-1].line)
        return Reader([*tokens, end], self.text, at)

    def declare(self, tokens: list[Token]) -> None:
        """Points and data sets that a line gives constant values to."""
        words = [t.text.lower() for t in tokens]
        while words and words[0] in ("decl", "global", "const"):
            tokens, words = tokens[1:], words[1:]
        typed = bool(words) and words[0] in (*POINTS, "fdat")
        kind = words[0] if typed else ""
        tokens = tokens[1:] if typed else tokens
        if not tokens or tokens[0].kind != "word":
            return
        reader = self.reader(tokens)
        name = self.name(reader)
        if not reader.take("=") or not reader.token.issymbol("{"):
            return
        if kind == "fdat" or (not typed and name.startswith("$")):
            if kind == "fdat":
                self.data[name] = dict(_words(reader))
            return
        if not typed and not _is_point(tokens):
            return
        point = _Point(name, tokens[0].line, self.fields(reader, name))
        if reader.token.kind != "end":
            raise ProgramError(
                point.line,
                f"{name.upper()}: {reader.shown} after its constant value, so it is computed; "
                "write one point a line, with constant values",
            )
        self.points.setdefault(name, []).append((self, point))

    def name(self, reader: Reader) -> str:
        """A name, with its index if it has one."""
        name = reader.next().text.lower()
        if reader.take("["):
            inner = ""
            while not reader.take("]") and reader.token.kind != "end":
                inner += reader.next().text.lower()
            name += f"[{inner}]"
        return name

    def fields(self, reader: Reader, what: str) -> dict[str, Number]:
        """Components of an aggregate."""
        self.read.add(reader.expect("{", what).start)
        if reader.token.kind == "word" and reader.tokens[reader.at + 1].issymbol(":"):
            reader.at += 2  # the type before the components
        out: dict[str, Number] = {}
        while True:
            component = reader.next()
            key = component.text.lower()
            if component.kind != "word":
                raise ProgramError(
                    component.line,
                    f"{what}: {one_line(component.text)!r} where a component is expected; decimals "
                    "have a point",
                )
            if key in out:
                raise ProgramError(component.line, f"{what}: {component.text} stands twice")
            literal = reader.token
            if key in ("s", "t"):
                if not _INTEGER.fullmatch(reader.next().text):
                    raise ProgramError(
                        literal.line,
                        f"{what}: {component.text} {one_line(literal.text)} is no whole number; "
                        "expected digits as 2, 'B010' or 'H2'",
                    )
                out[key] = Number(literal.text, literal.start, literal.end, literal.line)
            else:
                out[key] = reader.number(f"{what}, {component.text}")
            if reader.take("}"):
                return out
            reader.expect(",", what)

    def motion(self, tokens: list[Token]) -> None:
        """What a line moves to, and what it changes for later ones."""
        first, word = tokens[0], tokens[0].text.lower()
        self._follow(tokens, word)
        self._check_places(tokens, word)
        if word in MOVES:
            before = self.now
            self._with(tokens)
            self._moves(tokens)
            self.now = before
        elif word in ("spline", "ptp_spline"):
            self._with(tokens)  # until ENDSPLINE
        elif word in _RELATIVE:
            raise ProgramError(
                first.line, f"{first.text} moves by a distance, so where to is computed"
            )
        elif word in _SET:
            if self.blocks:
                raise ProgramError(
                    first.line, f"{first.text} is set within a branch or loop, so which is in "
                    "force later is not known",
                )  # fmt: skip
            self._set(tokens)
        elif word == "fdat_act":
            self._data_set(tokens)
        elif word == "bas":
            self._bas(tokens)
        else:
            self._check_points(tokens)
        self._check_aggregates(tokens)
        if foreign := self.flow.foreign(tokens):
            self.notes.append(
                f"{foreign} is not in the file: its targets stay as they are, and a tool or base "
                "that it sets is not seen"
            )
        if not routine_name(tokens) and (called := self.flow.called(tokens)):
            self._calls(tokens, called)

    def _follow(self, tokens: list[Token], word: str) -> None:
        """What is in force where control may have come from elsewhere."""
        line = tokens[0].line
        if routine_name(tokens):
            self.now, self.blocks = _InForce(), []
        elif opens(tokens):
            self.blocks.append((line, self.now))
            if word in LOOPS:
                self._doubt(line, self.flow.ends[line])
        elif word in (*BRANCHES, *CLOSE):
            if not self.blocks:
                raise ProgramError(line, f"{tokens[0].text} without the beginning of its block")
            start, before = self.blocks[-1]
            if word in CLOSE:
                self.blocks.pop()
            if word in (*BRANCHES, "endspline"):
                self.now = before
            else:
                self._doubt(start, line)
        elif is_label(tokens):
            why = f"GOTO may come to line {line} with another"
            self.now = self.now.in_doubt(self.flow.changed_by_jumps(line), why)

    def _doubt(self, first: int, last: int) -> None:
        why = f"the branch or loop of lines {first} to {last} sets it"
        self.now = self.now.in_doubt(self.flow.changed(first, last), why)

    def _calls(self, tokens: list[Token], name: str) -> None:
        """A call of a routine of this file that sets the tool, base or load."""
        line = tokens[0].line
        if any(t.isword("interrupt", "trigger") for t in tokens):
            raise ProgramError(
                line,
                f"{name} sets the tool, base or load and may be called at any time, so which is in "
                "force is not known",
            )
        self.now = self.now.in_doubt(EVERY, f"{name}, called in line {line}, sets it")

    def _check_places(self, tokens: list[Token], word: str) -> None:
        """Refuses motions, frames and targets in places where they are not read."""
        line = tokens[0].line
        declared = tokens[0].isword("decl", "global", "const", "fdat", *POINTS)
        for before, token in pairwise(tokens):
            if token.isword(*MOVES, *_RELATIVE) and not before.issymbol("#"):
                raise ProgramError(
                    line, f"{token.text} within a line is not read; write it on a line of its own"
                )
        head = _before_with(tokens) if word in (*MOVES, "spline", "ptp_spline") else tokens
        for first, name in [] if declared else assigned(head):
            if name in (*_SET, "fdat_act") and not first:
                raise ProgramError(
                    line,
                    f"{name.upper()} is set within a line, which is not read; write it on a line "
                    "of its own",
                )
            if name in _ROOT:
                raise ProgramError(
                    line, f"{name.upper()} is set; state bases in the robot's base frame instead"
                )
            if name in self.data or name in _STORED:
                raise ProgramError(
                    line, f"{name.upper()} is changed, so the tool and base that it states are not "
                    "known; give it constant values once",
                )  # fmt: skip
        if word not in ("bas", "ext") and "bas" in calls(tokens):
            raise ProgramError(line, "BAS within a line is not read; write it on a line of its own")

    def _check_aggregates(self, tokens: list[Token]) -> None:
        """Refuses axis angles and positions that no motion or declaration reads."""
        if tokens[0].text.startswith("$") and not tokens[0].isword(*_SET):
            return  # work spaces and the like
        for k, token in enumerate(tokens):
            if not token.issymbol("{") or token.start in self.read:
                continue
            inner = (key for key, _ in _words(self.reader(tokens, k)))
            if not (k and tokens[k - 1].isword("cm", "j")) and {*AXES, *"xyz"} & set(inner):
                raise ProgramError(
                    token.line,
                    "a target where none is read; write it into a motion, or declare a point of a "
                    f"type among {', '.join(POINTS).upper()}",
                )

    def _check_points(self, tokens: list[Token]) -> None:
        """Refuses what is computed for a point outside of declarations."""
        words = [t for t in tokens if t.kind == "word" and t.text.lower() in self._bases()]
        declared = tokens[0].isword("decl", "global", *POINTS)
        if not words or declared:
            return
        reader = self.reader(tokens)
        self.name(reader)
        if tokens[0] is words[0] and reader.take("=") and reader.token.issymbol("{"):
            return  # an assignment of constants, which is one of the point's values
        raise ProgramError(
            words[0].line,
            f"{words[0].text} is assigned or used outside of a motion, so the target is computed; "
            "write it with constant values",
        )

    def _bases(self) -> set[str]:
        return {name.partition("[")[0] for name in self.points}

    def _data_set(self, tokens: list[Token]) -> None:
        """FDAT_ACT=FP1, which BAS puts in force with the load of the tool."""
        if len(tokens) != 3 or not tokens[1].issymbol("=") or tokens[2].kind != "word":
            raise ProgramError(tokens[0].line, "FDAT_ACT is computed or changed in part")
        for what in ("tool", "base"):
            self._number(what, self._of_data(tokens[2].text.lower(), f"{what}_no", tokens[0].line))
        self.now = replace(self.now, load=None)

    def _of_data(self, name: str, key: str, line: int) -> str:
        """A component of a data set; empty where the set is not in these files."""
        data = self.data.get(name, {})
        if data.get("ipo_frame", "base") != "base":
            raise ProgramError(line, f"{name.upper()}: {_EXTERNAL}")
        return data.get(key, "")

    def _bas(self, tokens: list[Token]) -> None:
        """BAS(#TOOL,2), BAS(#BASE,3) and BAS(#INITMOV,0); others set neither tool nor base."""
        line, command = tokens[0].line, bas_command(tokens)
        if command == "ex_base":
            raise ProgramError(line, f"BAS(#EX_BASE): {_EXTERNAL}")
        if command == "initmov":
            self.now = _InForce()
        if command not in ("tool", "base"):
            return
        match = re.fullmatch(rf"bas\(#{command},(\d+)\)", _joined(tokens))
        if not match:
            raise ProgramError(line, f"the number of BAS(#{command.upper()}) is computed")
        self._number(command, match[1])
        if command == "tool":
            self.now = replace(self.now, load=None)

    def _number(self, what: str, number: str) -> None:
        pose = np.eye(4) if number == "0" else None
        self.now = self.now.having(what, _Frame(number, pose))

    def _set(self, tokens: list[Token]) -> None:
        """An assignment to $TOOL, $BASE, $LOAD or $IPO_MODE."""
        first, what = tokens[0], tokens[0].text.lower()[1:]
        reader = self.reader(tokens, 1)
        if not reader.take("="):
            raise ProgramError(first.line, f"{first.text} is changed in part")
        value = _joined(tokens[2:])
        if what == "ipo_mode":
            data = _OF_DATA[what].fullmatch(value)
            if value != "#base" and not data:
                raise ProgramError(first.line, f"{first.text}: {_EXTERNAL}")
            if data:
                self._of_data(data[1], "ipo_frame", first.line)
        elif what == "load":
            aggregate = reader.token.issymbol("{")
            load = _load(reader, self.fields) if aggregate else None
            if aggregate and reader.token.kind != "end":
                raise ProgramError(first.line, f"{first.text} is computed ({reader.shown})")
            self.now = replace(self.now, load=load)
        else:
            self._set_frame(what, value, reader, first)

    def _set_frame(self, what: str, value: str, reader: Reader, first: Token) -> None:
        """Puts a tool or base in force: a constant, one of a number, or that of a data set."""
        if reader.token.issymbol("{"):
            fields = self.fields(reader, first.text)
            if reader.token.kind == "end":
                self.now = self.now.having(what, _constant(fields, first))
                return
        elif value in _ROOT:
            self._number(what, "0")
            return
        elif match := _NUMBERED[what].fullmatch(value):
            self._number(what, match[1])
            return
        elif match := _OF_DATA[what].fullmatch(value):
            self._number(what, self._of_data(match[1], f"{what}_no", first.line))
            return
        elif len(self.points.get(value, [])) == 1:
            self.now = self.now.having(what, _constant(self.points[value][0][1].fields, first))
            self.frames.add(value)
            return
        raise ProgramError(
            first.line,
            f"{first.text} is computed; write it with a constant or with a number, as "
            f"{what.upper()}_DATA[1]",
        )

    def _with(self, tokens: list[Token]) -> None:
        """What a motion sets for itself: WITH $TOOL=STOOL2(FP1), $BASE=..."""
        tail = tokens[len(_before_with(tokens)) + 1 :]
        while tail and tail[-1].kind == "word" and tail[-1].text.lower().startswith("c_"):
            tail = tail[:-1]  # approximation, C_SPL
        for item in _items(tail):
            if item[0].isword(*_SET):
                self._set(item)
            elif {name for _, name in assigned(item)} & set(_SET):
                raise ProgramError(item[0].line, "WITH: a comma is expected between assignments")

    def _moves(self, tokens: list[Token]) -> None:
        word, line = tokens[0].text, tokens[0].line
        reader = self.reader(tokens, 1)
        for k in range(MOVES[word.lower()]):
            if k:
                reader.expect(",", f"target of {word}")
            self._goal(reader, word, line)
        if reader.token.issymbol(":", "+", "-", "*", "."):
            raise ProgramError(line, f"target of {word} is computed ({reader.shown})")

    def _goal(self, reader: Reader, move: str, line: int) -> None:
        what = f"target of {move}"
        if reader.token.issymbol("{"):
            point = _Point(move, line, self.fields(reader, what))
            self.add(point, self._setup(line, joints="a1" in point.fields))
            return
        if reader.token.kind != "word":
            raise ProgramError(line, f"{what} is computed ({reader.shown})")
        shown = reader.token.text
        name = self.name(reader)
        if reader.token.issymbol("("):
            raise ProgramError(line, f"{what} is computed by {shown}")
        if name in _HERE:
            return
        if name not in self.points:
            if name in self.options.keep:
                self.notes.append(f"{shown} stays as it is (--keep)")
                return
            raise ProgramError(
                line,
                f"{what}, {shown}, has no constant value in this program; correct the files "
                f"together, or leave it as it is by --keep {shown}",
            )
        if name in self.options.keep:
            self.notes.append(f"{shown} has constant values here and is corrected (--keep)")
        joints = "a1" in self.points[name][0][1].fields
        self.uses.setdefault(name, []).append((line, self._setup(line, joints=joints)))

    def _setup(self, line: int, *, joints: bool) -> Setup:
        used = [("tool", self.now.tool), ("base", self.now.base)]
        for what, each in used[: 1 if joints else 2]:
            if each.doubt and not (joints and not any(self.options.payloads)):
                raise ProgramError(
                    line, f"${what.upper()} is not known here: {each.doubt}; set it again before "
                    "this line",
                )  # fmt: skip
        number, base_number = self.now.tool.number, self.now.base.number
        tool, frame = self.now.tool.pose, self.now.base.pose
        tool = self.options.tool(number) if tool is None else tool
        frame = self.options.frame(base_number) if frame is None else frame
        if not joints and (tool is None or frame is None):
            missing, option = ("$TOOL", "tool") if tool is None else ("$BASE", "frame")
            unknown = number if tool is None else base_number
            named = f"{unknown}=" if unknown else ""
            raise ProgramError(
                line,
                f"{missing} is not known here (number {unknown or 'not stated'}); state it by "
                f"--{option} {named}X,Y,Z,A,B,C",
            )
        payload = self.options.payload(number) or self.now.load
        unit = np.eye(4)
        name = f"tool {number}" if number else "$TOOL"
        return Setup(
            unit if tool is None else tool, unit if frame is None else frame, payload, name
        )

    def add(self, point: _Point, setup: Setup) -> None:
        """A target of this file."""
        fields, line, name = point.fields, point.line, point.name.upper()
        joints = "a1" in fields
        needed, allowed = (AXES, set()) if joints else (POSE, {"s", "t"})
        missing = [key.upper() for key in needed if key not in fields]
        extra = set(fields) - set(needed) - allowed - {f"e{i}" for i in range(1, 7)}
        if missing or extra:
            raise ProgramError(
                line,
                f"{name}: expected {', '.join(key.upper() for key in needed)}"
                + (f", {', '.join(missing)} missing" if missing else "")
                + (f", {', '.join(sorted(extra)).upper()} not known" if extra else ""),
            )
        if ("s" in fields) is not ("t" in fields):
            raise ProgramError(line, f"{name}: S and T are both needed, or neither")
        numbers = tuple(fields[key] for key in needed)
        configuration = (fields["s"], fields["t"]) if "s" in fields else ()
        rotation: Literal["zyx"] | None = None if joints else "zyx"
        for key in () if joints else fields:
            if key[0] == "e" and fields[key].value != 0.0:
                self.external.setdefault(key.upper(), line)
        self.targets.append(ProgramTarget(name, line, numbers, rotation, setup, configuration))

    def moved(self) -> list[str]:
        """Notes on external axes."""
        return [
            f"{axis} of poses is not 0 (first in line {line}): it is taken to move neither the "
            "robot nor a base; state the targets as axis angles if it does"
            for axis, line in self.external.items()
        ]


def read_krl(path: Path, options: FrameOptions) -> list[Program]:
    """The targets of a program: those of the .src file, and of the .dat file beside it.

    Raises InputError naming the lines that are not understood.
    """
    paths = [p for p in _pair(path) if p.exists()] or [path]
    files: list[_Krl] = []
    for each in paths:
        files.append(_Krl(read_program_text(each), options, files[0] if files else None))
    for file in files:
        file.guarded(file.declare)
    for file in files:
        file.guarded(file.motion)
    _declared(files, options)
    for each, file in zip(paths, files, strict=True):
        refuse(each, file.faults)
    return [
        Program(each, file.text, tuple(file.targets), (*dict.fromkeys(file.notes), *file.moved()))
        for each, file in zip(paths, files, strict=True)
    ]


def _declared(files: Sequence[_Krl], options: FrameOptions) -> None:
    """Targets of the points with names, by the motions that go there."""
    shared = files[0]
    for name, values in shared.points.items():
        uses = shared.uses.get(name, [])
        for file, point in values:
            joints = "a1" in point.fields
            try:
                if not uses and not joints:
                    if name in shared.frames:
                        continue
                    raise ProgramError(
                        point.line,
                        f"{name.upper()}: no motion of this program goes there, so its tool is not "
                        "known",
                    )
                setup = uses[0][1] if uses else Setup(payload=options.payload(""))
                for line, other in uses[1:]:
                    if not same_setup(setup, other, joints=joints):
                        raise ProgramError(
                            point.line,
                            f"{name.upper()} is reached with other tools, bases or loads in lines "
                            f"{uses[0][0]} and {line}; declare a point for each",
                        )
                file.add(point, setup)
            except ProgramError as fault:
                file.faults.append((fault.line, fault.why))


def _pair(path: Path) -> tuple[Path, ...]:
    """The .src and the .dat file of a program, in the spelling of the given one."""
    upper = path.suffix.isupper()
    return tuple(path.with_suffix(s.upper() if upper else s) for s in (".src", ".dat"))


def _words(reader: Reader) -> list[tuple[str, str]]:
    """Components of an aggregate of any type, and the first words of their values."""
    out, depth = [], 0
    while reader.token.kind != "end":
        token = reader.next()
        depth += token.issymbol("{") - token.issymbol("}")
        if depth == 0:
            break
        if depth == 1 and token.kind == "word":
            reader.take("#")  # of an enumeration
            out.append((token.text.lower(), reader.token.text.lower()))
    return out


def _joined(tokens: Sequence[Token]) -> str:
    return "".join(t.text.lower() for t in tokens)


def _before_with(tokens: Sequence[Token]) -> Sequence[Token]:
    places = [k for k, token in enumerate(tokens) if token.isword("with")]
    return tokens[: places[0]] if places else tokens


def _items(tokens: Sequence[Token]) -> list[list[Token]]:
    """Parts of a list between its commas, those within brackets of any kind aside."""
    out: list[list[Token]] = [[]]
    depth = 0
    for token in tokens:
        depth += token.issymbol("(", "[", "{") - token.issymbol(")", "]", "}")
        if depth == 0 and token.issymbol(","):
            out.append([])
        else:
            out[-1].append(token)
    return [item for item in out if item]


def _constant(fields: dict[str, Number], token: Token) -> _Frame:
    """The constant frame of an aggregate."""
    if set(fields) != set(POSE):
        raise ProgramError(token.line, f"{token.text}: expected X, Y, Z, A, B, C")
    return _Frame("", pose_of_angles([fields[key].value for key in POSE]))


def _is_point(tokens: Sequence[Token]) -> bool:
    """Whether an aggregate holds axis angles or a position."""
    return any(t.isword("a1", "x") for t in tokens)


def _load(reader: Reader, fields: Callable[[Reader, str], dict[str, Number]]) -> Payload:
    """{M 5,CM {X 0,Y 0,Z 100,A 0,B 0,C 0},J {X 0,Y 0,Z 0}}"""
    what = "$LOAD"
    reader.expect("{", what)
    mass, centre = None, [0.0, 0.0, 0.0]
    while not reader.take("}"):
        key = reader.next()
        if key.isword("m"):
            mass = reader.number(what).value
        elif key.isword("cm", "j"):
            values = fields(reader, what)
            if key.isword("cm"):
                centre = [values[k].value if k in values else 0.0 for k in "xyz"]
        else:
            raise ProgramError(key.line, f"{what}: expected M, CM and J")
        reader.take(",")
    if mass is None or mass < 0.0:
        raise ProgramError(reader.tokens[0].line, f"{what}: expected a mass M")
    try:
        return payload_of(mass, centre)
    except InputError as error:
        raise ProgramError(reader.tokens[0].line, f"{what}: {error}") from None

"""Targets of a KRL program: E6AXIS and AXIS, E6POS, POS and FRAME, declared or in the motion.

A .src file and the .dat file of the same name are one program. Read are aggregates with constant
values, in declarations and in PTP, LIN, CIRC, SPTP, SLIN, SCIRC and SPL. The tool and the base of a
motion are those after its WITH, or of the data set (FDAT) of its inline form, or stated by the
options. A program that sets $TOOL or $BASE otherwise, or assigns to a target, is refused with its
line. $BASE is taken to be stated in the robot's base frame.

Source: KUKA System Software 8.3, Operating and Programming Instructions for System Integrators,
and the KRL reference. No result was loaded into a controller.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.compensation.frames import FrameOptions, pose_of_angles
from ballbar.compensation.program_source import (
    MoveSetup,
    ProgramSource,
    ProgramTarget,
    RobotProgram,
    computed,
    not_stated,
    numbers_of,
)
from ballbar.compensation.program_text import Number, ProgramError, Token, Value, parts

POINTS = ("e6axis", "axis", "e6pos", "pos", "frame")
AXES, POSE = tuple(f"a{i}" for i in range(1, 7)), ("x", "y", "z", "a", "b", "c")
EXTERNAL_AXES = tuple(f"e{i}" for i in range(1, 7))
_DECLARING = ("decl", "global", "const", "fdat", *POINTS)
MOVES = {"ptp": 1, "lin": 1, "sptp": 1, "slin": 1, "spl": 1, "circ": 2, "scirc": 2}
_SPLINES = ("spline", "ptp_spline")
_RELATIVE = (*(f"{move}_rel" for move in MOVES), "brake")
# lines between the FDAT_ACT of an inline form and its motion
_OF_INLINE_FORM = ("bas", "pdat_act", "ldat_act", "cpdat_act", "$bwdstart")
_CALLED = ("bas", "if", "while", "until", "switch", "wait", "case", "return")  # have brackets
_ROOT = ("$nullframe", "$robroot", "$world")
_FORMS = {  # of a frame by its number, and by the number in a data set (FDAT)
    "$tool": (r"tool_data\[(\d+)\]", r"stool2?\((\w+)(?:\.tool_no)?\)"),
    "$base": (r"base_data\[(\d+)\]", r"sbase\((\w+)\.base_no\)"),
}
# what sets the tool or base of later motions
_SETTING = (*_FORMS, *_ROOT, "tool_data", "base_data", "bas(#tool)", "bas(#base)", "bas(#ex_base)")
_IPO_MODE = re.compile(r"\$ipo_mode=(?:#base|sipo_mode\((\w+)\.ipo_frame\))")
_ASSIGNED = re.compile(r"(?:^|(?<= ))([$\w]+)(?: \. \w+| \[[^\]]*\])* = (?!=)")
_BAS = re.compile(r"(?:^|(?<= ))bas \( # \w+")
_EXTERNAL = (
    "a tool that stands in the cell, or a base that an external axis moves, is not understood; "
    "state the targets as axis angles in a program without it"
)


@dataclass(frozen=True, eq=False)
class _Frame:
    """A tool or base: its number where it has one, its pose (4, 4) where it is constant."""

    number: str = ""
    pose: Array | None = None


def read_krl(path: Path, options: FrameOptions) -> list[RobotProgram]:
    """The targets of a program: those of the .src file, and of the .dat file beside it.

    Raises InputError naming the lines that are not understood.
    """
    suffixes = (".SRC", ".DAT") if path.suffix.isupper() else (".src", ".dat")
    pair = [path.with_suffix(suffix) for suffix in suffixes]
    files: list[_Krl] = []
    for part in [p for p in pair if p.exists()] or [path]:
        files.append(_Krl(part, options, files[0] if files else None))
    for file in files:
        file.guarded(file.declaration, file.statements)
    for file in files:
        file.guarded(file.statement, file.statements)
    for file in files:
        used = [name for name, target in file.own.items() if target or name in file.uses]
        file.guarded(file.declared_targets, used)
        file.notes += [
            f"{axis} of poses is not 0 (first in line {line}): it is taken to move neither the "
            "robot nor a base; state the targets as axis angles if it does"
            for axis, line in file.external.items()
        ]
    return [file.program() for file in files]


class _Krl(ProgramSource):
    """A .src or .dat file while it is read; points and data sets of both are shared."""

    COMMENTS, WORDS = r";[^\n]*|(?m:^)&[^\n]*", r"[$A-Za-z_][$\w]*"
    MOVES = "a motion (PTP, LIN, CIRC, SPTP, SLIN, SCIRC, SPL)"
    HERE = ("$axis_act", "$pos_act", "$axis_int", "$pos_int")

    def __init__(self, path: Path, options: FrameOptions, shared: _Krl | None = None) -> None:
        super().__init__(path, options)
        if shared:
            self.points, self.uses, self.names = shared.points, shared.uses, shared.names
            self.frames = shared.frames
        self.own: dict[str, bool] = {}  # points of this file; a FRAME may be no target
        self.external: dict[str, int] = {}  # external axes off zero in poses, with the first line
        self.is_list = any(_routine(tokens)[0] == "defdat" for tokens in self.statements)
        self.routines = {_routine(tokens)[1] for tokens in self.statements}
        self.has_data_sets = any(tokens[0].isword("fdat_act") for tokens in self.statements)
        self.inline: dict[str, _Frame] = {}  # tool and base of the inline form that is read
        self.spline: dict[str, _Frame] = {}  # and of the spline block

    def declaration(self, tokens: list[Token]) -> None:
        """The point or data set that a line gives constant values to."""
        while tokens and tokens[0].isword("decl", "global", "const"):
            tokens = tokens[1:]
        kind = tokens[0].text.lower() if tokens and tokens[0].isword(*POINTS, "fdat") else ""
        tokens = tokens[1:] if kind else tokens
        if not tokens or tokens[0].kind != "word" or not (kind or self.is_list):
            return
        reader, line = self.reader(tokens), tokens[0].line
        name = reader.name()
        untyped = name.startswith("$") or not any(t.isword("a1", "x") for t in tokens)
        if not reader.take("=") or not reader.token.issymbol("{") or (not kind and untyped):
            return
        self.placed |= {tokens[0].start, reader.token.start}
        self.once(name, line)
        value = self.declared(reader, name)
        if kind == "fdat":
            self.frames[name.lower()] = kind, line, value
        elif kind != "frame" or set(POSE) <= set(_components(value)):
            self.declare(name, [self.target(value, name, line)])
            self.own[name.lower()] = kind != "frame"

    def target(self, value: Value, name: str, line: int) -> ProgramTarget:
        """The target of axis angles, or of a pose with S and T or without."""
        fields = _components(value)
        joints = "a1" in fields
        needed, allowed = (AXES, ()) if joints else (POSE, ("s", "t"))
        if not set(needed) <= set(fields) <= {*needed, *allowed, *EXTERNAL_AXES}:
            expected, stated = (", ".join(keys).upper() for keys in (needed, fields))
            wrong = f"{name}: expected {expected}, there are {stated}; decimals have a point"
            raise ProgramError(line, wrong)
        if ("s" in fields) is not ("t" in fields):
            raise ProgramError(line, f"{name}: S and T are both needed, or neither")
        configuration = numbers_of((fields[k] for k in allowed if k in fields), name, line)
        if any(number.value % 1.0 or number.value < 0.0 for number in configuration):
            raise ProgramError(line, f"{name}: S and T are whole numbers, as 2, 'B010' or 'H2'")
        external = {} if joints else {k: fields[k] for k in EXTERNAL_AXES if k in fields}
        for axis, number in zip(external, numbers_of(external.values(), name, line), strict=True):
            if number.value != 0.0:
                self.external.setdefault(axis.upper(), line)
        numbers = numbers_of((fields[key] for key in needed), name, line)
        return ProgramTarget(
            name, line, numbers, None if joints else "zyx", configuration=configuration
        )

    def begins_target(self, tokens: Sequence[Token], k: int) -> bool:
        """Whether the components of a point follow."""
        of_system = tokens[0].text.startswith("$")  # work spaces and the like
        of_load = k and tokens[k - 1].isword("cm", "j")
        if not tokens[k].issymbol("{") or of_system or of_load:
            return False
        return any(token.isword(*AXES, *"xyz") for token in tokens[k:])

    def statement(self, tokens: list[Token]) -> None:
        """The motion of a line; what a line does to tools, bases and targets else is refused."""
        first, word = tokens[0], tokens[0].text.lower()
        if any(t.isword(*MOVES, *_RELATIVE) and not a.issymbol("#") for a, t in pairwise(tokens)):
            raise ProgramError(
                first.line, "a motion within a line is not read; write it on a line of its own"
            )
        if word in _RELATIVE:
            raise ProgramError(
                first.line, f"{first.text} moves by a distance, so where to is computed"
            )
        if word in MOVES or word in _SPLINES:
            at_with = next((k for k, t in enumerate(tokens) if t.isword("with")), len(tokens))
            frames = self._with(tokens[at_with + 1 :])
            if word in MOVES:
                self._move(tokens[:at_with], self.inline | self.spline | frames)
            else:
                self.spline = frames  # until ENDSPLINE
        elif not first.isword(*_DECLARING):
            self._assignments(tokens)
        if word == "endspline":
            self.spline = {}
        if word == "fdat_act":
            name = tokens[-1].text.lower()
            self.inline = {what: self._of_data(what, name, first.line) for what in _FORMS}
        elif word not in _OF_INLINE_FORM:
            self.inline = {}
        if first.isword(*_DECLARING):
            self.placed |= {token.start for token in tokens if token.kind == "word"}
        self.elsewhere(tokens)
        self._calls(tokens)

    def _assignments(self, tokens: list[Token]) -> list[str]:
        """Names that are assigned to; refuses tools, bases and loads of more than one motion."""
        line, names = tokens[0].line, _assigned(tokens)
        for name in names:
            in_part = name == "fdat_act" and len(tokens) != 3  # FDAT_ACT=FP1
            if name in _SETTING or name in self.frames or in_part:
                raise ProgramError(
                    line,
                    f"{name.upper()} is set by the program, so the tool and base of a motion "
                    "depend on the way taken to it; write them into the motions, as SLIN P WITH "
                    "$TOOL=TOOL_DATA[1], or take the line out and state them by --tool and --frame",
                )
            if name == "$load" and not self.options.payloads:
                raise ProgramError(
                    line, "$LOAD is set by the program; take the line out and state it by --payload"
                )
            if name == "$ipo_mode":
                match = _IPO_MODE.fullmatch(_text(tokens, ""))
                if not match:
                    raise ProgramError(line, f"$IPO_MODE: {_EXTERNAL}")
                self._of_data("$base", match[1] or "", line)
        return names

    def _with(self, tokens: list[Token]) -> dict[str, _Frame]:
        """Tool and base that a motion sets for itself: WITH $TOOL=STOOL2(FP1), $BASE=..."""
        frames: dict[str, _Frame] = {}
        while tokens and tokens[-1].text.lower().startswith("c_"):
            tokens = tokens[:-1]  # approximation, C_SPL
        for item in filter(None, parts(tokens, ",")):
            name = item[0].text.lower()
            if len(_assigned(item)) > 1:
                raise ProgramError(item[0].line, "WITH: a comma is expected between assignments")
            if name in _FORMS and item[1:] and item[1].issymbol("="):
                frames[name] = self._frame(name, item)
            else:
                self._assignments(item)
        return frames

    def _frame(self, what: str, tokens: list[Token]) -> _Frame:
        """A tool or base: a constant, one of a number, or that of a data set."""
        line, shown, value = tokens[0].line, tokens[0].text, _text(tokens[2:], "")
        stored, of_data = _FORMS[what]
        if value.startswith("{"):
            self.placed.add(tokens[2].start)
            fields = _components(self.declared(self.reader(tokens, at=2), shown))
            if set(fields) != set(POSE):
                raise ProgramError(line, f"{shown}: expected X, Y, Z, A, B, C")
            return _constant(numbers_of((fields[key] for key in POSE), shown, line))
        if value in _ROOT:
            return _numbered("0")
        if match := re.fullmatch(stored, value):
            return _numbered(match[1])
        if match := re.fullmatch(of_data, value):
            return self._of_data(what, match[1], line)
        (point,) = self.points.get(value, [None])
        if point is not None and point.rotation and not point.configuration:
            self.placed.add(tokens[2].start)
            return _constant(point.numbers)
        numbered = f"{shown}, which may be a number as {what[1:].upper()}_DATA[1],"
        raise computed(line, numbered, value)

    def _of_data(self, what: str, name: str, line: int) -> _Frame:
        """The tool or base of a data set; without a number where it is not in these files."""
        data = _components(self.frames.get(name, ("", 0, {}))[2])
        words = {
            key: value.text.lower() for key, value in data.items() if not isinstance(value, dict)
        }
        if words.get("ipo_frame", "base") != "base":
            raise ProgramError(line, f"{name.upper()}: {_EXTERNAL}")
        return _numbered(words.get(f"{what[1:]}_no", ""))

    def _move(self, tokens: list[Token], frames: dict[str, _Frame]) -> None:
        move, reader = tokens[0], self.reader(tokens, at=1)
        for k in range(MOVES[move.text.lower()]):
            if k and not reader.take(","):
                raise computed(move.line, f"target {k + 1} of {move.text}", reader.shown)
            self.go(reader, move, partial(self._setup, frames, move.line))

    def _setup(self, frames: dict[str, _Frame], line: int, joints: bool) -> MoveSetup:
        """Tool, base and payload of a motion, from it or from the options."""
        poses, number = [], frames.get("$tool", _Frame()).number
        for what, option, stated in (
            ("$tool", "tool", self.options.tool),
            ("$base", "frame", self.options.frame),
        ):
            frame = frames.get(what, _Frame())
            weighed = what == "$tool" and any(self.options.payloads)  # counts for axis angles too
            if self.has_data_sets and what not in frames and (weighed or not joints):
                raise ProgramError(
                    line,
                    f"{what.upper()} of this motion is that of an earlier line; state it after "
                    "WITH, or by FDAT_ACT in the lines directly before",
                )
            pose = stated(frame.number) if frame.pose is None else frame.pose
            if pose is None and not joints:
                shown = f"{what.upper()} (number {frame.number or 'not stated'})"
                raise not_stated(line, shown, option, frame.number)
            poses.append(np.eye(4) if pose is None else pose)
        payload = self.options.payload(number)
        return MoveSetup(poses[0], poses[1], payload, f"tool {number}" if number else "$TOOL")

    def _calls(self, tokens: list[Token]) -> None:
        """Names calls of other files; refuses those that may change the tool or base here."""
        called = [t for t, after in pairwise(tokens) if t.kind == "word" and after.issymbol("(")]
        at_any_time = self.has_data_sets and any(t.isword("interrupt", "trigger") for t in tokens)
        if at_any_time and any(t.text.lower() in self.routines for t in called):
            raise ProgramError(
                tokens[0].line,
                f"{called[-1].text} may be called at any time, so which tool and base are in force "
                "is not known; put it into a file of its own",
            )
        calling = called[:1] == tokens[:1] and tokens[-1].issymbol(")")
        if calling and not tokens[0].isword(*_CALLED, *self.routines):
            self.notes.append(
                f"{tokens[0].text} is not in the file: its targets stay as they are, and a tool or "
                "base that it sets is not seen"
            )


def _components(value: Value) -> dict[str, Value]:
    return value if isinstance(value, dict) else {}


def _constant(numbers: Sequence[Number]) -> _Frame:
    return _Frame("", pose_of_angles([number.value for number in numbers]))


def _numbered(number: str) -> _Frame:
    """A tool or base of the controller; number 0 is the flange and the robot's base."""
    return _Frame(number, np.eye(4) if number == "0" else None)


def _routine(tokens: Sequence[Token]) -> tuple[str, str]:
    """DEF, DEFFCT or DEFDAT and the name of what a line begins, in lower case."""
    words = [t.text.lower() for t in tokens if t.kind == "word" and not t.isword("global")]
    if len(words) < 2 or words[0] not in ("def", "deffct", "defdat"):
        return "", ""
    return words[0], words[2] if words[0] == "deffct" and len(words) > 2 else words[1]


def _assigned(tokens: Sequence[Token]) -> list[str]:
    """Lower-case names that a line assigns to, whole or in part, and its calls of BAS."""
    text = _text(tokens, " ") + " "
    calls = [call.replace(" ", "") + ")" for call in _BAS.findall(text)]
    return [match[1] for match in _ASSIGNED.finditer(text)] + calls


def _text(tokens: Sequence[Token], between: str) -> str:
    return between.join(t.text.lower() for t in tokens)

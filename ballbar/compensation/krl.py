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
from itertools import pairwise
from pathlib import Path

import numpy as np

from ballbar.compensation.frames import FrameOptions
from ballbar.compensation.krl_values import (
    AXES,
    EXTERNAL_AXES,
    KrlFrame,
    KrlPoint,
    constant_frame,
    fields_of,
    numbered_frame,
    words_of,
)
from ballbar.compensation.program_source import (
    MoveSetup,
    ProgramSource,
    RobotProgram,
    computed,
    not_stated,
    used_elsewhere,
)
from ballbar.compensation.program_text import ProgramError, Reader, Token, parts

POINTS = ("e6axis", "axis", "e6pos", "pos", "frame")
_DECLARING = ("decl", "global", "const", "fdat", *POINTS)
MOVES = {"ptp": 1, "lin": 1, "sptp": 1, "slin": 1, "spl": 1, "circ": 2, "scirc": 2}
_SPLINES = ("spline", "ptp_spline")
_RELATIVE = (*(f"{move}_rel" for move in MOVES), "brake")
_HERE = ("$axis_act", "$pos_act", "$axis_int", "$pos_int")  # where the robot stands already
# lines between the FDAT_ACT of an inline form and its motion
_OF_INLINE_FORM = ("bas", "pdat_act", "ldat_act", "cpdat_act", "$bwdstart")
_ROOT = ("$nullframe", "$robroot", "$world")
# what sets the tool or base of later motions, beside $TOOL and $BASE
_SETTING = (*_ROOT, "tool_data", "base_data", "bas(#tool)", "bas(#base)", "bas(#ex_base)")
_CALLED = ("bas", "if", "while", "until", "switch", "wait", "case", "return")  # have brackets
_FORMS = {  # of a frame by its number, and by the number in a data set (FDAT)
    "$tool": (r"tool_data\[(\d+)\]", r"stool2?\((\w+)(?:\.tool_no)?\)"),
    "$base": (r"base_data\[(\d+)\]", r"sbase\((\w+)\.base_no\)"),
}
_IPO_MODE = re.compile(r"#base|sipo_mode\((\w+)\.ipo_frame\)")
_ASSIGNED = re.compile(r"(?:^|(?<= ))([$\w]+)(?: \. \w+| \[[^\]]*\])* = (?!=)")
_BAS = re.compile(r"(?:^|(?<= ))bas \( # \w+")
_EXTERNAL = (
    "a tool that stands in the cell, or a base that an external axis moves, is not understood; "
    "state the targets as axis angles in a program without it"
)


class _Krl(ProgramSource):
    """A .src or .dat file while it is read; points and data sets of both are shared."""

    def __init__(self, path: Path, options: FrameOptions, shared: _Krl | None = None) -> None:
        words = r"'[bBhH][0-9A-Fa-f]+'|[$A-Za-z_][$\w]*"
        super().__init__(path, options, comments=r";[^\n]*|(?m:^)&[^\n]*", words=words, lines=True)
        self.points: dict[str, tuple[_Krl, KrlPoint]] = shared.points if shared else {}
        self.data: dict[str, dict[str, str]] = shared.data if shared else {}  # FDAT by name
        if shared:
            self.uses, self.names = shared.uses, shared.names
        self.external: dict[str, int] = {}  # external axes off zero in poses, with the first line
        lines = self.statements()
        self.is_list = any(_routine(tokens)[0] == "defdat" for tokens in lines)
        self.routines = {_routine(tokens)[1] for tokens in lines}
        self.has_data_sets = any(tokens[0].isword("fdat_act") for tokens in lines)
        self.inline: dict[str, KrlFrame] = {}  # tool and base of the inline form that is read
        self.spline: dict[str, KrlFrame] = {}  # and of the spline block

    def declare(self, tokens: list[Token]) -> None:
        """The point or data set that a line gives constant values to."""
        while tokens and tokens[0].isword("decl", "global", "const"):
            tokens = tokens[1:]
        kind = tokens[0].text.lower() if tokens and tokens[0].isword(*POINTS, "fdat") else ""
        tokens = tokens[1:] if kind else tokens
        if not tokens or tokens[0].kind != "word" or not (kind or self.is_list):
            return
        reader = self.reader(tokens)
        shown = reader.name("[]")
        name = shown.lower()
        if not reader.take("=") or not reader.token.issymbol("{"):
            return
        if kind == "fdat":
            self.data[name] = dict(words_of(reader))
            return
        if not kind and (name.startswith("$") or not any(t.isword("a1", "x") for t in tokens)):
            return
        self.placed |= {tokens[0].start, reader.token.start}
        point = KrlPoint(shown, tokens[0].line, fields_of(reader, shown), kind != "frame")
        if reader.token.kind != "end":
            raise computed(point.line, shown, f"{reader.shown} after its value")
        if name in self.points:
            raise ProgramError(
                point.line, f"{shown} has constant values twice, so it is not clear which a "
                "motion means",
            )  # fmt: skip
        self.points[name] = self, point
        self.names.add(name.partition("[")[0])

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
            for name in _assigned(tokens):
                self._assignment(name, tokens)
        if word == "endspline":
            self.spline = {}
        if word == "fdat_act":
            name = tokens[-1].text.lower()
            self.inline = {what: self._of_data(what, name, first.line) for what in _FORMS}
        elif word not in _OF_INLINE_FORM:
            self.inline = {}
        self._elsewhere(tokens)
        self._calls(tokens)

    def _assignment(self, name: str, tokens: list[Token]) -> None:
        """Refuses what sets a tool, base or load otherwise than for a single motion."""
        line = tokens[0].line
        changed_in_part = name == "fdat_act" and len(tokens) != 3  # FDAT_ACT=FP1
        if name in _FORMS or name in _SETTING or name in self.data or changed_in_part:
            raise ProgramError(
                line,
                f"{name.upper()} is set by the program, so the tool and base of a motion depend on "
                "the way taken to it; write them into the motions, as SLIN P WITH "
                "$TOOL=TOOL_DATA[1], or take the line out and state them by --tool and --frame",
            )
        if name == "$load" and not self.options.payloads:
            raise ProgramError(
                line, "$LOAD is set by the program; take the line out and state it by --payload"
            )
        if name == "$ipo_mode":
            match = _IPO_MODE.fullmatch(_text(tokens[2:], ""))
            if not match:
                raise ProgramError(line, f"$IPO_MODE: {_EXTERNAL}")
            self._of_data("$base", match[1] or "", line)

    def _of_data(self, what: str, name: str, line: int) -> KrlFrame:
        """The tool or base of a data set; without a number where it is not in these files."""
        data = self.data.get(name, {})
        if data.get("ipo_frame", "base") != "base":
            raise ProgramError(line, f"{name.upper()}: {_EXTERNAL}")
        return numbered_frame(data.get(f"{what[1:]}_no", ""))

    def _with(self, tokens: list[Token]) -> dict[str, KrlFrame]:
        """Tool and base that a motion sets for itself: WITH $TOOL=STOOL2(FP1), $BASE=..."""
        frames: dict[str, KrlFrame] = {}
        while tokens and tokens[-1].text.lower().startswith("c_"):
            tokens = tokens[:-1]  # approximation, C_SPL
        for item in filter(None, parts(tokens, ",")):
            names = _assigned(item)
            if len(names) > 1:
                raise ProgramError(item[0].line, "WITH: a comma is expected between assignments")
            if names and names[0] in _FORMS and item[1].issymbol("="):
                frames[names[0]] = self._frame(names[0], item)
            elif names:
                self._assignment(names[0], item)
        return frames

    def _frame(self, what: str, tokens: list[Token]) -> KrlFrame:
        """A tool or base: a constant, one of a number, or that of a data set."""
        line, shown, value = tokens[0].line, tokens[0].text, _text(tokens[2:], "")
        stored, of_data = _FORMS[what]
        reader = self.reader(tokens, 2)
        if reader.token.issymbol("{"):
            self.placed.add(reader.token.start)
            fields = fields_of(reader, shown)
            if reader.token.kind == "end":
                return constant_frame(fields, tokens[0])
        elif value in _ROOT:
            return numbered_frame("0")
        elif match := re.fullmatch(stored, value):
            return numbered_frame(match[1])
        elif match := re.fullmatch(of_data, value):
            return self._of_data(what, match[1], line)
        elif value in self.points:
            self.placed.add(tokens[2].start)
            return constant_frame(self.points[value][1].fields, tokens[0])
        raise ProgramError(
            line, f"{shown} is computed; write it with a constant or with a number, as "
            f"{what[1:].upper()}_DATA[1]",
        )  # fmt: skip

    def _move(self, tokens: list[Token], frames: dict[str, KrlFrame]) -> None:
        move, reader = tokens[0], self.reader(tokens, 1)
        for k in range(MOVES[move.text.lower()]):
            if k:
                reader.expect(",", f"target of {move.text}")
            self._goal(reader, move, frames)
        if reader.token.issymbol(":", "+", "-", "*", "."):
            raise computed(move.line, f"target of {move.text}", reader.shown)

    def _goal(self, reader: Reader, move: Token, frames: dict[str, KrlFrame]) -> None:
        what, token = f"target of {move.text}", reader.token
        self.placed.add(token.start)
        if token.issymbol("{"):
            point = KrlPoint(move.text, move.line, fields_of(reader, what))
            self._add(point, self._setup(frames, move.line, joints=point.joints))
            return
        shown = reader.name("[]") if token.kind == "word" else ""
        if not shown or reader.token.issymbol("("):
            raise computed(move.line, what, shown or reader.shown)
        name = shown.lower()
        if name not in _HERE and self.named_target(
            move.text, shown, move.line, declared=name in self.points
        ):
            setup = self._setup(frames, move.line, joints=self.points[name][1].joints)
            self.uses.setdefault(name, []).append((move.line, setup))

    def _setup(self, frames: dict[str, KrlFrame], line: int, *, joints: bool) -> MoveSetup:
        """Tool, base and payload of a motion, from it or from the options."""
        poses, number = [], frames.get("$tool", KrlFrame()).number
        for what, option, stated in (
            ("$tool", "tool", self.options.tool),
            ("$base", "frame", self.options.frame),
        ):
            frame = frames.get(what, KrlFrame())
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

    def declared_point(self, point: KrlPoint) -> None:
        """The target that a declared point is, by the motions that go there."""
        if point.is_target or point.name.lower() in self.uses:
            self._add(point, self.setup_of(point.name, point.line, joints=point.joints))

    def _add(self, point: KrlPoint, setup: MoveSetup) -> None:
        self.targets.append(point.target(setup))
        for axis in () if point.joints else EXTERNAL_AXES:
            if axis in point.fields and point.fields[axis].value != 0.0:
                self.external.setdefault(axis.upper(), point.line)

    def _elsewhere(self, tokens: list[Token]) -> None:
        """Refuses targets, and names of targets, that no motion or declaration reads."""
        for k, token in enumerate(tokens):
            if self.names_a_target(token) and not tokens[0].isword(*_DECLARING):
                raise used_elsewhere(token, "a motion")
            if not token.issymbol("{") or token.start in self.placed:
                continue
            of_system = tokens[0].text.startswith("$")  # work spaces and the like
            if of_system or (k and tokens[k - 1].isword("cm", "j")):  # or the parts of a load
                continue
            if {*AXES, *"xyz"} & {key for key, _ in words_of(self.reader(tokens, k))}:
                raise ProgramError(
                    token.line,
                    "a target where none is read; write it into a motion, or declare a point of a "
                    f"type among {', '.join(POINTS).upper()}",
                )

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
        file.guarded(file.declare, file.statements())
    for file in files:
        file.guarded(file.statement, file.statements())
    for file, point in files[0].points.values():
        file.guarded(file.declared_point, [point])
    for file in files:
        file.notes = [*dict.fromkeys(file.notes)] + [
            f"{axis} of poses is not 0 (first in line {line}): it is taken to move neither the "
            "robot nor a base; state the targets as axis angles if it does"
            for axis, line in file.external.items()
        ]
    return [file.program() for file in files]


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

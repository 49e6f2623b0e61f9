"""Targets of a KRL program: E6AXIS and AXIS, E6POS, POS and FRAME, declared or in the motion.

A .src file and the .dat file of the same name are one program. Read are aggregates with constant
values, in declarations, in assignments to points, and in PTP, LIN, CIRC, SPTP, SLIN, SCIRC and SPL.
Tools and bases come from assignments of constant frames to $TOOL and $BASE outside of branches,
else from the options by the number in FDAT, TOOL_DATA or BASE_DATA. Whatever else goes to a target
is refused with its line. $BASE is taken to be stated in the robot's base frame.

Source: KUKA System Software 8.3, Operating and Programming Instructions for System Integrators,
and the KRL reference. No result was loaded into a controller.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.compensation.frames import FrameOptions, payload_of, pose_of_angles
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
from cell.foreign_text import one_line
from cell.payload import Payload

AXES, POSE = tuple(f"a{i}" for i in range(1, 7)), ("x", "y", "z", "a", "b", "c")
POINTS = ("e6axis", "axis", "e6pos", "pos", "frame")
MOVES = {"ptp": 1, "lin": 1, "sptp": 1, "slin": 1, "spl": 1, "circ": 2, "scirc": 2}
_RELATIVE = ("ptp_rel", "lin_rel", "circ_rel", "sptp_rel", "slin_rel", "scirc_rel", "brake")
_HERE = ("$axis_act", "$pos_act", "$axis_int", "$pos_int")  # where the robot stands already
_OPEN = ("if", "for", "while", "loop", "repeat", "switch")
_CLOSE = ("endif", "endfor", "endwhile", "endloop", "until", "endswitch")
_ROOT = ("$nullframe", "$robroot", "$world")
_WORDS = r"'[bBhH][0-9A-Fa-f]+'|[$A-Za-z_][$\w]*"


@dataclass(frozen=True, eq=False)
class _Point:
    """A constant value of a point, and where it stands."""

    name: str
    line: int
    fields: dict[str, Number]


class _Krl:
    """A .src or .dat file while it is read; points and data sets of both are shared."""

    def __init__(self, text: str, options: FrameOptions, shared: _Krl | None = None) -> None:
        self.text, self.options = text, options
        self.tokens = tokens_of(text, r";[^\n]*|(?m:^)&[^\n]*", lines=True, words=_WORDS)
        self.faults: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self.targets: list[ProgramTarget] = []
        self.points: dict[str, list[tuple[_Krl, _Point]]] = shared.points if shared else {}
        self.tools: dict[str, tuple[str, str]] = shared.tools if shared else {}
        self.uses: dict[str, list[tuple[int, Setup]]] = shared.uses if shared else {}
        self.frames: set[str] = shared.frames if shared else set()  # points that are tools or bases
        self.depth = 0
        self.setup = Setup()
        self.tool: str | None = None  # number or name of the tool in force; None: not known
        self.base: str | None = None
        self.known_tool: Array | None = None
        self.known_base: Array | None = None
        self.load: Payload | None = None

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

    def reader(self, tokens: Sequence[Token]) -> Reader:
        end = Token("end", "", tokens[-1].end, tokens[-1].end, tokens[-1].line)
        return Reader([*tokens, end], self.text)

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
                values = dict(_words(reader))
                self.tools[name] = values.get("tool_no", ""), values.get("base_no", "")
            return
        if not typed and not _is_point(tokens):
            return
        point = _Point(name, tokens[0].line, self.fields(reader, name))
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
        reader.expect("{", what)
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
            if literal.kind == "word" and literal.text.startswith("'"):
                reader.next()
                out[key] = Number(literal.text, literal.start, literal.end, literal.line)
            else:
                out[key] = reader.number(f"{what}, {component.text}")
            if reader.take("}"):
                return out
            reader.expect(",", what)

    def motion(self, tokens: list[Token]) -> None:
        """What a line moves to, and what it changes for later ones."""
        first, word = tokens[0], tokens[0].text.lower()
        self.depth += (word in _OPEN) - (word in _CLOSE)
        if word in ("def", "deffct", "defdat", "global"):
            self.tool = self.base = self.known_tool = self.known_base = self.load = None
        if word in MOVES:
            self._moves(tokens)
        elif word in _RELATIVE[:-1]:
            raise ProgramError(
                first.line, f"{first.text} moves by a distance, so where to is computed"
            )
        elif word in ("$tool", "$base", "$load"):
            self._frame(tokens)
        elif word == "fdat_act" and len(tokens) > 2:
            self._numbers_of(tokens[2].text.lower())
        elif word == "bas" and len(tokens) > 5 and tokens[3].isword("tool", "base"):
            self._select(tokens[3].text.lower(), tokens[5].text)
        else:
            self._check_points(tokens)

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

    def _numbers_of(self, data: str) -> None:
        tool, base = self.tools.get(data, ("", ""))
        self._select("tool", tool)
        self._select("base", base)

    def _select(self, what: str, number: str) -> None:
        if what == "tool":
            self.tool, self.known_tool, self.load = number, None, None
            if number == "0":
                self.known_tool = np.eye(4)
        else:
            self.base, self.known_base = number, np.eye(4) if number == "0" else None

    def _frame(self, tokens: list[Token]) -> None:
        """An assignment to $TOOL, $BASE or $LOAD."""
        what, reader = tokens[0].text.lower()[1:], self.reader(tokens[1:])
        if not reader.take("="):
            raise ProgramError(tokens[0].line, f"{tokens[0].text} is changed in part")
        if self.depth:
            raise ProgramError(
                tokens[0].line, f"{tokens[0].text} is set within a branch or loop, so which is in "
                "force later is not known",
            )  # fmt: skip
        if reader.token.issymbol("{"):
            if what == "load":
                self.load = _load(reader, self.fields)
                return
            self._select(what, "")
            self._known(what, self.fields(reader, tokens[0].text), tokens[0])
            return
        name = reader.token.text.lower()
        if what == "load":
            self.load = None
        elif name in _ROOT:
            self._select(what, "0")
        elif name in ("tool_data", "base_data") and len(tokens) == 6 and tokens[4].kind == "number":
            self._select(what, tokens[4].text)
        elif len(self.points.get(name, [])) == 1 and len(tokens) == 3:
            self._select(what, "")
            self._known(what, self.points[name][0][1].fields, tokens[0])
            self.frames.add(name)
        else:
            raise ProgramError(tokens[0].line, f"{tokens[0].text} is computed")

    def _known(self, what: str, fields: dict[str, Number], token: Token) -> None:
        """Puts a constant frame in force as $TOOL or $BASE."""
        if set(fields) != set(POSE):
            raise ProgramError(token.line, f"{token.text}: expected X, Y, Z, A, B, C")
        frame = pose_of_angles([fields[key].value for key in POSE])
        if what == "tool":
            self.known_tool = frame
        else:
            self.known_base = frame

    def _moves(self, tokens: list[Token]) -> None:
        word, line = tokens[0].text, tokens[0].line
        for k, token in enumerate(tokens[:-5]):
            if token.isword("stool", "stool2") and tokens[k + 1].issymbol("("):
                self._numbers_of(tokens[k + 2].text.lower())
        reader = self.reader(tokens[1:])
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
        joints = "a1" in self.points[name][0][1].fields
        self.uses.setdefault(name, []).append((line, self._setup(line, joints=joints)))

    def _setup(self, line: int, *, joints: bool) -> Setup:
        tool, frame = self.known_tool, self.known_base
        tool = self.options.tool(self.tool or "") if tool is None else tool
        frame = self.options.frame(self.base or "") if frame is None else frame
        if not joints and (tool is None or frame is None):
            missing, option = ("$TOOL", "tool") if tool is None else ("$BASE", "frame")
            number = self.tool if tool is None else self.base
            named = f"{number}=" if number else ""
            raise ProgramError(
                line,
                f"{missing} is not known here (number {number or 'not stated'}); state it by "
                f"--{option} {named}X,Y,Z,A,B,C",
            )
        payload = self.options.payload(self.tool or "") or self.load
        unit = np.eye(4)
        name = f"tool {self.tool}" if self.tool else "$TOOL"
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
        self.targets.append(ProgramTarget(name, line, numbers, rotation, setup, configuration))


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
        Program(each, file.text, tuple(file.targets), tuple(dict.fromkeys(file.notes)))
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
    """Components and their first words of an aggregate of any type."""
    out, depth = [], 0
    while reader.token.kind != "end":
        token = reader.next()
        depth += token.issymbol("{") - token.issymbol("}")
        if depth == 1 and token.kind == "word":
            out.append((token.text.lower(), reader.token.text.lower()))
    return out


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
    return payload_of(mass, centre)

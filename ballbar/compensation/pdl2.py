"""Targets of a PDL2 program: joint positions in braces or JNTP(...), in MOVE or assigned.

Cartesian positions are refused: what the flags of their configuration string mean on a given arm
could not be checked against public documents, so the joints that they stand for are not known.
A variable that a target is assigned to may be named in its declaration, in assignments of constant
values and as the target of MOVE; anywhere else it might be computed with, which is refused.

Source: Comau, PDL2 Programming Language manual, CR00757508. No result was loaded into a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from ballbar.compensation.frames import FrameOptions
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
    tokens_of,
)
from cell.foreign_text import one_line

_MOVES = ("move", "movefly")
_CURVES = ("joint", "linear", "circular")
_TYPES = ("jointpos", "array")  # of variables with joint positions
_OTHER = ("about", "relative", "away", "by", "near", "via")  # of moves: computed on the way


def read_pdl2(path: Path, options: FrameOptions) -> Program:
    """The targets of a program. Raises InputError naming the lines that are not understood."""
    text = read_program_text(path)
    file = _Pdl2(text, options)
    file.read()
    refuse(path, file.faults)
    return Program(path, text, tuple(file.targets), tuple(dict.fromkeys(file.notes)))


class _Pdl2:
    """A program while it is read."""

    def __init__(self, text: str, options: FrameOptions) -> None:
        self.text, self.options = text, options
        tokens = tokens_of(text, r"--[^\n]*", lines=True, words=r"[$A-Za-z_][$\w]*")
        self.lines: list[list[Token]] = [[]]
        for token in tokens:
            if token.kind == "end":
                self.lines.append([])
            else:
                self.lines[-1].append(token)
        self.faults: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self.targets: list[ProgramTarget] = []
        self.assigned: set[str] = set()
        self.placed: set[int] = set()  # places of targets and their names that were read
        self.arm = _program_arm(tokens)

    def read(self) -> None:
        """Constants first, then what computes with them, then moves, in whatever order of text."""
        for read in (self._constant, self._computed, self._motion, self._elsewhere):
            for tokens in filter(None, self.lines):
                try:
                    read(tokens)
                except ProgramError as fault:
                    self.faults.append((fault.line, fault.why))

    def _reader(self, tokens: Sequence[Token], at: int = 0) -> Reader:
        end = Token("end", "", tokens[-1].end, tokens[-1].end, tokens[-1].line)
        return Reader([*tokens, end], self.text, at)

    @property
    def _variables(self) -> set[str]:
        """Names that targets are assigned to, without their indices."""
        return {name.partition("[")[0] for name in self.assigned}

    def _constant(self, tokens: list[Token]) -> None:
        name, value = _assignment(tokens)
        if name and _is_target(value[0]):
            reader = self._reader(value)
            self._add(name, reader)
            self.assigned.add(name.lower())
            self.placed.add(tokens[0].start)
            if reader.token.kind != "end" and not reader.token.issymbol(";"):
                raise ProgramError(
                    tokens[0].line, f"{name} is computed ({reader.shown} after its value)"
                )

    def _computed(self, tokens: list[Token]) -> None:
        name, value = _assignment(tokens)
        if not name or _is_target(value[0]):
            return
        if value[0].isword("pos", "xtndpos"):
            raise ProgramError(tokens[0].line, f"{name}: {_CARTESIAN}")
        if name.partition("[")[0].lower() in self._variables:
            raise ProgramError(tokens[0].line, f"{name} is computed; write it with constant values")

    def _elsewhere(self, tokens: list[Token]) -> None:
        """Refuses targets, and variables that hold them, outside of MOVE and assignment."""
        variables = set() if _is_declaration(tokens) else self._variables
        for token in (t for t in tokens if t.start not in self.placed):
            if _is_target(token):
                raise ProgramError(token.line, "a joint position outside of MOVE and assignment")
            if token.isword("syncmove"):
                raise ProgramError(token.line, "SYNCMOVE is not understood")
            if token.isword(*variables):
                raise ProgramError(
                    token.line,
                    f"{token.text} is used outside of MOVE, so the target may be computed; write "
                    "it with constant values, each assignment on a line of its own",
                )
        if not any(t.isword(*_MOVES, "jointpos") for t in tokens):
            return
        for k, token in enumerate(tokens[:-2]):
            if token.isword("arm") and tokens[k + 2].text != self.arm:
                raise ProgramError(
                    token.line,
                    f"ARM[{one_line(tokens[k + 2].text)}] is not the program's arm (PROG_ARM = "
                    f"{self.arm}); correct the program of each arm with the result of its robot",
                )

    def _motion(self, tokens: list[Token]) -> None:
        first = next((k for k, t in enumerate(tokens) if t.isword(*_MOVES)), None)
        if first is None:
            return
        reader, line = self._reader(tokens, first + 1), tokens[first].line
        while reader.token.isword(*_CURVES) or reader.token.isword("arm"):
            if reader.next().isword("arm"):
                reader.expect("[", "ARM")
                reader.next()
                reader.expect("]", "ARM")
        if reader.token.isword(*_OTHER) or not reader.token.isword("to"):
            given = one_line(reader.token.text) or "without TO"
            raise ProgramError(line, f"MOVE {given}: where to is computed")
        reader.next()
        if _is_target(reader.token):
            self._add("MOVE", reader)
        elif reader.token.isword("pos", "xtndpos"):
            raise ProgramError(line, f"MOVE: {_CARTESIAN}")
        else:
            self._named(reader, line)
        rest = reader.tokens[reader.at :]
        if any(t.isword("via", "syncmove", *_MOVES) or _is_target(t) for t in rest):
            raise ProgramError(line, "MOVE has another target, which is not understood")

    def _named(self, reader: Reader, line: int) -> None:
        self.placed.add(reader.token.start)
        name = reader.next().text
        if reader.take("["):
            name += "["
            while not reader.take("]") and reader.token.kind != "end":
                name += reader.next().text
            name += "]"
        if reader.token.issymbol("(", ":", "."):
            raise ProgramError(line, f"target {name} of MOVE is computed")
        if name.lower() in self.options.keep:
            corrected = name.lower() in self.assigned
            what = "has constant values here and is corrected" if corrected else "stays as it is"
            self.notes.append(f"{name} {what} (--keep)")
        elif name.lower() not in self.assigned:
            raise ProgramError(
                line,
                f"target {name} of MOVE has no constant value in this file (a .var file may hold "
                f"it); write it into the program, or leave it as it is by --keep {name}",
            )

    def _add(self, name: str, reader: Reader) -> None:
        line, closing = reader.token.line, "}"
        self.placed.add(reader.token.start)
        if reader.token.kind == "word":
            reader.next()
            closing = ")"
        reader.next()
        numbers: list[Number] = [reader.number(f"target {name}")]
        while reader.take(","):
            numbers.append(reader.number(f"target {name}"))
        reader.expect(closing, f"target {name}: decimals have a point, and")
        setup = Setup(payload=self.options.payload(""))
        self.targets.append(ProgramTarget(name, line, tuple(numbers), None, setup))


_CARTESIAN = (
    "cartesian positions of PDL2 are not corrected: the arm reaches them in several "
    "configurations, each with errors of its own, and their configuration string is not "
    "understood; state the target as a joint position, {...} or JNTP(...)"
)


def _assignment(tokens: Sequence[Token]) -> tuple[str, Sequence[Token]]:
    """Name and value of an assignment; an empty name where a line is none."""
    places = [k for k, token in enumerate(tokens) if token.issymbol(":=")]
    if not places or tokens[0].kind != "word" or len(tokens) <= places[0] + 1:
        return "", tokens
    index = tokens[1 : places[0]]
    if index and not (index[0].issymbol("[") and index[-1].issymbol("]")):
        return "", tokens
    return "".join(t.text for t in tokens[: places[0]]), tokens[places[0] + 1 :]


def _is_target(token: Token) -> bool:
    return token.issymbol("{") or token.isword("jntp")


def _is_declaration(tokens: Sequence[Token]) -> bool:
    """Whether a line declares variables, and not parameters of a routine."""
    whole = sum(t.issymbol("(") - t.issymbol(")") for t in tokens) == 0
    typed = any(t.issymbol(":") and after.isword(*_TYPES) for t, after in pairwise(tokens))
    return whole and typed and not any(t.isword("routine") for t in tokens)


def _program_arm(tokens: Sequence[Token]) -> str:
    """Number of the arm that PROGRAM states; 1 where it states none."""
    for k, token in enumerate(tokens[:-2]):
        if token.isword("prog_arm") and tokens[k + 1].issymbol("="):
            return tokens[k + 2].text
    return "1"

"""Targets of a PDL2 program: joint positions in braces or JNTP(...), in MOVE or assigned.

Cartesian positions are refused: what the flags of their configuration string mean on a given arm
could not be checked against public documents, so the joints that they stand for are not known.
PDL2 declares no constant joint positions; a variable that is assigned constant values, each on a
line of its own, is taken for one as long as MOVE alone names it otherwise.

Source: Comau, PDL2 Programming Language manual, CR00757508. No result was loaded into a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from ballbar.compensation.frames import FrameOptions
from ballbar.compensation.program_source import (
    MoveSetup,
    ProgramSource,
    ProgramTarget,
    RobotProgram,
    computed,
    used_elsewhere,
)
from ballbar.compensation.program_text import ProgramError, Reader, Token
from cell.foreign_text import one_line

_MOVES = ("move", "movefly")
_CURVES = ("joint", "linear", "circular")
_TYPES = ("jointpos", "array")  # of variables with joint positions
_CARTESIAN = (
    "cartesian positions of PDL2 are not corrected: the arm reaches them in several "
    "configurations, each with errors of its own, and their configuration string is not "
    "understood; state the target as a joint position, {...} or JNTP(...)"
)


def read_pdl2(path: Path, options: FrameOptions) -> list[RobotProgram]:
    """The targets of a program. Raises InputError naming the lines that are not understood."""
    file = _Pdl2(path, options)
    for read in (file.constant, file.motion, file.elsewhere):
        file.guarded(read, file.statements())
    return [file.program()]


class _Pdl2(ProgramSource):
    """A program while it is read: constants first, then moves, then what may compute with them."""

    def __init__(self, path: Path, options: FrameOptions) -> None:
        super().__init__(path, options, comments=r"--[^\n]*", words=r"[$A-Za-z_][$\w]*", lines=True)
        self.assigned: set[str] = set()  # names of targets with their indices
        arms = [
            c.text
            for a, b, c in zip(self.tokens, self.tokens[1:], self.tokens[2:], strict=False)
            if a.isword("prog_arm") and b.issymbol("=")
        ]
        self.arm = arms[0] if arms else "1"

    def constant(self, tokens: list[Token]) -> None:
        """The target that a line assigns."""
        name, value = _assignment(tokens)
        if not name or not _is_target(value[0]):
            return
        reader = self.reader(value)
        self._add(name, reader)
        self.assigned.add(name.lower())
        self.names.add(name.lower().partition("[")[0])
        self.placed.add(tokens[0].start)
        if reader.token.kind != "end" and not reader.token.issymbol(";"):
            raise computed(tokens[0].line, name, f"{reader.shown} after its value")

    def motion(self, tokens: list[Token]) -> None:
        """The target of MOVE."""
        first = next((k for k, t in enumerate(tokens) if t.isword(*_MOVES)), None)
        if first is None:
            return
        reader, line = self.reader(tokens, first + 1), tokens[first].line
        while reader.token.isword(*_CURVES, "arm"):
            reader.name("[]")
        word = one_line(reader.token.text) or "without TO"
        if not reader.token.isword("to"):
            raise ProgramError(line, f"MOVE {word}: where to is computed")
        reader.next()
        if _is_target(reader.token):
            self._add("MOVE", reader)
        elif reader.token.isword("pos", "xtndpos"):
            raise ProgramError(line, f"MOVE: {_CARTESIAN}")
        else:
            self.placed.add(reader.token.start)
            name = reader.name("[]")
            if reader.token.issymbol("(", ":", "."):
                raise computed(line, "target of MOVE", name)
            self.named_target("MOVE", name, line, declared=name.lower() in self.assigned)
        after = reader.tokens[reader.place :]
        if any(t.isword("via", "syncmove", *_MOVES) or _is_target(t) for t in after):
            raise ProgramError(line, "MOVE has another target, which is not understood")

    def elsewhere(self, tokens: list[Token]) -> None:
        """Refuses targets, and variables that hold them, outside of MOVE and assignment."""
        line, (name, value) = tokens[0].line, _assignment(tokens)
        if name and value[0].isword("pos", "xtndpos"):
            raise ProgramError(line, f"{name}: {_CARTESIAN}")
        for token in tokens:
            if _is_target(token) and token.start not in self.placed:
                raise ProgramError(token.line, "a joint position outside of MOVE and assignment")
            if token.isword("syncmove"):
                raise ProgramError(token.line, "SYNCMOVE is not understood")
            if self.names_a_target(token) and not _is_declaration(tokens):
                raise used_elsewhere(token, "MOVE")
        if not any(t.isword(*_MOVES, "jointpos") for t in tokens):
            return
        for k, token in enumerate(tokens[:-2]):
            if token.isword("arm") and tokens[k + 2].text != self.arm:
                raise ProgramError(
                    token.line,
                    f"ARM[{one_line(tokens[k + 2].text)}] is not the program's arm (PROG_ARM = "
                    f"{self.arm}); correct the program of each arm with the result of its robot",
                )

    def _add(self, name: str, reader: Reader) -> None:
        """The target of {...} or JNTP(...)."""
        line, closing = reader.token.line, "}"
        self.placed.add(reader.token.start)
        if reader.next().kind == "word":
            closing = ")"
            reader.next()
        numbers = [reader.number(f"target {name}")]
        while reader.take(","):
            numbers.append(reader.number(f"target {name}"))
        reader.expect(closing, f"target {name}: decimals have a point, and")
        setup = MoveSetup(payload=self.options.payload(""))
        self.targets.append(ProgramTarget(name, line, tuple(numbers), None, setup))


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
    balanced = sum(t.issymbol("(") - t.issymbol(")") for t in tokens) == 0
    typed = any(t.issymbol(":") and after.isword(*_TYPES) for t, after in pairwise(tokens))
    return balanced and typed and not any(t.isword("routine") for t in tokens)

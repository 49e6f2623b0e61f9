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

from ballbar.cell.foreign_text import one_line
from ballbar.compensation.frames import FrameOptions
from ballbar.compensation.program_source import (
    MoveSetup,
    ProgramSource,
    ProgramTarget,
    RobotProgram,
    numbers_of,
    positional,
)
from ballbar.compensation.program_text import ProgramError, Token, Value

_MOVES = ("move", "movefly")
_CURVES = ("joint", "linear", "circular")
_TYPES = ("jointpos", "array")  # of variables with joint positions
_CARTESIAN = ("pos", "xtndpos")


def read_pdl2(path: Path, options: FrameOptions) -> list[RobotProgram]:
    """The targets of a program. Raises InputError naming the lines that are not understood."""
    file = _Pdl2(path, options)
    for read in (file.assignment, file.motion, file.rest):
        file.guarded(read, file.statements)
    file.guarded(file.declared_targets, file.points)
    return [file.program()]


class _Pdl2(ProgramSource):
    """A program while it is read: constants first, then moves, then what may compute with them."""

    COMMENTS, WORDS = r"--[^\n]*", r"[$A-Za-z_][$\w]*"
    MOVES, TYPE = "MOVE", "jntp"

    def __init__(self, path: Path, options: FrameOptions) -> None:
        super().__init__(path, options)
        arms = [
            tokens[k + 2].text
            for tokens in self.statements
            for k, token in enumerate(tokens[:-2])
            if token.isword("prog_arm") and tokens[k + 1].issymbol("=")
        ]
        self.arm = arms[0] if arms else "1"

    def target(self, value: Value, name: str, line: int) -> ProgramTarget:
        """The target of a joint position, of as many axes as it has."""
        count = len(value) if isinstance(value, dict) else 0
        angles = positional(value, name, line, *["angle"] * count)
        return ProgramTarget(name, line, numbers_of(angles, name, line), None)

    def begins_target(self, tokens: Sequence[Token], k: int) -> bool:
        """Whether a joint position begins at a token."""
        return tokens[k].issymbol("{") or tokens[k].isword(self.TYPE)

    def assignment(self, tokens: list[Token]) -> None:
        """The target that a line assigns, all of the line."""
        reader = self.reader(tokens[:-1] if tokens[-1].issymbol(";") else tokens)
        name = reader.name() if tokens[0].kind == "word" else ""
        if not name or not reader.take(":="):
            return
        if reader.token.isword(*_CARTESIAN):
            raise _cartesian(tokens[0].line, name)
        if self.begins_target(reader.tokens, reader.place):
            self.placed |= {tokens[0].start, reader.token.start}
            target = self.target(self.declared(reader, name), name, tokens[0].line)
            self.declare(name, [*self.points.get(name.lower(), ()), target])

    def motion(self, tokens: list[Token]) -> None:
        """The target of MOVE."""
        first = next((k for k, t in enumerate(tokens) if t.isword(*_MOVES)), None)
        if first is None:
            return
        reader, move = self.reader(tokens, at=first + 1), tokens[first]
        while reader.token.isword(*_CURVES, "arm"):
            reader.name()
        word = one_line(reader.token.text) or "without TO"
        if not reader.token.isword("to"):
            raise ProgramError(move.line, f"MOVE {word}: where to is computed")
        reader.next()
        if reader.token.isword(*_CARTESIAN):
            raise _cartesian(move.line, "MOVE")
        self.go(reader, move, lambda _: MoveSetup(payload=self.options.payload("")))
        after = range(reader.place, len(tokens))
        if any(tokens[k].isword("via", *_MOVES) or self.begins_target(tokens, k) for k in after):
            raise ProgramError(move.line, "MOVE has another target, which is not understood")

    def rest(self, tokens: list[Token]) -> None:
        """Refuses targets outside of MOVE and assignment, and motions of other arms."""
        if any(token.isword("syncmove") for token in tokens):
            raise ProgramError(tokens[0].line, "SYNCMOVE is not understood")
        if _is_declaration(tokens):
            self.placed |= {token.start for token in tokens if token.kind == "word"}
        self.elsewhere(tokens)
        if not any(t.isword(*_MOVES, "jointpos") for t in tokens):
            return
        for k, token in enumerate(tokens[:-2]):
            if token.isword("arm") and tokens[k + 2].text != self.arm:
                raise ProgramError(
                    token.line,
                    f"ARM[{one_line(tokens[k + 2].text)}] is not the program's arm (PROG_ARM = "
                    f"{self.arm}); correct the program of each arm with the result of its robot",
                )


def _cartesian(line: int, name: str) -> ProgramError:
    return ProgramError(
        line,
        f"{name}: cartesian positions of PDL2 are not corrected: the arm reaches them in several "
        "configurations, each with errors of its own, and their configuration string is not "
        "understood; state the target as a joint position, {...} or JNTP(...)",
    )


def _is_declaration(tokens: Sequence[Token]) -> bool:
    """Whether a line declares variables, and not parameters of a routine."""
    balanced = sum(t.issymbol("(") - t.issymbol(")") for t in tokens) == 0
    typed = any(t.issymbol(":") and after.isword(*_TYPES) for t, after in pairwise(tokens))
    return balanced and typed and not any(t.isword("routine") for t in tokens)

"""Targets of a PDL2 program: joint positions in braces or JNTP(...), in MOVE or assigned.

Cartesian positions are refused: what the flags of their configuration string mean on a given arm
could not be checked against public documents, so the joints that they stand for are not known.

Source: Comau, PDL2 Programming Language manual, CR00757508. No result was loaded into a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
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

    def read(self) -> None:
        """Constants first, then what computes with them, then moves, in whatever order of text."""
        for read in (self._constant, self._computed, self._motion):
            for tokens in filter(None, self.lines):
                try:
                    read(tokens)
                except ProgramError as fault:
                    self.faults.append((fault.line, fault.why))

    def _reader(self, tokens: Sequence[Token]) -> Reader:
        end = Token("end", "", tokens[-1].end, tokens[-1].end, tokens[-1].line)
        return Reader([*tokens, end], self.text)

    def _constant(self, tokens: list[Token]) -> None:
        name, value = _assignment(tokens)
        if name and (value[0].issymbol("{") or value[0].isword("jntp")):
            self._add(name, self._reader(value))
            self.assigned.add(name.lower())

    def _computed(self, tokens: list[Token]) -> None:
        name, value = _assignment(tokens)
        if not name and not any(t.isword(*_MOVES) for t in tokens):
            if any(t.issymbol("{") for t in tokens):
                raise ProgramError(
                    tokens[0].line, "a joint position outside of MOVE and assignment"
                )
            return
        if not name or value[0].issymbol("{") or value[0].isword("jntp"):
            return
        if value[0].isword("pos", "xtndpos"):
            raise ProgramError(tokens[0].line, f"{name}: {_CARTESIAN}")
        if {name.lower(), name.partition("[")[0].lower()} & self.assigned:
            raise ProgramError(tokens[0].line, f"{name} is computed; write it with constant values")

    def _motion(self, tokens: list[Token]) -> None:
        first = next((k for k, t in enumerate(tokens) if t.isword(*_MOVES)), None)
        if first is None:
            return
        reader, line = self._reader(tokens[first + 1 :]), tokens[first].line
        while reader.token.isword(*_CURVES) or reader.token.isword("arm"):
            if reader.next().isword("arm"):
                reader.expect("[", "ARM")
                reader.next()
                reader.expect("]", "ARM")
        if reader.token.isword(*_OTHER) or not reader.token.isword("to"):
            raise ProgramError(line, f"MOVE {one_line(reader.token.text)}: where to is computed")
        reader.next()
        if reader.token.issymbol("{") or reader.token.isword("jntp"):
            self._add("MOVE", reader)
        elif reader.token.isword("pos", "xtndpos"):
            raise ProgramError(line, f"MOVE: {_CARTESIAN}")
        else:
            self._named(reader, line)
        if any(t.isword("via", "syncmove") or t.issymbol("{") for t in reader.tokens[reader.at :]):
            raise ProgramError(line, "MOVE has another target, which is not understood")

    def _named(self, reader: Reader, line: int) -> None:
        name = reader.next().text
        if reader.take("["):
            name += "["
            while not reader.take("]") and reader.token.kind != "end":
                name += reader.next().text
            name += "]"
        if reader.token.issymbol("(", ":", "."):
            raise ProgramError(line, f"target {name} of MOVE is computed")
        if name.lower() in self.options.keep:
            self.notes.append(f"{name} stays as it is (--keep)")
        elif name.lower() not in self.assigned:
            raise ProgramError(
                line,
                f"target {name} of MOVE has no constant value in this file (a .var file may hold "
                f"it); write it into the program, or leave it as it is by --keep {name}",
            )

    def _add(self, name: str, reader: Reader) -> None:
        line, closing = reader.token.line, "}"
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
    return "".join(t.text for t in tokens[: places[0]]), tokens[places[0] + 1 :]

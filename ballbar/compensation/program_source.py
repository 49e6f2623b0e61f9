"""A robot program while it is read: its targets, the moves to them, and what is not understood.

A target is corrected where its value stands as numbers, and where the tool, the frame and the
payload that it is reached with are stated. The readers of the three languages find declarations and
moves; what a target and a refusal are is the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ballbar.compensation.frames import FrameOptions
from ballbar.compensation.program_text import (
    Number,
    ProgramError,
    Reader,
    Token,
    read_program_text,
    tokens_of,
)
from cell.arrays import Array
from cell.errors import InputError
from cell.payload import Payload

FAULTS_SHOWN = 10


@dataclass(frozen=True, eq=False)
class MoveSetup:
    """Tool and frame that a pose is stated in, and the load of the robot on the way to it."""

    tool: Array = field(default_factory=lambda: np.eye(4))  # (4, 4) tcp in the flange's frame
    frame: Array = field(default_factory=lambda: np.eye(4))  # (4, 4) in the robot's base frame
    payload: Payload | None = None  # None: not known
    tool_name: str = ""

    @property
    def load(self) -> tuple[float, ...]:
        """Mass [kg] and centre [m] of the payload; nothing where it is not known."""
        return () if self.payload is None else (self.payload.mass, *self.payload.com.tolist())

    def same(self, other: MoveSetup, *, joints: bool) -> bool:
        """Whether a target means the same with both; axis angles depend on the payload alone."""
        placed = np.array_equal(self.tool, other.tool) and np.array_equal(self.frame, other.frame)
        return self.load == other.load and (joints or placed)


@dataclass(frozen=True, eq=False)
class ProgramTarget:
    """A target with its numbers in the text."""

    name: str
    line: int
    numbers: tuple[Number, ...]  # axes [deg], or position [mm] and rotation
    # rotation of a pose: quaternion w x y z, or angles [deg] about z, y', x''; None for axis angles
    rotation: Literal["quaternion", "zyx"] | None
    setup: MoveSetup
    configuration: tuple[Number, ...] = ()  # cf1 cf4 cf6 cfx, or S T


@dataclass(frozen=True, eq=False)
class RobotProgram:
    """A program as read: its text, and every target that a motion goes to."""

    path: Path
    text: str
    targets: tuple[ProgramTarget, ...]
    notes: tuple[str, ...] = ()  # what was taken as given


class ProgramSource:
    """The text of a program while it is read; the reader of each language is one of these."""

    def __init__(
        self, path: Path, options: FrameOptions, *, comments: str, words: str, lines: bool
    ) -> None:
        """comments, words : patterns. lines : whether a statement ends with its line."""
        self.path, self.options, self.text = path, options, read_program_text(path)
        self.tokens = tokens_of(self.text, comments, lines=lines, words=words)
        self.faults: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self.targets: list[ProgramTarget] = []
        self.placed: set[int] = set()  # places of the tokens of targets that were read
        self.names: set[str] = set()  # lower-case names of targets, without their indices
        self.uses: dict[str, list[tuple[int, MoveSetup]]] = {}  # moves to named targets

    def statements(self) -> list[list[Token]]:
        """Tokens of every line that has any."""
        lines: list[list[Token]] = [[]]
        for token in self.tokens:
            if token.kind == "end":
                lines.append([])
            else:
                lines[-1].append(token)
        return [tokens for tokens in lines if tokens]

    def reader(self, tokens: Sequence[Token], at: int = 0) -> Reader:
        """A place in some tokens of the program, which end like a line."""
        last = tokens[-1] if tokens else self.tokens[-1]
        return Reader([*tokens, Token("end", "", last.end, last.end, last.line)], self.text, at)

    def guarded(self, read: Callable[[Any], None], items: Iterable[object]) -> None:
        """Reads every item; lines that are not understood become faults of the program."""
        for item in items:
            try:
                read(item)
            except ProgramError as fault:
                self.faults.append((fault.line, fault.why))

    def names_a_target(self, token: Token) -> bool:
        """Whether a token that no declaration or move has read is the name of a target."""
        named = token.kind == "word" and token.text.lower() in self.names
        return named and token.start not in self.placed

    def named_target(self, move: str, name: str, line: int, *, declared: bool) -> bool:
        """Whether a move to a target by its name is corrected; --keep is for others alone.

        declared : whether it has a constant value in the program.
        """
        if name.lower() in self.options.keep:
            what = "has constant values here and is corrected" if declared else "stays as it is"
            self.notes.append(f"{name} {what} (--keep)")
        elif not declared:
            raise ProgramError(
                line,
                f"target of {move}, {name}, has no constant value in this program; write it there, "
                f"or leave it as it is by --keep {name}",
            )
        return declared

    def setup_of(self, name: str, line: int, *, joints: bool) -> MoveSetup:
        """The setup of all moves to a declared target, which has to be the same."""
        uses = self.uses.get(name.lower(), [])
        if not uses and not joints:
            raise ProgramError(
                line, f"{name}: no move of this program goes there, so its tool is not known"
            )
        for other_line, other in uses[1:]:
            if not uses[0][1].same(other, joints=joints):
                raise ProgramError(
                    line,
                    f"{name} is reached with other tools, frames or loads in lines {uses[0][0]} "
                    f"and {other_line}; declare a target for each",
                )
        return uses[0][1] if uses else MoveSetup(payload=self.options.payload(""))

    def program(self) -> RobotProgram:
        """The program as read. Raises InputError naming the lines that are not understood."""
        refuse(self.path, self.faults)
        return RobotProgram(
            self.path, self.text, tuple(self.targets), tuple(dict.fromkeys(self.notes))
        )


def computed(line: int, what: str, given: str) -> ProgramError:
    """The refusal of a value that is not of constants alone; given : what stands there."""
    return ProgramError(line, f"{what} is computed ({given}); write it with constant values")


def used_elsewhere(token: Token, moves: str) -> ProgramError:
    """The refusal of a target's name where it may be computed with."""
    return ProgramError(
        token.line,
        f"{token.text} is assigned or used outside of {moves}, so the target is computed; write it "
        "with constant values, each on a line of its own",
    )


def not_stated(line: int, what: str, option: str, name: str) -> ProgramError:
    """The refusal of a tool or frame that neither the program nor an option states."""
    return ProgramError(
        line,
        f"{what} is not stated in this program; state it by --{option} "
        f"{name}{'=' if name else ''}X,Y,Z,A,B,C",
    )


def refuse(path: Path, faults: Sequence[tuple[int, str]]) -> None:
    """Raises InputError naming lines and reasons, if there are any."""
    if not faults:
        return
    lines = [f"{path}:{line}: {why}" for line, why in sorted(set(faults))]
    more = len(lines) - FAULTS_SHOWN
    others = [f"and {more} more"] if more > 0 else []
    raise InputError("\n".join(["nothing was written.", *lines[:FAULTS_SHOWN], *others]))

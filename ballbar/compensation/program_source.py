"""A robot program while it is read: its targets, the moves to them, and what is not understood.

A target is corrected where its value stands as numbers, and where the tool, the frame and the
payload that it is reached with are stated. The readers of the three languages find declarations and
moves; what a target and a refusal are is the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.foreign_text import one_line
from ballbar.cell.payload import Payload
from ballbar.compensation.frames import FrameOptions
from ballbar.compensation.program_text import (
    Number,
    ProgramError,
    Reader,
    Token,
    Value,
    read_program_text,
    statements_of,
)

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
    setup: MoveSetup = field(default_factory=MoveSetup)
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

    COMMENTS, WORDS, END = "", "", "\n"  # patterns; what a statement ends with
    MOVES = ""  # where a target may be named, for messages
    TYPE = ""  # word that may stand before a target in numbers
    HERE: tuple[str, ...] = ()  # names of the place where the robot stands already

    def __init__(self, path: Path, options: FrameOptions) -> None:
        self.path, self.options, self.text = path, options, read_program_text(path)
        self.statements = statements_of(
            self.text, comments=self.COMMENTS, words=self.WORDS, end=self.END
        )
        self.faults: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self.targets: list[ProgramTarget] = []
        self.placed: set[int] = set()  # places of tokens that a declaration or move has read
        self.names: set[str] = set()  # lower-case names of targets, without their indices
        self.points: dict[str, list[ProgramTarget]] = {}  # declared, by lower-case name
        self.uses: dict[str, list[tuple[int, MoveSetup]]] = {}  # moves to them
        self.frames: dict[str, tuple[str, int, Value]] = {}  # type, line and value of other data

    def target(self, value: Value, name: str, line: int) -> ProgramTarget:
        """The target that a constant stands for, its setup still to be found."""
        raise NotImplementedError

    def begins_target(self, tokens: Sequence[Token], k: int) -> bool:
        """Whether a target in numbers begins at a token."""
        raise NotImplementedError

    def reader(self, tokens: Sequence[Token], line: int = 0, at: int = 0) -> Reader:
        """A place in some tokens of the program."""
        return Reader(tokens, self.text, line, at)

    def guarded(self, read: Callable[[Any], None], items: Iterable[object]) -> None:
        """Reads every item; lines that are not understood become faults of the program."""
        for item in items:
            try:
                read(item)
            except ProgramError as fault:
                self.faults.append((fault.line, fault.why))

    def constant(self, reader: Reader, what: str) -> Value:
        """The constant at a place."""
        reader.place += reader.token.isword(self.TYPE)
        return reader.value(what)

    def declared(self, reader: Reader, name: str) -> Value:
        """The value of a declaration, the last part of its statement."""
        line = reader.token.line
        value = self.constant(reader, name)
        if reader.token.kind != "end":
            raise computed(line, name, f"{reader.shown} after its value")
        return value

    def once(self, name: str, line: int) -> None:
        """Refuses a second declaration of a name."""
        if name.lower() in self.points or name.lower() in self.frames:
            raise ProgramError(
                line, f"{name} is declared twice, so it is not clear which a move means"
            )

    def declare(self, name: str, targets: list[ProgramTarget]) -> None:
        """Keeps the target of a declaration; of an array all."""
        self.points[name.lower()] = targets
        self.names.add(name.lower().partition("[")[0])

    def go(self, reader: Reader, move: Token, setup: Callable[[bool], MoveSetup]) -> None:
        """The target of a move: a constant, or the name of a declared target.

        setup : of a target of axis angles, or of a pose.
        """
        what, token, name = f"target of {move.text}", reader.token, ""
        self.placed.add(token.start)
        if token.issymbol("[", "{") or token.isword(self.TYPE):
            target = self.target(self.constant(reader, what), move.text, token.line)
            self.targets.append(replace(target, setup=setup(target.rotation is None)))
        elif token.kind != "word" or reader.following.issymbol("("):
            raise computed(move.line, what, reader.shown)
        else:
            name = reader.name()
        if reader.token.issymbol(*"(:+-*/."):
            raise computed(move.line, what, reader.shown)
        if name and name.lower() not in self.HERE:
            self._go_to(name, move, setup)

    def _go_to(self, name: str, move: Token, setup: Callable[[bool], MoveSetup]) -> None:
        """A move to a named target; --keep is for those without a constant value alone."""
        keys = (name.lower(), name.lower().partition("{")[0])
        key = next((key for key in keys if key in self.points), "")
        if keys[0] in self.options.keep:
            what = "has constant values here and is corrected" if key else "stays as it is"
            self.notes.append(f"{name} {what} (--keep)")
        elif not key:
            raise ProgramError(
                move.line,
                f"target of {move.text}, {name}, has no constant value in this program; write it "
                f"there, or leave it as it is by --keep {name}",
            )
        if key:
            joints = self.points[key][0].rotation is None
            self.uses.setdefault(key, []).append((move.line, setup(joints)))

    def elsewhere(self, tokens: Sequence[Token]) -> None:
        """Refuses targets, and their names, that no declaration or move has read."""
        for k, token in enumerate(tokens):
            if token.start in self.placed:
                continue
            if token.kind == "word" and token.text.lower() in self.names:
                raise ProgramError(
                    token.line,
                    f"{token.text} is assigned or used outside of {self.MOVES}, so its value may "
                    "be another; write it with constant values, on a line of its own",
                )
            if self.begins_target(tokens, k):
                raise ProgramError(
                    token.line,
                    f"a target is written where none is read; write it into {self.MOVES}, or "
                    "declare it, and move to it by its name",
                )

    def declared_targets(self, name: str) -> None:
        """The targets of a declaration, by the moves to it, which have to have the same setup."""
        first, uses = self.points[name][0], self.uses.get(name, [])
        joints, line = first.rotation is None, first.line
        if not uses and not joints:
            raise ProgramError(
                line, f"{first.name}: no move of this program goes there, so its tool is not known"
            )
        for other_line, other in uses[1:]:
            if not uses[0][1].same(other, joints=joints):
                raise ProgramError(
                    line,
                    f"{first.name} is reached with other tools, frames or loads in lines "
                    f"{uses[0][0]} and {other_line}; declare a target for each",
                )
        setup = uses[0][1] if uses else MoveSetup(payload=self.options.payload(""))
        self.targets += [replace(target, setup=setup) for target in self.points[name]]

    def program(self) -> RobotProgram:
        """The program as read. Raises InputError naming the lines that are not understood."""
        refuse(self.path, self.faults)
        targets = sorted(self.targets, key=lambda target: target.numbers[0].start)
        return RobotProgram(self.path, self.text, tuple(targets), tuple(dict.fromkeys(self.notes)))


def positional(value: Value, name: str, line: int, *form: str) -> list[Value]:
    """The components of an aggregate without names, as many as its form has."""
    given = list(value) if isinstance(value, dict) else []
    if not isinstance(value, dict) or given != [str(k) for k in range(len(form))]:
        raise ProgramError(
            line,
            f"{name}: {len(given)} values where {len(form)} are expected, [{','.join(form)}]; "
            "decimals have a point",
        )
    return list(value.values())


def numbers_of(values: Iterable[Value], name: str, line: int) -> tuple[Number, ...]:
    """Components that are all numbers."""
    numbers = tuple(values)
    for value in numbers:
        if not isinstance(value, Number):
            shown = repr(one_line(value.text)) if isinstance(value, Token) else "an aggregate"
            raise ProgramError(
                line, f"{name}: {shown} is no number; computed values are not corrected"
            )
    return numbers  # type: ignore[return-value]


def computed(line: int, what: str, given: str) -> ProgramError:
    """The refusal of a value that is not of constants alone; given : what stands there."""
    return ProgramError(line, f"{what} is computed ({given}); write it with constant values")


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

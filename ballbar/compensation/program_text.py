"""Text of a robot program: tokens with their places, constant values, and numbers replaced.

Only the digits of targets are replaced; everything else stays as it is, byte for byte. The text is
read as Latin-1, which gives every byte back, so comments of any encoding survive.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from ballbar.cell.errors import InputError
from ballbar.cell.foreign_files import read_regular
from ballbar.cell.foreign_text import one_line
from ballbar.cell.strict_yaml import MAX_BYTES

Kind = Literal["word", "number", "string", "symbol", "end"]
MOST_BYTES = 50 * MAX_BYTES  # ten thousand targets have one
DECIMALS = {"deg": 4, "mm": 3, "1": 8}  # at least, of numbers that are written: 2 urad, 1 um
NESTED = 12  # aggregates in one another, of targets in an array of three dimensions five
_KINDS = ("skip", "end", "string", "word", "number", "symbol")
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|'[bB][01]+'|'[hH][0-9A-Fa-f]+'"
_NO_VALUE = "computed values are not corrected, and decimals have a point"
_CLOSING = {"[": "]", "{": "}", "(": ")"}


@dataclass(frozen=True)
class Token:
    """A piece of a program."""

    kind: Kind
    text: str
    start: int
    end: int
    line: int  # from 1

    def isword(self, *words: str) -> bool:
        return self.kind == "word" and self.text.lower() in words

    def issymbol(self, *symbols: str) -> bool:
        return self.kind == "symbol" and self.text in symbols


@dataclass(frozen=True)
class Number:
    """A number of a target, its sign included."""

    text: str
    start: int
    end: int
    line: int

    @property
    def value(self) -> float:
        if self.text.startswith("'"):  # binary or hexadecimal digits of KRL, 'B010'
            return float(int(self.text[2:-1], 2 if self.text[1] in "bB" else 16))
        return float(self.text.replace(" ", "").replace("\t", ""))

    def with_integer(self, value: int) -> str:
        """The text of another integer in the same notation."""
        if not self.text.startswith("'"):
            return str(value)
        digits = len(self.text) - 3
        form = f"0{digits}b" if self.text[1] in "bB" else f"0{digits}X"
        return f"{self.text[:2]}{value:{form}}'"


# A constant: a number, a word or text, or an aggregate, whose components have names or places
Value: TypeAlias = "Number | Token | dict[str, Value]"


class ProgramError(Exception):
    """Lines that are not understood; nothing of the program may be written then."""

    def __init__(self, line: int, why: str) -> None:
        super().__init__(why)
        self.line, self.why = line, why


def read_program_text(path: Path) -> str:
    """The text of a program, a character for each byte.

    Raises InputError for a file that holds no text in an encoding of eight bits.
    """
    content = read_regular(path, MOST_BYTES)
    if b"\0" in content:
        raise InputError(
            f"{path}: holds NUL bytes, so it is no text of eight bits a character; save the "
            "program as the controller does (Latin-1 or UTF-8)"
        )
    return content.decode("latin-1")


def statements_of(text: str, *, comments: str, words: str, end: str) -> list[list[Token]]:
    """Statements of a program, as their tokens without comments and blanks.

    comments, words : patterns. end : what a statement ends with, a semicolon or the end of a line.
    """
    pattern = re.compile(
        rf"(?P<end>{end})|(?P<skip>{comments}|(?:(?!{end})\s)+)|(?P<string>\"(?:[^\"\n]|\"\")*\")"
        rf"|(?P<word>{words})|(?P<number>{_NUMBER})|(?P<symbol>:=|<>|<=|>=|.)",
        re.DOTALL,
    )
    statements, line = list[list[Token]]([[]]), 1
    for match in pattern.finditer(text):
        kind = next(kind for kind in _KINDS if match[kind])
        if kind == "end":
            statements.append([])
        elif kind != "skip":
            statements[-1].append(Token(kind, match[0], *match.span(), line))  # type: ignore[arg-type]
        line += match[0].count("\n")
    return [tokens for tokens in statements if tokens]


def parts(tokens: Iterable[Token], separator: str) -> list[list[Token]]:
    """Tokens between separators that are not within brackets of any kind."""
    split: list[list[Token]] = [[]]
    depth = 0
    for token in tokens:
        depth += token.issymbol("(", "[", "{") - token.issymbol(")", "]", "}")
        if depth == 0 and token.issymbol(separator):
            split.append([])
        else:
            split[-1].append(token)
    return split


class Reader:
    """A place in the tokens of a statement."""

    def __init__(self, tokens: Sequence[Token], source: str, line: int, place: int = 0) -> None:
        """source : text of the program. line : for messages where there are no tokens."""
        line = tokens[-1].line if tokens else line
        self.tokens, self.source = [*tokens, Token("end", "", 0, 0, line)], source
        self.place = place

    @property
    def token(self) -> Token:
        return self.tokens[min(self.place, len(self.tokens) - 1)]

    @property
    def following(self) -> Token:
        return self.tokens[min(self.place + 1, len(self.tokens) - 1)]

    def next(self) -> Token:
        token = self.token
        self.place += 1
        return token

    def take(self, *symbols: str) -> bool:
        """Whether the next token is one of the symbols, which is then passed."""
        taken = self.token.issymbol(*symbols)
        self.place += taken
        return taken

    def name(self) -> str:
        """A name with the index that it may have in brackets."""
        name = self.next().text
        if self.token.issymbol("[", "{"):
            closing = _CLOSING[self.token.text]
            while self.token.kind != "end" and not name.endswith(closing):
                name += self.next().text
        return name

    @property
    def shown(self) -> str:
        """The next token, for a message."""
        ended = self.token.kind == "end"
        return "the end of the statement" if ended else repr(one_line(self.token.text))

    def value(self, what: str, depth: int = 0) -> Value:
        """A constant value. what : names it in the ProgramError that is raised for any other."""
        if self.token.issymbol(*_CLOSING):
            return self._aggregate(what, depth)
        self.take("#")  # of an enumeration
        if self.token.kind in ("word", "string"):
            return self.next()
        first, signed = self.token, self.take("-", "+")
        if self.token.kind != "number":
            raise ProgramError(first.line, f"{what}: {self.shown} is no number; {_NO_VALUE}")
        last = self.next()
        if signed and self.source[first.end : last.start].strip(" \t"):
            raise ProgramError(first.line, f"{what}: a sign stands apart from its number")
        return Number(self.source[first.start : last.end], first.start, last.end, last.line)

    def _aggregate(self, what: str, depth: int) -> dict[str, Value]:
        opening = self.next()
        if depth == NESTED:
            raise ProgramError(opening.line, f"{what}: aggregates more than {NESTED} deep")
        if self.following.issymbol(":"):
            self.place += 2  # the type before the components of KRL
        components: dict[str, Value] = {}
        while True:
            named = self.token.kind == "word" and not self.following.issymbol(",", *"]})")
            key = self.name().lower() if named else str(len(components))
            if key in components:
                raise ProgramError(opening.line, f"{what}: {key.upper()} stands twice")
            components[key] = self.value(what, depth + 1)
            if self.take(_CLOSING[opening.text]):
                return components
            if not self.take(","):
                raise ProgramError(
                    self.token.line,
                    f"{what}: expected a comma or {_CLOSING[opening.text]!r}, there is "
                    f"{self.shown}; {_NO_VALUE}",
                )


def rewritten(text: str, changes: Iterable[tuple[Number, str]]) -> str:
    """The text with some of its numbers replaced."""
    pieces, place = [], 0
    for number, new in sorted(changes, key=lambda change: change[0].start):
        pieces += [text[place : number.start], new]
        place = number.end
    return "".join((*pieces, text[place:]))


def number_text(number: Number, before: float, after: float, unit: str) -> str:
    """A number as the program has it where it does not change, otherwise with its decimals.

    before, after : what the text stands for, and what it shall stand for.
    """
    mantissa = number.text.lower().split("e")
    fraction = mantissa[0].partition(".")[2] if len(mantissa) == 1 else ""
    decimals = max(len(fraction), DECIMALS[unit])
    if abs(after - before) < 0.5 * 10.0**-decimals:
        return number.text
    return f"{number.value + after - before:.{decimals}f}"

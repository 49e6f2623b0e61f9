"""Text of a robot program: tokens with their places, and numbers of it replaced.

Only the digits of targets are replaced; everything else stays as it is, byte for byte. The text is
read as Latin-1, which gives every byte back, so comments of any encoding survive.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cell.errors import InputError
from cell.foreign_files import read_regular
from cell.foreign_text import one_line
from cell.strict_yaml import MAX_BYTES

Kind = Literal["word", "number", "string", "symbol", "end"]
MOST_BYTES = 50 * MAX_BYTES  # ten thousand targets have one
DECIMALS = {"deg": 4, "mm": 3, "1": 8}  # at least, of numbers that are written: 2 urad, 1 um
_KINDS = ("skip", "newline", "string", "word", "number", "symbol")
_NUMBER = re.compile(r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


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


def tokens_of(text: str, comments: str, *, lines: bool, words: str) -> list[Token]:
    """Tokens of a program without comments and blanks.

    comments : pattern of a comment. lines : whether the end of a line is a token. words : pattern
    of names and keywords.
    """
    pattern = re.compile(
        rf"(?P<skip>{comments}|[^\S\n]+)|(?P<newline>\n)|(?P<string>\"(?:[^\"\n]|\"\")*\")"
        rf"|(?P<word>{words})|(?P<number>{_NUMBER.pattern})|(?P<symbol>:=|<>|<=|>=|.)",
        re.DOTALL,
    )
    tokens, line = [], 1
    for match in pattern.finditer(text):
        piece, named = match[0], next(kind for kind in _KINDS if match[kind])
        if named == "newline":
            if lines:
                tokens.append(Token("end", "\n", *match.span(), line))
        elif named != "skip":
            tokens.append(Token(named, piece, *match.span(), line))  # type: ignore[arg-type]
        line += piece.count("\n")
    tokens.append(Token("end", "", len(text), len(text), line))
    return tokens


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
    """A place in the tokens of a program."""

    def __init__(self, tokens: Sequence[Token], text: str, place: int = 0) -> None:
        self.tokens, self.text, self.place = tokens, text, place

    @property
    def token(self) -> Token:
        return self.tokens[min(self.place, len(self.tokens) - 1)]

    def next(self) -> Token:
        token = self.token
        self.place += 1
        return token

    def take(self, *symbols: str) -> bool:
        """Whether the next token is one of the symbols, which is then passed."""
        if self.token.issymbol(*symbols):
            self.place += 1
            return True
        return False

    def expect(self, symbol: str, what: str) -> Token:
        if not self.token.issymbol(symbol):
            raise ProgramError(
                self.token.line, f"{what}: expected {symbol!r}, there is {self.shown}"
            )
        return self.next()

    def name(self, brackets: str) -> str:
        """A name with the index that it may have in brackets such as []."""
        name = self.next().text
        if self.token.issymbol(brackets[0]):
            while self.token.kind != "end" and not name.endswith(brackets[1]):
                name += self.next().text
        return name

    @property
    def shown(self) -> str:
        """The next token, for a message."""
        return (
            "the end of the line" if self.token.kind == "end" else repr(one_line(self.token.text))
        )

    def number(self, what: str) -> Number:
        """A number with its sign, and nothing computed."""
        first = self.token
        signed = self.take("-", "+")
        if self.token.kind != "number":
            raise ProgramError(
                first.line, f"{what}: {self.shown} is no number; computed values are not corrected"
            )
        last = self.next()
        if signed and self.text[first.end : last.start].strip(" \t"):
            raise ProgramError(first.line, f"{what}: a sign stands apart from its number")
        start = first.start if signed else last.start
        return Number(self.text[start : last.end], start, last.end, last.line)


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

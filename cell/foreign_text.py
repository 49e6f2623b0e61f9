"""Text that others wrote, made harmless where it would act.

A terminal obeys control characters, a controller runs what follows a line break, a spreadsheet runs
cells that begin with `=`, Markdown draws what looks like a table or a tag. Titles, names of files
and columns, notes and messages pass one of these functions on their way there.
"""

from __future__ import annotations

import re
import unicodedata

# control, invisible (direction of writing among them), surrogate, line and paragraph separator
_ACTING = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
_FORMULA = ("=", "+", "-", "@", "\t", "\n")  # first characters of a cell that is run
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\Z")
_MARKDOWN = re.compile(r"([\\`*_\[\]<>|])")


def is_printable(text: str, allowed: str = "") -> bool:
    """Whether a text holds no control, invisible or line-breaking character but the allowed."""
    return text.isprintable() or not _acting(text, allowed)


def printable(text: str, allowed: str = "\n") -> str:
    """The text with its control, invisible and line-breaking characters as escapes, `\\x1b`."""
    if text.isprintable():
        return text
    if not (acting := _acting(text, allowed)):
        return text
    return text.translate({ord(c): c.encode("unicode_escape").decode("ascii") for c in acting})


def one_line(text: str) -> str:
    """The text as one printable line."""
    return printable(" ".join(text.split()), allowed="")


def comment(mark: str, text: str) -> str:
    """A line of comment in a controller's program: one line, ASCII.

    Controllers read Latin-1 as well as UTF-8, and a byte of the one can end a line in the other.
    """
    line = printable(text, allowed="")
    return f"{mark} {line.encode('ascii', 'backslashreplace').decode()}"


def csv_text(text: str) -> str:
    """The text of a CSV cell that no spreadsheet runs: a formula gets an apostrophe before it.

    A carriage return becomes a line feed: CPython before 3.11.9 writes it without quotes, and what
    follows would begin a cell.
    """
    text = text.replace("\r", "\n")
    return f"'{text}" if text.startswith(_FORMULA) and not _NUMBER.match(text) else text


def markdown(text: str) -> str:
    """The text as one line of Markdown in which nothing is marked up."""
    return _MARKDOWN.sub(r"\\\1", one_line(text))


def _acting(text: str, allowed: str) -> set[str]:
    """Characters of a text that act."""
    return {c for c in set(text) - set(allowed) if unicodedata.category(c) in _ACTING}

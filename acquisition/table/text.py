"""A device file as lines of text and their fields, however it was saved and wherever it was cut.

A log that stopped with the power ends in half a line or in a block of NUL bytes. A half line can
look whole (`2000000049` cut to `200000` is a number too), so a last line without line end is never
used. Encodings: byte order mark, else UTF-8, else Windows-1252, which is what European Windows
writes.
"""

from __future__ import annotations

import bz2
import csv
import errno
import gzip
import lzma
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.report import Finding, finding
from ballbar.cell.errors import LogError, UnfinishedLogError
from ballbar.cell.foreign_files import open_regular

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blank"}
HEAD = 50  # lines among which the header is looked for
_TORN = "?"  # stands for a line whose quotes do not close; no number and no column has that name


def split_fields(line: str, separator: str) -> list[str]:
    """The fields of one line, without quotes and surrounding blanks."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error:
        return [_TORN]


def is_number(field: str) -> bool:
    """Whether a field is a number, with a decimal point or comma."""
    try:
        float(field.replace(",", "."))
    except ValueError:
        return False
    return True


def likely_separator(text: LogText) -> str:
    """The separator of the last line: beside semicolons and tabs, commas are decimal commas."""
    return next((s for s in (";", "\t", ",") if s in text.lines[-1]), " ")


def column_names(text: LogText) -> list[str]:
    """Fields of the header: the first line with as many fields as the last one."""
    separator = likely_separator(text)
    width = len(split_fields(text.lines[-1], separator))
    fields = (split_fields(line, separator) for line in text.lines[:HEAD])
    return next((row for row in fields if len(row) == width), [])


MOST_BYTES = 2_000_000_000  # of one file: fifty hours of a robot's log
# A packed file may claim anything. Logs shrink to a third (gzip) or a sixth (xz).
_UNPACKED_FREE = 50_000_000  # bytes that every packed file may unpack to
_UNPACKED_RATIO = 15  # of bytes unpacked to packed, beyond that
LONGEST_LINE = 100_000  # bytes; a thousand names take half of it
_LARGE = 10_000_000  # characters of a text whose rows are a time stamp and a value at least,
_QUOTES = 0.6  # of the characters; "0","0" has half
_SHORTEST_ROW = 10  # characters on average; each row takes 60 bytes beside its text
_PACKED: dict[str, Callable[[BinaryIO], Any]] = {
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
}
_MARKS = (  # byte order mark, codec, bytes of an ASCII character
    (b"\xef\xbb\xbf", "utf-8", 1),
    (b"\xff\xfe", "utf-16-le", 2),
    (b"\xfe\xff", "utf-16-be", 2),
)


@dataclass(frozen=True, eq=False)
class Content:
    """The bytes of one device file, unpacked."""

    raw: bytes
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class LogText:
    """The complete, non-blank lines of one device file."""

    file: str  # as recording.yaml names it
    encoding: str
    lines: list[str]
    number: NDArray[np.int64]  # line number of each, counted from 1
    quoted: bool  # whether there are quotes in it
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class _Decoded:
    text: str
    encoding: str
    width: int  # bytes of an ASCII character
    mark: int  # bytes of the byte order mark
    size: int  # bytes of the file


def read_text(path: Path, file: str) -> LogText:
    """Complete lines of a device file; its findings say what was left out or converted.

    file : the name that errors and findings give it.
    Raises LogError if the file is missing, unreadable or empty, or has NUL bytes inside a row.
    """
    return text_of(read_filled(path, file), file)


def read_filled(path: Path, file: str) -> Content:
    """The content of a device file as `read_bytes` gives it, at least one byte.

    Raises LogError if the file is missing, unreadable or empty.
    """
    with open_filled(path, file) as (source, findings):
        return Content(source.read(), findings)


def require_file(path: Path, file: str, description: str = "recording.yaml") -> None:
    """Raises LogError if there is no file at a path that `description` names `file`."""
    if not path.is_file():
        what = f"no such file (looked for {path})."
        raise LogError.at(file, what, f"Correct the name in {description}, or copy the file there.")


@contextmanager
def open_filled(path: Path, file: str) -> Iterator[tuple[BinaryIO, tuple[Finding, ...]]]:
    """A device file of at least one byte, open and unpacked, with what was found unpacking it.

    Raises as `read_filled` does, also where reading fails inside the `with`.
    """
    require_file(path, file)
    with _opened(path, file) as (source, findings):
        if not source.read(1):
            raise UnfinishedLogError(f"{file}: the file is empty. Copy it again from the logger.")
        source.seek(0)
        yield source, findings


def text_of(content: Content, file: str) -> LogText:
    """Complete lines of the content of a device file, as `read_text` gives them."""
    decoded, findings = _decode(content.raw), list(content.findings)
    if decoded.encoding != "utf-8":
        sentence = f"read as {decoded.encoding}."
        findings.append(finding("encoding", file, sentence, count=1))
    text = decoded.text.rstrip("\0")
    if len(text) > _LARGE:
        ends = text.count("\n") + text.count("\r")
        if len(text) < _SHORTEST_ROW * ends or _QUOTES * len(text) < text.count('"'):
            what = "hardly more than line ends or quotes."
            raise LogError.at(file, what, "Copy it again from the logger.")
    if stripped := (len(decoded.text) - len(text)) * decoded.width:
        first, last = decoded.size - stripped, decoded.size - 1
        sentence = f"bytes {first} to {last} are NUL (power loss); left out."
        findings.append(finding("NUL block at the end", file, sentence, count=1))
    if "\0" in text:
        raise LogError(_nul_inside(text, decoded, file))
    if not text:
        raise LogError(f"{file}: the file holds nothing but NUL bytes. Copy it again.")
    windows = "\r" in text and text.count("\r") == text.count("\n") == text.count("\r\n")
    lines = text.split("\r\n") if windows else _universal_newlines(text).split("\n")
    if lines.pop():
        findings.append(unterminated(file, len(lines) + 1))
    _refuse_long(lines, file)
    number = np.arange(1, len(lines) + 1, dtype=np.int64)
    if not all(lines) or any(map(str.isspace, lines)):
        filled = np.array([bool(line.strip()) for line in lines], dtype=bool)
        blank = np.flatnonzero(~filled) + 1
        findings.append(finding("blank line", file, "skipped.", lines=blank))
        lines, number = [line for line in lines if line.strip()], number[filled]
    if not lines:
        raise LogError(f"{file}: the file holds no complete line. Copy it again.")
    return LogText(file, decoded.encoding, lines, number, '"' in text, tuple(findings))


def _refuse_long(lines: list[str], file: str) -> None:
    """Raises LogError for a line that is longer than any of a log."""
    longest = max(map(len, lines), default=0)
    if longest > LONGEST_LINE:
        number = 1 + next(k for k, line in enumerate(lines) if len(line) == longest)
        raise LogError(
            f"{file}:{number}: a line of {longest} characters, and logs have lines of at most "
            f"{LONGEST_LINE}. Is this the file that the logger wrote? Copy it again."
        )


def unterminated(file: str, line: int) -> Finding:
    """The finding for a last line that was cut off."""
    sentence = "the last line has no line end, so it may be cut inside a number; dropped."
    return finding("unterminated last line", file, sentence, lines=[line])


def read_bytes(path: Path, file: str) -> Content:
    """The content of a device file, unpacked; of a packed file that was cut off, what it holds.

    Raises LogError if it cannot be read or unpacked.
    """
    with _opened(path, file) as (source, findings):
        return Content(source.read(), findings)


@contextmanager
def _opened(path: Path, file: str) -> Iterator[tuple[BinaryIO, tuple[Finding, ...]]]:
    """A device file, open and unpacked; raises LogError as `read_bytes` does."""
    suffix = path.suffix.lower()
    if suffix in (".zst", ".zip", ".7z", ".rar"):
        remedy = "Unpack it first, or use .gz, .bz2 or .xz."
        raise LogError(f"{file}: packed in a way that is not read here. {remedy}")
    try:
        with open_regular(path, MOST_BYTES) as source:
            if suffix in _PACKED:
                stored = os.fstat(source.fileno()).st_size
                content = _unpacked(_PACKED[suffix](source), file, stored)
                yield BytesIO(content.raw), content.findings
            else:
                yield source, ()
    except (gzip.BadGzipFile, lzma.LZMAError, zlib.error) as error:
        what = f"is no {path.suffix} file, or damaged: {error}."
        raise LogError.at(file, what, "Copy it again.") from None
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise LogError(f"{file}: {error.strerror}. Split it into one file a run.") from None
        what = f"cannot be read: {error.strerror or error}."
        raise LogError.at(file, what, "Check its permissions, or copy it again.") from None


def check_unpacked(size: int, stored: int, file: str) -> None:
    """Raises LogError if a file of so many stored bytes unpacks to more than a log does."""
    most = min(MOST_BYTES, max(_UNPACKED_FREE, _UNPACKED_RATIO * stored))
    if size > most:
        what = f"unpacks to more than {most / 1e6:.0f} MB, which no log of its size does."
        remedy = f"Unpack it yourself; at most {MOST_BYTES / 1e6:.0f} MB are read."
        raise LogError.at(file, what, remedy)


def _unpacked(packed: Any, file: str, stored: int) -> Content:
    parts, size, findings = [], 0, list[Finding]()
    with packed:
        while True:
            try:
                part = packed.read1(1 << 20)  # what there is, so that a cut file gives all it holds
            except EOFError:
                sentence = "what it holds up to there is read."
                findings.append(finding("packed file cut off", file, sentence, count=1))
                break
            if not part:
                break
            size += len(part)
            check_unpacked(size, stored, file)
            parts.append(part)
    return Content(b"".join(parts), tuple(findings))


def _decode(raw: bytes) -> _Decoded:
    for mark, codec, width in _MARKS:
        if raw.startswith(mark):
            # "replace": an odd byte at a torn end becomes U+FFFD, which no number contains.
            text = raw[len(mark) :].decode(codec, "replace")
            return _Decoded(text, f"{codec} with byte order mark", width, len(mark), len(raw))
    try:
        return _Decoded(raw.decode("utf-8"), "utf-8", 1, 0, len(raw))
    except UnicodeDecodeError:
        return _Decoded(raw.decode("cp1252", "replace"), "cp1252", 1, 0, len(raw))


def _nul_inside(text: str, decoded: _Decoded, file: str) -> str:
    """The error message for NUL bytes that are not at the end."""
    before = text[: text.index("\0")]
    location = f"{file}:{_universal_newlines(before).count(chr(10)) + 1}"
    if "\0" * 100 in (text[0:200:2], text[1:201:2]):
        why = "every other byte is NUL: UTF-16 without byte order mark"
        return f"{location}: {why}. Save the file as UTF-8."
    length = len(text) - len(before) - len(text[len(before) :].lstrip("\0"))
    # One byte a character is exact up to the first non-ASCII one, which a log has at most in its
    # header.
    first = decoded.mark + decoded.width * len(before)
    last = first + decoded.width * length - 1
    why = f"NUL bytes inside the row (bytes {first} to {last})"
    return f"{location}: {why}. The file is damaged here: split it around this line."


def _universal_newlines(text: str) -> str:
    return text if "\r" not in text else text.replace("\r\n", "\n").replace("\r", "\n")

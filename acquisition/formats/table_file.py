"""Every kind of file that holds poses as the lines of a table: text, workbook, RAPID, KUKA RSI."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from acquisition.formats.messages import rsi_text
from acquisition.formats.rapid import holds_jointtargets, jointtarget_text
from acquisition.formats.registry import container_of
from acquisition.formats.workbook import holds_workbook, workbook_text
from acquisition.report import finding
from acquisition.table.fields import SEPARATORS, is_number, split_fields
from acquisition.table.text import LogText, read_bytes, text_of
from cell.errors import LogError

FileKind = Literal["table", "workbook", "rapid", "kuka-rsi"]
_COMMENTS = ("#", "%", "//")


def pose_text(path: Path, file: str, sheet: str | None = None) -> tuple[LogText, FileKind]:
    """The lines of a file that holds poses, and what kind of file it is.

    file : the name that errors and findings give it. sheet : of a workbook; else its first one.
    Raises LogError if the file is missing, unreadable, empty, or of a kind that holds no poses.
    """
    if not path.is_file():
        raise LogError(
            f"{file}: no such file (looked for {path}). Correct the name in poses.yaml; a path is "
            "taken from the folder of that file."
        )
    content = read_bytes(path, file)
    if not content.raw:
        raise LogError(f"{file}: the file is empty. Export it again.")
    if holds_workbook(content.raw):
        return workbook_text(content, file, sheet), "workbook"
    if sheet is not None:
        raise LogError(f"{file}: is no workbook, so it has no sheet {sheet!r}. Leave `sheet` out.")
    if content.raw.startswith(b"\xd0\xcf\x11\xe0"):
        raise LogError(f"{file}: a workbook of the old kind (.xls). Save it as .xlsx or .csv.")
    kind = container_of(content.raw)
    text = text_of(content, file) if kind in ("text", "kuka-rsi", "twincat-scope") else None
    if text is None:
        raise LogError(
            f"{file}: a log ({kind}), not a table of still poses. Record one row for each pose, or "
            "read the log as a recording (recording.yaml)."
        )
    if kind == "kuka-rsi":
        return rsi_text(text), "kuka-rsi"
    if holds_jointtargets(text):
        return jointtarget_text(text), "rapid"
    return _without_comments(text), "table"


def _without_comments(text: LogText) -> LogText:
    """The lines without comments; a comment right above the rows that names them is the header."""
    comment = np.array([line.lstrip().startswith(_COMMENTS) for line in text.lines], dtype=bool)
    if not comment.any():
        return text
    if comment.all():
        raise LogError(f"{text.file}: the file holds nothing but comments. Export it again.")
    first = int(np.argmin(comment))
    header = _header_in(text.lines[first - 1], text.lines[first]) if first else None
    lines = list(text.lines)
    if header is not None:
        lines[first - 1], comment[first - 1] = header, False
    entry = finding("comment line", text.file, "skipped.", lines=text.number[comment])
    rows = np.flatnonzero(~comment)
    return replace(
        text,
        lines=[lines[row] for row in rows],
        number=text.number[rows],
        findings=(*text.findings, entry) if comment.any() else text.findings,
    )


def _header_in(comment: str, row: str) -> str | None:
    """The names that a comment gives the fields of a row of numbers; None if it gives none."""
    names = comment.strip().lstrip("#%/ ")
    for separator in SEPARATORS:
        cells = split_fields(row, separator)
        titles = split_fields(names, separator)
        if len(cells) > 1 and len(titles) == len(cells) and any(map(is_number, cells)):
            return None if any(map(is_number, titles)) else names
    return None

"""Every kind of file that holds poses as the lines of a table: text, workbook, RAPID, KUKA RSI.

Of an Excel workbook (.xlsx) one sheet is read, by openpyxl (extra `xlsx`). Of an ABB RAPID module
the joint targets are, as the module lists them:

    CONST jointtarget p10:=[[0,-15.2,30,0,45,10],[9E9,9E9,9E9,9E9,9E9,9E9]];

Their angles are degrees of the controller's axes. Targets of an array and of `MoveAbsJ` are read
too, comments (`! ...`) are not. Source: ABB, Technical reference manual RAPID, jointtarget.
"""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ballbar.acquisition.formats.messages import rsi_text
from ballbar.acquisition.formats.registry import container_of
from ballbar.acquisition.report import finding
from ballbar.acquisition.table.text import (
    SEPARATORS,
    Content,
    LogText,
    check_unpacked,
    is_number,
    read_bytes,
    require_file,
    split_fields,
    text_of,
)
from ballbar.cell.errors import LogError, imports_for

_ZIP = b"PK\x03\x04"  # a workbook is a zip archive


def workbook_text(content: Content, file: str, sheet: str | None) -> LogText:
    """The filled rows of a sheet, cells separated by tabs, numbers as the workbook stores them.

    sheet : its name; the first one if None.
    Raises LogError if the file is no workbook, or has no such sheet; InputError without openpyxl.
    """
    with imports_for(f"{file}: a workbook", "ballbar-bench[xlsx]"):
        import openpyxl  # noqa: PLC0415
    try:
        with zipfile.ZipFile(io.BytesIO(content.raw)) as archive:
            check_unpacked(
                sum(part.file_size for part in archive.infolist()), len(content.raw), file
            )
        book = openpyxl.load_workbook(io.BytesIO(content.raw), read_only=True, data_only=True)
    except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        what = f"is no workbook (.xlsx), or damaged: {error}."
        raise LogError.at(file, what, "Save it again, or as .csv.") from None
    names = book.sheetnames
    if sheet is not None and sheet not in names:
        raise LogError(f"{file}: no sheet {sheet!r}; it has {', '.join(names)}. Name one of them.")
    lines, number = [], []
    for row, cells in enumerate(book[sheet or names[0]].iter_rows(values_only=True), start=1):
        line = "\t".join(map(_text, cells)).rstrip("\t")
        if line.strip():
            lines.append(line)
            number.append(row)
    book.close()
    if not lines:
        what = f"sheet {sheet or names[0]!r} is empty."
        raise LogError.at(file, what, f"Name another: {', '.join(names)}.")
    width = max(line.count("\t") for line in lines)
    for k, line in enumerate(lines):
        # columns that a line of names leaves without name get `-`
        named = not any(map(is_number, line.split("\t")))
        lines[k] += ("\t-" if named else "\t") * (width - line.count("\t"))
    return LogText(
        file=file,
        encoding="xlsx",
        lines=lines,
        number=np.array(number, dtype=np.int64),
        quoted=False,
        findings=content.findings,
    )


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, datetime):
        return cell.isoformat(" ")
    return " ".join(str(cell).split())


COLUMNS = tuple(f"rax_{k} [deg]" for k in range(1, 7))
_NUMBER = r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*"
_TARGET = re.compile(rf"\[\s*\[{','.join([_NUMBER] * 6)}\]\s*,\s*\[[^\[\]]*\]\s*\]")
_BEGINS = re.compile(r"\bjointtarget\b|\bMoveAbsJ\b", re.IGNORECASE)
_LIST = re.compile(r"\[\s*\[\s*[-+0-9.]")


def jointtarget_text(text: LogText) -> LogText:
    """A table of COLUMNS with the axis angles [deg] of every joint target.

    Raises LogError for a target that has not six angles, or one of 9E9 (an axis that is absent).
    """
    code = [line.partition("!")[0] for line in text.lines]
    joined, starts = "\n".join(code), np.cumsum([0, *(len(line) + 1 for line in code[:-1])])
    rows, number = ["\t".join(COLUMNS)], [0]
    for statement in re.finditer(r"[^;]*;?", joined):
        if not _BEGINS.search(statement[0]):
            continue
        targets = list(_TARGET.finditer(statement[0]))
        at = statement.start() + (statement[0].find("[") if "[" in statement[0] else 0)
        if len(targets) != len(_LIST.findall(statement[0])) or not statement[0].endswith(";"):
            line = int(text.number[np.searchsorted(starts, at, side="right") - 1])
            what = "expected a jointtarget of six angles and six external axes."
            raise LogError.at(f"{text.file}:{line}", what, "Correct the line; is the file cut off?")
        for target in targets:
            place = statement.start() + target.start()
            line = int(text.number[np.searchsorted(starts, place, side="right") - 1])
            if any(float(angle) > 8.9e9 for angle in target.groups()):
                what = "9E9 for a robot axis, which stands for an axis that is not there."
                raise LogError.at(f"{text.file}:{line}", what, "Remove the target.")
            rows.append("\t".join(target.groups()))
            number.append(line)
    if len(rows) == 1:
        remedy = "Positions of the tool (robtarget) do not state joint angles: export jointtargets."
        raise LogError.at(text.file, "RAPID code without jointtargets that hold angles.", remedy)
    return replace(text, lines=rows, number=np.array(number, dtype=np.int64), quoted=False)


FileKind = Literal["table", "workbook", "rapid", "kuka-rsi"]
_COMMENTS = ("#", "%", "//")


def pose_text(path: Path, file: str, sheet: str | None = None) -> tuple[LogText, FileKind]:
    """The lines of a file that holds poses, and what kind of file it is.

    file : the name that errors and findings give it. sheet : of a workbook; else its first one.
    Raises LogError if the file is missing, unreadable, empty, or of a kind that holds no poses.
    """
    require_file(path, file, "poses.yaml")
    content = read_bytes(path, file)
    if not content.raw:
        raise LogError(f"{file}: the file is empty. Export it again.")
    if content.raw.startswith(_ZIP):
        return workbook_text(content, file, sheet), "workbook"
    if sheet is not None:
        raise LogError(f"{file}: is no workbook, so it has no sheet {sheet!r}. Leave `sheet` out.")
    if content.raw.startswith(b"\xd0\xcf\x11\xe0"):
        raise LogError(f"{file}: a workbook of the old kind (.xls). Save it as .xlsx or .csv.")
    kind = container_of(content.raw)
    text = text_of(content, file) if kind in ("text", "kuka-rsi", "twincat-scope") else None
    if text is None:
        remedy = "Record one row for each pose, or read the log as a recording (recording.yaml)."
        raise LogError.at(file, f"a log ({kind}), not a table of still poses.", remedy)
    if kind == "kuka-rsi":
        return rsi_text(text), "kuka-rsi"
    if any(_BEGINS.search(line) and "[" in line for line in text.lines):
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

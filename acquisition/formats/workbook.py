"""One sheet of an Excel workbook (.xlsx) as the lines of a table; needs openpyxl (extra `xlsx`)."""

from __future__ import annotations

import io
import zipfile
from datetime import datetime
from typing import Any

import numpy as np

from acquisition.table.fields import is_number
from acquisition.table.text import Content, LogText, check_unpacked
from cell.errors import InputError, LogError

_ZIP = b"PK\x03\x04"


def holds_workbook(raw: bytes) -> bool:
    """Whether the content of a file is a zip archive, as workbooks are."""
    return raw.startswith(_ZIP)


def workbook_text(content: Content, file: str, sheet: str | None) -> LogText:
    """The filled rows of a sheet, cells separated by tabs, numbers as the workbook stores them.

    sheet : its name; the first one if None.
    Raises LogError if the file is no workbook, or has no such sheet; InputError without openpyxl.
    """
    try:
        import openpyxl  # noqa: PLC0415  an extra
    except ImportError:
        raise InputError(
            f"{file}: workbooks are read by openpyxl, which is not installed. Install it with "
            "`pip install ballbar-bench[xlsx]`, or save the sheet as .csv."
        ) from None
    try:
        with zipfile.ZipFile(io.BytesIO(content.raw)) as archive:
            check_unpacked(
                sum(part.file_size for part in archive.infolist()), len(content.raw), file
            )
        book = openpyxl.load_workbook(io.BytesIO(content.raw), read_only=True, data_only=True)
    except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise LogError(
            f"{file}: is no workbook (.xlsx), or damaged: {error}. Save it again, or as .csv."
        ) from None
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
        raise LogError(
            f"{file}: sheet {sheet or names[0]!r} is empty. Name another: {', '.join(names)}."
        )
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

"""The fields of a line of a device table, and those that a text shows before a dialect is known."""

from __future__ import annotations

import csv

from acquisition.table.text import LogText

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

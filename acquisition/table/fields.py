"""The fields of one line of a device table."""

from __future__ import annotations

import csv

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blank"}
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

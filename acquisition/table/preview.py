"""What a text log shows of its table before a dialect is known: separator and column names."""

from __future__ import annotations

from acquisition.table.fields import split_fields
from acquisition.table.text import LogText

HEAD = 50  # lines among which the header is looked for


def likely_separator(text: LogText) -> str:
    """The separator of the last line: beside semicolons and tabs, commas are decimal commas."""
    return next((s for s in (";", "\t", ",") if s in text.lines[-1]), " ")


def column_names(text: LogText) -> list[str]:
    """Fields of the header: the first line with as many fields as the last one."""
    separator = likely_separator(text)
    width = len(split_fields(text.lines[-1], separator))
    fields = (split_fields(line, separator) for line in text.lines[:HEAD])
    return next((row for row in fields if len(row) == width), [])

"""Which columns a log must have, and where the header says they are: separator, names in any order.

The separator is the one under which the header shows most of the wanted names; rows that use another one are refused.
"""

from __future__ import annotations

import csv
import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from acquisition.report import Finding, finding
from acquisition.text import LogText
from cell.errors import LogError

Kind = Literal["integer", "float"]
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
_TORN = "?"  # stands for a line whose quotes do not close; no number and no column is called that


@dataclass(frozen=True)
class Layout:
    """The columns of a log, by name."""

    separators: tuple[str, ...]  # those the dialect allows
    required: Mapping[str, Kind]
    optional: Mapping[str, Kind] = field(default_factory=dict)  # read where present
    together: tuple[str, ...] = ()  # those of the optional ones that stand all or none


@dataclass(frozen=True)
class Header:
    """The header as found: where each wanted column stands."""

    separator: str
    names: tuple[str, ...]
    columns: Mapping[str, Kind]  # the wanted columns that are present

    @property
    def positions(self) -> list[int]:
        """Field number, from 0, of each wanted column."""
        return [self.names.index(name) for name in self.columns]


def split_fields(line: str, separator: str) -> list[str]:
    """The fields of one line, quotes and surrounding blanks removed."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error:
        return [_TORN]


def read_header(text: LogText, layout: Layout, findings: list[Finding]) -> Header:
    """The header, which is the first line; columns that nothing reads are appended to `findings`.

    Raises LogError if there is no header, a column is missing or stands twice, a set of optional columns is incomplete, or
    the separator is not the dialect's.
    """
    place = f"{text.file}:{text.number[0]}"
    known = {**layout.required, **layout.optional}
    separator = max(SEPARATORS, key=lambda s: _names_found(text.lines[0], s, known))
    names = split_fields(text.lines[0], separator)
    if all(_is_number(name) for name in names):
        raise LogError(f"{place}: the first line holds numbers, not column names. Expected a header with {', '.join(layout.required)}.")
    strange = [name for name in names if name and name not in known]
    _refuse_missing(place, names, strange, layout)
    _refuse_incomplete(place, names, strange, layout)
    if separator not in layout.separators:
        allowed = " or ".join(SEPARATORS[s] for s in layout.separators)
        raise LogError(f"{place}: fields are separated by {SEPARATORS[separator]}; this dialect has {allowed}.")
    twice = sorted({name for name in names if name in known and names.count(name) > 1})
    if twice:
        raise LogError(f"{place}: column {twice[0]} stands {names.count(twice[0])} times in the header. Remove the others.")
    if strange:
        sentence = f"{', '.join(strange)}.{_misspelt(names, strange, layout)}"
        findings.append(finding("column not used", "warning", text.file, sentence, count=len(strange)))
    return Header(separator, tuple(names), {name: kind for name, kind in known.items() if name in names})


def _names_found(line: str, separator: str, known: Mapping[str, Kind]) -> tuple[int, int]:
    names = split_fields(line, separator)
    return sum(name in known for name in names), len(names)


def _is_number(name: str) -> bool:
    try:
        float(name.replace(",", "."))
    except ValueError:
        return False
    return True


def _refuse_missing(place: str, names: list[str], strange: list[str], layout: Layout) -> None:
    missing = [name for name in layout.required if name not in names]
    if missing:
        shown = ", ".join(repr(name) for name in names[:12])
        raise LogError(f"{place}: {_columns(missing)} missing; the header has {shown}.{_meant(missing[0], strange)}")


def _refuse_incomplete(place: str, names: list[str], strange: list[str], layout: Layout) -> None:
    missing = [name for name in layout.together if name not in names]
    if missing and len(missing) < len(layout.together):
        present = ", ".join(name for name in layout.together if name in names)
        raise LogError(
            f"{place}: {_columns(missing)} missing beside {present}; they are read all or none.{_meant(missing[0], strange)} "
            f"Log {', '.join(missing)} too, or remove {present}."
        )


def _columns(names: list[str]) -> str:
    return f"column{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _meant(missing: str, strange: list[str]) -> str:
    near = _nearest(missing, strange)
    return f" Is {near!r} meant?" if near else ""


def _misspelt(names: list[str], strange: list[str], layout: Layout) -> str:
    """A question about the first optional column that is absent while an unknown one has nearly its name."""
    absent = (name for name in layout.optional if name not in names)
    return next((f" Is {near!r} meant for {name}? Then rename it." for name in absent if (near := _nearest(name, strange))), "")


def _nearest(wanted: str, strange: list[str]) -> str | None:
    """The unknown column name most like a wanted one, if any is."""
    near = difflib.get_close_matches(wanted.lower(), [name.lower() for name in strange], n=1)
    return next(name for name in strange if name.lower() == near[0]) if near else None

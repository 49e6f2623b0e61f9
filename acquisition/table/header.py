"""Which columns a log must have, and where the header says they are: separator, names in any order.

The separator is the one under which the header shows most of the wanted names; rows that use another one are refused. The
header is the first line that has all wanted names; what stands before it (a preamble of names and values) is skipped.
"""

from __future__ import annotations

import csv
import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from acquisition.report import Finding, finding
from acquisition.table import selectors
from acquisition.table.text import LogText
from cell.errors import LogError

Kind = Literal[
    "integer", "float", "decimal", "text"
]  # decimal: text where a float would lose digits
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blank"}
PREAMBLE = 200  # lines before a header, at most
_TORN = "?"  # stands for a line whose quotes do not close; no number and no column is called that


@dataclass(frozen=True)
class Layout:
    """The columns of a log, by selector (acquisition.table.selectors)."""

    separators: tuple[str, ...]  # those the dialect allows
    required: Mapping[str, Kind]
    optional: Mapping[str, Kind] = field(default_factory=dict)  # read where present
    together: tuple[str, ...] = ()  # those of the optional ones that stand all or none
    instead: Mapping[str, tuple[str, ...]] = field(
        default_factory=dict
    )  # integer columns read where a required one is absent
    names: tuple[str, ...] | None = None  # of all columns, for a file without header
    headerless: bool = False  # all columns are counted
    decimal: Literal["either", "point", "comma"] = "either"


@dataclass(frozen=True)
class Header:
    """The header as found: where each wanted column stands."""

    separator: str
    names: tuple[str, ...]
    columns: Mapping[str, Kind]  # the wanted columns that are present
    positions: tuple[int, ...]  # field number, from 0, of each
    row: int  # of the first line below, among the lines of the text
    line: str  # as written; empty if there is none
    glued: str = ""  # first row where the header lacks its line end

    def without_header(self) -> bool:
        return not self.line


def split_fields(line: str, separator: str) -> list[str]:
    """The fields of one line, quotes and surrounding blanks removed."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error:
        return [_TORN]


def read_header(text: LogText, layout: Layout, findings: list[Finding]) -> Header:
    """The header, and the columns that it shows; columns that nothing reads and a preamble are appended to `findings`.

    Raises LogError if there is no header, a column is missing or stands twice, a set of optional columns is incomplete, or
    the separator is not the dialect's.
    """
    at, separator = _header_line(text, layout)
    place = f"{text.file}:{text.number[at]}"
    cells = split_fields(text.lines[at], separator)
    numbers = all(_is_number(name) for name in cells)
    if numbers and (layout.names is not None or layout.headerless):
        return _headerless(place, cells, separator, layout, text.file, findings, at)
    if numbers:
        raise LogError(
            f"{place}: the first line holds numbers, not column names. Expected a header with {', '.join(layout.required)}. "
            "For a file without header, name all its columns in recording.yaml: `columns: [...]`."
        )
    names, glued = _without_glued_row(text, at, cells, separator, layout)
    if glued:
        sentence = "the header has no line end; the first row stands on its line."
        findings.append(
            finding(
                "header without line end",
                "repaired",
                text.file,
                sentence,
                lines=[int(text.number[at])],
            )
        )
    if at:
        sentence = f"{at} lines before the header skipped."
        findings.append(
            finding("preamble", "repaired", text.file, sentence, lines=text.number[:at])
        )
    return _checked(
        place,
        names,
        separator,
        layout,
        text.file,
        findings,
        row=at + 1,
        line=text.lines[at],
        glued=glued,
    )


def _header_line(text: LogText, layout: Layout) -> tuple[int, str]:
    """Which line is the header, or should be, and its separator."""
    best, found = (0, _separator(text.lines[0], layout)), -1
    for at, line in enumerate(text.lines[: PREAMBLE + 1]):
        separator = _separator(line, layout)
        shown = _names_found(line, separator, layout)[0]
        if shown > found:
            best, found = (at, separator), shown
        if shown == len(layout.required):
            break
        if at and all(_is_number(cell) for cell in split_fields(line, separator)):
            break  # the table has begun
    return best


def _separator(line: str, layout: Layout) -> str:
    candidates = [s for s in SEPARATORS if s != " " or " " in layout.separators]
    return max(candidates, key=lambda s: (*_names_found(line, s, layout), s in layout.separators))


def _names_found(line: str, separator: str, layout: Layout) -> tuple[int, int]:
    names = split_fields(line, separator)
    required = sum(
        bool(selectors.find(one, names)) or _halves(one, names, layout) for one in layout.required
    )
    return required, sum(bool(selectors.find(one, names)) for one in layout.optional) + len(names)


def _halves(selector: str, names: list[str], layout: Layout) -> bool:
    halves = layout.instead.get(selector, ())
    return bool(halves) and all(len(selectors.find(one, names)) == 1 for one in halves)


def _headerless(
    place: str,
    cells: list[str],
    separator: str,
    layout: Layout,
    file: str,
    findings: list[Finding],
    at: int,
) -> Header:
    names = (
        list(layout.names) if layout.names is not None else [f"#{i + 1}" for i in range(len(cells))]
    )
    if len(names) != len(cells):
        raise LogError(
            f"{place}: {len(cells)} fields, but recording.yaml names {len(names)} columns."
        )
    return _checked(place, names, separator, layout, file, findings, row=at, line="", glued="")


def _checked(
    place: str,
    names: list[str],
    separator: str,
    layout: Layout,
    file: str,
    findings: list[Finding],
    *,
    row: int,
    line: str,
    glued: str,
) -> Header:
    while names and not names[-1] and len(names) > 1:
        names = names[:-1]  # a separator at the end of the line
    wanted: dict[str, Kind] = {}
    for name, kind in layout.required.items():
        halves = _halves(name, names, layout) and not selectors.find(name, names)
        wanted.update(dict.fromkeys(layout.instead[name], "integer") if halves else {name: kind})
    found = {name: selectors.find(name, names) for name in (*wanted, *layout.optional)}
    used = {position for positions in found.values() for position in positions}
    strange = [name for i, name in enumerate(names) if name and i not in used]
    _refuse_missing(place, names, strange, [name for name in wanted if not found[name]])
    _refuse_incomplete(place, names, strange, layout)
    if separator not in layout.separators:
        allowed = " or ".join(SEPARATORS[s] for s in layout.separators)
        raise LogError(
            f"{place}: fields are separated by {SEPARATORS[separator]}; this dialect has {allowed}."
        )
    _refuse_several(place, names, found)
    if strange:
        sentence = f"{_listed(strange)}.{_misspelt(names, strange, layout)}"
        findings.append(finding("column not used", "warning", file, sentence, count=len(strange)))
    columns = {**wanted, **{name: kind for name, kind in layout.optional.items() if found[name]}}
    return Header(
        separator,
        tuple(names),
        columns,
        tuple(found[name][0] for name in columns),
        row,
        line,
        glued,
    )


def _without_glued_row(
    text: LogText, at: int, cells: list[str], separator: str, layout: Layout
) -> tuple[list[str], str]:
    """The names, and the first row where the header's line end is missing: last name and first number share a field."""
    if at + 1 >= len(text.lines) or len(cells) < 3 or len(cells) % 2 == 0:
        return cells, ""
    last = len(cells) // 2
    width = len(split_fields(text.lines[at + 1], separator))
    behind = cells[last + 1 :]
    if (
        width != last + 1
        or not all(_is_number(cell) for cell in behind)
        or any(_is_number(cell) for cell in cells[:last])
    ):
        return cells, ""
    known = [name for name in (*layout.required, *layout.optional) if name not in cells[:last]]
    fits = [
        name
        for name in known
        if cells[last].startswith(name) and _is_number(cells[last][len(name) :])
    ]
    if len(fits) != 1:
        return cells, ""
    joint = "\t" if separator == " " else separator
    return [*cells[:last], fits[0]], joint.join((cells[last][len(fits[0]) :], *behind))


def _is_number(name: str) -> bool:
    try:
        float(name.replace(",", "."))
    except ValueError:
        return False
    return True


def _refuse_missing(place: str, names: list[str], strange: list[str], missing: list[str]) -> None:
    if missing:
        shown = ", ".join(repr(name[:40]) for name in names[:12])
        if why := selectors.why_not(missing[0], names):
            raise LogError(f"{place}:{why} The header has {shown}.")
        raise LogError(
            f"{place}: {_columns(missing)} missing; the header has {shown}.{_meant(missing[0], strange)}"
        )


def _refuse_incomplete(place: str, names: list[str], strange: list[str], layout: Layout) -> None:
    missing = [name for name in layout.together if not selectors.find(name, names)]
    if missing and len(missing) < len(layout.together):
        present = ", ".join(name for name in layout.together if name not in missing)
        raise LogError(
            f"{place}: {_columns(missing)} missing beside {present}; they are read all or none.{_meant(missing[0], strange)} "
            f"Log {', '.join(missing)} too, or remove {present}."
        )


def _refuse_several(place: str, names: list[str], found: Mapping[str, list[int]]) -> None:
    for selector, positions in sorted(found.items()):
        if len(positions) > 1 and selector in names:
            raise LogError(
                f"{place}: column {selector} stands {len(positions)} times in the header. Remove the others."
            )
        if len(positions) > 1:
            shown = _listed([names[i] for i in positions])
            raise LogError(
                f"{place}: {selector} finds {len(positions)} columns: {shown}. Make the expression narrower."
            )
    twice = {i: [name for name, at in found.items() if at == [i]] for i in range(len(names))}
    for i, selected in twice.items():
        if len(selected) > 1:
            raise LogError(f"{place}: {' and '.join(selected)} are the same column {names[i]!r}.")


def _listed(names: list[str]) -> str:
    """Some names; a log of EGM has a hundred that nothing reads."""
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _columns(names: list[str]) -> str:
    return f"column{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _meant(missing: str, strange: list[str]) -> str:
    near = _nearest(missing, strange)
    return f" Is {near!r} meant?" if near else ""


def _misspelt(names: list[str], strange: list[str], layout: Layout) -> str:
    """A question about the first optional column that is absent while an unknown one has nearly its name."""
    absent = (name for name in layout.optional if not selectors.find(name, names))
    return next(
        (
            f" Is {near!r} meant for {name}? Then rename it."
            for name in absent
            if (near := _nearest(name, strange))
        ),
        "",
    )


def _nearest(wanted: str, strange: list[str]) -> str | None:
    """The unknown column name most like a wanted one, if any is."""
    near = difflib.get_close_matches(
        wanted.lower(), [name.lower() for name in strange[:PREAMBLE]], n=1
    )
    return next(name for name in strange if name.lower() == near[0]) if near else None

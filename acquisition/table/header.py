"""Which columns a log must have, and where its header says they are: separator, names in any order.

The separator is the one with which the header shows most of the wanted names; rows that use another
one are refused. The header is the first line that has all wanted names; what stands before it (a
preamble of names and values) is skipped.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.text import SEPARATORS, LogText, is_number, split_fields
from ballbar.cell import selectors
from ballbar.cell.errors import LogError

Kind = Literal["integer", "float", "decimal", "text"]  # decimal: text where a float loses digits
MOST_COLUMNS = 2000
PREAMBLE = 200  # lines before a header, at most
FINE = 4e6  # a float64 below it resolves 1e-9


@dataclass(frozen=True)
class Remedies:
    """Advice in errors about a table, by the file that describes its columns."""

    description: str = "recording.yaml"
    missing: str = "Log them, or name the dialect of this file."
    headerless: str = (
        "For a file without header, name all its columns in recording.yaml: `columns: [...]`."
    )
    other_table: str = (
        "is this the file that the dialect describes? If not, name its dialect; else copy it again."
    )
    damaged: str = (
        "Correct the cell, export the file again, or let such rows be left out: `damaged_rows: 5` "
        "in recording.yaml, `--damaged-rows 5` of `ballbar new`."
    )


RECORDING = Remedies()


@dataclass(frozen=True)
class Layout:
    """The columns of a log, by selector (ballbar.cell.selectors)."""

    separators: tuple[str, ...]  # those the dialect allows
    required: Mapping[str, Kind]
    optional: Mapping[str, Kind] = field(default_factory=dict)  # read where present
    together: tuple[str, ...] = ()  # optional ones of which a log has all or none
    # Integer columns that are read where a required one is absent.
    instead: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    names: tuple[str, ...] | None = None  # of all columns, for a file without header
    headerless: bool = False  # all columns are selected by number
    decimal: Literal["either", "point", "comma"] = "either"
    all_empty: tuple[str, ...] = ()  # columns read as 0 in rows where all of them are empty
    # Columns of the signal that is read: a row that fills none of them, and columns that nothing
    # here names, is of another signal of the table.
    signal: tuple[str, ...] = ()
    remedies: Remedies = RECORDING
    damaged_rows: int = 0  # rows with cells that are no number, up to which they are left out


@dataclass(frozen=True)
class Header:
    """Where each wanted column of a file stands."""

    separator: str
    names: tuple[str, ...]
    columns: Mapping[str, Kind]  # the wanted columns that are present
    positions: tuple[int, ...]  # field number, from 0, of each
    row: int  # of the first line below, among the lines of the text
    line: str  # as written; empty if there is none
    glued: str = ""  # first row where the header lacks its line end
    findings: tuple[Finding, ...] = ()

    def without_header(self) -> bool:
        """Whether the file has no header, so that its columns are named or counted elsewhere."""
        return not self.line


@dataclass(frozen=True)
class _HeaderLine:
    """The line that is the header, or should be."""

    file: str
    row: int  # among the lines of the text
    number: int  # line number
    separator: str

    @property
    def location(self) -> str:
        return f"{self.file}:{self.number}"


def read_header(text: LogText, layout: Layout) -> Header:
    """The header and the columns that it shows; findings name unused columns and a preamble.

    Raises LogError if there is no header, a column is missing or stands twice, a set of optional
    columns is incomplete, or the separator is not the dialect's.
    """
    row, separator = _header_line(text, layout)
    line = _HeaderLine(text.file, row, int(text.number[row]), separator)
    cells = split_fields(text.lines[row], separator)
    headerless = all(is_number(name) for name in cells)
    findings, glued = list[Finding](), ""
    if headerless:
        cells = _declared_names(line, cells, layout)
    else:
        cells, glued = _without_glued_row(text, line, cells, layout)
        if glued:
            kind = "header without line end"
            sentence = "the header has no line end; the first row stands on its line."
            findings.append(finding(kind, text.file, sentence, lines=[line.number]))
        if row:
            sentence = f"{row} lines before the header skipped."
            lines = text.number[:row]
            findings.append(finding("preamble", text.file, sentence, lines=lines))
    names, columns, positions, unused = _columns_in(line, cells, layout)
    return Header(
        separator=separator,
        names=tuple(names),
        columns=columns,
        positions=positions,
        row=row if headerless else row + 1,
        line="" if headerless else text.lines[row],
        glued=glued,
        findings=(*findings, *unused),
    )


def _header_line(text: LogText, layout: Layout) -> tuple[int, str]:
    """Row of the line that is the header, or should be, and its separator."""
    for row, line in enumerate(text.lines[: PREAMBLE + 1]):
        if (columns := max(map(line.count, SEPARATORS))) > MOST_COLUMNS:
            raise LogError(
                f"{text.file}:{text.number[row]}: {columns + 1} fields; logs have at most "
                f"{MOST_COLUMNS}. Is this the file that the logger wrote? Export fewer columns."
            )
    best, most = (0, _separator(text.lines[0], layout)), -1
    for row, line in enumerate(text.lines[: PREAMBLE + 1]):
        separator = _separator(line, layout)
        shown = _names_shown(line, separator, layout)[0]
        if shown > most:
            best, most = (row, separator), shown
        if shown == len(layout.required):
            break
        if row and all(is_number(cell) for cell in split_fields(line, separator)):
            break  # the table has begun
    return best


def _separator(line: str, layout: Layout) -> str:
    candidates = [s for s in SEPARATORS if s != " " or " " in layout.separators]

    def shown(separator: str) -> tuple[int, bool, int, bool]:
        required, fields = _names_shown(line, separator, layout)
        # Decimal commas would make more columns than there are.
        numbers = layout.headerless and all(map(is_number, split_fields(line, separator)))
        return required, numbers, fields, separator in layout.separators

    return max(candidates, key=shown)


def _names_shown(line: str, separator: str, layout: Layout) -> tuple[int, int]:
    """How many required columns a line shows, and how many optional columns and fields."""
    names = split_fields(line, separator)
    required = sum(
        bool(selectors.find(name, names)) or _halves(name, names, layout)
        for name in layout.required
    )
    return required, sum(bool(selectors.find(name, names)) for name in layout.optional) + len(names)


def _halves(selector: str, names: list[str], layout: Layout) -> bool:
    halves = layout.instead.get(selector, ())
    return bool(halves) and all(len(selectors.find(half, names)) == 1 for half in halves)


def _declared_names(line: _HeaderLine, cells: list[str], layout: Layout) -> list[str]:
    """Names of the columns of a file that begins with a row of numbers: declared, or counted."""
    if layout.names is None and not layout.headerless:
        raise LogError(
            f"{line.location}: the first line holds numbers, not column names. Expected a header "
            f"with {', '.join(layout.required)}. {layout.remedies.headerless}"
        )
    counted = [f"#{i + 1}" for i in range(len(cells))]
    names = counted if layout.names is None else list(layout.names)
    if len(names) != len(cells):
        what = f"{len(cells)} fields, but recording.yaml names {len(names)} columns."
        raise LogError.at(line.location, what, "Name every column once, in their order.")
    return names


def _columns_in(
    line: _HeaderLine, names: list[str], layout: Layout
) -> tuple[list[str], dict[str, Kind], tuple[int, ...], tuple[Finding, ...]]:
    """Names of all columns, kinds and positions of the wanted ones, a finding about the others."""
    while names and not names[-1] and len(names) > 1:
        names = names[:-1]  # a separator at the end of the line
    wanted: dict[str, Kind] = {}
    for name, kind in layout.required.items():
        halves = _halves(name, names, layout) and not selectors.find(name, names)
        wanted.update(dict.fromkeys(layout.instead[name], "integer") if halves else {name: kind})
    positions = {name: selectors.find(name, names) for name in (*wanted, *layout.optional)}
    used = {position for several in positions.values() for position in several}
    unused = [name for i, name in enumerate(names) if name and i not in used]
    missing = [name for name in wanted if not positions[name]]
    _refuse_missing(line, names, unused, missing, layout.remedies)
    _refuse_incomplete(line, names, unused, layout)
    if line.separator not in layout.separators:
        allowed = " or ".join(SEPARATORS[s] for s in layout.separators)
        what = f"fields are separated by {SEPARATORS[line.separator]}; this dialect has {allowed}."
        raise LogError.at(line.location, what, "Export again, or name the dialect of this file.")
    _refuse_several(line, names, positions)
    columns = wanted | {name: kind for name, kind in layout.optional.items() if positions[name]}
    findings: tuple[Finding, ...] = ()
    if unused:
        absent = (name for name in layout.optional if not positions[name])
        similar = ((name, other) for name in absent if (other := _nearest(name, unused)))
        meant = [f" Is {other!r} meant for {name}? Then rename it." for name, other in similar]
        sentence, count = f"{_listed(unused)}.{''.join(meant[:1])}", len(unused)
        findings = (finding("column not used", line.file, sentence, count=count),)
    return names, columns, tuple(positions[name][0] for name in columns), findings


def _without_glued_row(
    text: LogText, line: _HeaderLine, cells: list[str], layout: Layout
) -> tuple[list[str], str]:
    """The names, and the first row where the header's line end is missing.

    The last name and the first number then share a field.
    """
    if line.row + 1 >= len(text.lines) or len(cells) < 3 or len(cells) % 2 == 0:
        return cells, ""
    last = len(cells) // 2
    width = len(split_fields(text.lines[line.row + 1], line.separator))
    behind = cells[last + 1 :]
    names_before = not any(is_number(cell) for cell in cells[:last])
    if width != last + 1 or not all(is_number(cell) for cell in behind) or not names_before:
        return cells, ""
    glued = cells[last]
    wanted = [name for name in (*layout.required, *layout.optional) if name not in cells[:last]]
    fits = [name for name in wanted if glued.startswith(name) and is_number(glued[len(name) :])]
    if len(fits) != 1:
        return cells, ""
    joint = "\t" if line.separator == " " else line.separator
    return [*cells[:last], fits[0]], joint.join((glued[len(fits[0]) :], *behind))


def _refuse_missing(
    line: _HeaderLine, names: list[str], unused: list[str], missing: list[str], remedies: Remedies
) -> None:
    if missing:
        shown = ", ".join(repr(name[:40]) for name in names[:12])
        if why := selectors.why_not(missing[0], names):
            raise LogError(
                f"{line.location}:{why} The header has {shown}. "
                f"Name one of these in {remedies.description}."
            )
        raise LogError(
            f"{line.location}: {_columns(missing)} missing; the header has {shown}."
            f"{_meant(missing[0], unused)} {remedies.missing}"
        )


def _refuse_incomplete(
    line: _HeaderLine, names: list[str], unused: list[str], layout: Layout
) -> None:
    missing = [name for name in layout.together if not selectors.find(name, names)]
    if missing and len(missing) < len(layout.together):
        present = ", ".join(name for name in layout.together if name not in missing)
        raise LogError(
            f"{line.location}: {_columns(missing)} missing beside {present}; they are read all or "
            f"none.{_meant(missing[0], unused)} Log {', '.join(missing)} too, or remove {present}."
        )


def _refuse_several(
    line: _HeaderLine, names: list[str], positions: Mapping[str, list[int]]
) -> None:
    for selector, several in sorted(positions.items()):
        if len(several) > 1 and selector in names:
            what = f"column {selector} stands {len(several)} times in the header."
            raise LogError.at(line.location, what, "Remove the others.")
        if len(several) > 1:
            raise LogError(
                f"{line.location}: {selector} finds {len(several)} columns: "
                f"{_listed([names[i] for i in several])}. Make the expression narrower."
            )
    for i, name in enumerate(names):
        selected = [selector for selector, several in positions.items() if several == [i]]
        if len(selected) > 1:
            what = f"{' and '.join(selected)} are the same column {name!r}."
            raise LogError.at(line.location, what, "Name another column for one of them.")


def _listed(names: list[str]) -> str:
    """The first names; a log of EGM has a hundred that nothing reads."""
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _columns(names: list[str]) -> str:
    return f"column{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _meant(missing: str, unused: list[str]) -> str:
    similar = _nearest(missing, unused)
    return f" Is {similar!r} meant?" if similar else ""


def _nearest(wanted: str, unused: list[str]) -> str | None:
    """The unused column name most like a wanted one, if any is."""
    lower = [name.lower() for name in unused[:PREAMBLE]]
    close = difflib.get_close_matches(wanted.lower(), lower, n=1)
    return next(name for name in unused if name.lower() == close[0]) if close else None

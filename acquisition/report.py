"""Import report: everything the reader found or mended in the files of a recording, counted by kind, with file and lines.

A finding is either `repaired` (the reader changed or left out something, and says what) or a `warning` (nothing was
changed, but the engineer should know). What cannot be repaired is no finding: it is an error, and reading stops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cell.recording import SourceName

Severity = Literal["repaired", "warning"]
LINES_SHOWN = 5  # line numbers kept with a finding; enough to open the file at the place


@dataclass(frozen=True)
class Finding:
    """One kind of finding in one file."""

    kind: str
    severity: Severity
    file: str
    lines: tuple[
        int, ...
    ]  # the first few, counted from 1; empty where the finding concerns the whole file
    count: int
    sentence: str


@dataclass(frozen=True)
class FileSummary:
    """How one device file was read."""

    file: str
    source: SourceName
    dialect: str
    encoding: str
    separator: str
    decimal: str
    rows_read: int  # below the header, blank lines not counted
    rows_kept: int
    time: str  # form of the time stamps, and their column


@dataclass(frozen=True)
class ImportReport:
    """What was read, and every repair and warning."""

    files: tuple[FileSummary, ...]
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """The report as plain lists, dicts, numbers and text, ready for JSON."""
        plain = asdict(self)
        plain["files"] = list(plain["files"])
        plain["findings"] = [
            {**finding, "lines": list(finding["lines"])} for finding in plain["findings"]
        ]
        return plain


def finding(
    kind: str,
    severity: Severity,
    file: str,
    sentence: str,
    *,
    lines: Sequence[int] | NDArray[np.int64] = (),
    count: int | None = None,
) -> Finding:
    """A finding at some lines; `count` defaults to their number."""
    return Finding(
        kind,
        severity,
        file,
        tuple(int(n) for n in lines[:LINES_SHOWN]),
        len(lines) if count is None else count,
        sentence,
    )


def report_lines(report: ImportReport) -> list[str]:
    """The report as lines of text: how each file was read, what was repaired, what else to know; headings are not indented."""
    lines = ["FILES"]
    for file in report.files:
        lines += [
            f"  {file.file}: {file.rows_kept} of {file.rows_read} rows used",
            f"    {file.source}, dialect {file.dialect}; {file.encoding}, separator {file.separator}, decimal {file.decimal}; {file.time}",
        ]
    headings: tuple[tuple[str, Severity], ...] = (("REPAIRED", "repaired"), ("WARNINGS", "warning"))
    for heading, severity in headings:
        found = [one for one in report.findings if one.severity == severity]
        lines += (
            [heading, *(f"  {finding_line(one)}" for one in found)]
            if found
            else [f"{heading}: none"]
        )
    return lines


def finding_line(one: Finding) -> str:
    """A finding with its place, as a line of text."""
    return f"{_place(one)}: {one.kind}{_times(one)}: {one.sentence}"


def _place(one: Finding) -> str:
    if not one.lines:
        return one.file
    more = ",..." if one.count > len(one.lines) else ""
    return f"{one.file}:{','.join(map(str, one.lines))}{more}"


def _times(one: Finding) -> str:
    return f" ({one.count} times)" if one.lines and one.count > 1 else ""

"""Import report: what the reader found or repaired in the files of a recording, and where.

A finding is `repaired` where the reader changed or left out something, and a `warning` where
nothing was changed but the engineer should know: the kinds with a remedy. What cannot be repaired
is an error, and reading stops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.logs import SourceName

Severity = Literal["repaired", "warning"]
# What to do about each kind of warning; every other kind of finding is a repair.
REMEDIES = {
    "angles jump": "Start the logger once for each recording.",
    "angles on a grid": "Log more decimals, if the controller has them.",
    "axis beyond its limits": "Name the robot that was recorded, or correct its limits.",
    "axis stands still": "Move every axis; what only that axis shows stays nominal.",
    "beyond axis limits": "Name the robot that was recorded, or correct its limits.",
    "column not used": "What is none of the signals needs nothing; name others as the dialect "
    "does.",
    "counter jumped": "Check the encoder's supply and coupling if nobody reset it.",
    "counter preset": "Preset counters before a recording, not during it.",
    "counter reset": "Leave the encoders powered from the first row to the last.",
    "end of export": "Export it again if rows at the end are missing.",
    "far from the nominal robot": "Name the robot that was measured, or correct the columns.",
    "gap": "Nothing, if they are few: the rows on either side are used. Else lower the load of the "
    "logging computer.",
    "irregular stamp": "Nothing, if the verdict is good. Else do not set clocks while recording.",
    "joints stand still": "Declare the columns of the joint angles in poses.yaml.",
    "length outside the range": "Leave these rows out, or correct the range in the instrument's "
    "file.",
    "long log": "Nothing; to use every row, make several recordings and identify them together.",
    "logger restarted": "Start the logger once for each recording.",
    "loose reference points": "Fasten them, or correct sigma_m of reference in poses.yaml.",
    "lost messages": "Nothing, if they are few. Else lower the load of the network.",
    "missing messages": "Nothing, if they are few. Else record to a faster disk.",
    "moving seat": "Nothing: the values are those of a seat at rest.",
    "no status word": "Log the status words too, to have faults of the encoders found.",
    "no test signals": "Define them in the controller (TestSignDefine) before EGM is started, if "
    "its RobotWare sends them; else record without --egm-torque.",
    "off the sample time": "Export it again if rows are missing.",
    "other joints": "Nothing, if they are of another device; else record a topic that has all.",
    "overrun": "Nothing: such rows are late, and used at their own time.",
    "pause or clock jump": "Nothing, after a pause. Else do not set clocks while recording.",
    "point out of reach": "Leave these rows out, or measure them again.",
    "reference point moved": "Fasten it. Where three or four points are read, it may be another "
    "one: leave out the rows on one side.",
    "repeated pose": "Measure other poses; repeated ones tell of noise only.",
    "rotations off the nominal robot": "State the convention of the rotations in poses.yaml.",
    "rows of other signals": "Nothing: each signal of the table is read by its own columns.",
    "scaled channel": "Nothing, if it is in the declared unit; else record it unscaled.",
    "scaling unknown": "Check that no channel was scaled in the Scope.",
    "stale process data": "Nothing, if they are few. Else synchronise the encoders with the bus.",
    "sync error": "Nothing, if they are few. Else synchronise the encoders with the bus.",
    "time of sending": "Nothing: the clock is identified. A newer RobotWare has finer stamps.",
    "unusual period": "Declare the unit of the time column, if it is another.",
    "write-ahead log": "Do so before the recording is read.",
}
LINES_SHOWN = 5  # line numbers stored with a finding; enough to open the file there


@dataclass(frozen=True)
class Finding:
    """One kind of finding in one file."""

    kind: str
    file: str
    lines: tuple[int, ...]  # the first few, counted from 1; empty for findings about the whole file
    count: int
    sentence: str

    @property
    def severity(self) -> Severity:
        """`repaired`, or `warning` where the user has to do something."""
        return "warning" if self.kind in REMEDIES else "repaired"

    @property
    def remedy(self) -> str:
        """The sentence on how to deal with a warning; empty for a repair."""
        return REMEDIES.get(self.kind, "")

    @property
    def notable(self) -> bool:
        """Whether something was changed or left out, or is to be done."""
        return not self.remedy.startswith("Nothing")


@dataclass(frozen=True)
class FileSummary:
    """How one device file was read."""

    file: str
    source: SourceName | Literal["poses"]
    dialect: str
    encoding: str
    separator: str
    decimal: str
    rows_read: int  # below the header, without blank lines
    rows_kept: int
    time: str  # form of the time stamps, and their column
    day: str = ""  # of the last row, such as 2026-03-31; empty where its clock has no epoch


@dataclass(frozen=True)
class ImportReport:
    """The files that were read, with all repairs and warnings."""

    files: tuple[FileSummary, ...]
    findings: tuple[Finding, ...]

    @property
    def day(self) -> str:
        """Last day that the stamps of any file show, such as 2026-03-31; empty without epoch."""
        return max((file.day for file in self.files), default="")

    def to_dict(self) -> dict[str, Any]:
        """The report as plain lists, dicts, numbers and text, ready for JSON."""
        findings = [
            {
                **{"kind": entry.kind, "severity": entry.severity},
                **asdict(entry),
                **{"lines": list(entry.lines), "remedy": entry.remedy},
            }
            for entry in self.findings
        ]
        return {"files": [asdict(file) for file in self.files], "findings": findings}


def finding(
    kind: str,
    file: str,
    sentence: str,
    *,
    lines: Sequence[int] | NDArray[np.int64] = (),
    count: int | None = None,
) -> Finding:
    """A finding at some line numbers; `count` defaults to how many they are."""
    first = tuple(int(line) for line in lines[:LINES_SHOWN])
    return Finding(kind, file, first, len(lines) if count is None else count, sentence)


def report_lines(report: ImportReport) -> list[str]:
    """The report as lines of text: files, repairs, warnings; only headings are not indented."""
    lines = ["FILES"]
    for file in report.files:
        lines += [
            f"  {file.file}: {file.rows_kept} of {file.rows_read} rows used",
            f"    {file.source}, dialect {file.dialect}; {file.encoding}, "
            f"separator {file.separator}, decimal {file.decimal}; {file.time}",
        ]
    headings: tuple[tuple[str, Severity], ...] = (("REPAIRED", "repaired"), ("WARNINGS", "warning"))
    for heading, severity in headings:
        entries = [finding_line(f) for f in report.findings if f.severity == severity]
        lines += (
            [heading, *(f"  {entry}" for entry in entries)] if entries else [f"{heading}: none"]
        )
    return lines


def finding_line(entry: Finding) -> str:
    """A finding with its location as a line: `file:lines: kind (count): sentence remedy`."""
    location, times = entry.file, ""
    if entry.lines:
        more = ",..." if entry.count > len(entry.lines) else ""
        location += f":{','.join(map(str, entry.lines))}{more}"
        times = f" ({entry.count} times)" if entry.count > 1 else ""
    return f"{location}: {entry.kind}{times}: {entry.sentence} {entry.remedy}".rstrip()

"""Logs of abb_motion_program_exec: everything float32, little-endian, as a RAPID task packs it.

    file version | length, text: time stamp | length, text: `timestamp,cmdnum,J1,...,J6` |
    rows of one float32 a column

Times are seconds of a RAPID clock, angles are degrees of the axes. A float32 second resolves 61 us
after ten minutes; nothing better is in the file, and it has no checksum: a changed bit in a number
can only be seen if the number becomes implausible.
Source: rpiRobotics/abb_motion_program_exec, motion_program_logger.mod and its reader, version
10011.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ballbar.acquisition.formats.columns import one_file, wanted_columns
from ballbar.acquisition.report import finding
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table
from ballbar.acquisition.table.text import read_filled
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError

VERSIONS = range(10_000, 11_000)  # 10011 in 2024; the head has not changed since 10007
_LONGEST_TEXT = 1000  # bytes; RAPID packs strings of at most 80
_COMMAND = "cmdnum"
_AGAIN = "Copy the file again, or cut it before this row."


def read_mpe(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted columns of a log, float32 as the float64 of the same value.

    Its lines are row numbers, counted from 1.
    Raises LogError if the head is no such log's, columns are missing, or a number cannot be.
    """
    content = read_filled(path, file)
    raw, findings = content.raw, list(content.findings)
    version = _number(raw, 0, file)
    if version not in VERSIONS:
        raise LogError(
            f"{file}: begins with {version:g}, not with a file version of abb_motion_program_exec "
            "(10011). Name the dialect of this file."
        )
    _, at = _text(raw, 4, file)
    header, at = _text(raw, at, file)
    names = header.split(",")
    if len(set(names)) < len(names) or time not in names:
        what = f"the columns are {header!r}; expected {time} and the axes, each once."
        raise LogError.at(file, what, "Log each axis once, or name the dialect of this file.")
    wanted = (time, *wanted_columns(layout, time, names, file))
    width = 4 * len(names)
    torn = (len(raw) - at) % width
    if torn:
        first, last = len(raw) - torn, len(raw) - 1
        sentence = f"the last row has {torn} of {width} bytes (bytes {first} to {last}); dropped."
        findings.append(finding("torn row", file, sentence, count=1))
    numbers = np.frombuffer(raw, dtype="<f4", offset=at, count=(len(raw) - at - torn) // 4)
    with np.errstate(invalid="ignore"):  # signalling NaNs, refused below
        rows = numbers.reshape(-1, len(names)).astype(np.float64)
    # A power loss leaves a block of zeros at the end; the first row may be zero.
    filled = np.flatnonzero(rows.any(axis=1))
    count = int(filled[-1]) + 1 if filled.size else 0
    if nul := len(rows) - count:
        sentence = f"the last {nul} rows are NUL bytes (power loss); left out."
        findings.append(finding("NUL block at the end", file, sentence, count=nul))
    if not count:
        raise LogError(f"{file}: a head but no complete row behind it. Copy it again.")
    _check_rows(rows[:count], names, [names.index(name) for name in wanted], file)
    columns = {name: rows[:count, names.index(name)].copy() for name in wanted}
    table = one_file(columns, file, np.arange(1, count + 1), findings)
    return table, Form("float32", "none", "none", len(rows))


def _number(raw: bytes, at: int, file: str) -> float:
    if len(raw) < at + 4:
        raise LogError(f"{file}: ends within its head, at byte {len(raw)}. Copy it again.")
    return float(struct.unpack_from("<f", raw, at)[0])


def _text(raw: bytes, at: int, file: str) -> tuple[str, int]:
    """A text with its length before it, and where the next field begins."""
    length = _number(raw, at, file)
    if not (0 < length <= _LONGEST_TEXT and length == int(length)):
        raise LogError(
            f"{file}: a text of the head (byte {at}) claims {length:g} bytes: no log of "
            "abb_motion_program_exec, or damaged. Copy it again, or name its dialect."
        )
    stop = at + 4 + int(length)
    text = raw[at + 4 : stop]
    if len(text) < length or not all(32 <= byte < 127 for byte in text):
        what = f"a text of the head (byte {at}) is not plain ASCII: {text[:40]!r}."
        raise LogError.at(file, what, "Copy it again, or name its dialect.")
    return text.decode("ascii"), stop


def _check_rows(rows: Array, names: list[str], positions: list[int], file: str) -> None:
    """Raises LogError for rows (N, C) with numbers that no clock and no axis shows.

    positions : of the columns that are read.
    """
    wanted = rows[:, positions]
    # 9E9 is ABB's mark of an axis that is not there.
    bad = np.argwhere(~np.isfinite(wanted) | (np.abs(wanted) > 1e6))
    if bad.size:
        row, column = (int(index) for index in bad[0])
        shown = f"{names[positions[column]]} is {wanted[row, column]:g}"
        what = f"{shown}, which no clock and no axis shows."
        raise LogError.at(f"{file}:{row + 1}", what, _AGAIN)
    if _COMMAND in names:
        command = rows[:, names.index(_COMMAND)]
        back = np.diff(command, prepend=command[0]) < 0
        odd = np.flatnonzero((command != np.rint(command)) | back)
        if odd.size:
            number = f"{_COMMAND} {command[odd[0]]:g}"
            what = f"{number} is no number of a command, or goes back. Damaged here."
            raise LogError.at(f"{file}:{odd[0] + 1}", what, _AGAIN)

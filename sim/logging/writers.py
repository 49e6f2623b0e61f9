"""Device logs as the loggers of the cell write them, in the shipped dialects.

Every file appears whole or not at all: it is written beside its place and renamed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.dialect import Dialect
from cell.files import write_whole

_DC_FILETIME = 125_911_584_000_000_000  # [100 ns] from 1601 to 2000


def write_ballbar_log(
    path: Path,
    dialect: Dialect,
    stamps: NDArray[np.int64],
    counts: Mapping[str, NDArray[np.uint32]],
    status: Mapping[str, NDArray[np.int64]],
) -> None:
    """Write a ball-bar log: time, counters and status words, lines that end in CRLF.

    stamps : (N,) [ns] distributed clock time since 2000-01-01. counts : (N,) uint32 counter values
        by column name. status : (N,) words by encoder, for the columns of the dialect. Source:
        notes/log_formats secs. A.6, A.7.
    """
    words = {name: status[encoder] for encoder, name in dialect.status.items() if encoder in status}
    columns: dict[str, NDArray[np.integer[Any]]] = {**counts, **words}
    if dialect.container == "twincat-scope":
        write_whole(path, _scope_export(stamps, columns))
        return
    rows = np.column_stack((stamps, *(c.astype(np.int64) for c in columns.values())))
    separator = dialect.separators[0]
    lines = [
        separator.join((dialect.time.column, *columns)),
        *(separator.join(map(str, row)) for row in rows.tolist()),
    ]
    write_whole(path, ("\r\n".join(lines) + "\r\n").encode("ascii"))


def _scope_export(
    stamps: NDArray[np.int64], columns: Mapping[str, NDArray[np.integer[Any]]]
) -> bytes:
    """An export of TwinCAT Scope: channels with one column of times, ms from its start."""
    start, end = (int(stamp) // 100 + _DC_FILETIME for stamp in stamps[[0, -1]])
    elapsed = (stamps - stamps[0]).astype(np.float64) * 1e-6  # [ms]
    step = f"{np.median(np.diff(elapsed)):g}"
    count = len(columns)
    metadata = {
        "Name": list(columns),
        "SymbolComment": [""] * count,
        "Data-Type": ["UINT32"] * count,
        "SampleTime[ms]": [step] * count,
        "VariableSize": ["4"] * count,
        "Offset": ["0"] * count,
        "ScaleFactor": ["1"] * count,
        "BitMask": ["0xffffffffffffffff"] * count,
        "Unit": ["(None)"] * count,
        "Unit ScaleFactor": ["1"] * count,
        "Unit Offset": ["0"] * count,
    }
    head = [
        "Name\tballbar",
        "File\tballbar.csv",
        f"Starttime of export\t{start}",
        f"Endtime of export\t{end}",
        "",
        "",
        *("\t".join((key, *values)) for key, values in metadata.items()),
        "",
    ]
    values = np.column_stack([c.astype(np.int64) for c in columns.values()])
    rows = [
        "\t".join((f"{time:g}", *map(str, row)))
        for time, row in zip(elapsed.tolist(), values.tolist(), strict=True)
    ]
    return ("\n".join([*head, *rows]) + "\n").encode("ascii")


def write_lengths(path: Path, stamps: Array, lengths: Array) -> None:
    """Write a log of lengths: `time,length` in s and mm.

    stamps : (N,) [s] on the sensor's clock. lengths : (N,) [m].
    """
    rows = np.column_stack((stamps, lengths * 1e3))
    _write_table(path, ["time", "length"], ["%.6f", "%.7f"], rows)


def write_force_torque(path: Path, stamps: Array, readings: Array) -> None:
    """Write a force sensor log: `time,fx,fy,fz,tx,ty,tz` in s, N and N m.

    stamps : (N,) [s] on the sensor's clock. readings : (N, 6) [N, N m].
    """
    names, forms = ["time", "fx", "fy", "fz", "tx", "ty", "tz"], ["%.6f", *["%.5f"] * 6]
    _write_table(path, names, forms, np.column_stack((stamps, readings)))


def write_tracker_points(path: Path, stamps: Array, points: Array) -> None:
    """Write a log of an optical tracker: `time,x,y,z` in s and mm.

    stamps : (N,) [s] on the tracker's clock. points : (N, 3) [m] in its frame.
    """
    rows = np.column_stack((stamps, points * 1e3))
    _write_table(path, ["time", "x", "y", "z"], ["%.6f", *["%.5f"] * 3], rows)


def _write_table(path: Path, names: list[str], forms: list[str], rows: Array) -> None:
    form = ",".join(forms)
    lines = [form % tuple(row) for row in rows.tolist()]
    write_whole(path, ("\n".join([",".join(names), *lines]) + "\n").encode("ascii"))

"""Rows of a text log that another program writes, a tracker's or a robot's, as they come.

Every line is kept as it was written. Stamps and values are read from a copy, by the reader of every
other command, for the terminal alone; rows that it cannot read are recorded all the same.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.acquisition.live.source import Batch, DeviceSilentError, Encoders
from ballbar.acquisition.sources import LogSource, inside, with_stamps
from ballbar.acquisition.stamps.order import STAMP
from ballbar.acquisition.table.header import read_header
from ballbar.acquisition.table.table import text_table
from ballbar.acquisition.table.text import Content, text_of
from ballbar.cell.errors import InputError, LogError
from ballbar.cell.recording import TrackerFile

_MOST = 1 << 22  # bytes of a poll: half a minute of the fastest logs
_HEAD = 1 << 16  # bytes among which the header is looked for


class FileSource:
    """One log of a recording.yaml whose file grows.

    Rows that are there when the recorder begins are older than the recording and are left out. A
    file that was started again goes into a new one, from its first row.

    Raises InputError for a log that is no text, or lies in several files.
    """

    encoders = Encoders()

    def __init__(self, log: LogSource) -> None:
        self.name, declared = log.name, log.declared
        stated = declared.model_dump(mode="json", exclude={"files"}, exclude_unset=True)
        # a dialect that is a file is copied beside recording.yaml
        self.entry: Mapping[str, object] = stated | {"dialect": Path(declared.dialect).name}
        (file, *others), where = declared.files, f"sources.{log.name}.files"
        packed = Path(file).suffix in (".gz", ".bz2", ".xz")
        if others or packed or log.dialect.container != "text":
            what = "one text file that grows is recorded, neither several nor a packed one."
            raise InputError.at(log.folder / "recording.yaml", f"{where}: {what}", "Name that one.")
        self.file_suffix, self._file = Path(file).suffix, file
        self._log, self._path = log, inside(log.folder, file)
        self.channels, self.unit = log.layout.signal, "as logged"
        if log.name == "robot":  # its columns may be expressions
            self.channels = tuple(f"q{k}" for k in range(1, len(self.channels) + 1))
            self.unit = log.dialect.angle_unit
        elif isinstance(declared, TrackerFile):
            self.unit = declared.unit
        self.quiet = f"{file}: no new row yet"
        self._head, self._end, self._fresh = b"", 0, False

    def file_start(self) -> bytes:
        return self._head

    def connect(self) -> None:
        """Finds the header, and the row to go on with."""
        content = self._read(0, _HEAD)
        whole = content[: content.rfind(b"\n") + 1]
        try:
            text = text_of(Content(whole), self._file)
            header = read_header(text, self._log.layout)
        except LogError as error:
            self._fresh = True
            raise DeviceSilentError(str(error).rstrip(".")) from None
        if text.encoding.startswith("utf-16"):
            raise DeviceSilentError(f"{self._file} is UTF-16. Have it written as plain text")
        first = int(text.number[header.row - 1]) if header.row else 0
        self._head = b"".join(whole.splitlines(keepends=True)[:first])
        if self._fresh:
            self._end = len(self._head)
        elif not self._end:
            size = self._path.stat().st_size
            start = max(0, size - _HEAD)
            self._end = start + self._read(start, size - start).rfind(b"\n") + 1
        self._fresh = False

    def poll(self) -> Batch:
        content = self._read(self._end, _MOST)
        rows = content[: content.rfind(b"\n") + 1]
        self._end += len(rows)
        lines, status = rows.splitlines(keepends=True), np.zeros(0, dtype=np.int64)
        nothing = Batch(lines, status, np.zeros((0, len(self.channels))), status)
        try:
            table, _ = text_table(text_of(Content(self._head + rows), self._file), self._log.layout)
            columns = with_stamps(self._log, table)[0].columns
        except LogError:  # none yet, or damaged: what reads the recording says so
            return nothing
        values = np.stack([columns[name] for name in self._log.layout.signal], axis=1)
        return replace(nothing, t_ns=columns[STAMP], values=values.astype(np.float64))

    def disconnect(self) -> None:
        """Nothing is held open."""

    def _read(self, start: int, size: int) -> bytes:
        """Bytes from `start` on. Raises DeviceSilentError where it is gone or began again."""
        try:
            with self._path.open("rb") as stream:
                if stream.seek(0, os.SEEK_END) < max(start, self._end):
                    self._fresh, self._end = True, 0
                    raise DeviceSilentError(f"{self._file} was started again")
                stream.seek(start)
                return stream.read(size)
        except OSError as error:
            self._fresh, self._end = True, 0
            raise DeviceSilentError(f"{self._file}: {error.strerror}") from None

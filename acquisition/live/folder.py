"""The recording folder while it grows: its device files, and a recording.yaml that is right.

A file is declared once it holds records, so that no reader stumbles over an empty one; only the
first of all is declared just before, since rows without recording.yaml could not be read.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

from ballbar.acquisition.live.source import Encoders, Source
from ballbar.cell.errors import InputError
from ballbar.cell.files import aside_of, require_writable, write_whole, write_yaml
from ballbar.cell.logs import SourceName
from ballbar.cell.recording import RecordingFile

DESCRIPTION = "recording.yaml"
_MISSING: dict[SourceName, str] = {
    "robot": (
        "the robot's log: copy it into raw/ and declare it under sources.robot, with its dialect"
    ),
    "ballbar": (
        "the ball-bar's log: copy it into raw/, declare it under sources.ballbar, and the "
        "encoders with lines, bits and sign"
    ),
}


@dataclass(frozen=True)
class CellNames:
    """Robot, ball-bar and plate as recording.yaml names them, and the lines of the encoders.

    described : recording.yaml of logs that other programs write. What it says of them, and of all
        that is not recorded by a name of its own here, is kept.
    """

    robot: str
    ballbar: str  # or an instrument, as `described` has it
    plate: str
    lines: int = 0
    described: RecordingFile | None = None

    @property
    def expected(self) -> tuple[SourceName, ...]:
        """The sources without which the recording is not whole."""
        if self.described is None:
            return ("robot", "ballbar")
        return tuple(self.described.sources.named)


class RecordingFolder:
    """A new folder that takes a recording.

    own_files : descriptions that are copied into it.

    Raises InputError if something is in it already.
    """

    def __init__(self, path: Path, cell: CellNames, own_files: Sequence[Path] = ()) -> None:
        copied = {file.name: file.read_bytes() for file in own_files}
        remains = [] if not path.exists() else _without_records(path, copied)
        if remains is None:
            what = "exists already; nothing was written."
            raise InputError.at(path, what, "A recording needs a folder that is new or empty.")
        require_writable(path)
        for file in remains:
            file.unlink()
        (path / "raw").mkdir(parents=True, exist_ok=True)
        for name, content in copied.items():
            write_whole(path / name, content)
        self.path = path
        self._cell = cell
        self._encoders = Encoders()
        self._files: dict[SourceName, list[str]] = {}
        self._entries: dict[SourceName, Mapping[str, object]] = {}
        self._lock = threading.Lock()  # each source declares its files from a thread of its own

    def next_file(self, source: SourceName, suffix: str) -> Path:
        """Where the next segment of a source goes: raw/ballbar.csv, raw/ballbar_2.csv, .."""
        taken = len(self._files.get(source, ()))
        return self.path / "raw" / f"{source}{f'_{taken + 1}' if taken else ''}{suffix}"

    @property
    def is_new(self) -> bool:
        """Whether no file is declared."""
        return not self._files

    def declare(self, source: Source, file: Path) -> None:
        """Enters a file into recording.yaml.

        Raises OSError if that cannot be written.
        """
        with self._lock:
            self._files.setdefault(source.name, []).append(f"raw/{file.name}")
            self._entries[source.name] = source.entry
            if source.encoders.joints:
                self._encoders = source.encoders
            self._write("")

    def withdraw(self, source: Source, file: Path) -> None:
        """Takes a file that was removed, because it got no record, out of recording.yaml.

        Raises OSError if that cannot be written.
        """
        with self._lock:
            files = self._files.get(source.name, [])
            if f"raw/{file.name}" not in files:
                return
            files.remove(f"raw/{file.name}")
            if not files:
                del self._files[source.name]
            if self._files:
                self._write("")
            else:
                (self.path / DESCRIPTION).unlink(missing_ok=True)

    def finish(self, notes: str) -> None:
        """Enters what happened on the way. Raises OSError if that cannot be written."""
        with self._lock:
            if self._files and notes:
                self._write(notes)

    @property
    def missing(self) -> tuple[str, ...]:
        """Phrases for everything that the recording still needs before it can be read."""
        left = (name for name in self._cell.expected if name not in self._files)
        return tuple(_MISSING.get(name, f"the rows of sources.{name}") for name in left)

    def _write(self, notes: str) -> None:
        recorded = {
            name: {"files": self._files[name], **self._entries[name]}
            for name in sorted(self._files, reverse=True)
        }
        # The direction is left at +1: identification finds it, from either start.
        lines, bits = self._cell.lines, self._encoders.bits
        fitted: object = {
            f"b{j}": {"column": f"b{j}", "lines": lines, "bits": bits, "sign": 1}
            for j in self._encoders.joints
        }
        content: dict[str, object] = {"schema": "ballbar-recording/1", "kind": "real"}
        measured_by, described = "ballbar", self._cell.described
        if described is not None:
            content = described.model_dump(mode="json", by_alias=True, exclude_unset=True)
            measured_by = "ballbar" if described.instrument is None else "instrument"
            fitted, notes = (
                fitted or content.get("encoders", {}),
                f"{described.notes} {notes}".strip(),
            )
        content |= {
            "robot": self._cell.robot,
            measured_by: self._cell.ballbar,
            "plate": self._cell.plate,
            "sources": recorded,
            "encoders": fitted or content.get("encoders", {}) if "ballbar" in recorded else {},
            "notes": notes,
        }
        write_yaml(self.path / DESCRIPTION, content)


class SegmentFile:
    """A new device file that grows by whole records: readable wherever the recording breaks off.

    Each append reaches the disk before the next poll; after a crash at most the last append is
    missing or cut, and the reader drops an incomplete last record. When the disk is full the file
    is cut back to its last whole record.

    Raises OSError if it exists already or cannot be made.
    """

    def __init__(self, path: Path, start: bytes) -> None:
        self.path = path
        self.records = 0  # in the file, whole
        self._descriptor = os.open(
            path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644
        )
        self._start = start
        self._size = 0  # bytes of the whole records, with the start

    def append(self, records: list[bytes]) -> None:
        """Writes records, the first ones after the start of the file, and waits for the disk.

        Raises OSError when the disk is full or gone; the file then ends with its last whole record.
        """
        start = b"" if self._size else self._start
        ends = list(accumulate((len(record) for record in records), initial=len(start)))
        content, written = memoryview(start + b"".join(records)), 0
        try:
            while written < len(content):
                written += os.write(self._descriptor, content[written:])
            os.fsync(self._descriptor)
        except OSError:
            self._count_whole(ends, written)
            os.ftruncate(self._descriptor, self._size)
            raise
        self._count_whole(ends, written)

    def close(self) -> None:
        """Closes the file; one without a record is removed, because no reader can use it."""
        os.close(self._descriptor)
        if not self.records:
            self.path.unlink()

    def _count_whole(self, ends: list[int], written: int) -> None:
        whole = [end for end in ends[1:] if end <= written]
        if whole:
            self.records += len(whole)
            self._size += whole[-1]


def _without_records(path: Path, copied: Mapping[str, bytes]) -> list[Path] | None:
    """Files of a recorder that ended before its first record; None where anything else is there.

    copied : content of the descriptions that the next one copies, by their names.
    """
    if not path.is_dir():
        return None
    raw = list(path.glob("raw/*"))
    if not all(file.is_file() and not file.stat().st_size for file in raw):
        return None
    unfinished = {aside_of(path / name).name for name in (DESCRIPTION, *copied)}
    remains = [*raw]
    for entry in path.iterdir():
        if entry.name in unfinished or (entry.name == DESCRIPTION and raw):
            remains.append(entry)
        elif entry.name != "raw" and (
            entry.name not in copied or entry.read_bytes() != copied[entry.name]
        ):
            return None
    return remains

"""A device file that grows by whole records: it can be read wherever the recording breaks off.

Each append reaches the disk before the next poll; after a crash at most the last append is missing
or cut, and the reader drops an incomplete last record. When the disk is full the file is cut back
to its last whole record.
"""

from __future__ import annotations

import os
from itertools import accumulate
from pathlib import Path


class SegmentFile:
    """A new file, open for appending.

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
        """Writes records, the first ones behind the start of the file, and waits for the disk.

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

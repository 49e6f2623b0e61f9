"""`ballbar watch` in a process of its own beside a recorder, which waits for nothing of it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

from ballbar.cell.processes import process_apart
from ballbar.cell.threads import one_thread_each
from ballbar.watch.show import Data

LAST = 120.0  # [s] for the complete fit of the whole recording
# Asks a process to end, on Windows and elsewhere
END = getattr(signal, "CTRL_BREAK_EVENT", signal.SIGTERM)


class WatchBeside:
    """A process that watches a folder, and the latest of what it says."""

    def __init__(self, folder: Path, *, accuracy: float | None, duration: float | None) -> None:
        """accuracy : [m]. duration : [s] of the recording, if it is known."""
        command = [sys.executable, "-m", "ballbar", "watch", str(folder), "--json"]
        command += [] if accuracy is None else ["--accuracy", repr(accuracy * 1e3)]
        command += [] if duration is None else ["--duration", repr(duration)]
        self.latest: Data | None = None
        self.updates = 0
        self._duration, self._finished, self._left_out = duration, False, False
        with one_thread_each():  # Ctrl-C is for the recorder, which ends this one when it has ended
            self._process = process_apart(command, subprocess.PIPE)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None  # as it was started
        for text in self._process.stdout:
            self.latest = json.loads(text)
            self.updates += 1

    @property
    def failure(self) -> str:
        """Why the process has ended too early; empty while it runs, or where its work is done."""
        if self._left_out:
            return "without the last fit of the whole recording, which `ballbar identify` makes"
        code, reached = self._process.poll(), self.latest["recorded_s"] if self.latest else 0.0
        over = self._finished or (self._duration is not None and reached >= self._duration - 1.0)
        if code is None or (over and code in (0, 1)):
            return ""
        return f"exit code {code}; say `ballbar watch` in another terminal to see why"

    def finish(self) -> Data | None:
        """The last state, with a fit of the whole recording; None where the process has failed.

        Raises KeyboardInterrupt after Ctrl-C, which leaves that fit out.
        """
        self._finished = not self.failure
        if self._process.poll() is None:
            self._process.send_signal(END)
        try:
            self._process.wait(LAST)
        except (subprocess.TimeoutExpired, KeyboardInterrupt) as reason:
            self._left_out = True
            self._process.kill()
            self._process.wait()
            if isinstance(reason, KeyboardInterrupt):
                raise
        finally:
            self._reader.join(1.0)
            if self._process.stdout is not None and not self._reader.is_alive():
                self._process.stdout.close()
        return None if self.failure else self.latest

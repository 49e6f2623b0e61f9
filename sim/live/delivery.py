"""The thread of a simulated device: it begins when it is started, and ends with the device."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class DeviceThread:
    """Calls `cycle` every so many seconds, until it says that all is done, or until it is ended."""

    def __init__(self, cycle: Callable[[], bool], *, period: float) -> None:
        """cycle : returns whether there is no more to do. period : [s]."""
        self._cycle, self._period = cycle, period
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Whether all was done, or the thread was ended, within `seconds`."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def end(self) -> None:
        """Ends the thread, if it was started, and waits for it."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(self._period) and not self._cycle():
            pass


REAL_TIME = 1.0


class Pace:
    """Seconds of a recording that have been delivered; several devices share one."""

    def __init__(self, speed: float) -> None:
        """speed : times real time."""
        self._speed, self._rate = speed, 0.0
        self._since, self._before = time.monotonic(), 0.0  # when the rate was set; [s] until then
        self._lock = threading.Lock()

    @property
    def delivered(self) -> float:
        """[s] of the recording."""
        with self._lock:
            return self._before + self._rate * (time.monotonic() - self._since)

    def start(self) -> None:
        """The devices begin."""
        self._set(self._speed)

    def hold_back(self, *, wanted: bool) -> None:
        """Goes on in real time, or no longer; a speed below that stays as it is."""
        self._set(min(self._speed, REAL_TIME) if wanted else self._speed)

    def _set(self, rate: float) -> None:
        with self._lock:
            now = time.monotonic()
            self._before += self._rate * (now - self._since)
            self._since, self._rate = now, rate

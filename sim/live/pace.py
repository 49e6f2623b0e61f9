"""How fast simulated devices deliver a recording: faster than real time, or in real time."""

from __future__ import annotations

import threading
import time

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

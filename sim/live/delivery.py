"""Devices that deliver a recording at a common pace, each in a thread of its own."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from typing import Self

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


class Device(ABC):
    """A device that works from its start until all is done, or until the block ends."""

    def __init__(self, period: float) -> None:
        """period : [s] of its cycle."""
        self._period, self._stop = period, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._close()

    def start(self) -> None:
        """Starts the device."""
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Whether all was done, or the device has ended, within `seconds`."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stop.wait(self._period) and not self._cycle():
            pass

    @abstractmethod
    def _cycle(self) -> bool:
        """Does what is due, also what is late; whether there is no more to do."""

    @abstractmethod
    def _close(self) -> None:
        """Ends the connections."""

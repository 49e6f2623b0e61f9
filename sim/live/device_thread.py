"""The thread of a simulated device: it begins when it is started, and ends with the device."""

from __future__ import annotations

import threading
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

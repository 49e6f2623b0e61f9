"""The loop of `ballbar watch`: an update a second, until it is stopped or the recording is over."""

from __future__ import annotations

import os
import signal
import threading
import time
from multiprocessing import get_context
from pathlib import Path

from ballbar.acquisition.recording import require_folder
from ballbar.cell.threads import one_thread_each
from ballbar.watch.show import Show
from ballbar.watch.state import WatchState
from ballbar.watch.watch import Watch

PERIOD = 1.0  # [s] between updates
REST = 1.0  # times as long as an update took: half a core at most
LAST = 15.0  # [s] without new rows, once the duration is over, after which the recording is over


def watch(
    folder: Path,
    show: Show,
    *,
    accuracy: float | None,
    duration: float | None,
    stop: threading.Event,
) -> WatchState:
    """Watches a recording until `stop` is set, or its duration [s] is over; gives the last state.

    accuracy : [m] TCP error (rms) that is asked for.

    Raises DescriptionError for a folder that is not there.
    """
    require_folder(folder)
    # a process for the fits that take long, which yields to recorder and alarms; terminated at the
    # end, since the result of an unfinished fit is of no use
    with one_thread_each(), get_context("spawn").Pool(1, _yields_to_others) as pool:
        watched = Watch(folder, accuracy=accuracy, duration=duration, pool=pool)
        recorded, grown = -1.0, time.monotonic()
        while True:
            begun = time.monotonic()
            state = watched.update(begun)
            show(state.to_dict())
            took = time.monotonic() - begun
            if state.seconds != recorded:
                recorded, grown = state.seconds, begun
            over = duration is not None and recorded >= duration - PERIOD
            if (over and begun - grown > LAST) or stop.wait(max(PERIOD - took, REST * took)):
                break
    state = watched.finish(time.monotonic())
    show(state.to_dict())
    return state


def _yields_to_others() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(10)

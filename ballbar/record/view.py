"""The live view: angles and faults of a running recording in a rerun window, on this machine alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from acquisition.faults.encoders import FAULTS
from acquisition.live.source import Batch, Source
from ballbar.replay.viewer import live_viewer
from cell.recording import SourceName

FLUSH = 2.0  # [s] for the last records to reach the window
ROWS = 10  # of a batch that are shown: 100 Hz is enough for the eye, and a slow screen keeps up
COLOURS = [
    (31, 119, 180),
    (255, 127, 14),
    (44, 160, 44),
    (214, 39, 40),
    (148, 103, 189),
    (140, 86, 75),
]
TIMELINE = "recording_time"
APPLICATION = "ballbar-record"
_TITLES: dict[SourceName, str] = {"ballbar": "Ball-bar encoders [deg]", "robot": "Robot axes [deg]"}


class LiveView:
    """Sends each batch to a rerun stream.

    Both devices have clocks of their own; each is shifted once, so that its first record stands at the time it arrived. That is
    good enough for the eye and enters no file.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._begun = time.monotonic()
        self._shift: dict[SourceName, float] = {}  # [s] from a device's stamps to the timeline
        self._last: dict[SourceName, float] = {}

    def watch(self, source: Source, batch: Batch) -> None:
        """Shows a batch; called from the recorder's threads."""
        if not batch.t_ns.size:
            return
        first = source.name not in self._last
        t = self._anchor(source.name, batch.t_ns) + (batch.t_ns - batch.t_ns[0]) * 1e-9
        self._last[source.name] = float(t[-1])
        entity = f"/{source.name}/angle_deg"
        if first:
            lines = rr.SeriesLines(
                names=list(source.channels), colors=COLOURS[: len(source.channels)]
            )
            for shown in (entity, f"/{source.name}/fault"):
                self._stream.log(shown, lines, static=True)
        few = slice(None, None, -(-batch.t_ns.size // ROWS))
        at = [rr.TimeColumn(TIMELINE, duration=t[few])]
        self._stream.send_columns(
            entity, indexes=at, columns=rr.Scalars.columns(scalars=batch.values[few])
        )
        if batch.status.size:
            self._faults(source, batch, float(t[-1]))

    def _anchor(self, name: SourceName, t_ns: NDArray[np.int64]) -> float:
        """[s] on the timeline of the first record of a batch."""
        shift = self._shift.get(name)
        if shift is None or shift + float(t_ns[0]) * 1e-9 < self._last[name]:  # a new clock
            arrived = time.monotonic() - self._begun
            shift = arrived - float(t_ns[-1]) * 1e-9
            self._shift[name] = shift
        return shift + float(t_ns[0]) * 1e-9

    def _faults(self, source: Source, batch: Batch, t: float) -> None:
        entity = f"/{source.name}/fault"
        faulty = (batch.status & sum(FAULTS)) != 0
        self._stream.set_time(TIMELINE, duration=t)
        self._stream.log(entity, rr.Scalars(faulty.astype(np.float64)))


def layout() -> rrb.Blueprint:
    """Encoders above, faults below them, robot axes at the bottom; each follows the present."""
    views = [
        rrb.TimeSeriesView(origin="/ballbar/angle_deg", name=_TITLES["ballbar"]),
        rrb.TimeSeriesView(
            origin="/ballbar/fault", name="Encoder faults (1: rows will be left out)"
        ),
        rrb.TimeSeriesView(origin="/robot/angle_deg", name=_TITLES["robot"]),
    ]
    return rrb.Blueprint(
        rrb.Vertical(*views, row_shares=[3, 1, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


@contextmanager
def live_view() -> Iterator[LiveView]:
    """A window that shows what it is sent; it stays open when the recording has ended.

    Raises ViewerError if the viewer does not start.
    """
    address = live_viewer()
    stream = rr.RecordingStream(APPLICATION, send_properties=False)
    stream.connect_grpc(address, default_blueprint=layout())
    yield LiveView(stream)
    with suppress(RuntimeError):  # the window was closed: nothing is left to send to
        stream.flush(timeout_sec=FLUSH)

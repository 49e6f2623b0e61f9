"""Live view of a running recording: values and faults in a rerun window on this machine."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ballbar.acquisition.faults.encoders import FAULTS
from ballbar.acquisition.live.source import Batch, Source
from ballbar.cell.logs import SourceName
from ballbar.figure_style import LINES, rgb
from ballbar.replay.window import blueprint

ROWS = 10  # rows of a batch that are shown: 100 Hz suffices for the eye and for a slow screen
TIMELINE = "recording_time"
APPLICATION = "ballbar-record"
TITLES: dict[SourceName, str] = {"ballbar": "Ball-bar encoders", "robot": "Robot axes"}


class LiveView:
    """Sends each batch to a rerun stream.

    Each device has a clock of its own, which is shifted once so that its first record is shown at
    the time it arrived. That is accurate enough for the eye and enters no file.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._begun = time.monotonic()
        self._shift: dict[SourceName, float] = {}  # [s] from a device's stamps to the timeline
        self._last: dict[SourceName, float] = {}  # [s] of the last record on the timeline

    def on_batch(self, source: Source, batch: Batch) -> None:
        """Shows a batch; called from the recorder's threads."""
        if not batch.t_ns.size:
            return
        values_of, faults = f"/{source.name}/value", f"/{source.name}/fault"
        if source.name not in self._last:
            colours = [rgb(colour) for colour in LINES[: len(source.channels)]]
            lines = rr.SeriesLines(names=list(source.channels), colors=colours)
            for entity in (values_of, faults):
                self._stream.log(entity, lines, static=True)
        t = self._begin_of(source.name, batch.t_ns) + (batch.t_ns - batch.t_ns[0]) * 1e-9
        self._last[source.name] = float(t[-1])
        step = -(-batch.t_ns.size // ROWS)
        times = [rr.TimeColumn(TIMELINE, duration=t[::step])]
        values = rr.Scalars.columns(scalars=batch.values[::step])
        self._stream.send_columns(values_of, indexes=times, columns=values)
        if batch.status.size:
            faulty = (batch.status & sum(FAULTS)) != 0
            self._stream.set_time(TIMELINE, duration=float(t[-1]))
            self._stream.log(faults, rr.Scalars(faulty.astype(np.float64)))

    def _begin_of(self, name: SourceName, t_ns: NDArray[np.int64]) -> float:
        """Time [s] on the timeline of the first record of a batch with stamps t_ns (N,) [ns]."""
        shift = self._shift.get(name)
        if shift is None or shift + float(t_ns[0]) * 1e-9 < self._last[name]:  # a new clock
            arrived = time.monotonic() - self._begun
            shift = arrived - float(t_ns[-1]) * 1e-9
            self._shift[name] = shift
        return shift + float(t_ns[0]) * 1e-9


def layout(sources: Sequence[Source]) -> rrb.Blueprint:
    """A view of each source, and below the encoders one of their faults."""
    faults, views, shares = (
        "Encoder faults (1: rows will be left out)",
        list[rrb.View](),
        list[int](),
    )
    for source in sources:
        name = f"{TITLES.get(source.name, source.name.capitalize())} [{source.unit}]"
        views.append(rrb.TimeSeriesView(origin=f"/{source.name}/value", name=name))
        shares.append(3)
        if source.name == "ballbar":
            views.append(rrb.TimeSeriesView(origin="/ballbar/fault", name=faults))
            shares.append(1)
    return blueprint(rrb.Vertical(*views, row_shares=shares), TIMELINE)

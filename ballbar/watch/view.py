"""Live view of a growing recording: uncertainty, coverage, latest rows and alarms in rerun."""

from __future__ import annotations

import rerun as rr
import rerun.blueprint as rrb

from ballbar.record.view import TIMELINE
from ballbar.replay.window import blueprint
from ballbar.units import MM
from ballbar.watch.show import Data

APPLICATION = "ballbar-watch"
SIGMA, END, COVERED, PREDICTED, ALARMS = (
    "/tcp/so_far_mm", "/tcp/at_the_end_mm", "/covered_percent", "/latest_rows", "/alarms",
)  # fmt: skip


class WatchView:
    """Sends each state of a recording to a rerun stream."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._standing: set[tuple[str, str]] = set()

    def show(self, data: Data) -> None:
        """Adds a state; an alarm stands in the list once for as long as it is there."""
        self._stream.set_time(TIMELINE, duration=data["recorded_s"])
        scalars = {
            SIGMA: (data["tcp_sigma_m"], MM),
            END: (data["tcp_sigma_end_m"], MM),
            COVERED: (data["sphere_covered"], 100.0),
            PREDICTED: (data["predicted"], 1.0),
        }
        for entity, (value, scale) in scalars.items():
            if value is not None:
                self._stream.log(entity, rr.Scalars(value * scale))
        alarms = {(alarm["kind"], alarm["subject"]): alarm["sentence"] for alarm in data["alarms"]}
        for key in alarms.keys() - self._standing:
            text = f"{key[0]}: {alarms[key]}"
            self._stream.log(ALARMS, rr.TextLog(text, level=rr.TextLogLevel.ERROR))
        self._standing = set(alarms)


def layout() -> rrb.Blueprint:
    """Uncertainty at the top, then the latest rows and the coverage, alarms at the bottom."""
    views = [
        rrb.TimeSeriesView(origin="/tcp", name="Stated TCP uncertainty [mm]"),
        rrb.TimeSeriesView(origin=PREDICTED, name="Residual of the latest rows over the expected"),
        rrb.TimeSeriesView(origin=COVERED, name="Sphere covered [%]"),
        rrb.TextLogView(origin=ALARMS, name="Alarms"),
    ]
    return blueprint(rrb.Vertical(*views, row_shares=[3, 2, 1, 1]), TIMELINE)

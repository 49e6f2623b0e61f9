"""How windows of the viewer open: panels folded, and live ones while data arrive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from ballbar.replay.viewer import live_viewer

FLUSH = 5.0  # [s] for the last data to reach a live window


def blueprint(root: rrb.Container | rrb.View, timeline: str, speed: float = 0.0) -> rrb.Blueprint:
    """A blueprint with folded panels that plays a timeline over and over.

    speed : of playing; 0 follows what is being recorded.
    """
    playing: dict[str, Any] = {"play_state": "following"}
    if speed:
        playing = {"play_state": "playing", "loop_mode": "all", "playback_speed": speed}
    return rrb.Blueprint(
        root,
        rrb.TimePanel(timeline=timeline, state="collapsed", **playing),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


@contextmanager
def live_window(
    application: str, layout: rrb.Blueprint, address: str | None = None
) -> Iterator[rr.RecordingStream]:
    """The stream to a window that remains open when the program has ended.

    address : of the viewer; by default one is started. Raises ViewerError if it does not start.
    """
    stream = rr.RecordingStream(application, send_properties=False)
    stream.connect_grpc(address or live_viewer(), default_blueprint=layout)
    yield stream
    with suppress(RuntimeError):  # the window was closed: nothing is left to send to
        stream.flush(timeout_sec=FLUSH)

"""A run shown while it is made: the cell as simulated, then the iterations, then the replay."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ballbar.replay.arrangements import identify_layout
from ballbar.replay.entities import CELL, CLOSURE_ERROR, TIMELINE, Branch
from ballbar.replay.iterations import log_step
from ballbar.replay.motion import moving_cell, thinning
from ballbar.replay.scene import log_path_so_far, log_poses, log_shapes
from ballbar.replay.viewer import live_viewer
from ballbar.replay.write import send_replay
from ballbar.result.iterations import Step
from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry

APPLICATION = "ballbar-live"
FLUSH = 5.0  # [s] for the window to take what it was sent


class LiveRun:
    """Sends what is known of a run so far to a rerun stream."""

    def __init__(self, stream: rr.RecordingStream, address: str = "") -> None:
        """address : of the viewer, for the replay at the end; empty for none."""
        self._stream, self._branch, self._address = stream, Branch(stream), address
        self._moved = self._iterated = False

    def moved(self, cell: Cell, geometry: Geometry, t: Array, q: Array, b: Array) -> None:
        """A stretch of the true motion; arguments as of `sim.motion.MotionCallback`."""
        # its last row is the first of the next stretch
        rows = np.unique(np.append(np.arange(0, t.size, thinning(t)), t.size - 1))
        motion = moving_cell(geometry, t[rows], q[rows], b[rows])
        if not self._moved:
            self._stream.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            log_shapes(self._branch, cell, geometry, motion)
            self._moved = True
        log_poses(self._branch, motion)
        log_path_so_far(self._branch, motion)

    def iterated(self, number: int, step: Step) -> None:
        """One iteration of the identification."""
        if not self._iterated:
            self._stream.send_blueprint(identify_layout(), make_active=True)
            self._iterated = True
        log_step(self._stream, number, step)

    def finished(self, data: RunData) -> None:
        """The whole replay, in the same window."""
        if self._address:
            send_replay(self._address, data)


@contextmanager
def live_run() -> Iterator[LiveRun]:
    """A window for a run; it stays open when the run has ended.

    Raises ViewerError if the viewer does not start.
    """
    address = live_viewer()
    stream = rr.RecordingStream(APPLICATION, send_properties=False)
    stream.connect_grpc(address, default_blueprint=_scene())
    yield LiveRun(stream, address)
    with suppress(RuntimeError):  # the window was closed: nothing is left to send to
        stream.flush(timeout_sec=FLUSH)


def _scene() -> rrb.Blueprint:
    cell = rrb.Spatial3DView(
        origin=CELL, contents=["$origin/**", f"- {CLOSURE_ERROR}/**"], name="The cell as simulated"
    )
    return rrb.Blueprint(
        cell,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )

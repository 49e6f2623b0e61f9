"""A run shown while it is made: the cell as it is simulated, then the replay."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.replay.entities import CELL, TIMELINE, Branch
from ballbar.replay.scene import log_path_so_far, log_poses, log_shapes
from ballbar.replay.viewer import live_viewer
from ballbar.replay.window import blueprint, live_window
from ballbar.replay.write import send_replay
from ballbar.report.motion import moving_cell, thinning
from ballbar.result.run_data import RunData

APPLICATION = "ballbar-live"


class LiveRun:
    """Sends what is known of a run so far to a rerun stream."""

    def __init__(self, stream: rr.RecordingStream, address: str = "") -> None:
        """address : of the viewer, for the replay at the end; empty for none."""
        self._stream, self._branch, self._address = stream, Branch(stream), address
        self._moved = False

    def moved(self, cell: Cell, geometry: Geometry, t: Array, q: Array, b: Array) -> None:
        """A stretch of the true motion; arguments as of `ballbar.sim.motion.MotionCallback`."""
        # its last row is the first of the next stretch
        rows = np.unique(np.append(np.arange(0, t.size, thinning(t)), t.size - 1))
        motion = moving_cell(geometry, t[rows], q[rows], b[rows])
        if not self._moved:
            self._stream.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            log_shapes(self._branch, cell, geometry, motion)
            self._moved = True
        log_poses(self._branch, motion)
        log_path_so_far(self._branch, motion)

    def finished(self, data: RunData) -> None:
        """The whole replay, in the same window."""
        if self._address:
            send_replay(self._address, data)


@contextmanager
def live_run() -> Iterator[LiveRun]:
    """A window for a run; it stays open when the run has ended.

    Raises ViewerError if the viewer does not start.
    """
    scene = rrb.Spatial3DView(origin=CELL, name="The cell as simulated")
    address = live_viewer()
    with live_window(APPLICATION, blueprint(scene, TIMELINE), address) as stream:
        yield LiveRun(stream, address)

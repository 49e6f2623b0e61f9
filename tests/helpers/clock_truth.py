"""The clock of a fit against the true one of its simulation."""

from __future__ import annotations

import numpy as np

from ballbar.ident.result import Identification
from ballbar.sim.simulate import Simulation


def clock_error(simulation: Simulation, found: Identification) -> np.ndarray:
    """(M,) [s] robot time that the fit gives each ball-bar row, less the true one."""
    times, rows = simulation.times, simulation.rows.ballbar
    row = np.concatenate(rows)
    stamps = (times.bar_stamp[row] - times.bar_stamp[row[0]]) * 1e-9
    true = times.bar_true[row] - times.robot_true[0]
    (recording,) = found.recordings
    assert recording.clock is not None
    back = np.flatnonzero(np.diff(stamps) < 0)
    for k in back:  # as the reader joins the two segments
        stamps[k + 1 :] += stamps[k] - stamps[k + 1] + np.median(np.diff(stamps))
    told = stamps.copy()
    for event in recording.step_faults:
        if event.kind == "clock":
            told[stamps > event.time] -= event.size
    return np.asarray(recording.clock.robot_time(told) - true)

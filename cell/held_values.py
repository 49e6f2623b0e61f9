"""Values that a log repeats because its source holds them between its own updates.

A logger that asks more often than its source measures writes each value several times. A repeated
row is no measurement: the value is that of the row in which it first appeared, and taken as a
signal the log would be late by half a hold on average.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array

DWELL = 2.0  # times the source's period: values that stay for longer are those of a dwell
NOTABLE = 0.05  # share of repeated rows among those of the motion from which values are held
# Times the smallest change: where most changes are smaller, values repeat since they are rounded.
ROUNDED = 3.0


def changed_rows(channels: Sequence[Array] | Array) -> NDArray[np.bool_]:
    """(N,) rows that differ from the row before in some channel, and the first; channels : (N,)."""
    changed = np.zeros(channels[0].size, dtype=bool)
    changed[0] = True
    for channel in channels:
        changed[1:] |= channel[1:] != channel[:-1]
    return changed


def fresh_rows(t: Array, values: Array) -> NDArray[np.bool_]:
    """(N,) which rows are measurements: all of them, unless values are held.

    t : (N,) [s]. values : (N, C). In a dwell a row of each of the source's periods remains.
    """
    changes, changed = np.diff(values, axis=0), changed_rows(values.T)
    first = np.flatnonzero(changed)
    if first.size < 3:
        return np.ones(t.size, dtype=bool)
    period = float(np.median(np.diff(t[first])))
    since = t - t[first][np.cumsum(changed) - 1]
    moving = since < DWELL * period
    sizes = [np.abs(column[column != 0.0]) for column in changes.T]
    steps = max(float(np.median(size) / size.min()) for size in sizes if size.size)
    if (~changed & moving).sum() < NOTABLE * moving.sum() or steps < ROUNDED:
        return np.ones(t.size, dtype=bool)
    number = np.floor(since / (DWELL * period))
    return np.asarray(changed | (np.diff(number, prepend=0.0) > 0.0))

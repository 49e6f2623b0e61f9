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
# Smallest steps of a channel: what goes on by more stops for no tick. A value whose decade counts.
COARSE, LEAST = 10.0, 1e-9


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


def whole_and_torn_rows(channels: Sequence[Array]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(F,) rows with new values, and (K,) rows in which a channel is still at its last value.

    channels : (N,) each. A torn row was read while the source renewed its values. The row after it
    has the values that were missing, and is whole.
    """
    fresh = np.flatnonzero(changed_rows(channels))
    row = np.unique(np.concatenate([_stops(channel[fresh]) for channel in channels]))
    place = np.arange(row.size)
    since = place - np.maximum.accumulate(np.where(np.diff(row, prepend=-2) > 1, place, 0))
    torn = row[since % 2 == 0]
    return np.delete(fresh, torn), fresh[torn]


def _stops(channel: Array) -> NDArray[np.intp]:
    """(K,) rows at which a channel (F,) stops for a single row.

    Before and after it goes on by many of its smallest steps in one direction; a motion that is
    finer than they are holds values too.
    """
    step = np.diff(channel)
    held = np.flatnonzero((step[1:-1] == 0.0) & (step[:-2] * step[2:] > 0.0)) + 1
    if not held.size:
        return held
    decade = np.log10(np.maximum(np.abs(channel[1:]), LEAST)).astype(np.intp)
    decade -= decade.min()  # numbers of so many digits are coarser above 100 than below
    finest = np.full(decade.max() + 1, np.inf)
    np.minimum.at(finest, decade, np.where(step == 0.0, np.inf, np.abs(step)))
    size = np.minimum(np.abs(step[held - 1]), np.abs(step[held + 1]))
    return held[size >= COARSE * finest[decade[held]]] + 1

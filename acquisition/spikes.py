"""Single values that do not lie between their neighbours as all others do: a changed digit or bit in a file without checksum.

A robot moves smoothly: sampled every few milliseconds, a value differs little from the cubic through the two before and the two
behind it. One changed value shows in its own difference and, in known proportion, in those of the four beside it, which
motion, noise, steps and late samples do not do at this size.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.table import Table

USUAL = 20.0  # times the upper quartile of the differences nearby, which a second spike does not raise
_NEARBY = 12  # rows on each side that say what is usual
_SHAPE = 0.15  # how far the differences beside may be from their proportion; a sudden change of speed is 0.17 off
_MOST = 300  # rows looked at in a column: those with the largest differences
_STEEPEST = 8.0  # weight of a neighbour in the cubic; late samples make larger ones, and differences without meaning
_ROUNDING = 1e-13  # of the largest value: below it, differences are those of float64

Array = NDArray[np.float64]


def report_spikes(table: Table, time: str, names: Iterable[str], findings: list[Finding]) -> None:
    """Rows where the time or one of these columns has a spike are appended to `findings` as a warning; nothing is changed."""
    stamps = table.columns[time]
    rows = np.flatnonzero(np.concatenate(([True], np.diff(stamps) > 0)))
    if len(rows) < 2 * _NEARBY or (np.diff(stamps) < 0).any():
        return  # too short to say what is usual; a time that goes back is refused later
    t = (stamps[rows] - stamps[0]).astype(np.float64)
    found = {time: spikes(np.arange(len(rows), dtype=np.float64), t)}
    found |= {name: spikes(t, _unwrapped(table.columns[name][rows])) for name in names}
    for name, at in found.items():
        if at.size:
            sentence = f"{name} stands out from its neighbours as nothing else nearby does: a damaged number?"
            findings.append(finding("spike", "warning", table.files[0], sentence, lines=table.line[rows[at]]))


def spikes(t: Array, values: Array) -> NDArray[np.int64]:
    """Indices of (N,) values that differ from the cubic through their neighbours far more than those nearby do.

    t : (N,) strictly increasing, in any unit.
    """
    stencil, weights = _cubics(t)
    differs = values - (weights * values[stencil]).sum(axis=1)
    size = np.abs(differs) / (1.0 + np.abs(weights).sum(axis=1))
    size[np.abs(weights).max(axis=1) > _STEEPEST] = 0.0
    steps = np.abs(np.diff(values))
    quantum = float(steps[steps > 0.0].min(initial=steps.max()))
    found = []
    largest = np.argsort(size)[::-1][:_MOST]
    around = np.clip(largest[:, None] + np.arange(-_NEARBY, _NEARBY + 1), 0, t.size - 1)
    for i in largest[size[largest] > USUAL * np.median(size[around], axis=1)]:  # at most nine of these 25 are touched by one spike
        beside = slice(max(i - _NEARBY - 4, 0), i + _NEARBY + 5)
        touched = stencil[beside] == i  # (R, 4)
        nearby = size[beside][~touched.any(axis=1) & (np.arange(len(t))[beside] != i)]
        # At rest, where nothing differs, a value may still flicker by the smallest step.
        usual = max(float(np.quantile(nearby, 0.75)), quantum if np.median(nearby) == 0.0 else 0.0, _ROUNDING * float(np.abs(values).max()))
        off = (differs[beside] + (weights[beside] * touched).sum(axis=1) * differs[i])[touched.any(axis=1)]
        if size[i] > USUAL * usual and (np.abs(off) < _SHAPE * np.abs(differs[i])).all():
            found.append(i)
    return np.sort(np.array(found, dtype=np.int64))


def _cubics(t: Array) -> tuple[NDArray[np.int64], Array]:
    """(N, 4) indices of the four rows nearest to each, and their weights in the cubic through them (Lagrange)."""
    rows = np.arange(t.size)
    first = np.clip(rows - 2, 0, t.size - 5)[:, None] + np.arange(5)
    stencil = first[first != rows[:, None]].reshape(-1, 4)
    away = t[stencil] - t[:, None]
    weights = np.ones_like(away)
    for k in range(4):
        for m in range(4):
            if m != k:
                weights[:, k] *= away[:, m] / (away[:, m] - away[:, k])
    return stencil, weights


def _unwrapped(values: NDArray[Any]) -> Array:
    """Floats as they are; counters of 32 bits without their wraps."""
    if values.dtype == np.float64:
        return np.asarray(values, dtype=np.float64)
    steps = (np.diff(values) + 2**31) % 2**32 - 2**31
    return np.concatenate(([0.0], np.cumsum(steps, dtype=np.float64)))

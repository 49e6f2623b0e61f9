"""Single values that do not lie between their neighbours as all others do: a changed digit or bit in a file without checksum.

A robot moves smoothly: sampled every few milliseconds, a value differs from the mean of its two neighbours by little. One
changed value shows as (-d/2, d, -d/2) in these differences, which motion, noise and steps do not do at this size.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.table import Table

USUAL = 12.0  # times the largest difference nearby
_NEARBY = 10  # rows on each side that say what is usual
_SHAPE = 0.25  # how far the two neighbours' differences may be from half, as a fraction
_MOST = 100  # spikes looked for in a column: a column with more is no smooth signal


def report_spikes(table: Table, names: Iterable[str], findings: list[Finding]) -> None:
    """Rows where one of these columns has a spike are appended to `findings` as a warning; nothing is changed."""
    for name in names:
        rows = spikes(_unwrapped(table.columns[name]))
        if rows.size:
            sentence = f"{name} stands out from its neighbours as no motion does: a damaged number?"
            findings.append(finding("spike", "warning", table.files[0], sentence, lines=table.line[rows]))


def spikes(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of values that differ from the mean of their neighbours by more than USUAL times what is usual nearby."""
    if values.size < 2 * _NEARBY + 3:
        return np.empty(0, dtype=np.int64)
    steps = np.abs(np.diff(values))
    quantum = steps[steps > 0.0].min(initial=steps.max())  # a value at rest may flicker by one
    differs = np.pad(values[1:-1] - 0.5 * (values[:-2] + values[2:]), 2)  # the ends have no two neighbours
    size = np.abs(differs)
    largest = np.argsort(size)[::-1][: 3 * _MOST]
    found = []
    for i in largest[size[largest] > 0.0]:
        nearby = np.concatenate((size[max(i - 1 - _NEARBY, 0) : i - 1], size[i + 2 : i + 2 + _NEARBY]))
        beside = differs[[i - 1, i + 1]] / differs[i]
        inside = beside[[i >= 3, i <= values.size - 2]]  # where the neighbour has a difference of its own
        if size[i] > USUAL * _usual(nearby, quantum) and (np.abs(inside + 0.5) < _SHAPE).all():
            found.append(i - 1)
    for end, step in ((0, 1), (values.size - 1, -1)):  # an end lies on the line through the two beside it
        off = abs(values[end] - 2.0 * values[end + step] + values[end + 2 * step])
        nearby = 2.0 * (size[4 : 4 + _NEARBY] if step > 0 else size[-4 - _NEARBY : -4])
        if off > USUAL * _usual(nearby, quantum) and not {end + step, end + 2 * step} & set(found):
            found.append(end)
    return np.sort(np.array(found, dtype=np.int64))


def _usual(nearby: NDArray[np.float64], quantum: float) -> float:
    """The largest difference nearby; at rest, where there is none, the smallest step of all."""
    return float(max(nearby.max(), quantum if not nearby.all() else 0.0))


def _unwrapped(values: NDArray[Any]) -> NDArray[np.float64]:
    """Floats as they are; counters of 32 bits without their wraps."""
    if values.dtype == np.float64:
        return values
    steps = (np.diff(values) + 2**31) % 2**32 - 2**31
    return np.concatenate(([0.0], np.cumsum(steps, dtype=np.float64)))

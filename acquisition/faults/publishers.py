"""Two publishers on one topic: rows in close pairs whose values alternate between two levels.

A recorder that listens to two publishers gets their rows in pairs, far closer in time than either
publishes. No motion leads from one level to the other within a pair, and the two keep their
distance from pair to pair. Pairs that are two updates of one source, delivered together, or a value
held and the next one, differ by the motion instead: in proportion to the speed, and not at all at
rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbar.acquisition.stamps.order import STAMP, amount
from ballbar.acquisition.table.table import Table
from ballbar.acquisition.times import Stamps
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.neighbours import Rows

CLOSE = 0.25  # of the distance of a row to the next but one: closer rows are a pair
FEWEST, SHARE = 20, 0.5  # pairs, and share of the rows that are in pairs
MOTION = 0.5  # of the difference within pairs: what no delay of the motion accounts for
LEVEL = 0.4  # of that difference: what varies more from pair to pair is no distance of levels
LEAST = 3e-5  # of the travel: a smaller difference does not matter, 30 um over 1 m


def refuse_two_publishers(table: Table, columns: Sequence[str], unit: str) -> None:
    """Raises LogError if the rows of one file are of two publishers.

    columns : those of the values. unit : of the values, empty if unknown.
    """
    stamps = table.columns[STAMP]
    first = _pairs(stamps)
    if not first.size:
        return
    values = np.stack([table.columns[name] for name in columns], axis=1).astype(np.float64)
    if not _two_levels(stamps[first], values[first], values[first + 1]):
        return
    apart = np.median(np.abs(values[first + 1] - values[first]), axis=0)
    within = amount(float(np.median(stamps[first + 1] - stamps[first])) * 1e-9)
    most, size = columns[int(apart.argmax())], f"{apart.max():.3g} {unit}".strip()
    what = f"two publishers: {first.size} pairs of rows, {within} apart, whose values lie on two "
    what += f"levels, {size} apart in {most} (median)."
    remedy = "Record one of them, or leave the rows of the other out of the file."
    raise LogError.at(table.location(first[0]), what, remedy)


def _pairs(stamps: Stamps) -> Rows:
    """(K,) first rows of pairs of rows at stamps (N,) [ns]; none unless most rows are in pairs."""
    step = np.diff(stamps)
    if step.size < 2 * FEWEST:
        return np.zeros(0, dtype=np.intp)
    first = np.flatnonzero(step < CLOSE * float(np.median(stamps[2:] - stamps[:-2])))
    return first if first.size >= max(FEWEST, 0.5 * SHARE * stamps.size) else first[:0]


def _two_levels(stamps: Stamps, a: Array, b: Array) -> bool:
    """Whether pairs of values a and b (K, C) at stamps (K,) [ns] lie on two levels."""
    jump, t = b - a, (stamps - stamps[0]).astype(np.float64)
    speed = np.gradient(a, axis=0) / np.maximum(np.gradient(t), 1.0)[:, None]
    usual = np.median(np.abs(speed), axis=0)
    delay = np.median(jump * np.sign(speed), axis=0) / np.where(usual > 0.0, usual, np.inf)
    turned = np.where((jump[1:] * jump[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    order = np.cumprod(np.append(1.0, turned))[:, None]  # -1 where the second publisher comes first
    size = _typical(jump)
    low, high = np.quantile(a, (0.01, 0.99), axis=0)
    return (
        size > LEAST * float(np.linalg.norm(high - low))
        and _typical(jump - delay * speed) > MOTION * size
        and _typical(np.diff(jump * order, axis=0)) < LEVEL * size
    )


def _typical(vectors: Array) -> float:
    """Median of the norms of vectors (K, C)."""
    return float(np.median(np.linalg.norm(vectors, axis=1)))

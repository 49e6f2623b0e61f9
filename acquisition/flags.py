"""Row flags: what is wrong or special with a row of a log, as bits of one word."""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.uint32]


class RowFlag(IntFlag):
    """The bits of a row's flags."""

    DUPLICATE = 1  # other rows had the same stamp and were left out
    REORDERED = 2  # put in order by its sequence number
    GAP = 4  # rows are missing before it
    OVERRUN = 8  # later than it should be
    AMPLITUDE = 16  # encoder: sine signal too weak
    FREQUENCY = 32  # encoder: too fast for the terminal
    SYNC = 64  # encoder: bus cycle missed, the sample may be a cycle old
    INVALID = 128  # encoder: terminal marked its data as suspect; tracker: no LED in sight
    STALE = 256  # encoder: process data not renewed since the row before
    PRESET = 512  # counter set or reset here
    IMPLAUSIBLE = 1024  # no motion leads to this value
    REPAIRED = 2048  # line read with a repair
    SENTINEL = 4096  # rows before it had a number that stands for no value, and were left out
    FROZEN = 8192  # a channel repeats the value of a row before


EXCLUDED = (
    RowFlag.AMPLITUDE | RowFlag.FREQUENCY | RowFlag.INVALID | RowFlag.IMPLAUSIBLE | RowFlag.FROZEN
)


def usable(flags: Flags) -> NDArray[np.bool_]:
    """(N,) whether a fit may use the row; flags : (N,) bits of RowFlag."""
    return np.asarray((flags & np.uint32(EXCLUDED)) == 0)

"""The ring buffer that the PLC fills and the recorder empties, byte by byte.

    header  layout, capacity, fitted, bits: UDINT; started, written: ULINT                  32 bytes
    sample  sequence, time: ULINT; counter: 5 UDINT; status: 5 UINT; spare: UINT       48 bytes each

The PLC writes sample n (counted from 0) to slot n mod capacity, with n + 1 as its sequence number,
and only then counts `written` up. `started` is the time of the PLC's first cycle. The Structured
Text of both structures is in docs/plc/ball_bar.st. Little-endian, as every TwinCAT target.
"""

from __future__ import annotations

import numpy as np

RING = "GVL_BallBar.stRing"  # its variable in the PLC program docs/plc/ball_bar.st
LAYOUT = 0x31424244  # "DBB1" in memory
HEADER = np.dtype(
    [
        ("layout", "<u4"),
        ("capacity", "<u4"),
        ("fitted", "<u4"),
        ("bits", "<u4"),
        ("started", "<u8"),
        ("written", "<u8"),
    ]
)
SAMPLE = np.dtype(
    [
        ("sequence", "<u8"),
        ("time", "<u8"),
        ("counter", "<u4", 5),
        ("status", "<u2", 5),
        ("spare", "<u2"),
    ]
)

"""Device logs as the loggers of the cell write them: dialects `twincat-plc` and `abb-motor`.

Every file appears whole or not at all: it is written beside its place and renamed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from cell.files import write_whole


def write_twincat_plc(
    path: Path, stamps: NDArray[np.int64], counts: Mapping[str, NDArray[np.uint32]], status: Mapping[str, NDArray[np.int64]]
) -> None:
    """Ball-bar log: `time;b1;..;s1;..` with DC time in ns and raw uint32 counters, records ending CRLF (log_formats sec. A.6).

    stamps : (N,) [ns since 2000-01-01]; counts, status : column name to (N,) counter values and status words.
    """
    columns: dict[str, NDArray[np.integer[Any]]] = {**counts, **status}
    rows = np.column_stack((stamps, *(c.astype(np.int64) for c in columns.values())))
    lines = [";".join(("time", *columns)), *(";".join(map(str, row)) for row in rows.tolist())]
    write_whole(path, ("\r\n".join(lines) + "\r\n").encode("ascii"))


def write_abb_motor(path: Path, stamps: Array, motors: Array) -> None:
    """Robot log: `time,m1..m6`, time in s on the robot's clock, motor angles in rad.

    stamps : (N,) [s]; motors : (N, 6) [rad].
    """
    header = "time," + ",".join(f"m{i + 1}" for i in range(motors.shape[1]))
    form = "%.6f," + ",".join(["%.9f"] * motors.shape[1])  # 1e-9 rad of the motor is 1e-11 rad of the joint
    lines = [form % tuple(row) for row in np.column_stack((stamps, motors)).tolist()]
    write_whole(path, ("\n".join([header, *lines]) + "\n").encode("ascii"))

"""Device logs as the loggers of the cell write them: dialects `twincat-plc` and `abb-motor`.

Every file appears whole or not at all: it is written beside its place and renamed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.files import write_whole


def write_twincat_plc(
    path: Path,
    stamps: NDArray[np.int64],
    counts: Mapping[str, NDArray[np.uint32]],
    status: Mapping[str, NDArray[np.int64]],
) -> None:
    """Ball-bar log: `time;b1;..;s1;..` with DC time in ns and raw uint32 counters, records ending CRLF (notes/log_formats sec. A.6).

    stamps : (N,) [ns since 2000-01-01]; counts, status : column name to (N,) counter values and status words.
    """
    columns: dict[str, NDArray[np.integer[Any]]] = {**counts, **status}
    rows = np.column_stack((stamps, *(c.astype(np.int64) for c in columns.values())))
    lines = [";".join(("time", *columns)), *(";".join(map(str, row)) for row in rows.tolist())]
    write_whole(path, ("\r\n".join(lines) + "\r\n").encode("ascii"))


def write_abb_motor(path: Path, stamps: Array, motors: Array, torques: Array | None = None) -> None:
    """Robot log: `time,m1..m6[,tau1..tau6]`, time in s on the robot's clock, motor angles in rad, torques in N m.

    stamps : (N,) [s]; motors : (N, 6) [rad]; torques : (N, 6) [N m] at the motors, if they are logged.
    """
    names, forms, columns = (
        ["time", *(f"m{i + 1}" for i in range(6))],
        ["%.6f", *["%.9f"] * 6],
        [stamps, motors],
    )
    if (
        torques is not None
    ):  # 1e-9 rad of the motor is 1e-11 rad of the joint, 1e-6 N m is 1e-4 N m there
        names, forms, columns = (
            [*names, *(f"tau{i + 1}" for i in range(6))],
            [*forms, *["%.6f"] * 6],
            [*columns, torques],
        )
    _write_table(path, names, forms, np.column_stack(columns))


def write_force_torque(path: Path, stamps: Array, readings: Array) -> None:
    """Force sensor log: `time,fx,fy,fz,tx,ty,tz` in s, N and N m.

    stamps : (N,) [s] on the sensor's clock; readings : (N, 6).
    """
    _write_table(
        path,
        ["time", "fx", "fy", "fz", "tx", "ty", "tz"],
        ["%.6f", *["%.5f"] * 6],
        np.column_stack((stamps, readings)),
    )


def _write_table(path: Path, names: list[str], forms: list[str], rows: Array) -> None:
    form = ",".join(forms)
    lines = [form % tuple(row) for row in rows.tolist()]
    write_whole(path, ("\n".join([",".join(names), *lines]) + "\n").encode("ascii"))

"""Device logs as the loggers of the cell write them, in the shipped dialects.

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
    """Write a ball-bar log: `time;b1;..;s1;..` with lines that end in CRLF.

    stamps : (N,) [ns] distributed clock time since 2000-01-01. counts, status : (N,) uint32 counter
        values and status words by column name. Source: notes/log_formats sec. A.6.
    """
    columns: dict[str, NDArray[np.integer[Any]]] = {**counts, **status}
    rows = np.column_stack((stamps, *(c.astype(np.int64) for c in columns.values())))
    lines = [";".join(("time", *columns)), *(";".join(map(str, row)) for row in rows.tolist())]
    write_whole(path, ("\r\n".join(lines) + "\r\n").encode("ascii"))


def write_abb_motor(path: Path, stamps: Array, motors: Array, torques: Array | None = None) -> None:
    """Write a robot log: `time,m1..mJ[,tau1..tauJ]` in s, rad and N m.

    stamps : (N,) [s] on the robot's clock. motors : (N, J) [rad]. torques : (N, J) [N m] at the
        motors, if they are logged.
    """
    # 1e-9 rad of a motor is 1e-11 rad of its joint, 1e-6 N m is 1e-4 N m there.
    joints = range(1, motors.shape[1] + 1)
    names, forms = ["time", *(f"m{i}" for i in joints)], ["%.6f", *["%.9f"] * len(joints)]
    columns = [stamps, motors]
    if torques is not None:
        names += [f"tau{i}" for i in joints]
        forms += ["%.6f"] * len(joints)
        columns.append(torques)
    _write_table(path, names, forms, np.column_stack(columns))


def write_lengths(path: Path, stamps: Array, lengths: Array) -> None:
    """Write a log of lengths: `time,length` in s and mm.

    stamps : (N,) [s] on the sensor's clock. lengths : (N,) [m].
    """
    rows = np.column_stack((stamps, lengths * 1e3))
    _write_table(path, ["time", "length"], ["%.6f", "%.7f"], rows)


def write_force_torque(path: Path, stamps: Array, readings: Array) -> None:
    """Write a force sensor log: `time,fx,fy,fz,tx,ty,tz` in s, N and N m.

    stamps : (N,) [s] on the sensor's clock. readings : (N, 6) [N, N m].
    """
    names, forms = ["time", "fx", "fy", "fz", "tx", "ty", "tz"], ["%.6f", *["%.5f"] * 6]
    _write_table(path, names, forms, np.column_stack((stamps, readings)))


def _write_table(path: Path, names: list[str], forms: list[str], rows: Array) -> None:
    form = ",".join(forms)
    lines = [form % tuple(row) for row in rows.tolist()]
    write_whole(path, ("\n".join([",".join(names), *lines]) + "\n").encode("ascii"))

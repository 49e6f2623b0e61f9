"""Peak memory of `ballbar check` and `ballbar identify` on a recording of hours.

    python -m benchmarks.long_recordings [HOURS] [--keep DIR]      # 8

The robot's log has 248 rows a second with six motor angles, the ball-bar's 100 with five counters,
as text. The tool runs to and fro along the path of scenarios/paths/irb2400_a.yaml, each time within
another duration, so that no lag but one explains both logs; the robot has the errors of thesis
Table 3.1, and every row white noise. Peak is the resident set of the command's own process
(VmHWM of /proc, getrusage of a finished child), processor time its user and system time.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TextIO

import numpy as np
from scipy.interpolate import CubicSpline

from ballbar.cell.arrays import Array
from ballbar.cell.robot_angles import joints_to_motors
from benchmarks.study import COUNTS_PER_RAD, describe
from tests.helpers.minute_logs import TRUE
from tests.helpers.synthetic_recording import CELL, closed, minute

ROBOT_HZ, BAR_HZ = 248.0, 100.0
LATE_S = 3.7  # the ball-bar's log begins
NOISE = 1e-5  # [rad]
PASS_S = (40.0, 90.0)  # durations of a pass along the path, of which sixty seconds move
BLOCK = 200_000  # rows
COMMANDS = ("check", "identify")


def written(folder: Path, hours: float) -> None:
    """The recording folder of so many hours."""
    rng = np.random.default_rng(8)
    path = minute(0.005)
    phase = path.t / path.t[-1]
    joints = CubicSpline(phase, closed(TRUE, path.b, path.q))
    bar = CubicSpline(phase, path.b)
    passes = rng.uniform(*PASS_S, size=round(hours * 3600.0 / PASS_S[0]) + 2)
    ends = np.concatenate(([0.0], np.cumsum(passes)))

    def phase_at(t: Array) -> Array:
        k = np.searchsorted(ends, t, side="right") - 1
        along = (t - ends[k]) / passes[k]
        return np.where(k % 2, 1.0 - along, along)

    def robot_rows(t: Array) -> str:
        q = joints(phase_at(t)) + rng.normal(0.0, NOISE, (t.size, 6))
        form = "%.6f" + ",%.9f" * 6 + "\n"
        table = np.column_stack((100.0 + t, joints_to_motors(CELL.robot, q)))
        return "".join(form % tuple(row) for row in table.tolist())

    def bar_rows(t: Array) -> str:
        b = bar(phase_at(t)) + rng.normal(0.0, NOISE, (t.size, 5))
        counts = np.rint(b * COUNTS_PER_RAD).astype(np.int64) % 2**32
        stamps = 830_000_000_000_000_000 + np.rint((t - LATE_S) * 1e9).astype(np.int64)
        form = "%d" + ";%d" * 5 + "\r\n"
        return "".join(form % tuple(row) for row in np.column_stack((stamps, counts)).tolist())

    (folder / "raw").mkdir(parents=True)
    with (folder / "raw/robot.csv").open("w", newline="") as file:
        file.write("time,m1,m2,m3,m4,m5,m6\n")
        _write(file, robot_rows, np.arange(round(hours * 3600.0 * ROBOT_HZ)), ROBOT_HZ, 0.0)
    with (folder / "raw/ballbar.csv").open("w", newline="") as file:
        file.write("time;b1;b2;b3;b4;b5\r\n")
        rows = np.arange(round((hours * 3600.0 - LATE_S) * BAR_HZ))
        _write(file, bar_rows, rows, BAR_HZ, LATE_S)
    describe(folder)


def _write(file: TextIO, text, rows: Array, rate: float, late: float) -> None:  # type: ignore[no-untyped-def]
    for block in np.array_split(rows, rows.size // BLOCK + 1):
        file.write(text(late + block / rate))


def measured(arguments: list[str]) -> tuple[int, float, float]:
    """Exit code, peak [MB] and processor time [s] of a command."""
    with tempfile.TemporaryFile() as said:
        command = subprocess.Popen(
            [sys.executable, "-m", "ballbar", *arguments], stdout=said, stderr=subprocess.STDOUT
        )
        _, status, usage = os.wait4(command.pid, 0)
        command.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        if command.returncode not in (0, 1):
            print(said.read().decode()[-2000:])
    return command.returncode, usage.ru_maxrss * 1.024e-3, usage.ru_utime + usage.ru_stime


def main() -> None:
    """Prints a line for each command."""
    parser = argparse.ArgumentParser()
    parser.add_argument("hours", type=float, nargs="?", default=8.0)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        folder = given.keep or Path(work) / "recording"
        if not folder.is_dir():
            # in a process of its own: the peak of a command is at least that of who starts it
            maker = multiprocessing.Process(target=written, args=(folder, given.hours))
            maker.start()
            maker.join()
        size = sum(file.stat().st_size for file in (folder / "raw").iterdir()) / 1e6
        print(f"{given.hours:g} h, {size:.0f} MB", flush=True)
        for name in COMMANDS:
            out = ["--out", str(Path(work) / "result")] if name == "identify" else []
            code, peak, seconds = measured([name, str(folder), *out])
            print(f"{name:10} exit {code}, peak {peak:.0f} MB, {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main()

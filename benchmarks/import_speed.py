"""Time and memory of reading a 10-minute recording, against pandas on the same bytes.

    python -m benchmarks.import_speed

150 000 robot rows (time and six motor angles), 60 000 ball-bar rows (time, five counters, five
status words). Processor and wall time, medians of ROUNDS in which the rivals take turns; pandas
reads on one thread, pyarrow under our reader on all cores. Memory is the peak of a process of its
own that reads nothing else, less what it held before.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd

from ballbar.acquisition.formats.registry import read_file
from ballbar.acquisition.recording import read_recording
from ballbar.acquisition.sources import layout_of
from ballbar.cell.dialect import load_dialect
from ballbar.cell.load import load_robot
from ballbar.cell.recording import SourceFile, load_recording_file
from ballbar.cell.robot_angles import joints_to_motors
from benchmarks.study import COUNTS_PER_RAD, describe

ROUNDS = 15
ROBOT_ROWS, BAR_ROWS = 150_000, 60_000


def write_recording(
    folder: Path, *, robot_rows: int = ROBOT_ROWS, robot_period: float = 0.004
) -> None:
    """A clean recording of ten minutes; robot_period : [s]."""
    robot = load_robot("irb2400")
    t = robot_period * np.arange(robot_rows)
    q = np.stack(
        [0.2 * (i - 2.5) + 0.4 * np.sin((0.3 + 0.1 * i) * t + i) for i in range(6)], axis=1
    )
    rng = np.random.default_rng(1)
    table = np.column_stack((100.0 + t, joints_to_motors(robot, q + rng.normal(0, 1e-5, q.shape))))
    form = ",".join(["%.6f"] + ["%.9f"] * 6)
    (folder / "raw").mkdir()
    lines = ["time,m1,m2,m3,m4,m5,m6", *(form % tuple(row) for row in table.tolist())]
    (folder / "raw/robot.csv").write_text("\n".join(lines) + "\n")
    ticks = 0.01 * np.arange(BAR_ROWS)
    angles = np.stack([0.3 * np.sin(0.8 * ticks + i) for i in range(5)], axis=1) + rng.normal(
        0, 1e-5, (BAR_ROWS, 5)
    )
    counts = np.rint(angles * COUNTS_PER_RAD).astype(np.int64) % 2**32
    stamps = 830_000_000_000_000_000 + 10_000_000 * np.arange(BAR_ROWS)
    rows = np.column_stack((stamps, counts, np.zeros((BAR_ROWS, 5), dtype=np.int64)))
    head = ";".join(["time", *(f"b{k}" for k in range(1, 6)), *(f"s{k}" for k in range(1, 6))])
    (folder / "raw/ballbar.csv").write_text(
        "\r\n".join([head, *(";".join(map(str, row)) for row in rows.tolist())]) + "\r\n",
        newline="",
    )
    describe(folder)


def with_pandas(folder: Path) -> None:
    """The same bytes as pandas reads them: clean, known separators, nothing checked."""
    pd.read_csv(folder / "raw/robot.csv")
    pd.read_csv(folder / "raw/ballbar.csv", sep=";")


def with_read_table(folder: Path) -> None:
    """Only the tables: what pandas does, with every check of form."""
    dialects = load_dialect("abb-motor"), load_dialect("twincat-plc")
    fitted = load_recording_file(folder).encoders
    sources = [
        SourceFile(files=(name,), dialect="") for name in ("raw/robot.csv", "raw/ballbar.csv")
    ]
    layouts = layout_of(sources[0], dialects[0]), layout_of(sources[1], dialects[1], fitted)
    for source, dialect, layout in zip(sources, dialects, layouts, strict=True):
        read_file(folder / source.files[0], source.files[0], dialect, layout)


def seconds(jobs: list[Callable[[Path], object]], folder: Path) -> list[tuple[float, float]]:
    """[s] processor and wall time of each job, medians of ROUNDS; before them, each runs once."""
    spent: list[list[tuple[float, float]]] = [[] for _ in jobs]
    for _ in range(ROUNDS + 1):
        for job, times in zip(jobs, spent, strict=True):
            start, clock = time.process_time(), time.perf_counter()
            job(folder)
            times.append((time.process_time() - start, time.perf_counter() - clock))
    return [
        (median(one[0] for one in times[1:]), median(one[1] for one in times[1:]))
        for times in spent
    ]


def _peak_kb() -> int:
    """Peak memory of this process alone; getrusage would tell its parent's."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0])


def peak_mb(folder: Path) -> tuple[float, float]:
    """[MB] that reading adds to a process, and its peak with all libraries."""
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.import_speed", str(folder)],
        check=True,
        capture_output=True,
        text=True,
    )
    added, whole = (float(word) for word in run.stdout.split())
    return added, whole


def main() -> None:
    """Prints one line for each measurement."""
    if len(sys.argv) > 1:
        before = _peak_kb()
        read_recording(Path(sys.argv[1]))
        print((_peak_kb() - before) / 1000.0, _peak_kb() / 1000.0)
        return
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        write_recording(folder)
        size = sum(file.stat().st_size for file in (folder / "raw").iterdir()) / 1e6
        print(f"{ROBOT_ROWS} robot and {BAR_ROWS} ball-bar rows, {size:.1f} MB")
        added, whole = peak_mb(folder)
        ours, tables, theirs = seconds([read_recording, with_read_table, with_pandas], folder)
        for name, (spent, passed) in (
            ("read_recording", ours),
            ("  of which tables", tables),
            ("pandas.read_csv", theirs),
        ):
            against = (
                ""
                if spent == theirs[0]
                else f"; {spent / theirs[0]:.2f}, {passed / theirs[1]:.2f} times pandas (limit 3)"
            )
            print(f"{name:18} {spent:.3f} s processor, {passed:.3f} s wall{against}")
        print(
            f"memory             {added:.0f} MB added, "
            f"{whole:.0f} MB with all libraries (limit 300 MB)"
        )


if __name__ == "__main__":
    main()

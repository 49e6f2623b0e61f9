"""Calibration from logs with stamps of arrival, against the same logs with their own stamps.

    python -m benchmarks.arrival_stamps           # six robots with everything on; some minutes
    python -m benchmarks.arrival_stamps --speed   # reading ten minutes at 1 kHz and a clean log

The robot's CSV file of each recording is written again as software would have written it: rows in
bursts of two to ten, up to 20 ms after the last of them; then also so that 40 % of all rows repeat
the one before. Nothing of this is the project's simulator. The delays' own mean is part of the
clock offset, so the clock is compared by the times that both readings give to the same joint
angles. Writes docs/studies/arrival_stamps.csv.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.recording import read_recording, read_robot
from ballbar.cell.clock import Clock
from ballbar.cell.load import load_robot
from ballbar.cell.recording import SourceFile
from ballbar.ident.options import FitOptions
from ballbar.ident.signals.smooth_log import smooth_log
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.truth.compare import identification_against_truth
from benchmarks.import_speed import write_recording as write_long
from benchmarks.study import STUDIES, write_table
from tests.helpers.drawn_robots import SCENARIOS, scenario_of
from tests.helpers.one_recording import identify

Array = NDArray[np.float64]
ROBOTS = (("irb2400", 1), ("irb2400", 2), ("irb2400", 3), ("nj220", 1), ("nj220", 2), ("nj220", 3))
KINDS = ("own stamps", "bursts", "bursts and 40 % repeats")
LATEST, REPEATS, DURATION = 0.020, 0.4, 120.0
COLUMNS = (
    "robot", "seed", "stamps", "rows", "tcp_mean_mm", "over_own_stamps", "clock_us", "clock_sigmas",
    "outliers", "clock_steps", "verdict",
)  # fmt: skip


def in_bursts(t: Array, rng: np.random.Generator) -> Array:
    """(N,) [s] arrivals of rows taken at t (N,) [s]."""
    arrival, first = np.empty(t.size), 0
    while first < t.size:
        stop = min(first + int(rng.integers(2, 11)), t.size)
        apart = np.cumsum(rng.uniform(2e-5, 8e-5, stop - first))
        arrival[first:stop] = t[stop - 1] + rng.uniform(0.0, LATEST) + apart
        first = stop
    return np.maximum.accumulate(arrival - 1e-5 * np.arange(t.size)) + 1e-5 * np.arange(t.size)


def disturb(file: Path, kind: str, rng: np.random.Generator) -> None:
    """Writes the file again with stamps of arrival."""
    head, *lines = file.read_text().splitlines()
    cells = [line.split(",", 1) for line in lines]
    unit = 1e-9 if head.startswith("t_ns") else 1.0
    t = np.array([float(stamp) for stamp, _ in cells]) * unit
    arrival, row = (in_bursts(t, rng) if "bursts" in kind else t), np.arange(t.size)
    if "repeats" in kind:
        again = np.flatnonzero(rng.random(t.size - 1) < REPEATS / (1.0 - REPEATS))
        late = rng.uniform(0.2, 0.8, again.size) * (arrival[again + 1] - arrival[again])
        row = np.insert(row, again + 1, again)
        arrival = np.insert(arrival, again + 1, arrival[again] + late)
    form = "{:.0f},{}" if unit < 1.0 else "{:.6f},{}"
    stamps = (arrival / unit).tolist()
    written = [form.format(a, cells[k][1]) for a, k in zip(stamps, row.tolist(), strict=True)]
    file.write_text("\n".join([head, *written]) + "\n")


def first_time(both: Array, clock: Clock) -> float:
    """[s] clock offset in times by own stamps, of one in times by stamps of arrival.

    both : (K, 2) [s] times of equal joint angles. The line between them goes through the medians
    of both halves: of the angles of a robot that stands, the time may be that of another row.
    """
    half = len(both) // 2
    (t1, d1), (t2, d2) = (
        (float(np.median(part[:, 0])), float(np.median(part[:, 1] - part[:, 0])))
        for part in (both[:half], both[half:])
    )
    slope = (d2 - d1) / (t2 - t1)
    return (clock.offset - d1 + slope * t1) / (1.0 + slope)


def robot_rows(robot: str, seed: int) -> list[dict[str, object]]:
    """Figures of one robot, for each kind of stamps."""
    scenario = scenario_of(robot, "a", seed, DURATION)
    simulation, rows, own = simulate(scenario, relative_to=SCENARIOS), [], 0.0
    times: dict[bytes, float] = {}  # of the joint angles by their own stamps
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "recording"
            write_recording(simulation, scenario, folder)
            if kind != KINDS[0]:
                disturb(folder / "raw/robot.csv", kind, np.random.default_rng(seed))
            read = read_recording(folder)
        found = identify(
            simulation.cell,
            read.robot_log,
            read.ballbar_log,
            read.force_log,
            options=FitOptions(model="complete"),
        )
        compared = identification_against_truth(found, simulation.truth)
        error, estimate = compared.tcp.mean, found.recordings[0]
        angles = [q.tobytes() for q in read.robot_log.q]
        times = times or dict(zip(angles, read.robot_log.t.tolist(), strict=True))
        both = [(times[q], t) for q, t in zip(angles, read.robot_log.t, strict=True) if q in times]
        off = abs(first_time(np.array(both), estimate.clock) - simulation.truth.clock.offset_s)
        own = own or error
        log = smooth_log(read.robot_log.t, read.robot_log.q, widest_knot_spacing=0.2, checked=True)
        damaged = sum(f.count for f in read.report.findings if f.kind == "implausible value")
        rows.append(
            dict(
                zip(
                    COLUMNS,
                    (
                        robot, seed, kind, read.robot_log.t.size, error * 1e3, error / own,
                        off * 1e6, off / estimate.clock_sigma[0], damaged + log.outliers.rows,
                        sum(step.channel is None for step in log.steps), found.verdict.status.value,
                    ),
                    strict=True,
                )
            )
        )  # fmt: skip
        print(rows[-1], flush=True)
    return rows


def speed() -> None:
    """Prints how long a burst log takes against a clean one, medians of nine turns."""
    robot = load_robot("irb2400")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_long(folder, robot_rows=600_000, robot_period=0.001)
        text = (folder / "raw/robot.csv").read_text()
        (folder / "raw/bursts.csv").write_text(text)
        disturb(folder / "raw/bursts.csv", "bursts", np.random.default_rng(1))
        spent: dict[str, list[float]] = {"robot.csv": [], "bursts.csv": []}
        for _ in range(9):
            for file, times in spent.items():
                begin = time.perf_counter()
                declared = SourceFile(files=(f"raw/{file}",), dialect="abb-motor")
                read_robot(folder, declared, robot)
                times.append(time.perf_counter() - begin)
    clean, late = median(spent["robot.csv"]), median(spent["bursts.csv"])
    print(f"clean {clean:.2f} s, bursts {late:.2f} s: {late / clean:.2f} times")


def main() -> None:
    """Identifies every robot with every kind of stamps, or measures the speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--speed", action="store_true")
    if parser.parse_args().speed:
        return speed()
    with ProcessPoolExecutor(2) as pool:
        rows = [row for some in pool.map(robot_rows, *zip(*ROBOTS, strict=True)) for row in some]
    write_table(STUDIES / "arrival_stamps.csv", rows, ".4g")
    return None


if __name__ == "__main__":
    main()

"""Identification while recording: how soon an alarm comes, and how well the end is foretold.

    python -m benchmarks.live_identification faults [--seeds 5] [--out FILE.csv]
    python -m benchmarks.live_identification start
    python -m benchmarks.live_identification clean [--hours 1]
    python -m benchmarks.live_identification forecast
    python -m benchmarks.live_identification recorder [--seconds 120]

Simulated recordings are written row by row, as their stamps say, into a folder that
`ballbar.watch.Watch` reads once a second of recorded time: the code of `ballbar watch`, faster than
the motion. To the instant of an alarm the processor time of its update is added.

faults : each of twelve faults begins at a random instant in the middle of the motion; seconds until
the first alarm. start : what is wrong with the files from their first row on; seconds of recording
until the alarm. clean : sound recordings of other machines, seeds and paths; every alarm is false.
forecast : the uncertainty foretold for the end, from half of the recording on, over the one stated
once it has ended. recorder : `ballbar record --identify` against the ADS test server; rows lost and
processor time.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ballbar.watch.state import State
from ballbar.watch.watch import Watch
from tests.helpers.growing_recording import PER_COUNT, GrowingRecording, Logs
from tests.helpers.simulated_recordings import record

Rng = np.random.Generator
STEP = 1.0  # [s] between updates, as in the command
BEFORE = 6.0  # [s] of updates before a fault begins
AFTER = 12.0  # [s] after which a fault counts as not seen
DWELL = 4.0  # [s] longest dwell of the simulated paths: a robot may stand that long
SECONDS = 120.0
ENCODERS = ("b1", "b2", "b3", "b4", "b5")


# --- faults that begin at an instant


def _behind(logs: Logs, name: str, at: float) -> np.ndarray:
    return np.flatnonzero(logs[name].t >= at)


def _some(rng: Rng, count: int) -> list[int]:
    return sorted(int(k) for k in rng.choice(count, 2, replace=False))


def encoder_frozen(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder's counter repeats its value."""
    rows, name = _behind(logs, "ballbar", at), str(rng.choice(ENCODERS))
    column = logs["ballbar"].column(name)
    logs["ballbar"].cells[rows, column] = logs["ballbar"].cells[rows[0] - 1, column]
    return at


def motor_frozen(logs: Logs, at: float, rng: Rng) -> float:
    """A motor's angle repeats its value."""
    rows, column = _behind(logs, "robot", at), int(rng.integers(1, 7))
    logs["robot"].cells[rows, column] = logs["robot"].cells[rows[0] - 1, column]
    return at


def robot_log_frozen(logs: Logs, at: float, rng: Rng) -> float:
    """All angles of the robot's log repeat their values."""
    del rng
    rows = _behind(logs, "robot", at)
    logs["robot"].cells[rows, 1:] = logs["robot"].cells[rows[0] - 1, 1:]
    return at


def encoders_exchanged(logs: Logs, at: float, rng: Rng) -> float:
    """The counters of two encoders change places."""
    log, rows = logs["ballbar"], _behind(logs, "ballbar", at)
    i, j = (log.column(ENCODERS[k]) for k in _some(rng, 5))
    log.cells[rows[:, None], [i, j]] = log.cells[rows[:, None], [j, i]]
    return at


def motors_exchanged(logs: Logs, at: float, rng: Rng) -> float:
    """The angles of two motors change places."""
    log, rows = logs["robot"], _behind(logs, "robot", at)
    i, j = (1 + k for k in _some(rng, 6))
    log.cells[rows[:, None], [i, j]] = log.cells[rows[:, None], [j, i]]
    return at


def _scaled(logs: Logs, at: float, rng: Rng, factor: float) -> float:
    log, rows, name = logs["ballbar"], _behind(logs, "ballbar", at), str(rng.choice(ENCODERS))
    counts = log.numbers(name)
    first = counts[rows[0] - 1]
    moved = (counts[rows] - first + 2.0**31) % 2.0**32 - 2.0**31
    log.put(rows, name, first + factor * moved)
    return at


def encoder_reversed(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder counts in the other direction."""
    return _scaled(logs, at, rng, -1.0)


def line_count(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder counts twice as far."""
    return _scaled(logs, at, rng, 2.0)


def slip(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder slips on its shaft by 1 to 5 mrad."""
    log, rows, name = logs["ballbar"], _behind(logs, "ballbar", at), str(rng.choice(ENCODERS))
    size = float(rng.uniform(1e-3, 5e-3)) * rng.choice([-1.0, 1.0])
    log.put(rows, name, log.numbers(name)[rows] + size / PER_COUNT)
    return at


def stamps_back(logs: Logs, at: float, rng: Rng) -> float:
    """The ball-bar's clock is set back by 1 to 10 s."""
    log, rows = logs["ballbar"], _behind(logs, "ballbar", at)
    back = int(1e9 * rng.uniform(1.0, 10.0))
    log.cells[rows, 0] = [str(int(stamp) - back) for stamp in log.cells[rows, 0]]
    return at


def weak_signal(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder's sine is too weak; its status word says so."""
    log, rows, name = logs["ballbar"], _behind(logs, "ballbar", at), str(rng.choice(ENCODERS))
    log.cells[rows, log.column(name.replace("b", "s"))] = str(1 << 4)
    return at


def tool_moved(logs: Logs, at: float, rng: Rng) -> float:
    """The zero of a wrist's motor moves by 2 to 5 mrad at the joint, as after a collision."""
    log, rows, name = logs["robot"], _behind(logs, "robot", at), f"m{int(rng.integers(4, 7))}"
    size = float(rng.uniform(2e-3, 5e-3)) * rng.choice([-1.0, 1.0]) * 80.0
    log.put(rows, name, log.numbers(name)[rows] + size)
    return at


def robot_stands(logs: Logs, at: float, rng: Rng) -> float:
    """The robot stops; the cause is there once it stands for longer than any dwell of the path."""
    for source, log in logs.items():
        rows = _behind(logs, source, at)
        for name in log.head.split(log.separator)[1:]:
            if name[0] in "mb":
                sigma = 1e-5 / PER_COUNT if name[0] == "b" else 1e-3
                pair = slice(rows[0] - 1, rows[0] + 1)  # both logs stop at one instant
                value = np.interp(at, log.t[pair], log.numbers(name)[pair])
                log.put(rows, name, value + rng.normal(0.0, sigma, rows.size))
    return at + DWELL


FAULTS: tuple[Callable[[Logs, float, Rng], float], ...] = (
    encoder_frozen, motor_frozen, robot_log_frozen, encoders_exchanged, motors_exchanged,
    encoder_reversed, line_count, slip, stamps_back, weak_signal, tool_moved, robot_stands,
)  # fmt: skip


# --- recordings


def recorded(folder: Path, seed: int, seconds: float = SECONDS, **changes: object) -> Path:
    """A simulated recording of another machine for each seed."""
    path = {"kind": "lissajous", "file": f"paths/irb2400_{'ab'[seed % 2]}.yaml"}
    times = {"duration_s": seconds, "dwell_s": DWELL, "stops": 2}
    return record(folder, path=path | times, seed=seed, **changes).folder


@dataclass(frozen=True)
class Row:
    """How soon one fault was noticed."""

    fault: str
    seed: int
    began_s: float
    delay_s: float  # inf: never
    kind: str
    sentence: str


def faults(seeds: int, scratch: Path) -> Iterator[Row]:
    """Each fault with each seed."""
    for seed in range(1, seeds + 1):
        source = recorded(scratch / f"seed{seed}", seed)
        for number, fault in enumerate(FAULTS):
            rng = np.random.default_rng([seed, number])
            at = float(rng.uniform(0.55, 0.85)) * SECONDS
            growing = GrowingRecording(source, scratch / "grow")
            while _stands(growing.logs, at):
                at += 1.0
            cause = fault(growing.logs, at, rng)
            yield _noticed(fault.__name__, seed, cause, at - BEFORE + rng.uniform(), growing)


def _stands(logs: Logs, at: float) -> bool:
    """Whether the robot dwells about an instant: nothing shows then, whatever is wrong."""
    log = logs["robot"]
    rows = (log.t > at - 0.5) & (log.t < at + 1.5)
    return float(np.ptp(log.numbers("m1")[rows])) < 1.0


def _noticed(fault: str, seed: int, cause: float, now: float, growing: GrowingRecording) -> Row:
    watch, before = Watch(growing.folder, duration=growing.seconds), set[str]()
    while now < cause + AFTER:
        growing.write_until(now)
        begun = time.process_time()
        state = watch.update(now)
        new = [alarm for alarm in state.alarms if alarm.kind not in before]
        if now < cause - DWELL:
            before |= {alarm.kind for alarm in new}
        elif new:
            delay = now + time.process_time() - begun - cause
            return Row(fault, seed, cause, delay, new[0].kind, new[0].sentence)
        now += STEP
    return Row(fault, seed, cause, float("inf"), "", "")


# --- command line


def main() -> None:
    """Runs one part, prints its rows and what they come to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("faults", "start", "clean", "forecast", "recorder"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for row in faults(given.seeds, Path(folder)):
            print(
                f"{row.fault:20} {row.seed} {row.began_s:6.1f} {row.delay_s:6.2f}  {row.kind}: {row.sentence[:150]}",
                flush=True,
            )
            rows.append(row)
    within = sum(row.delay_s <= 3.0 for row in rows)
    print(f"{within} of {len(rows)} within 3 s")


if __name__ == "__main__":
    main()

"""Identification while recording: how soon an alarm comes, and how well the end is foretold.

    python -m benchmarks.live_identification faults [--seeds 5] [--out FILE.csv]
    python -m benchmarks.live_identification start
    python -m benchmarks.live_identification sound [--hours 1] [--seconds 120]
    python -m benchmarks.live_identification recorder [--seconds 120]

Simulated recordings are written row by row, as their stamps say, into a folder that
`ballbar.watch.Watch` reads once a second of recorded time: the code of `ballbar watch`, faster than
the motion. To the instant of an alarm the processor time of its update is added.

faults : each of twelve faults begins at a random instant in the middle of the motion; seconds until
the first alarm. start : what is wrong with the files from their first row on; seconds of motion
until the alarm. sound : recordings of other machines, every second one with all errors of
scenarios/irb2400_full.yaml; every alarm is false, and the uncertainty foretold for the end, from
half of the recording on, is divided by the one stated once it has ended. recorder : `ballbar record
--identify` in real time, the encoders from the ADS test server at 100 Hz and the robot's axes by
EGM at 248 Hz; rows lost and processor time.
"""

from __future__ import annotations

import argparse
import csv
import json
import resource
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.recording import read_recording
from ballbar.scenario import load_scenario
from ballbar.watch.watch import Watch
from cell.arrays import Array
from cell.load import load_robot
from cell.recording import load_recording_file
from cell.robot_angles import joints_to_axes
from tests.helpers.egm_robot import PERIOD_NS, egm_message
from tests.helpers.growing_recording import PER_COUNT, GrowingRecording, Logs, TextLog
from tests.helpers.plc_server import Plc
from tests.helpers.simulated_recordings import SCENARIOS, record

Rng = np.random.Generator
STEP = 1.0  # [s] between updates, as in the command
BEFORE = 6.0  # [s] of updates before a fault begins
AFTER = 12.0  # [s] after which a fault counts as not seen
DWELL = 4.0  # [s] longest dwell of the simulated paths: a robot may stand that long
SECONDS = 120.0
SOON = 3.0  # [s] after its cause
ADDRESS, PORT = "127.0.0.41", 6541
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


def _noticed(
    fault: str, seed: int, cause: float, now: float, growing: GrowingRecording, after: float = AFTER
) -> Row:
    watch, before = Watch(growing.folder, duration=growing.seconds), set[str]()
    while now < cause + after:
        growing.write_until(now)
        begun = time.process_time()
        state = watch.update(now)
        took = time.process_time() - begun
        new = [alarm for alarm in state.alarms if alarm.kind not in before]
        if new and now > cause - DWELL:
            delay = round(now + took - cause, 3)
            return Row(fault, seed, round(cause, 3), delay, new[0].kind, new[0].sentence)
        before |= {alarm.kind for alarm in new}
        now += STEP
    return Row(fault, seed, round(cause, 3), float("inf"), "", "")


# --- faults of the files from their first row on


def wrong_from_the_start(scratch: Path, seeds: int) -> Iterator[Row]:
    """Files that are not what they are declared to be."""
    for seed in range(1, seeds + 1):
        source = recorded(scratch / f"seed{seed}", seed)
        other = recorded(scratch / f"other{seed}", seed + 1)
        for number, name in enumerate(("encoders", "lines", "motors", "robot", "run")):
            rng = np.random.default_rng([seed, number, 1])
            growing = GrowingRecording(source, scratch / "grow")
            if name == "encoders":
                encoders_exchanged(growing.logs, -1.0, rng)
            elif name == "lines":
                log, column = growing.logs["ballbar"], str(rng.choice(ENCODERS))
                counts = (log.numbers(column) + 2.0**31) % 2.0**32 - 2.0**31
                log.put(np.arange(counts.size), column, 2.0 * counts)
            elif name == "motors":
                motors_exchanged(growing.logs, -1.0, rng)
            elif name == "run":
                growing.logs["ballbar"] = GrowingRecording(other, scratch / "two").logs["ballbar"]
            else:
                file = growing.folder / "recording.yaml"
                file.write_text(file.read_text().replace("irb2400", "irb4600"))
            yield _noticed(name, seed, DWELL, 1.0 + rng.uniform(), growing, after=90.0)


# --- sound recordings


@dataclass(frozen=True)
class Sound:
    """A sound recording, watched to its end."""

    seed: int
    kind: str
    recorded_s: float
    alarms: str
    processor_s: float
    slowest_s: float  # processor time of one update
    model: str
    foretold: float  # largest and smallest uncertainty, foretold from half time on, over the last
    least_foretold: float
    last_mm: float


def sound(seed: int, scratch: Path, seconds: float, *, full: bool) -> Sound:
    """Watches one from its first row to its last."""
    changes = {}
    if full:
        errors = load_scenario(SCENARIOS / "irb2400_full.yaml").errors
        changes = {"errors": errors.model_dump(exclude_none=True)}
    growing = GrowingRecording(
        recorded(scratch / "sound", seed, seconds, **changes), scratch / "grow"
    )
    alarms, foretold = Counter[str](), defaultdict[str, list[float]](list)
    begun, slowest = time.process_time(), 0.0
    with ThreadPool(1) as pool:  # the complete fits take no time of the recording
        watch, now = Watch(growing.folder, duration=growing.seconds, pool=pool), 0.0
        while now < growing.seconds:
            now += STEP
            growing.write_until(now)
            before = time.process_time()
            state = watch.update(now)
            slowest = max(slowest, time.process_time() - before)
            for alarm in state.alarms:
                alarms[f"{alarm.kind} at {alarm.raised:.0f} s: {alarm.sentence[:80]}"] += 1
            if now > 0.5 * growing.seconds and state.estimate and state.tcp_sigma_end:
                foretold[state.estimate.model].append(state.tcp_sigma_end)
        last = watch.finish(now + STEP).estimate
    assert last is not None
    return Sound(
        seed=seed,
        kind="full" if full else "plain",
        recorded_s=growing.seconds,
        alarms="; ".join(f"{text} ({count} times)" for text, count in alarms.items()),
        processor_s=round(time.process_time() - begun, 1),
        slowest_s=round(slowest, 2),
        model=last.model,
        foretold=round(max(foretold[last.model], default=np.nan) / last.tcp_sigma, 3),
        least_foretold=round(min(foretold[last.model], default=np.nan) / last.tcp_sigma, 3),
        last_mm=round(1e3 * last.tcp_sigma, 5),
    )


# --- the recorder


@dataclass(frozen=True)
class Recorded:
    """A recording with `--identify`."""

    seconds: float
    ballbar_records: int
    robot_records: int
    lost: int
    gaps: int
    missing: int  # samples of the PLC between the first and the last row that are in no row
    processor_share: float  # of one core: recorder, watch and complete fits, start included
    verdict: str
    tcp_sigma_mm: float


def with_recorder(seconds: float, scratch: Path) -> Recorded:
    """Records a simulated cell in real time over ADS and EGM, and identifies meanwhile."""
    clocks = {"offset_s": 0.137, "skew": 5e-5}
    source = recorded(scratch / "source", 1, seconds + 30.0, clocks=clocks)
    log = TextLog.read(source / "raw" / "ballbar.csv")
    signs = [encoder.sign for _, encoder in sorted(load_recording_file(source).encoders.items())]
    counters = np.stack([log.numbers(name) for name in ENCODERS], axis=1).astype(np.int64)
    counters = np.where(np.array(signs) > 0, counters, -counters) % 2**32
    q = read_recording(source).robot_log.q
    axes = np.rad2deg(joints_to_axes(load_robot("irb2400"), q))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    folder, stop = scratch / "recording", threading.Event()
    with Plc(ADDRESS, 100, joints=(1, 2, 3, 4, 5), counters=counters) as plc:
        sender = threading.Thread(target=_send_egm, args=(axes, stop), daemon=True)
        sender.start()
        names = ["--robot", "irb2400", "--ballbar", "lund_600", "--plc", plc.net_id]
        command = [sys.executable, "-m", "ballbar", "record", str(folder), *names]
        command += ["--egm", str(PORT), "--identify", "--accuracy", "0.05", "--json"]
        recorder = subprocess.Popen([*command, "--duration", str(seconds)], stdout=subprocess.PIPE)
        text = recorder.communicate()[0]
        stop.set()
        sender.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    data, rows = json.loads(text), TextLog.read(folder / "raw" / "ballbar.csv").cells
    stamps = rows[:, 0].astype(np.int64)
    sources, known = data["sources"], data["identified"]
    return Recorded(
        seconds=seconds,
        ballbar_records=sources["ballbar"]["records"],
        robot_records=sources["robot"]["records"],
        lost=sum(source["lost"] for source in sources.values()),
        gaps=sum(source["gaps"] for source in sources.values()),
        missing=int((stamps[-1] - stamps[0]) // plc.period_ns + 1 - stamps.size),
        processor_share=round(used / seconds, 3),
        verdict=f"{known['verdict']}, {len(known['alarms'])} alarms",
        tcp_sigma_mm=round(1e3 * known["tcp_sigma_m"], 5),
    )


def _send_egm(axes: Array, stop: threading.Event) -> None:
    """Sends a message every 4.032 ms, late ones as soon as they are due."""
    begun, sent = time.monotonic_ns(), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        while not stop.wait(0.002):
            due = min((time.monotonic_ns() - begun) // PERIOD_NS, len(axes))
            for number in range(sent, due):
                out.sendto(egm_message(number, axes[number].tolist()), ("127.0.0.1", PORT))
            sent = max(sent, due)


# --- command line


def rows_of(part: str, given: argparse.Namespace, scratch: Path) -> Iterator[Any]:
    """The rows of one part."""
    if part == "faults":
        yield from faults(given.seeds, scratch)
    elif part == "start":
        yield from wrong_from_the_start(scratch, given.seeds)
    elif part == "recorder":
        yield with_recorder(given.seconds, scratch)
    else:
        watched, seed = 0.0, 100
        while watched < 3600.0 * given.hours:
            yield sound(seed, scratch, given.seconds, full=seed % 2 == 1)
            watched, seed = watched + given.seconds, seed + 1


def main() -> None:
    """Runs one part, prints its rows and what they come to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("faults", "start", "sound", "recorder"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for row in rows_of(given.part, given, Path(folder)):
            print(row, flush=True)
            rows.append(row)
    if given.part in ("faults", "start"):
        within = sum(row.delay_s <= SOON for row in rows)
        print(f"{within} of {len(rows)} within {SOON:g} s")
    if given.out is not None:
        with given.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(asdict(rows[0])), lineterminator="\n")
            writer.writeheader()
            writer.writerows(asdict(row) for row in rows)


if __name__ == "__main__":
    main()

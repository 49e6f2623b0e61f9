"""Identification while recording: how soon an alarm comes, and how well the end is predicted.

    python -m benchmarks.live_identification faults [--seeds 5] [--out FILE.csv]
    python -m benchmarks.live_identification start
    python -m benchmarks.live_identification sound [--hours 1] [--seconds 120] [--first 100]
    python -m benchmarks.live_identification enough [--runs 40] [--seconds 120] [--first 200]
    python -m benchmarks.live_identification recorder [--seconds 120]

Simulated recordings are written row by row, as their stamps say, into a folder that
`ballbar.watch.Watch` reads once a second of recorded time: the code of `ballbar watch`, faster than
the motion. A complete fit, which takes some seconds beside a real recording, is there at once. To
the instant of an alarm the processor time of its update is added.

faults : each of twelve faults begins at a random instant in the middle of the motion; seconds until
the first alarm. start : what is wrong with the files from their first row on; seconds of motion
until the alarm. sound : recordings of other machines, every second one with all errors of
scenarios/irb2400_full.yaml and motor torque; every alarm is false, and the uncertainty predicted
for the end, from half of the recording on and while the fit is good, is divided by the one stated
once it has ended. enough : recordings of drawn machines, every second one with all errors and motor
torque, and an accuracy that is asked of each; what had been recorded when the watch said that it is
enough is identified as `ballbar identify` does, and its true TCP error (rms) compared with what was
asked. recorder : `ballbar record --identify` in real time, the encoders from the ADS test server at
100 Hz and the robot's axes by EGM at 248 Hz; rows lost and processor time.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.cell.load import load_robot
from ballbar.cell.statistics import rms
from ballbar.result.identify import identify
from ballbar.scenario import load_scenario
from ballbar.sim.live.delivery import EgmRobot, Pace
from ballbar.sim.live.device_logs import GrowingRecording, device_logs
from ballbar.sim.live.faults import DWELL, FAULTS, moving_at
from ballbar.sim.live.plc import Plc, logged_samples
from ballbar.truth.compare import identification_against_truth
from ballbar.watch.watch import Watch
from benchmarks.study import study_parser, write_table
from tests.helpers.drawn_robots import DRAWN
from tests.helpers.simulated_recordings import CLOCK, SCENARIOS, Recorded, record

STEP = 1.0  # [s] between updates, as in the command
BEFORE = 6.0  # [s] of updates before a fault begins
AFTER = 12.0  # [s] after which a fault counts as not seen
SECONDS = 120.0
SOON = 3.0  # [s] after its cause
ADDRESS, PORT = "127.0.0.41", 6541


# --- recordings


def recorded(folder: Path, seed: int, seconds: float = SECONDS, **changes: object) -> Path:
    """A simulated recording of another machine for each seed."""
    return _record(folder, seed, seconds, **changes).folder


def _record(folder: Path, seed: int, seconds: float, **changes: object) -> Recorded:
    path = {"kind": "lissajous", "file": f"paths/irb2400_{'ab'[seed % 2]}.yaml"}
    times = {"duration_s": seconds, "dwell_s": DWELL, "stops": 2}
    return record(folder, path=path | times, seed=seed, **changes)


def _everything_on() -> dict[str, Any]:
    """The errors and encoders of scenarios/irb2400_full.yaml, and the motor torque it logs."""
    scenario = load_scenario(SCENARIOS / "irb2400_full.yaml")
    parts = {name: getattr(scenario, name) for name in ("errors", "encoders")}
    stated = {
        name: part.model_dump(mode="json", by_alias=True, exclude_none=True)
        for name, part in parts.items()
    }
    return stated | {"logs": {"torque": {}}}


class AtOnce:
    """A pool whose results are there at once: its work takes no time of the recording."""

    def apply_async(self, work: Callable[..., Any], arguments: tuple[object, ...]) -> AtOnce:
        self._work = partial(work, *arguments)
        return self

    def ready(self) -> bool:
        return True

    def get(self) -> Any:
        return self._work()


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
        for number, (name, fault) in enumerate(FAULTS.items()):
            rng = np.random.default_rng([seed, number])
            at = float(rng.uniform(0.55, 0.85)) * SECONDS
            growing = GrowingRecording(source, scratch / "grow", CLOCK)
            cause = fault(growing.logs, moving_at(growing.logs, at), rng)
            yield _noticed(name, seed, cause, at - BEFORE + rng.uniform(), growing)


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
            growing = GrowingRecording(source, scratch / "grow", CLOCK)
            if name == "encoders":
                FAULTS["encoders_exchanged"](growing.logs, -1.0, rng)
            elif name == "lines":
                log = growing.logs["ballbar"]
                column = str(rng.choice(list(log.scales)))
                counts = (log.numbers(column) + 2.0**31) % 2.0**32 - 2.0**31
                log.put(np.arange(counts.size), column, 2.0 * counts)
            elif name == "motors":
                FAULTS["motors_exchanged"](growing.logs, -1.0, rng)
            elif name == "run":
                growing.logs["ballbar"] = GrowingRecording(other, scratch / "two", CLOCK).logs[
                    "ballbar"
                ]
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
    predicted_s: float  # of the recording, from which its end was predicted, half time or later
    predicted: float  # largest and smallest uncertainty predicted from then on, over the last
    least_predicted: float
    last_mm: float


def sound(seed: int, scratch: Path, seconds: float, *, full: bool) -> Sound:
    """Watches one from its first row to its last."""
    changes = _everything_on() if full else {}
    source = recorded(scratch / "sound", seed, seconds, **changes)
    growing = GrowingRecording(source, scratch / "grow", CLOCK)
    alarms, predicted, since = Counter[str](), defaultdict[str, list[float]](list), np.inf
    begun, slowest = time.process_time(), 0.0
    watch, now = Watch(growing.folder, duration=growing.seconds, pool=AtOnce()), 0.0
    while now < growing.seconds:
        now += STEP
        growing.write_until(now)
        before = time.process_time()
        state = watch.update(now)
        slowest = max(slowest, time.process_time() - before)
        for alarm in state.alarms:
            alarms[f"{alarm.kind} at {alarm.raised:.0f} s: {alarm.sentence[:80]}"] += 1
        if now > 0.5 * growing.seconds and state.estimate and state.tcp_sigma_end:
            predicted[state.estimate.model].append(state.tcp_sigma_end)
            since = min(since, now)
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
        predicted_s=since,
        predicted=round(max(predicted[last.model], default=np.nan) / last.tcp_sigma, 3),
        least_predicted=round(min(predicted[last.model], default=np.nan) / last.tcp_sigma, 3),
        last_mm=round(1e3 * last.tcp_sigma, 5),
    )


# --- whether enough is enough

UPDATE = 2.0  # [s] between updates
# [m] accuracies: from what two minutes hardly reach to three times as much. Of machines with errors
# of geometry, plate, ball-bar and noise; of those with all errors.
ASKED, ASKED_OF_FULL = (0.05e-3, 0.15e-3), (0.08e-3, 0.25e-3)


@dataclass(frozen=True)
class Enough:
    """A recording of which the watch said that it is enough, and what that was worth."""

    seed: int
    kind: str
    asked_mm: float
    said_s: float  # of the recording; inf: never
    model: str  # of the estimate that was enough
    stated_mm: float  # then
    status: str  # of the identification of what had been recorded
    identified_mm: float  # stated by it
    true_rms_mm: float
    true_mean_mm: float
    true_max_mm: float
    alarms: str  # up to then, all of them false


def enough(seed: int, scratch: Path, seconds: float, *, full: bool) -> Enough:
    """Watches a recording until the accuracy that is asked is said to be reached."""
    rng, changes = np.random.default_rng([seed, 7]), _everything_on()
    lowest, highest = ASKED_OF_FULL if full else ASKED
    asked = float(np.exp(rng.uniform(np.log(lowest), np.log(highest))))
    if not full:
        errors = changes["errors"]
        few = {k: errors[k] for k in ("joint_noise", "plate_length", "ballbar_axes")}
        changes = {"errors": few}
    changes["errors"] |= {"static": DRAWN}
    made = _record(scratch / "enough", seed, seconds, **changes)
    growing = GrowingRecording(made.folder, scratch / "grow", CLOCK)
    alarms, state, now = Counter[str](), None, 0.0
    watch = Watch(growing.folder, accuracy=asked, duration=growing.seconds, pool=AtOnce())
    while now < growing.seconds and not (state and state.enough):
        now += UPDATE
        growing.write_until(now)
        state = watch.update(now)
        for alarm in state.alarms:
            alarms[f"{alarm.kind} at {alarm.raised:.0f} s: {alarm.sentence[:80]}"] += 1
    assert state is not None
    said, estimate = state.enough, state.estimate
    assert estimate is not None
    data = identify(growing.folder).data
    tcp = identification_against_truth(data.identification, made.simulation.truth).tcp
    robot = data.identification.robot
    return Enough(
        seed=seed,
        kind="full" if full else "plain",
        asked_mm=round(1e3 * asked, 5),
        said_s=now if said else float("inf"),
        model=estimate.model,
        stated_mm=round(1e3 * estimate.tcp_sigma, 5),
        status=str(data.identification.verdict.status),
        identified_mm=round(1e3 * rms(robot.tcp_sigma), 5),
        true_rms_mm=round(1e3 * rms(tcp.error), 5),
        true_mean_mm=round(1e3 * tcp.mean, 5),
        true_max_mm=round(1e3 * tcp.maximum, 5),
        alarms="; ".join(f"{text} ({count} times)" for text, count in alarms.items()),
    )


# --- the recorder


@dataclass(frozen=True)
class RecordedLive:
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


def with_recorder(seconds: float, scratch: Path) -> RecordedLive:
    """Records a simulated cell in real time over ADS and EGM, and identifies meanwhile."""
    clocks = {"offset_s": CLOCK.offset, "skew": CLOCK.skew}
    encoders = {"noise_sigma_rad": 1e-5, "directions": "unknown"}
    source = recorded(scratch / "source", 1, seconds + 30.0, clocks=clocks, encoders=encoders)
    logs = device_logs(source, CLOCK)
    pace = Pace(1.0)
    program, joints = logged_samples(logs["ballbar"], pace)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    folder = scratch / "recording"
    with (
        Plc(ADDRESS, program, joints=joints) as plc,
        EgmRobot(PORT, logs["robot"], load_robot("irb2400"), pace) as robot,
    ):
        plc.start()
        robot.start()
        pace.start()
        names = ["--robot", "irb2400", "--ballbar", "lund_600", "--plc", plc.net_id]
        command = [sys.executable, "-m", "ballbar", "record", str(folder), *names]
        command += ["--egm", str(PORT), "--identify", "--accuracy", "0.05", "--json"]
        recorder = subprocess.Popen([*command, "--duration", str(seconds)], stdout=subprocess.PIPE)
        text = recorder.communicate()[0]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    data = json.loads(text)
    rows = (folder / "raw" / "ballbar.csv").read_text().splitlines()[1:]
    stamps = np.array([int(row.split(";", 1)[0]) for row in rows])
    made = program.rows["time"].astype(np.int64)
    sources, known = data["sources"], data["identified"]
    return RecordedLive(
        seconds=seconds,
        ballbar_records=sources["ballbar"]["records"],
        robot_records=sources["robot"]["records"],
        lost=sum(source["lost"] for source in sources.values()),
        gaps=sum(source["gaps"] for source in sources.values()),
        missing=int(((made >= stamps[0]) & (made <= stamps[-1])).sum()) - stamps.size,
        processor_share=round(used / seconds, 3),
        verdict=f"{known['verdict']}, {len(known['alarms'])} alarms",
        tcp_sigma_mm=round(1e3 * known["tcp_sigma_m"], 5),
    )


# --- command line


def rows_of(part: str, given: argparse.Namespace, scratch: Path) -> Iterator[Any]:
    """The rows of one part."""
    if part == "faults":
        yield from faults(given.seeds, scratch)
    elif part == "start":
        yield from wrong_from_the_start(scratch, given.seeds)
    elif part == "recorder":
        yield with_recorder(given.seconds, scratch)
    elif part == "enough":
        said, seed = 0, given.first or 200
        while said < given.runs:
            row = enough(seed, scratch, given.seconds, full=seed % 2 == 1)
            said, seed = said + np.isfinite(row.said_s), seed + 1
            yield row
    else:
        watched, seed = 0.0, given.first or 100
        while watched < 3600.0 * given.hours:
            yield sound(seed, scratch, given.seconds, full=seed % 2 == 1)
            watched, seed = watched + given.seconds, seed + 1


def main() -> None:
    """Runs one part, prints its rows and what they come to."""
    parser = study_parser(__doc__)
    parser.add_argument("part", choices=("faults", "start", "sound", "enough", "recorder"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--runs", type=int, default=40, help="of which enough is said")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--first", type=int, help="seed of the first sound or enough recording")
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
    if given.part == "enough":
        said = [row for row in rows if np.isfinite(row.said_s)]
        held = sum(row.true_rms_mm <= row.asked_mm for row in said)
        print(f"true TCP error (rms) within what was asked: {held} of {len(said)} that were enough")
    if given.out is not None:
        write_table(given.out, rows)


if __name__ == "__main__":
    main()

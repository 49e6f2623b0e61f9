"""The live recorder against the ADS test server: is each sample in the file, once, byte for byte?

    python -m benchmarks.live_recorder [--seconds 300] [--out docs/studies/live_recorder.csv]
    python -m benchmarks.live_recorder --kills 20 [--out docs/studies/live_recorder_kills.csv]

A PLC (tests.helpers.plc_server) makes samples at 100 Hz and at 1 kHz, each of which follows from
its number; `ballbar record` runs as a process of its own. The file must be what those samples are
in the dialect `twincat-plc`, from its first row to its last, and the last must be younger than two
polls when the recorder is told to stop. With --kills it is killed (SIGKILL) at random instants at 1
kHz instead, and what is missing at the end of the file is measured.
"""

from __future__ import annotations

import argparse
import resource
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ballbar.sim.live.plc import STARTED
from benchmarks.study import write_table
from tests.helpers.plc_server import Plc, plc_samples, text_of

RATES = (100, 1000)  # [Hz]
ADDRESS = "127.0.0.40"


@dataclass(frozen=True)
class Outcome:
    """One recording."""

    rate_hz: int
    seconds: float
    samples_made: int  # by the PLC, from the first recorded one until the recorder was told to stop
    records: int
    missing: int
    doubled: int
    byte_exact: bool
    tail_s: float  # age of the last record at the stop; negative if made after it
    processor_s: float  # of the recorder, its start included


@dataclass(frozen=True)
class Kill:
    """One recording that was killed."""

    after_s: float  # since its file appeared
    records: int  # whole ones
    byte_exact: bool
    torn_bytes: int  # behind the last whole record
    lost_s: float  # samples that the PLC had made and the file has not


def measure(rate: int, seconds: float) -> Outcome:
    """Records for some time and compares."""
    with TemporaryDirectory() as work, Plc(ADDRESS, rate) as plc:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        recorder, file = _started(Path(work) / "recording", plc)
        time.sleep(seconds)
        made = plc.written
        recorder.send_signal(signal.SIGINT)
        code = recorder.wait()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if code:
            raise SystemExit(f"the recorder ended with code {code}")
        return _compare(
            file.read_bytes(),
            plc,
            rate,
            made,
            after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        )


def kill(after: float) -> Kill:
    """Records at 1 kHz, kills, and compares."""
    with TemporaryDirectory() as work, Plc(ADDRESS, 1000) as plc:
        recorder, file = _started(Path(work) / "recording", plc)
        time.sleep(after)
        made = plc.written
        recorder.kill()
        recorder.wait()
        raw = file.read_bytes()
        whole = raw[: raw.rindex(b"\n") + 1]
        found = _compare(whole, plc, 1000, made, 0.0)
        return Kill(
            round(after, 3), found.records, found.byte_exact, len(raw) - len(whole), found.tail_s
        )


def _started(folder: Path, plc: Plc) -> tuple[subprocess.Popen[bytes], Path]:
    """A recorder, and its file, which is there already."""
    file = folder / "raw" / "ballbar.csv"
    names = ["--robot", "irb2400", "--ballbar", "lund_600", "--plc", plc.net_id]
    command = [sys.executable, "-m", "ballbar", "record", str(folder), *names]
    nowhere = subprocess.DEVNULL
    recorder = subprocess.Popen(command, stdout=nowhere, stderr=nowhere)
    while not file.exists() or not file.stat().st_size:
        if recorder.poll() is not None:
            raise SystemExit(f"the recorder ended with code {recorder.returncode}")
        time.sleep(0.05)
    return recorder, file


def _compare(raw: bytes, plc: Plc, rate: int, made: int, processor: float) -> Outcome:
    stamps = np.array([int(line.split(b";", 1)[0]) for line in raw.splitlines()[1:]])
    numbers, off_grid = np.divmod(stamps - STARTED, plc.period_ns)
    first, last = int(numbers[0]), int(numbers[-1])
    distinct = np.unique(numbers[off_grid == 0])
    return Outcome(
        rate_hz=rate,
        seconds=round(float(stamps[-1] - stamps[0]) * 1e-9, 3),
        samples_made=made - first,
        records=stamps.size,
        missing=last - first + 1 - distinct.size,
        doubled=stamps.size - distinct.size,
        byte_exact=raw == text_of(plc_samples(first, last - first + 1, plc.period_ns)),
        tail_s=round((made - 1 - last) * plc.period_ns * 1e-9, 3),
        processor_s=round(processor, 1),
    )


def main() -> None:
    """Measures both rates, or kills, and prints, or writes, a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rng = np.random.default_rng(1)
    outcomes = [kill(rng.uniform(0.5, 2.0)) for _ in range(options.kills)] or [
        measure(rate, options.seconds) for rate in RATES
    ]
    for outcome in outcomes:
        print(outcome)
    if options.out is not None:
        write_table(options.out, outcomes)


if __name__ == "__main__":
    main()

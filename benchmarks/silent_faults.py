"""Faults that leave a log in perfect form: is each one noticed, and no result good and wrong?

    python -m benchmarks.silent_faults              # docs/studies/silent_faults.csv
    python -m benchmarks.silent_faults --part files # the 500 files alone; or: recordings

Sound recordings come from the simulator (two IRB 2400 and NJ 220 with every error source) and from
the generator of another hand (tests/independent). A fault is put into the text of one device file;
nothing of the reader takes part in that.

Files: each of FILES recordings has one fault that is decidable, which is to say that an angle is
off by more than TOLERANCE (twenty times the noise, as in benchmarks.mutated_logs), a torque by more
than NOISY times its noise. It is read as `ballbar check` reads it. Outcomes:

refused   an error
repaired  no used row is off, and a finding says that rows were left out
reported  a finding that the sound recording does not have stands at the rows, or names the channel
silent    none of these (target: none)

Recordings: each of RECORDINGS has one fault and is identified, alone or with a second path of the
same machine. `deceived` is a result whose status is good while the mean tool error, base aligned,
at the angles that the robot's log would show, is over TWICE times the stated 95 % bound, two
standard deviations. Sound recordings stand beside them. Ten freezes and one step are in the list
because what is repaired costs accuracy that has to be stated.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar import identify
from ballbar.acquisition.recording import Recording, read_recording
from ballbar.cell.errors import FailureError, InputError
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.start.automatic import StartError
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.sim.truth import Truth as SimulatedTruth
from ballbar.truth.compare import reference_of, true_tool
from benchmarks.study import STUDIES, study_parser, write_table
from tests.helpers.drawn_robots import SCENARIOS, scenario_of
from tests.independent.machine import files as cell_files
from tests.independent.recording import Plan, accuracy_box, aligned_distance, record_path
from tests.independent.recording import Truth as IndependentTruth

FILES, RECORDINGS = 500, 60
SIMULATED_S, INDEPENDENT_S = 80.0, 60.0  # the plant is not exact enough on a path that is quicker
TOLERANCE = 2e-4  # [rad]
NOISY = 8.0  # standard deviations of a torque
TWICE, BOUND = 2.0, 2.0  # times the stated 95 % bound; standard deviations of that
RESULT = STUDIES / "silent_faults.csv"
SEEDS = (1, 2, 3)
MOTOR_TURNS = 100.0  # of a joint's turn, about
SAID = 240  # characters of a sentence that are written
SAMPLES = 500  # of each recording in the fit
PER_COUNT = 2.0 * np.pi / (3600 * 2**12)  # [rad]

Array = np.ndarray
Rng = np.random.Generator
Logs = dict[str, "Text"]  # robot, ballbar


@dataclass
class Text:
    """A device file as text cells."""

    separator: str
    ending: str
    names: list[str]
    cells: Array  # (N, C) of text

    @classmethod
    def read(cls, path: Path) -> Text:
        raw = path.read_bytes().decode()
        ending = "\r\n" if "\r\n" in raw else "\n"
        head, *rows = raw.split(ending)
        separator = ";" if ";" in head else ","
        cells = np.array([row.split(separator) for row in rows if row], dtype=object)
        return cls(separator, ending, head.split(separator), cells)

    def write(self, path: Path) -> None:
        lines = [self.names, *self.cells.tolist()]
        text = self.ending.join(self.separator.join(line) for line in lines) + self.ending
        path.write_bytes(text.encode())

    def copy(self) -> Text:
        return replace(self, cells=self.cells.copy())

    def columns(self, *starts: str) -> list[int]:
        """Columns whose names are one of `starts` and a number."""
        return [
            k
            for k, name in enumerate(self.names)
            if name.startswith(starts) and name.lstrip("".join(starts)).isdigit()
        ]

    @property
    def signals(self) -> list[int]:
        return self.columns("m", "b", "tau")

    def numbers(self, column: int) -> Array:
        return self.cells[:, column].astype(float)

    def put(self, rows: Array, column: int, values: Array) -> None:
        """Numbers in the form of the column: whole counter words, or decimals."""
        if self.names[column].startswith("b"):
            self.cells[rows, column] = [str(round(v) % 2**32) for v in values]
        else:
            self.cells[rows, column] = [f"{v:.9f}" for v in values]


@dataclass(frozen=True)
class Damage:
    """Places of a fault: channels (names) and rows (from 0) of one file."""

    source: str
    channels: tuple[str, ...]
    rows: Array


# --- faults of a file


def _source(rng: Rng) -> str:
    return str(rng.choice(["robot", "ballbar"]))


def _stretch(rng: Rng, total: int, least: int = 5, most: int = 500) -> Array:
    """Some rows in succession, as many as log-uniform between the two."""
    length = round(float(np.exp(rng.uniform(np.log(least), np.log(most)))))
    return np.arange(length) + int(rng.integers(20, total - length - 20))


def frozen_channel(logs: Logs, rng: Rng) -> Damage:
    """One channel repeats the value of a row, to the last digit."""
    source = _source(rng)
    log = logs[source]
    column = int(rng.choice(log.signals))
    rows = _stretch(rng, len(log.cells))
    log.cells[rows, column] = log.cells[rows[0] - 1, column]
    return Damage(source, (log.names[column],), rows)


def frozen_logger(logs: Logs, rng: Rng) -> Damage:
    """All channels of a file repeat those of a row, while the stamps go on."""
    source = _source(rng)
    log = logs[source]
    rows = _stretch(rng, len(log.cells))
    for column in range(1, len(log.names)):
        log.cells[rows, column] = log.cells[rows[0] - 1, column]
    return Damage(source, tuple(log.names[k] for k in log.signals), rows)


def short_words(logs: Logs, rng: Rng) -> Damage:
    """Counters of 16 bits in columns of 32: one encoder's, or all."""
    log = logs["ballbar"]
    columns = log.columns("b")
    if rng.random() < 0.7:
        columns = [int(rng.choice(columns))]
    signed = rng.random() < 0.5
    for column in columns:
        low = log.cells[:, column].astype(np.int64) % 2**16
        log.cells[:, column] = (low - 2**16 * (signed & (low >= 2**15))).astype(str)
    names = tuple(log.names[k] for k in columns)
    return Damage("ballbar", names, np.arange(len(log.cells)))


def kink(logs: Logs, rng: Rng) -> Damage:
    """All angles of a file leave the motion over five rows and come back."""
    source = _source(rng)
    log = logs[source]
    rows = np.arange(5) + int(rng.integers(20, len(log.cells) - 25))
    tent = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 3.0
    for column in log.columns("m", "b"):
        size = float(np.exp(rng.uniform(np.log(3e-4), np.log(0.05)))) * rng.choice([-1, 1])
        size *= 1.0 / PER_COUNT if source == "ballbar" else MOTOR_TURNS
        log.put(rows, column, log.numbers(column)[rows] + size * tent)
    return Damage(source, tuple(log.names[k] for k in log.columns("m", "b")), rows)


FILE_FAULTS = (frozen_channel, frozen_logger, short_words, kink)


# --- faults of a machine or of a whole recording


def late_row(logs: Logs, rng: Rng) -> Damage:
    """One angle is that of the row before, throughout."""
    source = _source(rng)
    log = logs[source]
    column = int(rng.choice(log.columns("m", "b")))
    log.cells[1:, column] = log.cells[:-1, column].copy()
    return Damage(source, (log.names[column],), np.arange(1, len(log.cells)))


def ten_freezes(logs: Logs, rng: Rng) -> Damage:
    """One angle freezes ten times."""
    source = _source(rng)
    log = logs[source]
    column = int(rng.choice(log.columns("m", "b")))
    every = [_stretch(rng, len(log.cells)) for _ in range(10)]
    for rows in every:
        log.cells[rows, column] = log.cells[rows[0] - 1, column]
    return Damage(source, (log.names[column],), np.unique(np.concatenate(every)))


def one_step(logs: Logs, rng: Rng) -> Damage:
    """An encoder slips on its shaft, or a motor's zero moves, once."""
    source = _source(rng)
    log = logs[source]
    column, total = int(rng.choice(log.columns("m", "b"))), len(log.cells)
    rows = np.arange(int(rng.integers(total // 4, 3 * total // 4)), total)
    size = float(np.exp(rng.uniform(np.log(3e-4), np.log(5e-3)))) * rng.choice([-1, 1])
    size *= 1.0 / PER_COUNT if source == "ballbar" else MOTOR_TURNS
    log.put(rows, column, log.numbers(column)[rows] + size)
    return Damage(source, (log.names[column],), rows)


def jitter(logs: Logs, rng: Rng) -> Damage:
    """Rows are stamped late by 4 ms rms, in order."""
    source = _source(rng)
    log = logs[source]
    late = np.abs(rng.normal(0.0, 4e-3, len(log.cells)))
    if "." in log.cells[0, 0]:
        stamps = np.maximum.accumulate(log.numbers(0) + late)
        log.cells[:, 0] = [f"{t:.6f}" for t in stamps + 1e-6 * np.arange(late.size)]
    else:
        counts = log.cells[:, 0].astype(np.int64) + (1e9 * late).astype(np.int64)
        stamps = np.maximum.accumulate(counts) + 1000 * np.arange(late.size)
        log.cells[:, 0] = stamps.astype(str)
    return Damage(source, (log.names[0],), np.arange(len(log.cells)))


RECORDING_FAULTS = (
    frozen_channel, frozen_logger, short_words, kink, late_row, ten_freezes, one_step, jitter,
)  # fmt: skip
SCALED = "motor_scaled"
SOUND = "none"


# --- sound recordings


@dataclass(frozen=True, eq=False)
class Machine:
    """A machine recorded on two paths, and where its tool truly is."""

    name: str
    folders: tuple[Path, Path]
    truth: SimulatedTruth | IndependentTruth

    def error(self, result: Identification, motor: int = 0, factor: float = 1.0) -> float:
        """[m] mean tool error; motor : from 1, whose log is `factor` times its angle."""
        robot = result.robot.identified
        if isinstance(self.truth, IndependentTruth):
            q, truth = accuracy_box(cell_files()), replace(self.truth, scaled=(motor, factor))
            return float(aligned_distance(robot.tool(q), truth.tool(q)).mean())
        cell = result.robot.cell
        q = accuracy_grid(cell.robot)
        motors = q @ np.linalg.inv(cell.robot.transmission)
        if motor:
            motors[:, motor - 1] /= factor
        actual = true_tool(
            cell, self.truth, reference_of(self.truth), motors @ cell.robot.transmission
        )
        return position_error(robot.tool(q), actual).mean


def machines(scratch: Path) -> list[Machine]:
    """Sound recordings of all machines."""
    out = []
    for seed in SEEDS:
        folders = (scratch / f"independent{seed}a", scratch / f"independent{seed}b")
        plan = Plan(seed, duration=INDEPENDENT_S)
        truths = [record_path(plan, k, folder) for k, folder in enumerate(folders)]
        out.append(Machine(f"independent {seed}", folders, truths[0]))
        robot = "nj220" if seed == SEEDS[-1] else "irb2400"
        folders = (scratch / f"{robot}{seed}a", scratch / f"{robot}{seed}b")
        simulated = [scenario_of(robot, path, seed, SIMULATED_S) for path in "ab"]
        runs = [simulate(scenario, relative_to=SCENARIOS) for scenario in simulated]
        for run, scenario, folder in zip(runs, simulated, folders, strict=True):
            write_recording(run, scenario, folder)
        out.append(Machine(f"{robot} {seed}", folders, runs[0].truth))
    return out


def logs_of(folder: Path) -> Logs:
    """The device files of a recording."""
    return {name: Text.read(folder / "raw" / f"{name}.csv") for name in ("robot", "ballbar")}


def spoilt(sound: Path, folder: Path, logs: Logs) -> Path:
    """The recording with other device files."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(sound, folder)
    for name, log in logs.items():
        log.write(folder / "raw" / f"{name}.csv")
    return folder


# --- outcomes


@dataclass(frozen=True)
class Row:
    """How one case ended."""

    part: str
    number: int
    machine: str
    fault: str
    channels: str
    rows: int
    outcome: str
    error_mm: float = np.nan
    stated_95_mm: float = np.nan
    ratio: float = np.nan
    seconds: float = np.nan
    sentence: str = ""


def off_rows(sound: Text, other: Text, channels: tuple[str, ...]) -> Array:
    """(N,) rows in which an angle or torque of the file is off decidably."""
    out = np.zeros(len(sound.cells), dtype=bool)
    for name in channels:
        k = sound.names.index(name)
        a, b = sound.numbers(k), other.numbers(k)
        off = np.abs(a - b)
        if name.startswith("b"):
            off = PER_COUNT * np.minimum(off, 2.0**32 - off)
            out |= off > TOLERANCE
        elif name.startswith("m"):
            out |= off > MOTOR_TURNS * TOLERANCE
        else:
            second = np.diff(a, 2)
            out |= off > NOISY * np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0)
    return out


def file_rows(every: list[Machine], scratch: Path) -> Iterator[Row]:
    """Each file fault, read."""
    sound: dict[Path, tuple[Logs, Recording]] = {}
    for number in range(FILES):
        rng = np.random.default_rng([number, 5])
        machine = every[number % len(every)]
        folder = machine.folders[int(rng.integers(2))]
        if folder not in sound:
            sound[folder] = logs_of(folder), read_recording(folder)
        logs, clean = sound[folder]
        fault = FILE_FAULTS[number // len(every) % len(FILE_FAULTS)]
        off = np.zeros(1, dtype=bool)
        while not off.any():
            other = {name: log.copy() for name, log in logs.items()}
            damage = fault(other, rng)
            off = off_rows(logs[damage.source], other[damage.source], damage.channels)
        begun = time.process_time()
        outcome, sentence = read_outcome(
            spoilt(folder, scratch / "case", other), clean, damage, off
        )
        channels = " ".join(damage.channels)
        yield Row(
            "files",
            number,
            machine.name,
            fault.__name__,
            channels,
            damage.rows.size,
            outcome,
            seconds=time.process_time() - begun,
            sentence=sentence,
        )


def read_outcome(folder: Path, clean: Recording, damage: Damage, off: Array) -> tuple[str, str]:
    """Outcome of `ballbar check` for a file."""
    try:
        read = read_recording(folder)
    except InputError as error:
        return "refused", str(error)
    usual = {(f.file, f.kind): f.count for f in clean.report.findings}
    file = f"raw/{damage.source}.csv"
    lines = damage.rows[[0, -1]] + 2  # below the header, counted from 1
    for found in read.report.findings:
        if found.file != file or found.count <= usual.get((file, found.kind), 0):
            continue
        there = any(lines[0] - 2 <= line <= lines[1] + 2 for line in found.lines)
        named = any(name in found.sentence.split() for name in damage.channels)
        if there or named:
            used = read.rows[damage.source].used  # type: ignore[index]
            whole = used.size == off.size and not used[off].any()
            return "repaired" if whole else "reported", f"{found.kind}: {found.sentence}"
    return "silent", ""


def recording_rows(every: list[Machine], scratch: Path) -> Iterator[Row]:
    """Each fault of a whole recording, identified; the sound ones first."""
    for number, machine in enumerate(every):
        for count in (1, 2):
            yield identified(number, machine, SOUND, machine.folders[:count], "", 0)
    faults: list[Callable[[Logs, Rng], Damage] | None] = [*RECORDING_FAULTS, None, None]
    for number in range(RECORDINGS):
        rng = np.random.default_rng([number, 6])
        machine, fault = every[number % len(every)], faults[number // len(every) % len(faults)]
        pair = bool(rng.integers(2))
        if fault is None:
            yield scaled(number, machine, rng, scratch, pair=pair)
            continue
        logs = logs_of(machine.folders[0])
        other = {name: log.copy() for name, log in logs.items()}
        damage = fault(other, rng)
        folders = [spoilt(machine.folders[0], scratch / "case", other)]
        folders += machine.folders[1:] if pair else ()
        channels = " ".join(damage.channels)
        yield identified(number, machine, fault.__name__, folders, channels, damage.rows.size)


def scaled(number: int, machine: Machine, rng: Rng, scratch: Path, *, pair: bool) -> Row:
    """One motor's angle is logged in another unit of its gear than stated, in all recordings."""
    motor, factor = int(rng.integers(1, 7)), 1.0 + 1e-3 * float(rng.choice([-1, 1]))
    folders = []
    for k, sound in enumerate(machine.folders[: 1 + pair]):
        logs = logs_of(sound)
        column = logs["robot"].names.index(f"m{motor}")
        every = np.arange(len(logs["robot"].cells))
        logs["robot"].put(every, column, factor * logs["robot"].numbers(column))
        folders.append(spoilt(sound, scratch / f"scaled{k}", logs))
    return identified(
        number, machine, SCALED, folders, f"m{motor} {factor:g}", every.size, (motor, factor)
    )


def identified(
    number: int, machine: Machine, fault: str, folders: Sequence[Path], channels: str, rows: int,
    scale: tuple[int, float] = (0, 1.0),
) -> Row:  # fmt: skip
    """The identification of some recordings, judged."""
    name = f"{machine.name}, {len(folders)} recordings"
    case = Row("recordings", number, name, fault, channels, rows, "refused")
    begun = time.process_time()
    try:
        options = FitOptions(samples=SAMPLES)
        result = identify(*list(folders), options=options).data.identification
    except np.linalg.LinAlgError:
        return replace(case, outcome="crashed", seconds=time.process_time() - begun)
    except (InputError, StartError, FailureError) as error:
        return replace(case, seconds=time.process_time() - begun, sentence=str(error))
    error = machine.error(result, *scale)
    stated = BOUND * float(result.robot.tcp_sigma.mean())
    return replace(
        case,
        outcome=str(result.verdict.status),
        error_mm=1e3 * error,
        stated_95_mm=1e3 * stated,
        ratio=error / stated,
        seconds=time.process_time() - begun,
        sentence=" | ".join((result.verdict.sentence, *result.verdict.warnings)),
    )


def deceived(row: Row) -> bool:
    """Whether a result is called good and is wrong."""
    return row.outcome == "good" and row.ratio > TWICE


def main() -> None:
    """Records, spoils, reads, identifies; prints each failure and the tables, writes all rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--part", choices=("files", "recordings"), help="only this part")
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    rows: list[Row] = []
    parts = {"files": file_rows, "recordings": recording_rows}
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        every = machines(scratch)
        for part in [given.part] if given.part else parts:
            for row in parts[part](every, scratch):
                rows.append(row)
                if row.outcome == "silent" or part == "recordings":
                    print(_said(row), flush=True)
    short = [replace(row, sentence=row.sentence[:SAID]) for row in rows]
    write_table(given.out, short, ".4g")
    for part in ("files", "recordings"):
        _table([row for row in rows if row.part == part])


def _said(row: Row) -> str:
    return (
        f"{row.number:3} {row.fault} {row.channels}, {row.rows} rows, {row.machine}: "
        f"{row.outcome}, "
        f"{row.ratio:.2f} times stated, {row.seconds:.1f} s: {row.sentence[:160]}"
    )


def _table(rows: list[Row]) -> None:
    """Outcomes by fault."""
    for fault in dict.fromkeys(row.fault for row in rows):
        own = [row for row in rows if row.fault == fault]
        counts = Counter(row.outcome for row in own)
        worst = max(
            (row.ratio for row in own if row.outcome in ("good", "suspect")), default=np.nan
        )
        said = ", ".join(f"{outcome} {count}" for outcome, count in counts.most_common())
        print(f"{own[0].part:10} {fault:14} {len(own):3}: {said}; "
              f"worst accepted ratio {worst:.2f}")  # fmt: skip
    if rows:
        silent = sum(row.outcome == "silent" for row in rows)
        seconds = sum(row.seconds for row in rows)
        print(f"{rows[0].part}: {silent} silent, {sum(map(deceived, rows))} deceived, "
              f"{seconds:.0f} s of processor")  # fmt: skip


if __name__ == "__main__":
    main()

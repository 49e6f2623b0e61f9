"""20 000 damaged files of each kind of text log: no crash, no hang, no value silently wrong.

    python -m benchmarks.mutated_logs [FILES]        # 20000 of each; docs/studies/mutated_logs.csv

Each file has ROWS rows of a smooth motion with noise, damaged once, in a way drawn from MUTATIONS.
What is read is compared with the motion: at each stamp, the angle that the motion has at that time.
A constant offset of the clock, and of encoders, is no error, since both are unknown anyway.
Outcomes:

equal     every row that is used is right, and nothing was remarked
repaired  every row that is used is right, and the report says what was mended or left out
reported  some row is off, and the report names the fault
refused   an error, with file
silent    some row is off by more than TOLERANCE, and the report says nothing (target: none)
crashed   any other exception (target: none)
slow      more than 5 s (target: none)

peak_MB is the peak of the resident memory up to the end of the family, so no file takes more.
TOLERANCE is what a single row may be off unnoticed: twenty times the noise, an eighth of a signal
period. Within a log four times less is seen, but the rows at its ends have neighbours on one side
only.
"""

from __future__ import annotations

import csv
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from ballbar.acquisition.recording import read_ballbar, read_robot
from ballbar.cell.errors import InputError
from ballbar.cell.load import load_robot
from ballbar.cell.recording import EncoderFitting, EncoderName, SourceFile
from ballbar.cell.robot_angles import joints_to_axes, joints_to_motors

FILES = 20_000
ROWS = 120
PERIOD = 0.012  # [s]
NOISE = 1e-5  # [rad]
TOLERANCE = 20 * NOISE
RESULT = Path(__file__).parent.parent / "docs/studies/mutated_logs.csv"
OUTCOMES = ("equal", "repaired", "reported", "refused", "silent", "crashed", "slow")
USUAL = {"no status word", "column not used"}  # remarks that a sound file has too

Array = np.ndarray
Rng = np.random.Generator
ROBOT = load_robot("irb2400")
T = PERIOD * np.arange(ROWS)
PER_RAD = 3600 * 2**12 / (2 * np.pi)
FITTED: dict[EncoderName, EncoderFitting] = {
    name: EncoderFitting(column=name, lines=3600, bits=12)
    for name in ("b1", "b2", "b3", "b4", "b5")
}


def joints(t: Array) -> Array:
    """(N, 6) [rad] of the robot."""
    return np.stack(
        [0.15 * (i - 2.5) + 0.5 * np.sin((0.9 + 0.15 * i) * t + i) for i in range(6)], axis=1
    )


def bar(t: Array) -> Array:
    """(N, 5) [rad] of the ball-bar."""
    return np.stack([0.4 * np.sin((1.0 + 0.2 * i) * t + i) - 0.1 for i in range(5)], axis=1)


@dataclass(frozen=True)
class Family:
    """One kind of log: how a sound file looks."""

    name: str
    dialect: str
    separator: str
    header: str
    cells: Callable[[Array, Array], list[list[str]]]  # times and true angles -> rows
    ending: str = "\n"
    own: dict[str, object] | None = None  # dialect file of the user's

    @property
    def of_bar(self) -> bool:
        return self.name == "twincat-plc"


def _robot_cells(
    form: str, stamp: Callable[[float], str], values: Callable[[Array], Array]
) -> Callable[[Array, Array], list[list[str]]]:
    return lambda t, q: [
        [stamp(s), *(form % v for v in row)]
        for s, row in zip(t.tolist(), values(q).tolist(), strict=True)
    ]


def _motors(q: Array) -> Array:
    return joints_to_motors(ROBOT, q)


def _degrees(q: Array) -> Array:
    return np.rad2deg(joints_to_axes(ROBOT, q))


def _counts(t: Array, b: Array) -> list[list[str]]:
    words = np.rint(b * PER_RAD).astype(np.int64) % 2**32
    return [
        [str(830_000_000_000_000_000 + round(s * 1e9)), *map(str, row)]
        for s, row in zip(t.tolist(), words.tolist(), strict=True)
    ]


OWN: dict[str, object] = {
    "schema": "ballbar-dialect/1",
    "source": "robot",
    "separators": [";"],
    "time": {"column": "t", "type": "float", "unit": "ms"},
    "axes": [f"re:(?i)axis.{k}" for k in range(1, 7)],
    "angle_unit": "deg",
    "period_s": [0.001, 0.1],
}
_LABCOMM = "Time [s]," + ",".join(f"robot_0:irb2ext.joint[{k}].posRawAbs" for k in range(1, 7))
FAMILIES = (
    Family("twincat-plc", "twincat-plc", ";", "time;b1;b2;b3;b4;b5", _counts, "\r\n"),
    Family(
        "abb-motor", "abb-motor", ",", "time,m1,m2,m3,m4,m5,m6",
        _robot_cells("%.9f", lambda s: f"{1234.5 + s:.6f}", _motors),
    ),
    Family(
        "abb-labcomm", "abb-labcomm", ",", _LABCOMM,
        _robot_cells("%.9f", lambda s: f"{s:.6f}", _motors),
    ),
    Family(
        "comau-joint", "comau-joint", ",", "time,J1,J2,J3,J4,J5,J6",
        _robot_cells("%.7f", lambda s: str(1_700_000_000_000_000 + round(s * 1e6)), _degrees),
    ),
    Family(
        "abb-libegm", "abb-libegm", ",",
        "TIMESTAMP," + ",".join(f"R_FB_POS_RJ{k}" for k in range(1, 7)) + ",S_REF_SPEED",
        lambda t, q: [
            [*row, "0"]
            for row in _robot_cells("%.7f", lambda s: str(round(5000 + s * 1e3)), _degrees)(t, q)
        ],
    ),
    Family(
        "canonical", "canonical-robot", ",", "t_ns,m1,m2,m3,m4,m5,m6",
        _robot_cells("%r", lambda s: str(10**9 + round(s * 1e9)), _motors),
    ),
    Family(
        "generic", "own.yaml", ";", "t;" + ";".join(f"Axis {k} [deg]" for k in range(1, 7)),
        _robot_cells("%.7f", lambda s: f"{s * 1e3:.4f}", _degrees), "\r\n", OWN,
    ),
)  # fmt: skip


@dataclass
class File:
    """A file on its way to damage."""

    header: str
    rows: list[list[str]]
    separator: str
    ending: str
    of_bar: bool

    def content(self) -> bytes:
        return (
            self.ending.join([self.header, *(self.separator.join(row) for row in self.rows)])
            + self.ending
        ).encode()


# --- damage


def cut(file: File, rng: Rng) -> bytes:
    """The end is missing."""
    raw = file.content()
    return raw[: int(rng.integers(len(raw)))]


def flipped(file: File, rng: Rng) -> bytes:
    """One to three bits are wrong."""
    raw = bytearray(file.content())
    for at in rng.integers(len(raw), size=rng.integers(1, 4)):
        raw[at] ^= 1 << int(rng.integers(8))
    return bytes(raw)


def other_bytes(file: File, rng: Rng) -> bytes:
    """One to three bytes are others, most of them digits."""
    raw = bytearray(file.content())
    for at in rng.integers(len(raw), size=rng.integers(1, 4)):
        raw[at] = (
            int(rng.choice(list(b"0123456789.,;-+eE \t\n")))
            if rng.random() < 0.8
            else int(rng.integers(256))
        )
    return bytes(raw)


def lost_range(file: File, rng: Rng) -> bytes:
    """A buffer was overwritten: some bytes in the middle are missing."""
    raw = file.content()
    at = int(rng.integers(len(raw)))
    return raw[:at] + raw[at + int(rng.integers(1, 400)) :]


def zeroed(file: File, rng: Rng) -> bytes:
    """A sector was never written: NUL bytes, in the middle or at the end."""
    raw = file.content()
    at = int(rng.integers(len(raw)))
    length = int(rng.integers(1, 600))
    return raw[:at] + bytes(length) + (raw[at + length :] if rng.random() < 0.5 else b"")


def doubled(file: File, rng: Rng) -> bytes:
    """A stretch was written twice."""
    raw = file.content()
    at = int(rng.integers(len(raw)))
    return raw[:at] + raw[max(0, at - int(rng.integers(1, 800))) :]


def swapped_columns(file: File, rng: Rng) -> bytes:
    """Columns in another order, the header with them."""
    order = rng.permutation(len(file.rows[0]))
    names = file.header.split(file.separator)
    file.header = file.separator.join(names[i] for i in order)
    file.rows = [[row[i] for i in order] for row in file.rows]
    return file.content()


def other_unit(file: File, rng: Rng) -> bytes:
    """Angles or times in another unit than declared."""
    if file.of_bar or rng.random() < 0.4:
        factor = float(rng.choice([1e3, 1e-3, 1e6, 1e-6]))
        file.rows = [[_scaled(row[0], factor), *row[1:]] for row in file.rows]
    else:
        factor = float(rng.choice([180 / np.pi, np.pi / 180]))
        file.rows = [
            [row[0], *(f"{float(cell) * factor:.9f}" for cell in row[1:])] for row in file.rows
        ]
    return file.content()


def _scaled(cell: str, factor: float) -> str:
    return str(round(int(cell) * factor)) if cell.isdigit() else f"{float(cell) * factor:.9f}"


def other_side(file: File, rng: Rng) -> bytes:  # noqa: ARG001
    """Joint for motor angles, or the other way; for counters, another number of bits."""
    if file.of_bar:
        file.rows = [
            [row[0], *(str(int(cell) * 64 % 2**32) for cell in row[1:])] for row in file.rows
        ]
        return file.content()
    angles = np.array([[float(cell) for cell in row[1:7]] for row in file.rows])
    motors = (
        np.abs(angles).max() > 40.0
        and "deg" not in file.header
        and "J1" not in file.header
        and "FB" not in file.header
    )
    other = (
        joints_to_axes(ROBOT, angles @ ROBOT.transmission)
        if motors
        else joints_to_motors(ROBOT, angles)
    )
    file.rows = [
        [row[0], *map(repr, new), *row[7:]]
        for row, new in zip(file.rows, other.tolist(), strict=True)
    ]
    return file.content()


def encoded(file: File, rng: Rng) -> bytes:
    """Saved in another encoding, with other line ends, with quotes."""
    text = file.content().decode()
    if rng.random() < 0.4:
        file.rows = [[f'"{cell}"' for cell in row] for row in file.rows]
        text = file.content().decode()
    text = text.replace(file.ending, str(rng.choice(["\n", "\r\n", "\r", "\n\n"])))
    codec = str(rng.choice(["utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp1252", "cp037"]))
    return (text.replace("m6", "m6") if codec != "cp1252" else "M\u00e4rz\n" + text).encode(codec)


def decimal_commas(file: File, rng: Rng) -> bytes:  # noqa: ARG001
    """Exported on a German or Swedish Windows."""
    file.rows = [[cell.replace(".", ",") for cell in row] for row in file.rows]
    return file.content()


def form(file: File, rng: Rng) -> bytes:
    """Header twice, none, or glued to its first row; a preamble; stray separators and blanks."""
    raw, end = file.content(), file.ending.encode()
    head, _, body = raw.partition(end)
    at = body.index(end, int(rng.integers(len(body) // 2))) + len(end)
    match int(rng.integers(8)):
        case 0:
            return b"key;value" + end + b"Started;2026" + end + raw
        case 1:
            return body
        case 2:
            return head + body
        case 3:
            return head + end + body[:at] + head + end + body[at:]
        case 4:
            sep = file.separator.encode()
            return raw.replace(end, sep + end)
        case 5:
            return head + end + body[:at] + end * int(rng.integers(1, 4)) + body[at:]
        case 6:
            return raw + b"EOF" + end
        case _:
            return head + end + body[:at] + b"# logger restarted" + end + body[at:]


def odd_cells(file: File, rng: Rng) -> bytes:
    """Cells that hold no number, or one that stands for none."""
    words = ["nan", "NaN", "inf", "9E9", "1.234.567", "1e5", "0x10", "ERR", "-", "1_000"]
    odd = ["", *words, " ", "9" * 30, "\u0661", "1,5"]
    for _ in range(int(rng.integers(1, 4))):
        row = file.rows[int(rng.integers(len(file.rows)))]
        row[int(rng.integers(len(row)))] = str(rng.choice(odd))
    return file.content()


def clock_fault(file: File, rng: Rng) -> bytes:
    """The clock is set, stamps repeat or swap, rows are missing, the logger restarts."""
    row = int(rng.integers(1, len(file.rows) - 1))
    size = float(rng.choice([0.001, 0.04, 1.0, 3600.0, 1e6])) * rng.uniform(0.5, 2.0)
    match int(rng.integers(6)):
        case 0:
            file.rows[row:] = [[_shifted(r[0], size, file.header), *r[1:]] for r in file.rows[row:]]
        case 1:
            file.rows[row:] = [
                [_shifted(r[0], -size, file.header), *r[1:]] for r in file.rows[row:]
            ]
        case 2:
            file.rows.insert(row, list(file.rows[row]))
        case 3:
            file.rows[row], file.rows[row - 1] = file.rows[row - 1], file.rows[row]
        case 4:
            del file.rows[row : row + int(rng.integers(1, 40))]
        case _:
            again = int(rng.integers(0, row))
            file.rows = file.rows[:row] + file.rows[again:]
    return file.content()


def _shifted(cell: str, seconds: float, header: str) -> str:
    if not cell.isdigit():
        return f"{float(cell) + seconds * (1e3 if header.startswith('t;') else 1.0):.6f}"
    ticks = {18: 1e9, 16: 1e6, 4: 1e3}.get(len(cell), 1e9)
    return str(int(cell) + round(seconds * ticks))


MUTATIONS: tuple[Callable[[File, Rng], bytes], ...] = (
    cut, flipped, other_bytes, lost_range, zeroed, doubled, swapped_columns, other_unit, other_side,
    encoded, decimal_commas, form, odd_cells, clock_fault,
)  # fmt: skip


# --- judgement


def outcome(family: Family, folder: Path, raw: bytes) -> str:
    """Outcome of reading one file."""
    (folder / "log.csv").write_bytes(raw)
    source = SourceFile(files=("log.csv",), dialect=family.dialect)
    start = time.process_time()
    try:
        if family.of_bar:
            log, imported = read_ballbar(folder, source, FITTED, robot_moves=True)
            t, angles = log.t, log.angles
        else:
            robot, imported = read_robot(folder, source, ROBOT)
            t, angles = robot.t, robot.q
    except InputError:
        return "slow" if time.process_time() - start > 5.0 else "refused"
    except Exception as error:
        print(f"{family.name}: {type(error).__name__}: {error}")
        return "crashed"
    if time.process_time() - start > 5.0:
        return "slow"
    remarked = any(one.kind not in USUAL for one in imported.findings)
    right = is_right(t, angles, bar if family.of_bar else joints, free_zero=family.of_bar)
    if right:
        return "repaired" if remarked else "equal"
    return "reported" if remarked else "silent"


def is_right(t: Array, angles: Array, course: Callable[[Array], Array], *, free_zero: bool) -> bool:
    """Whether all angles are the motion's at their time, but for constant offsets."""
    start = float(
        np.clip(
            T[int(np.argmin(np.abs(course(T) - angles[0]).sum(axis=1)))] if not free_zero else 0.0,
            0.0,
            T[-1],
        )
    )
    candidates = [start] if not free_zero else list(T[: max(1, ROWS - t.size + 1)])
    for first in candidates:
        shift = first
        for _ in range(4):  # Newton, robust
            off = angles - course(shift + t)
            off = off - np.median(off, axis=0) if free_zero else off
            speed = (course(shift + t + 1e-6) - course(shift + t)) / 1e-6
            speed = speed - speed.mean(axis=0) if free_zero else speed
            shift += float(
                np.median((off * speed).sum(axis=1) / np.maximum((speed * speed).sum(axis=1), 1e-3))
            )
        off = angles - course(shift + t)
        off = off - np.median(off, axis=0) if free_zero else off
        if np.abs(off).max() < TOLERANCE:
            return True
    return False


def study(family: Family, files: int, folder: Path) -> dict[str, Counter[str]]:
    """Outcomes of each way of damage."""
    rng = np.random.default_rng([7, *family.name.encode()])
    if family.own is not None:
        (folder / family.dialect).write_text(yaml.safe_dump(family.own))
    counts: dict[str, Counter[str]] = {mutation.__name__: Counter() for mutation in MUTATIONS}
    true = bar(T) if family.of_bar else joints(T)
    for k in range(files):
        mutation = MUTATIONS[k % len(MUTATIONS)]
        rows = family.cells(T, true + rng.normal(0.0, NOISE, true.shape))
        file = File(family.header, rows, family.separator, family.ending, family.of_bar)
        raw = mutation(file, rng)
        found = outcome(family, folder, raw)
        counts[mutation.__name__][found] += 1
        if found in ("silent", "crashed", "slow"):
            (folder.parent / f"{family.name}-{mutation.__name__}-{k}.csv").write_bytes(raw)
    return counts


def main() -> None:
    """Prints a line for each family and writes the table."""
    files = int(sys.argv[1]) if len(sys.argv) > 1 else FILES
    table = []
    with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as work:
        for family in FAMILIES:
            start = time.process_time()
            counts = study(family, files, Path(work))
            total = sum(counts.values(), Counter())
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000
            table += [
                [family.name, name, *(one[outcome] for outcome in OUTCOMES), peak]
                for name, one in counts.items()
            ]
            said = ", ".join(f"{total[outcome]} {outcome}" for outcome in OUTCOMES)
            took = f"{time.process_time() - start:.0f} s, {peak} MB"
            print(f"{family.name:12} {files} files in {took}: {said}", flush=True)
    with RESULT.open("w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(
            [["family", "damage", *OUTCOMES, "peak_MB"], *table]
        )


if __name__ == "__main__":
    main()

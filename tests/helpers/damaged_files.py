"""Files of every container damaged at random, and how the reader's answer to them is judged."""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.recording import read_ballbar, read_force, read_robot
from ballbar.acquisition.report import Finding
from ballbar.cell.errors import InputError
from ballbar.cell.load import load_robot
from ballbar.cell.neighbours import SMALLEST
from ballbar.cell.recording import EncoderFitting, EncoderName, SourceFile
from tests.helpers.container_files import (
    Written,
    db3,
    egm,
    force_torque,
    json_lines,
    mcap,
    mpe,
    scope,
)

LIMIT_S = 5
ROBOT = load_robot("irb2400")
ENCODERS: dict[EncoderName, EncoderFitting] = {
    "b1": EncoderFitting(column="b1", lines=3600, bits=12),
    "b2": EncoderFitting(column="b2", lines=3600, bits=12),
}
OUTCOMES = ("equal", "reported", "refused", "below", "silent", "crash", "hang")
Mutation = Callable[[np.random.Generator, bytes], bytes]


@dataclass
class Tally:
    """Outcomes of one family."""

    counts: Counter[str] = field(default_factory=Counter)
    largest: float = 0.0  # [rad] deviation in `below`
    largest_silent: float = 0.0  # [rad], of a force sensor [N, N m]
    slowest: float = 0.0  # [s]
    examples: list[str] = field(default_factory=list)


class _Hang(BaseException):
    """Not an Exception: no reader may swallow it."""


def truncated(rng: np.random.Generator, content: bytes) -> bytes:
    """The beginning of the file."""
    return content[: int(rng.integers(len(content)))]


def flipped(rng: np.random.Generator, content: bytes) -> bytes:
    """One to four bits."""
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def overwritten(rng: np.random.Generator, content: bytes) -> bytes:
    """A stretch of NUL or of noise."""
    at, size = int(rng.integers(len(content))), int(rng.integers(1, 64))
    filling = bytes(size) if rng.random() < 0.5 else rng.bytes(size)
    return content[:at] + filling[: len(content) - at] + content[at + size :]


def cut_out(rng: np.random.Generator, content: bytes) -> bytes:
    """A stretch missing."""
    at, size = int(rng.integers(len(content))), int(rng.integers(1, 400))
    return content[:at] + content[at + size :]


def inserted(rng: np.random.Generator, content: bytes) -> bytes:
    """Noise between two bytes."""
    at = int(rng.integers(len(content)))
    return content[:at] + rng.bytes(int(rng.integers(1, 40))) + content[at:]


def doubled(rng: np.random.Generator, content: bytes) -> bytes:
    """A stretch twice."""
    at, size = int(rng.integers(len(content))), int(rng.integers(1, 600))
    return content[: at + size] + content[at:]


def swapped(rng: np.random.Generator, content: bytes) -> bytes:
    """Two stretches of the file in each other's place."""
    a, b = sorted(int(i) for i in rng.integers(len(content), size=2))
    size = min(int(rng.integers(1, 200)), b - a, len(content) - b)
    return (
        content[:a]
        + content[b : b + size]
        + content[a + size : b]
        + content[a : a + size]
        + content[b + size :]
    )


def padded(rng: np.random.Generator, content: bytes) -> bytes:
    """Cut, and NUL up to a page of the disk."""
    kept = content[: int(rng.integers(1, len(content) + 1))]
    return kept + bytes(4096 - len(kept) % 4096)


BYTES: tuple[Mutation, ...] = (
    truncated,
    flipped,
    overwritten,
    cut_out,
    inserted,
    doubled,
    swapped,
    padded,
)


def digit_changed(rng: np.random.Generator, content: bytes) -> bytes:
    """One digit another one."""
    digits = np.flatnonzero(
        (np.frombuffer(content, np.uint8) >= 48) & (np.frombuffer(content, np.uint8) <= 57)
    )
    changed = bytearray(content)
    changed[int(rng.choice(digits))] = 48 + int(rng.integers(10))
    return bytes(changed)


def recoded(rng: np.random.Generator, content: bytes) -> bytes:
    """The text in another encoding."""
    codec = ("utf-16", "utf-16-le", "utf-8-sig", "utf-16-be", "utf-32")[int(rng.integers(5))]
    return content.decode().encode(codec)


def line_swapped(rng: np.random.Generator, content: bytes) -> bytes:
    """Two lines in each other's place."""
    lines = content.split(b"\n")
    a, b = (int(i) for i in rng.integers(len(lines), size=2))
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


def field_swapped(rng: np.random.Generator, content: bytes) -> bytes:
    """Two fields of one line swapped; names of channels stay: the log would be another, as good."""
    lines = content.split(b"\n")
    at = int(rng.choice([i for i, line in enumerate(lines) if not line.startswith(b"Name\tb1")]))
    separator = next((mark for mark in (b"\t", b", ", b";") if mark in lines[at]), b":")
    cells = lines[at].split(separator)
    a, b = (int(i) for i in rng.integers(len(cells), size=2))
    cells[a], cells[b] = cells[b], cells[a]
    lines[at] = separator.join(cells)
    return b"\n".join(lines)


def decimal_comma(rng: np.random.Generator, content: bytes) -> bytes:
    """The points of some lines become commas."""
    lines = content.split(b"\n")
    first, last = sorted(int(i) for i in rng.integers(len(lines) + 1, size=2))
    return b"\n".join(
        line.replace(b".", b",") if first <= i < last else line for i, line in enumerate(lines)
    )


TEXT: tuple[Mutation, ...] = (digit_changed, recoded, line_swapped, field_swapped, decimal_comma)


@dataclass(frozen=True, eq=False)
class Log:
    """Outcome of reading a file with the recording's reader."""

    t: NDArray[np.float64]  # (N,) [s]
    angles: NDArray[np.float64]  # (N, C) [rad]; of a force sensor [N, N m]
    findings: tuple[Finding, ...]


def read(folder: Path, name: str, dialect: str) -> Log:
    """The robot's or the ball-bar's log in a file, through all checks of the reader."""
    source = SourceFile(files=(name,), dialect=dialect)
    if dialect == "twincat-scope":
        bar, imported = read_ballbar(folder, source, ENCODERS, robot_moves=True)
        return Log(bar.t, bar.angles, imported.findings)
    if dialect == "force-torque":
        force, imported = read_force(folder, source)
        return Log(force.t, force.wrench, imported.findings)
    robot, imported = read_robot(folder, source, ROBOT)
    return Log(robot.t, robot.q, imported.findings)


def judge(clean: Log, folder: Path, name: str, dialect: str, tally: Tally) -> str:
    """The outcome of reading a damaged file."""
    try:
        log = read(folder, name, dialect)
    except InputError as error:
        return "refused" if name in str(error) else "crash"
    if any(one not in clean.findings for one in log.findings):
        return "reported"
    deviation = _deviation(log, clean)
    if deviation == 0.0:
        return "equal"
    if deviation > SMALLEST:
        tally.largest_silent = max(tally.largest_silent, deviation)
        return "silent"
    tally.largest = max(tally.largest, deviation)
    return "below"


def _deviation(log: Log, clean: Log) -> float:
    """[rad] Largest difference, a wrong time times the speed; infinite where rows are missing."""
    count = len(log.t)
    if count > len(clean.t):
        return np.inf
    speed = float(np.abs(np.diff(clean.angles, axis=0) / np.diff(clean.t)[:, None]).max())
    late = float(np.abs(log.t - clean.t[:count]).max()) * speed
    return max(
        late,
        float(np.abs(log.angles - log.angles[0] - (clean.angles[:count] - clean.angles[0])).max()),
    )


def _alarm(_signum: int, _frame: FrameType | None) -> None:
    raise _Hang


def campaign(
    written: Written,
    mutations: tuple[Mutation, ...],
    files: int,
    folder: Path,
    rng: np.random.Generator,
) -> Tally:
    """Reads so many damaged files of one family."""
    signal.signal(signal.SIGALRM, _alarm)
    tally, name = Tally(), "damaged" + written.suffix
    (folder / name).write_bytes(written.content)
    clean = read(folder, name, written.dialect)
    for i in range(files):
        mutation = mutations[i % len(mutations)]
        content = mutation(rng, written.content)
        (folder / name).write_bytes(content)
        start = time.perf_counter()
        signal.alarm(LIMIT_S)
        try:
            outcome = judge(clean, folder, name, written.dialect, tally)
        except _Hang:
            outcome = "hang"
        except Exception as error:
            outcome = "crash"
            tally.examples.append(f"{mutation.__name__}: {type(error).__name__}: {error}")
        finally:
            signal.alarm(0)
        tally.slowest = max(tally.slowest, time.perf_counter() - start)
        tally.counts[outcome] += 1
        if outcome in {"silent", "crash", "hang"} and tally.counts[outcome] <= 5:
            kept = (
                folder.parent
                / f"bad_{written.dialect}_{outcome}_{tally.counts[outcome]}{written.suffix}"
            )
            kept.write_bytes(content)
            tally.examples.append(f"{mutation.__name__}, {outcome}: {kept}")
    return tally


def other_unit(content: bytes) -> Mutation:
    """The same trajectory in radians where degrees are meant, or the other way; with a cut."""
    return lambda rng, _: content[: len(content) - int(rng.integers(len(content) // 4))]


def families(folder: Path) -> dict[str, tuple[Written, tuple[Mutation, ...]]]:
    """A file of each family, and how it is damaged."""
    less, more = np.pi / 180.0, 180.0 / np.pi
    return {
        "twincat-scope": (scope(), BYTES + TEXT),
        "json-lines": (json_lines(), (*BYTES, *TEXT, other_unit(json_lines(scale=less).content))),
        "egm": (egm(), (*BYTES, other_unit(egm(scale=less).content))),
        "rosbag .db3": (db3(folder), (*BYTES, other_unit(db3(folder, scale=more).content))),
        "rosbag .mcap": (mcap(), (*BYTES, other_unit(mcap(scale=more).content))),
        "abb-mpe": (mpe(), (*BYTES, other_unit(mpe(scale=less).content))),
        "force-torque": (force_torque(), BYTES + TEXT),
    }

"""Files of every container damaged at random: what the reader makes of them. `python -m benchmarks.mutated_containers [FILES]`

Every outcome is one of
    equal      all rows as they were written, or a shorter file cut between two records of a format that has no mark of its end
    reported   read, with a repair or a warning in the report
    refused    an error that names the file
    below      wrong values without a finding, each within what the plausibility check can see in a format without checksum
    silent     wrong values beyond that
    crash      an exception that is no refusal; hang: longer than LIMIT_S
Judged is the table behind the checks of the stamps (order, duplicates, periods). Writes docs/studies/mutated_containers.csv.
"""

from __future__ import annotations

import csv
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

import numpy as np

from acquisition.containers import read_file
from acquisition.dialect import Dialect, load_dialect
from acquisition.layout import Layout
from acquisition.report import Finding
from acquisition.stamps import in_order, report_periods, seconds_from_first
from acquisition.table import Table
from benchmarks.container_files import Written, db3, egm, json_lines, mcap, mpe, scope
from cell.errors import InputError

FILES = 20_000  # of each family
LIMIT_S = 5
RESULT = Path(__file__).parent.parent / "docs/studies/mutated_containers.csv"
OUTCOMES = ("equal", "reported", "refused", "below", "silent", "crash", "hang")

Mutation = Callable[[np.random.Generator, bytes], bytes]


@dataclass
class Tally:
    """Outcomes of one family."""

    counts: Counter[str] = field(default_factory=Counter)
    largest: float = 0.0  # deviation in `below`, as a fraction of the column's range
    slowest: float = 0.0  # [s]
    examples: list[str] = field(default_factory=list)


class _Hang(BaseException):
    """Not an Exception: no reader may swallow it."""


# ---- mutations of bytes


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
    return content[:a] + content[b : b + size] + content[a + size : b] + content[a : a + size] + content[b + size :]


def padded(rng: np.random.Generator, content: bytes) -> bytes:
    """Cut, and NUL up to a page of the disk."""
    kept = content[: int(rng.integers(1, len(content) + 1))]
    return kept + bytes(4096 - len(kept) % 4096)


BYTES: tuple[Mutation, ...] = (truncated, flipped, overwritten, cut_out, inserted, doubled, swapped, padded)


# ---- mutations of texts


def digit_changed(rng: np.random.Generator, content: bytes) -> bytes:
    """One digit another one."""
    digits = np.flatnonzero((np.frombuffer(content, np.uint8) >= 48) & (np.frombuffer(content, np.uint8) <= 57))
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
    """Two fields of one line."""
    lines = content.split(b"\n")
    at = int(rng.integers(len(lines)))
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
    return b"\n".join(line.replace(b".", b",") if first <= i < last else line for i, line in enumerate(lines))


TEXT: tuple[Mutation, ...] = (digit_changed, recoded, line_swapped, field_swapped, decimal_comma)


# ---- judging


def judge(written: Written, dialect: Dialect, path: Path, tally: Tally) -> str:
    """The outcome of reading a damaged file."""
    column = dialect.time.column
    wanted = {column: dialect.time.type, **dict.fromkeys(dialect.axes, "float"), **dict.fromkeys(written.integers, "integer")}
    findings: list[Finding] = []
    try:
        table, _ = read_file(path, path.name, dialect, Layout((), wanted), findings)
        table = in_order(table, dialect.time, findings)
        if len(table) > 1:
            report_periods(table, seconds_from_first(table.columns[column], dialect.time), dialect.period_s, findings)
    except InputError as error:
        return "refused" if path.name in str(error) else "crash"
    if findings:
        return "reported"
    deviation = _deviation(table, written, column)
    if deviation == 0.0:
        return "equal"
    tally.largest = max(tally.largest, deviation if deviation <= BELOW else 0.0)
    return "below" if deviation <= BELOW else "silent"


BELOW = 1e-4  # of a column's range: for an axis that has turned by 80 deg, 0.008 deg


def _deviation(table: Table, written: Written, column: str) -> float:
    """Largest difference from what was written, as a fraction of the column's range; infinite if rows are missing within."""
    count = len(table)
    if count > len(written.columns[column]) or table.columns.keys() != written.columns.keys():
        return np.inf
    largest = 0.0
    for name, values in written.columns.items():
        off = np.abs((table.columns[name] - values[:count]).astype(np.float64)).max(initial=0.0)
        largest = max(largest, float(off) / float(np.ptp(values.astype(np.float64) - float(values[0]))))
    return largest


def _alarm(_signum: int, _frame: FrameType | None) -> None:
    raise _Hang


def campaign(written: Written, mutations: tuple[Mutation, ...], files: int, folder: Path, rng: np.random.Generator) -> Tally:
    """Reads so many damaged files of one family."""
    tally, dialect = Tally(), load_dialect(written.dialect)
    path = folder / ("damaged" + written.suffix)
    for i in range(files):
        mutation = mutations[i % len(mutations)]
        content = mutation(rng, written.content)
        path.write_bytes(content)
        start = time.perf_counter()
        signal.alarm(LIMIT_S)
        try:
            outcome = judge(written, dialect, path, tally)
        except _Hang:
            outcome = "hang"
        except Exception as error:
            outcome = "crash"
            tally.examples.append(f"{mutation.__name__}: {type(error).__name__}: {error}")
        finally:
            signal.alarm(0)
        tally.slowest = max(tally.slowest, time.perf_counter() - start)
        tally.counts[outcome] += 1
        if outcome in {"silent", "crash", "hang"}:
            kept = folder.parent / f"bad_{written.dialect}_{outcome}_{tally.counts[outcome]}{written.suffix}"
            if tally.counts[outcome] <= 5:
                kept.write_bytes(content)
                tally.examples.append(f"{mutation.__name__} {outcome}: {kept}")
    return tally


def families(folder: Path) -> dict[str, tuple[Written, tuple[Mutation, ...]]]:
    """A file of each family, and how it is damaged."""
    return {
        "twincat-scope": (scope(), BYTES + TEXT),
        "json-lines": (json_lines(), BYTES + TEXT),
        "egm": (egm(), BYTES),
        "rosbag .db3": (db3(folder), BYTES),
        "rosbag .mcap": (mcap(), BYTES),
        "abb-mpe": (mpe(), BYTES),
    }


def main(files: int) -> None:
    """Runs all campaigns, prints and writes their table."""
    signal.signal(signal.SIGALRM, _alarm)
    rows = []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for number, (family, (written, mutations)) in enumerate(families(folder).items()):
            tally = campaign(written, mutations, files, folder, np.random.default_rng([2026, number]))
            rows.append([family, files, *(tally.counts[name] for name in OUTCOMES), f"{tally.largest:.1e}", f"{tally.slowest:.2f}"])
            print(*rows[-1], *tally.examples, sep="\n    " if tally.examples else "  ", flush=True)
    with RESULT.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["family", "files", *OUTCOMES, "largest_below", "slowest_s"], *rows])


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else FILES)

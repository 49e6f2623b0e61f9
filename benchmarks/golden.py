"""Results of the product for twenty-three data sets, compared with those of the last commit.

    make golden                                   compares; exit code 1 where anything moved
    python -m benchmarks.golden --accept          stores what it says now
    python -m benchmarks.golden --record          adds the figures of this commit to the table

Twelve recordings and eleven tables of still poses are simulated, or read where measured robots lie
beside the project, and go through the command line: `simulate`, `identify`, `verify` with the same
data, and `verify` with the data of another robot. Every number of the results is compared at 1e-9
relative, a covariance in units of its standard deviations, every sentence exactly. A move of code
changes none of them; what is meant to change one
is a commit of its own that says why.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ballbar.cell.files import write_whole
from tests.helpers import real_robots

STORED = Path("benchmarks/golden_values")  # a file for each data set
FIGURES = Path("docs/studies/golden.csv")
RELATIVE, ABSOLUTE = 1e-9, 1e-15
ROWS = "covariance.lower["  # leaves that hold a row of numbers
SHOWN = 20  # leaves of a data set that moved, printed
# beside calibration.yaml, these say when, where and with what; they are no results
NO_RESULT = {
    *("folder", "files", "version", "versions", "command", "written", "wall_time_s"),
    "measured_on",
}


@dataclass(frozen=True)
class Case:
    """A simulated data set: a scenario with changes, and how it is identified."""

    scenario: str
    changes: tuple[str, ...] = ()
    options: tuple[str, ...] = ()  # of identify
    moved_mm: float = 0.0  # by which what is measured stands elsewhere from the middle row on


CASES = {
    "irb2400": Case("irb2400"),
    "irb2400_dh": Case("irb2400", (), ("--model", "dh")),
    "irb2400_four_encoders": Case("irb2400", ("encoders.fitted=[1, 2, 4, 5]",)),
    "irb2400_torque": Case("irb2400", ("logs.torque={}", "errors.joint_compliance={}")),
    "irb2400_steps": Case("irb2400", ("errors.coupling_slips=[{encoder: 2, at_s: 60}]",)),
    "irb2400_tracker": Case("irb2400", ("logs.tracker={}",)),
    "irb2400_full": Case("irb2400_full"),
    "nj220": Case("nj220"),
    "nj220_full": Case("nj220_full"),
    "irb2400_telescoping": Case("irb2400_telescoping"),
    "irb2400_drawwire": Case("irb2400_drawwire"),
    "ur10e_telescoping": Case("ur10e_telescoping"),
    "irb120_length": Case("irb120_length"),
    "panda_sockets": Case("panda_sockets"),
    "ur10e_tracker": Case("ur10e_tracker"),
    "ur10e_tracker_reference": Case("ur10e_tracker_reference"),
    "ur10e_tracker_drift": Case("ur10e_tracker", ("errors.drift={}",)),
    "ur10e_tracker_moved": Case("ur10e_tracker", moved_mm=1.0),
    "ur10e_theodolites": Case("ur10e_theodolites"),
    "ur10e_plates": Case("ur10e_plates"),
}
MEASURED = {
    "ur5_measured": real_robots.ur5_grid,
    "ur10_measured": real_robots.ur10_b,
    "panda_measured": lambda folder: real_robots.panda(folder, "panda_6"),
}


@dataclass(frozen=True)
class Said:
    """Results of one data set."""

    seconds: float  # of identify
    content: dict[str, Any]  # flat: key to number, text or truth value
    error_mm: float = math.nan  # TCP error, mean; not known of measured robots


def said_of(name: str, folder: Path) -> Said:
    """Simulates or finds a data set, identifies it and verifies the result twice."""
    folder.mkdir()
    if name in MEASURED:
        data = other = MEASURED[name](folder / "data").parent
        options: tuple[str, ...] = ()
    else:
        case = CASES[name]
        options = case.options
        sets = [part for change in case.changes for part in ("--set", change)]
        data, other = folder / "data", folder / "other"
        for out, seed in ((data, 1), (other, 2)):
            made = ballbar("simulate", case.scenario, *sets, "--set", f"seed={seed}", "--out", out)
            if made["exit_code"]:
                raise RuntimeError(f"{name}: {made['error']}")
            if case.moved_mm:
                _move_seat(out / "poses.csv", case.moved_mm)
    start = time.perf_counter()
    result = ballbar("identify", data, *options, "--out", folder / "result", "--json")
    seconds = time.perf_counter() - start
    again = ballbar("verify", folder / "result", data, "--json")
    changed = ballbar("verify", folder / "result", other, "--json") if other != data else {}
    each = {"identify": result, "verify": again, "verify_other": changed}
    paths = (str(folder), str(real_robots.DATA))
    truth = data.with_name(data.name + ".truth.yaml")
    compared = ballbar("compare", folder / "result", truth, "--json") if truth.exists() else {}
    error = compared.get("tcp_error", compared.get("tcp_difference", {})).get("mean_m", math.nan)
    return Said(seconds, dict(flat(each, paths)), 1e3 * error)


def _move_seat(table: Path, size_mm: float) -> None:
    """Moves what a table measured along x from its middle row on."""
    with table.open(newline="") as file:
        head, *rows = csv.reader(file)
    column = head.index("x [mm]")
    for row in rows[len(rows) // 2 :]:
        row[column] = f"{float(row[column]) + size_mm:.8f}"
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    table.write_text(text.getvalue())


def ballbar(*arguments: object) -> dict[str, Any]:
    """JSON of a command, or its exit code and error."""
    command = [sys.executable, "-m", "ballbar", *map(str, arguments)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if "--json" in arguments and done.stdout.strip():
        return {"exit_code": done.returncode, **json.loads(done.stdout)}
    return {"exit_code": done.returncode, "error": done.stderr.strip()}


def flat(value: Any, paths: tuple[str, ...], key: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and leaves of nested JSON, without what is no result and without folders in texts."""
    if isinstance(value, dict):
        for name, part in value.items():
            if name not in NO_RESULT:
                yield from flat(part, paths, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for k, part in enumerate(value):
            yield from flat(part, paths, f"{key}[{k}]")
    elif isinstance(value, str):
        for path in paths:
            value = value.replace(path, "DIR")
        yield key, value
    else:
        yield key, value


def moved(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """A line for every leaf that is not what it was."""
    lines = []
    for key in {**before, **after}:
        old, new = before.get(key), after.get(key)
        if not (same(old, new) or (ROWS in key and same_row(key, before, after))):
            lines.append(f"  {key}: {old!r} -> {new!r}")
    return lines


def same(old: Any, new: Any) -> bool:
    """Whether two leaves are equal, numbers within rounding."""
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in (old, new))
    if not numbers:
        return bool(old == new)
    return abs(old - new) <= RELATIVE * max(abs(old), abs(new)) + ABSOLUTE


def same_row(key: str, before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Whether a row of a covariance's lower triangle is, in units of its standard deviations."""
    name, _, row = key.removesuffix("]").rpartition("[")
    rows = [f"{name}[{k}]" for k in range(int(row) + 1)]
    if any(at not in before or at not in after for at in rows):
        return False
    scale = np.sqrt([float(before[at].split()[-1]) for at in rows])
    old, new = (np.array(said[key].split(), dtype=float) for said in (before, after))
    return old.size == new.size and bool((abs(old - new) <= RELATIVE * scale * scale[-1]).all())


def main() -> None:
    """Compares, stores or records."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=[*CASES, *MEASURED])
    parser.add_argument("--accept", action="store_true", help="Store what is said now.")
    parser.add_argument("--record", metavar="COMMIT", help="Add this commit's figures.")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    names = arguments.only or [*CASES, *MEASURED]
    if not real_robots.DATA.is_dir():
        names = [name for name in names if name not in MEASURED]
        print(f"{real_robots.DATA.name}: measured robots are not there and are left out")
    faults = 0
    with TemporaryDirectory() as folder, ThreadPoolExecutor(arguments.processes) as pool:
        for name, said in zip(
            names, pool.map(lambda n: said_of(n, Path(folder) / n), names), strict=True
        ):
            path = STORED / f"{name}.json"
            lines = moved(json.loads(path.read_text()) if path.exists() else {}, said.content)
            faults += len(lines)
            print(f"{name}: {len(said.content)} leaves, {len(lines)} moved, {said.seconds:.1f} s")
            if arguments.accept:
                text = json.dumps(said.content, indent=0, sort_keys=True, ensure_ascii=False)
                write_whole(path, f"{text}\n".encode())
            elif lines:
                print("\n".join(lines[:SHOWN]))
            if arguments.record:
                _record(arguments.record, name, said)
    if faults and not arguments.accept:
        sys.exit(1)


def _record(commit: str, name: str, said: Said) -> None:
    """Adds a row of figures: accuracy, and as stated, seconds and sentences."""
    content = said.content
    fit = "identify.calibration.fit."
    row = (
        commit,
        name,
        "" if math.isnan(said.error_mm) else f"{said.error_mm:.4f}",
        f"{content.get(fit + 'tcp_sigma_mean_m', float('nan')) * 1e3:.4f}",
        f"{said.seconds:.1f}",
        json.dumps(content.get("identify.sentence", content.get("identify.error", ""))),
        json.dumps(content.get("verify.sentence", content.get("verify.error", ""))),
    )
    header = "commit,case,error_mm,stated_mm,seconds,identify,verify\n"
    before = FIGURES.read_text() if FIGURES.exists() else header
    write_whole(FIGURES, (before + ",".join(row) + "\n").encode())


if __name__ == "__main__":
    main()

"""How long the commands take that people wait for, from the shell's view.

    python -m benchmarks.whole_commands                  # this checkout, three minutes
    python -m benchmarks.whole_commands --old DIR        # beside it another checkout, in turns

Of whole processes, medians: seconds until the answer stands on the screen, until the end, and of
the processor; and the first over those of Python importing LIBRARIES, in the same round. Commands:
`ballbar run irb2400`, as `make run` calls it; `ballbar identify` of one and of two recordings of
120 s with everything on (irb2400_full); and of two that cannot be fitted together: the second one
is of another robot, or repeats five seconds of the robot's log, or its robot's clock goes 2 ms
astray and back. Each recording is made by the checkout that reads it. The first round, which may
compile, is not counted: bytecode is kept in the system's temporary folder, even where the
environment forbids it in the checkout.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.study import study_parser
from tests.helpers.drawn_robots import ROOT

ANSWER = "stated TCP uncertainty"  # comes with the verdict
LIBRARIES = "import numpy, scipy.optimize, scipy.interpolate, scipy.spatial, mujoco"
COMMANDS = {  # words, and the seconds sought beside libraries that load in 0.9 s
    "run irb2400": (("run", "scenarios/irb2400.yaml"), 3.0),
    "identify one": (("identify", "{one}"), 2.0),
    "identify two": (("identify", "{one}", "{two}"), 3.0),
    "another robot": (("identify", "{one}", "{other}"), 10.0),
    "replayed block": (("identify", "{replayed}", "{two}"), 10.0),
    "bent clock": (("identify", "{one}", "{bent}"), 10.0),
}
LOADED = 0.9  # [s] of the libraries, where the seconds above are sought
TABLE = "{table: thesis_3_1}"
OTHER = "{sigma_m: 5.0e-4, sigma_rad: 5.0e-4}"  # errors of the other robot's geometry
Rows = list[list[str]]  # of robot.csv: the time, then motor angles and torques


@dataclass(frozen=True)
class Took:
    """One process from its call to its end."""

    answer: float  # [s] until the ANSWER is on the screen; to the end where there is none
    wall: float  # [s]
    processor: float  # [s]


def timed(words: list[str], checkout: Path) -> Took:
    """How long a program takes that Python runs in a checkout."""
    compiling = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    cache = str(Path(tempfile.gettempdir()) / "ballbar-bytecode")
    begun, before = time.perf_counter(), os.times()
    with subprocess.Popen(
        [sys.executable, *words],
        cwd=checkout,
        env=compiling | {"PYTHONPATH": str(checkout), "PYTHONPYCACHEPREFIX": cache},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        lines = [(line, time.perf_counter() - begun) for line in process.stdout]
    wall, after = time.perf_counter() - begun, os.times()
    used = after.children_user + after.children_system
    used -= before.children_user + before.children_system
    answer = next((at for line, at in lines if line.startswith(ANSWER)), wall)
    return Took(answer, wall, used)


def simulated(checkout: Path, folder: Path, path: str, *changes: tuple[str, str]) -> None:
    """Writes a recording of irb2400_full on another path, with changes of the scenario's text."""
    scenarios, file = checkout / "scenarios", folder.with_suffix(".yaml")
    text = (scenarios / "irb2400_full.yaml").read_text()
    whole = str(scenarios / "paths" / f"irb2400_{path}.yaml")
    for old, new in (("paths/irb2400_a.yaml", whole), *changes):
        text = text.replace(old, new)
    file.write_text(text)
    words = ["-m", "ballbar", "simulate", str(file), "--out", str(folder)]
    timed(words, checkout)


def spoilt(source: Path, folder: Path, spoil: Callable[[Rows, np.ndarray], None]) -> None:
    """Writes a recording whose robot's log was spoilt; the times in it begin at zero."""
    shutil.copytree(source, folder)
    file = folder / "raw" / "robot.csv"
    head, *lines = file.read_text().splitlines()
    rows = [line.split(",") for line in lines]
    times = np.array([float(row[0]) for row in rows])
    spoil(rows, times - times[0])
    file.write_text("\n".join([head, *(",".join(row) for row in rows)]) + "\n")


def replay(rows: Rows, times: np.ndarray) -> None:
    """Repeats what was logged from 40 s on, from 60 s to 65 s."""
    first, last, source = np.searchsorted(times, (60.0, 65.0, 40.0)).tolist()
    for row, earlier in zip(rows[first:last], [row[1:] for row in rows[source:]], strict=False):
        row[1:] = earlier


def bend(rows: Rows, times: np.ndarray) -> None:
    """Moves the times by a parabola, 2 ms in the middle."""
    share = times / times[-1]
    for row, late in zip(rows, 8e-3 * share * (1.0 - share), strict=True):
        row[0] = f"{float(row[0]) + late:.6f}"


def recordings(checkout: Path, folder: Path) -> dict[str, str]:
    """Makes the recordings of a checkout, and gives their folders."""
    names = {name: folder / name for name in ("one", "two", "other", "replayed", "bent")}
    folder.mkdir()
    simulated(checkout, names["one"], "a")
    simulated(checkout, names["two"], "b")
    simulated(checkout, names["other"], "b", ("seed: 1", "seed: 7"), (TABLE, OTHER))
    spoilt(names["one"], names["replayed"], replay)
    spoilt(names["two"], names["bent"], bend)
    return {name: str(path) for name, path in names.items()}


def main() -> None:
    """Prints the medians of every command."""
    parser = study_parser(__doc__)
    parser.add_argument("--old", type=Path, help="another checkout")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default=",".join(COMMANDS), help="names, by comma")
    given = parser.parse_args()
    checkouts = [ROOT, *([given.old.resolve()] if given.old else [])]
    with tempfile.TemporaryDirectory() as scratch:
        made = [recordings(c, Path(scratch) / str(k)) for k, c in enumerate(checkouts)]
        for label in given.only.split(","):
            arguments, sought = COMMANDS[label]
            rounds = []
            for _ in range(given.rounds + 1):
                libraries = timed(["-c", LIBRARIES], ROOT).wall
                row = []
                for k, checkout in enumerate(checkouts):
                    words = ["-m", "ballbar", *(word.format(**made[k]) for word in arguments)]
                    out = ["--out", str(Path(scratch) / f"{k} {label}")]
                    took = timed([*words, *out], checkout)
                    row.append((took.answer, took.wall, took.processor, took.answer / libraries))
                rounds.append(row)
            for checkout, medians in zip(checkouts, np.median(rounds[1:], axis=0), strict=True):
                answer, wall, used, ratio = medians
                print(
                    f"{label:<15} {checkout.name:<12} answer {answer:5.2f} s, end {wall:5.2f} s, "
                    f"processor {used:5.2f} s; answer over libraries {ratio:5.1f}, sought "
                    f"{sought / LOADED:.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()

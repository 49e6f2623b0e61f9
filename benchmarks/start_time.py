"""Start of commands and of a sweep worker: processor and wall time, modules, heavy libraries.

    python -m benchmarks.start_time                  # this checkout
    python -m benchmarks.start_time --old DIR        # beside it another checkout, the two in turn

Each start is a fresh interpreter, whose own start is counted; the first round, which may compile,
is not.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.cell.threads import ONE_THREAD

ROUNDS = 11
HEAVY = ("numpy", "scipy", "mujoco", "pyarrow", "matplotlib", "rerun")
COMMAND = "import sys; sys.argv[:] = {}; from ballbar.__main__ import main; main()"
COMPLETION = {"_BALLBAR_COMPLETE": "complete_bash", "COMP_CWORD": "1", "COMP_WORDS": "ballbar id"}
OPTIONS = {"COMP_CWORD": "2", "COMP_WORDS": "ballbar identify --co"}
STARTS: dict[str, tuple[str, dict[str, str]]] = {  # program and environment
    "Python alone": ("", {}),
    "ballbar --help": (COMMAND.format(["ballbar", "--help"]), {}),
    "ballbar --version": (COMMAND.format(["ballbar", "--version"]), {}),
    "completion of a command": (COMMAND.format(["ballbar"]), COMPLETION),
    "completion of an option": (COMMAND.format(["ballbar"]), COMPLETION | OPTIONS),
    "ballbar identify --help": (COMMAND.format(["ballbar", "identify", "--help"]), {}),
    "worker of a sweep": ("import ballbar.trial.trial", {}),
}
_REPORT = """
import atexit, json, sys, time
def report():
    heavy = [name for name in {heavy!r} if name in sys.modules]
    print(json.dumps([time.process_time(), len(sys.modules), heavy]), file=sys.stderr)
atexit.register(report)
"""


@dataclass(frozen=True)
class Start:
    """One program from its call to its end."""

    processor: float  # [s]
    wall: float  # [s]
    modules: int  # loaded at the end
    heavy: tuple[str, ...]  # of HEAVY


def start(checkout: Path, name: str) -> Start:
    """One of STARTS in a fresh interpreter; checkout : folder of the project."""
    program, variables = STARTS[name]
    environment = os.environ | dict.fromkeys(ONE_THREAD, "1") | {"PYTHONPATH": str(checkout)}
    since = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _REPORT.format(heavy=HEAVY) + program],
        cwd=checkout,
        env=environment | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    wall = time.perf_counter() - since
    processor, modules, heavy = json.loads(done.stderr.splitlines()[-1])
    return Start(processor, wall, modules, tuple(heavy))


def main() -> None:
    """Prints a line for each start and checkout: medians, and the libraries."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--old", type=Path, metavar="DIR", help="another checkout of the project")
    old: Path | None = parser.parse_args().old
    checkouts = {"this": Path(__file__).parents[1]} | ({"old": old.resolve()} if old else {})
    for name in STARTS:
        rounds = [
            [start(checkout, name) for checkout in checkouts.values()] for _ in range(ROUNDS + 1)
        ]
        for which, starts in zip(checkouts, zip(*rounds[1:], strict=True), strict=True):
            processor = np.median([each.processor for each in starts])
            wall = np.median([each.wall for each in starts])
            print(
                f"{name:<24} {which:<5} {processor:.2f} s processor, {wall:.2f} s wall, "
                f"{starts[0].modules:4} modules; {', '.join(starts[0].heavy) or 'none'} of "
                "the heavy ones"
            )


if __name__ == "__main__":
    main()

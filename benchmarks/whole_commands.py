"""How long the commands take that people wait for, from the shell's view.

    python -m benchmarks.whole_commands                  # this checkout, two minutes
    python -m benchmarks.whole_commands --old DIR        # beside it another checkout, in turns

Wall and processor time of whole processes, medians: `ballbar run irb2400`, as `make run` calls it,
and `ballbar identify` of one and of two recordings with everything on (irb2400_full), each made by
the checkout that reads it. The first round, which may compile, is not counted.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.study import study_parser
from tests.helpers.drawn_robots import ROOT

COMMANDS = {
    "run irb2400": ("run", "scenarios/irb2400.yaml"),
    "identify one": ("identify", "{one}"),
    "identify two": ("identify", "{one}", "{two}"),
}


def command(checkout: Path, *arguments: str, out: Path) -> tuple[float, float]:
    """Wall and processor time [s] of a command of a checkout."""
    begun, before = time.perf_counter(), os.times()
    subprocess.run(
        [sys.executable, "-m", "ballbar", *arguments, "--out", str(out)],
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    after = os.times()
    used = after.children_user + after.children_system
    return time.perf_counter() - begun, used - before.children_user - before.children_system


def main() -> None:
    """Prints the medians of every command."""
    parser = study_parser(__doc__)
    parser.add_argument("--old", type=Path, help="another checkout")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    checkouts = [ROOT, *([given.old.resolve()] if given.old else [])]
    with tempfile.TemporaryDirectory() as scratch:
        folders = [Path(scratch) / str(number) for number in range(len(checkouts))]
        for folder, checkout in zip(folders, checkouts, strict=True):
            for name, path in (("one", "a"), ("two", "b")):
                (folder / name).mkdir(parents=True)
                scenarios = checkout / "scenarios"
                text = (scenarios / "irb2400_full.yaml").read_text()
                file = folder / f"{name}.yaml"
                whole = scenarios / "paths" / f"irb2400_{path}.yaml"
                file.write_text(text.replace("paths/irb2400_a.yaml", str(whole)))
                command(checkout, "simulate", str(file), out=folder / name / "logs")
        for label, arguments in COMMANDS.items():
            times = np.zeros((given.rounds + 1, len(checkouts), 2))
            for row in times:
                for k, (folder, checkout) in enumerate(zip(folders, checkouts, strict=True)):
                    logs = {name: str(folder / name / "logs") for name in ("one", "two")}
                    words = [word.format(**logs) for word in arguments]
                    row[k] = command(checkout, *words, out=folder / label)
            wall, used = np.moveaxis(np.median(times[1:], axis=0), 1, 0)
            print(f"{label}: {wall[0]:.2f} s, processor {used[0]:.2f} s", end="")
            if given.old:
                print(f"; {given.old.name}: {wall[1]:.2f} s, {used[1]:.2f} s", end="")
                print(f"; ratio {wall[0] / wall[1]:.2f}", end="")
            print(flush=True)


if __name__ == "__main__":
    main()

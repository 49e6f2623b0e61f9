"""Start of a sweep worker: seconds and modules that the import of its work, `run_trial`, costs.

    python -m benchmarks.worker_start                  # this checkout
    python -m benchmarks.worker_start --old DIR        # beside it another checkout, the two in turn

Each import happens in a fresh interpreter; the first one, which may compile, is not counted.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from cell.threads import ONE_THREAD

ROUNDS = 11
HEAVY = ("rerun", "matplotlib", "jinja2", "pyarrow")  # viewer, figures, page, tables
_SCRIPT = """
import json, sys, time
since = time.perf_counter()
__import__({module!r})
seconds = time.perf_counter() - since
heavy = [name for name in {heavy!r} if name in sys.modules]
print(json.dumps([seconds, len(sys.modules), heavy]))
"""


def worker_start(checkout: Path) -> tuple[float, int, list[str]]:
    """Seconds of the import, number of loaded modules, and those of HEAVY among them.

    checkout : folder of the project, `run_trial` in ballbar/trial/trial.py or ballbar/trial.py.
    """
    module = "ballbar.trial.trial" if (checkout / "ballbar/trial").is_dir() else "ballbar.trial"
    environment = os.environ | dict.fromkeys(ONE_THREAD, "1") | {"PYTHONPATH": str(checkout)}
    script = _SCRIPT.format(module=module, heavy=HEAVY)
    answer = subprocess.run(
        [sys.executable, "-c", script],
        cwd=checkout,
        env=environment,
        capture_output=True,
        check=True,
    )
    seconds, modules, heavy = json.loads(answer.stdout)
    return seconds, modules, heavy


def main() -> None:
    """Prints a line for each checkout."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--old", type=Path, metavar="DIR", help="another checkout of the project")
    old: Path | None = parser.parse_args().old
    checkouts = {"this": Path(__file__).parents[1]} | ({"old": old.resolve()} if old else {})
    rounds = [
        [worker_start(checkout) for checkout in checkouts.values()] for _ in range(ROUNDS + 1)
    ]
    for name, starts in zip(checkouts, zip(*rounds[1:], strict=True), strict=True):
        seconds, (_, modules, heavy) = [start[0] for start in starts], starts[0]
        print(
            f"{name:<5} {np.median(seconds):.2f} s (quartiles {np.quantile(seconds, 0.25):.2f} to "
            f"{np.quantile(seconds, 0.75):.2f}), {modules} modules; "
            f"heavy ones: {', '.join(heavy) or 'none'}"
        )


if __name__ == "__main__":
    main()

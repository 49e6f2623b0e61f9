"""Replay file of a 120 s run: processor time to write it, and its size.

    python -m benchmarks.replay_file [SCENARIO ...]

Limits: 2 s and 15 MB for a run of 120 s.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from ballbar.replay.write import write_replay
from ballbar.run import run_scenario
from ballbar.scenario import load_scenario

SCENARIOS = ("scenarios/irb2400.yaml", "scenarios/irb2400_full.yaml", "scenarios/nj220_full.yaml")
REPEATS = 3
LIMIT_S, LIMIT_MB = 2.0, 15.0


def main(scenarios: list[str]) -> bool:
    """Prints a row for each scenario; whether all are within the limits."""
    within = True
    for name in scenarios:
        with TemporaryDirectory(prefix="ballbar-replay-") as top:
            settings = load_scenario(Path(name))
            data = run_scenario(
                settings,
                Path(name),
                out=Path(top) / "run",
                command="benchmark",
                progress=lambda _: None,
            )
            path, spent = Path(top) / "again.rrd", []
            for _ in range(REPEATS):
                begun = time.process_time()
                write_replay(path, data)
                spent.append(time.process_time() - begun)
            size = path.stat().st_size / 1e6
        length, seconds = data.recordings[0].recording.robot_log.t[-1], sorted(spent)[REPEATS // 2]
        within &= seconds <= LIMIT_S and size <= LIMIT_MB
        print(
            f"{settings.name:14} {length:4.0f} s: "
            f"{seconds:.2f} s processor time (limit {LIMIT_S:g}), "
            f"{size:.1f} MB (limit {LIMIT_MB:g})"
        )
    return within


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1:] or list(SCENARIOS)) else 1)

"""Recordings of a ball-bar and still points of a tracker in one fit: drawn robots, everything on.

    python -m benchmarks.mixed_fit               # six IRB 2400; ten minutes

Two recordings of each robot as in benchmarks.everything_on, and the still poses of
tests.helpers.tracker_points, at which a tracker measured a target on the tool. Writes
docs/studies/mixed_fit.csv: a row for each robot and for the data fitted, `recordings` alone or
`mixed`. Plate and ball-bar axes leave the scale open; the tracker determines it.
"""

from __future__ import annotations

import argparse
import csv
import io
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.cell.files import write_whole
from ballbar.ident.identify import identify_together
from ballbar.truth.compare import identification_against_truth
from tests.helpers.drawn_robots import ROOT, recorded, scenario_of
from tests.helpers.tracker_points import still_points

COLUMNS = (
    "robot", "fitted", "status", "tcp_mean_mm", "tcp_max_mm", "scale_known_mm", "tcp_sigma_mm",
    "over_stated",
)  # fmt: skip


def robot_rows(seed: int, duration: float) -> list[dict[str, object]]:
    """The rows of one drawn robot."""
    with tempfile.TemporaryDirectory() as folder:
        runs = [recorded(scenario_of("irb2400", p, seed, duration), Path(folder) / p) for p in "ab"]
    cell, _, truth = runs[0]
    logs = [replace(log, name=name) for (_, log, _), name in zip(runs, "ab", strict=True)]
    rows = []
    for fitted, table in (("recordings", None), ("mixed", still_points(cell, truth, seed))):
        result = identify_together(cell, logs, table)
        compared = identification_against_truth(result, truth)
        stated = float(result.robot.tcp_sigma.mean())
        values = (
            seed, fitted, str(result.verdict.status), compared.tcp.mean * 1e3,
            compared.tcp.maximum * 1e3, float(compared.tcp.error_without_scale.mean()) * 1e3,
            stated * 1e3, compared.tcp.mean / stated,
        )  # fmt: skip
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def main() -> None:
    """Draws, identifies, writes the rows and prints medians."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--duration", type=float, default=120.0, help="[s] of each recording")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rows: list[dict[str, object]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        jobs = [
            pool.submit(robot_rows, seed, options.duration) for seed in range(1, options.robots + 1)
        ]
        for job in jobs:
            rows += job.result()
            for row in rows[-2:]:
                print(*(f"{row[c]:.4g}" if isinstance(row[c], float) else row[c] for c in COLUMNS))
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows
    )
    write_whole(ROOT / "docs" / "studies" / "mixed_fit.csv", text.getvalue().encode())
    for fitted in ("recordings", "mixed"):
        own = [row for row in rows if row["fitted"] == fitted]
        error = np.array([row["tcp_mean_mm"] for row in own], dtype=float)
        ratio = np.array([row["over_stated"] for row in own], dtype=float)
        print(
            f"{fitted}: median of the mean TCP error {np.median(error):.4f} mm, "
            f"error over stated {np.sqrt((ratio**2).mean()):.2f} (rms)"
        )


if __name__ == "__main__":
    main()

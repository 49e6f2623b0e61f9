"""Two paths at two speeds, identified apart: do their results agree within the stated sigma?

    python -m benchmarks.two_speeds    # 8 IRB 2400, everything on; two minutes on two cores

Path a in 120 s and path b in 180 s, each with its own clocks, encoder offsets and drawn noise; the
motors' torque is logged. Compared are the predictions of the tool over the accuracy grid, base
aligned. Writes docs/studies/two_speeds.csv, a row for each robot.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd

from ballbar.cell.files import write_whole
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from tests.helpers.drawn_robots import ROOT, recorded, scenario_of, study_options

SLOWER = 1.5


def robot_row(seed: int, duration: float) -> dict[str, object]:
    """One robot."""
    with tempfile.TemporaryDirectory() as folder:
        made = [
            recorded(scenario_of("irb2400", p, seed, s * duration), Path(folder) / p)
            for p, s in (("a", 1.0), ("b", SLOWER))
        ]
    cell, options = made[0][0], FitOptions(model="complete", force="torque")
    first, second = (identify_together(cell, [logs], options=options) for _, logs, _ in made)
    grid = accuracy_grid(cell.robot)
    positions = (found.robot.identified.tool(grid) for found in (first, second))
    apart = position_error(*positions)
    stated = float(np.sqrt((first.robot.tcp_sigma**2 + second.robot.tcp_sigma**2).mean()))
    rms = float(np.sqrt((apart.error**2).mean()))
    return {
        "seed": seed, "status_a": first.verdict.status, "status_b": second.verdict.status,
        "mean_mm": apart.mean * 1e3, "max_mm": apart.maximum * 1e3, "rms_mm": rms * 1e3,
        "stated_sigma_mm": stated * 1e3, "in_sigmas": rms / stated,
    }  # fmt: skip


def main() -> None:
    """Draws, identifies, writes the rows and prints medians and worst cases."""
    options = study_options(__doc__)
    with ProcessPoolExecutor(2) as pool:
        table = pd.DataFrame(
            list(
                pool.map(
                    robot_row, range(1, options.robots + 1), [options.duration] * options.robots
                )
            )
        )
    write_whole(
        ROOT / "docs" / "studies" / "two_speeds.csv",
        table.to_csv(index=False, float_format="%.6g").encode(),
    )
    print(table.to_string(index=False))
    print(
        "difference of the predictions, mean over the grid: "
        f"median {table.mean_mm.median():.4f} mm, worst {table.mean_mm.max():.4f} mm; "
        f"rms over what both state: median {table.in_sigmas.median():.2f}, "
        f"worst {table.in_sigmas.max():.2f}"
    )


if __name__ == "__main__":
    main()

"""Whether the expanded uncertainty holds: drawn robots with every error source on.

    python -m benchmarks.budget_coverage                        # 60 robots; ten minutes of one core
    python -m benchmarks.budget_coverage --first 31 --robots 8 --recordings FOLDER

One recording of each robot is identified as `ballbar identify` does. Of the poses of the workspace
are counted those at which the tool's error along each axis of the base, base aligned, is within two
standard uncertainties, and those whose distance is within k times the combined one. Recordings are
simulated, or read from FOLDER/irb2400_SEED/a beside their truth. Writes
docs/studies/budget_coverage.csv.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from ballbar.acquisition.recording import read_recording
from ballbar.cell.descriptions import Cell
from ballbar.ident.identify import identify_together
from ballbar.ident.recording_fit import Logs
from ballbar.ident.robot.accuracy import accuracy_grid, rigid_basis
from ballbar.sim.truth import Truth, load_truth
from ballbar.truth.compare import true_tool
from benchmarks.study import STUDIES, in_words, study_parser, write_table
from tests.helpers.drawn_robots import recorded, scenario_of
from tests.helpers.synthetic_recording import CELL


def robot_row(seed: int, recordings: Path | None) -> dict[str, object]:
    """Shares of the poses at which one robot's uncertainty holds."""
    if recordings is None:
        with tempfile.TemporaryDirectory() as folder:
            cell, logs, truth = recorded(scenario_of("irb2400", "a", seed, 120.0), Path(folder))
    else:
        cell, logs, truth = read(recordings / f"irb2400_{seed}" / "a")
    found = identify_together(cell, [logs])
    grid, robot, budget = accuracy_grid(cell.robot), found.robot.identified, found.budget
    assert budget is not None, "a fresh identification has its fit"
    actual, predicted = true_tool(cell, truth, truth.geometry, grid), robot.tool(grid)
    error = (predicted - actual).ravel()
    basis = rigid_basis(predicted)
    error = (error - basis @ (basis.T @ error)).reshape(-1, 3)
    stated = robot.uncertainty(grid)
    along = np.sqrt(np.diagonal(stated.covariance, axis1=1, axis2=2))
    distance = np.linalg.norm(error, axis=1)
    return {
        "seed": seed,
        "status": found.verdict.status,
        "error_rms_mm": 1e3 * float(np.sqrt((distance**2).mean())),
        "combined_mm": 1e3 * budget.combined,
        "k": budget.coverage_factor,
        "axes_within_2": float((np.abs(error) <= 2.0 * along).mean()),
        "distances_within_2": float((distance <= 2.0 * stated.sigma).mean()),
        "distances_within_k": float((distance <= budget.coverage_factor * stated.sigma).mean()),
    }


def read(folder: Path) -> tuple[Cell, Logs, Truth]:
    """A recording that was simulated before, and its truth."""
    made = read_recording(folder)
    logs = Logs(made.robot_log, made.ballbar_log, made.force_log)
    truth = load_truth(folder.with_name("a.truth.yaml"))
    assert isinstance(truth, Truth), "of a moving robot"
    return CELL, logs, truth


def main() -> None:
    """Draws, identifies, writes the rows and prints the means."""
    parser = study_parser(__doc__)
    parser.add_argument("--robots", type=int, default=60)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--recordings", type=Path)
    parser.add_argument("--out", type=Path, default=STUDIES / "budget_coverage.csv")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.robots)
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        for row in pool.map(partial(robot_row, recordings=options.recordings), seeds):
            rows.append(row)
            print(in_words(row), flush=True)
            write_table(options.out, rows, ".4g")
    for key in ("axes_within_2", "distances_within_2", "distances_within_k"):
        print(f"{key}: {np.mean([row[key] for row in rows]):.1%} of the poses")


if __name__ == "__main__":
    main()

"""Robot error from a tracker that drifts, without and with reference points; knocked points.

    python -m benchmarks.reference_points
    python -m benchmarks.reference_points --frames

The cell of scenarios/ur10e_tracker_reference.yaml with the first 3, all 4, or 6 points, for each
drift and seed, and the same seeds without drift. Columns: root mean square over the seeds of the
mean TCP error, ratio of that to the error without drift (least and largest of a seed), and how
often the identification names a drift.

--frames : only the correction itself, in plain numpy: what is left of the motion at the targets, by
single measurements and by the fit, beside the stated deviation; then how often a point that was
knocked by some distance is named, or another one.
"""

from __future__ import annotations

import sys
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.acquisition.pose_tables import read_poses
from ballbar.acquisition.reference_fit import fit_with_knocks
from ballbar.cell.statistics import rms
from ballbar.ident.table_fit import fit_table
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.recording_files import write_poses
from ballbar.sim.still_poses import simulate_poses
from ballbar.truth.compare import poses_against_truth
from tests.helpers.reference_points import (
    MOTIONS,
    SIGMA,
    errors,
    errors_of_single_measurements,
    fitted,
    readings,
)

SEEDS = range(1, 13)
DRIFTS = ((1e-4, 0.0), (3e-4, 1e-4), (1e-3, 3e-4))  # [m], [rad] from the first pose to the last
MORE = (
    {"name": "wall", "position_m": (1.3, 0.2, 1.1)},
    {"name": "door", "position_m": (-1.4, 0.1, 0.9)},
)
POINTS = (0, 3, 4, 6)
KNOCKS = 50


def mean_error(seed: int, drift: tuple[float, float], points: int) -> tuple[float, bool]:
    """Mean TCP error [m], and whether a drift is named."""
    data: dict[str, Any] = load_scenario("ur10e_tracker_reference").model_dump()
    data["seed"] = seed
    data["poses"]["reference"] = (*data["poses"]["reference"], *MORE)[:points]
    data["errors"]["drift"] = {"shift_m": drift[0], "turn_rad": drift[1]}
    settings = Scenario.model_validate(data)
    with tempfile.TemporaryDirectory() as folder:
        simulation = simulate_poses(settings, relative_to=Path())
        write_poses(simulation, settings, Path(folder) / "t")
        result = fit_table(read_poses(Path(folder) / "t"))
    error = poses_against_truth(result, simulation.truth).tcp.mean
    return error, bool(result.findings.drifts)


def robots() -> None:
    """Print the table of TCP errors."""
    print("| drift | reference points | TCP error, um | over that without drift | drift named |")
    print("|---|---|---|---|---|")
    still = np.array([mean_error(seed, (0.0, 0.0), 0)[0] for seed in SEEDS])
    print(f"| none | none | {rms(still) * 1e6:.2f} | 1 | |", flush=True)
    for drift in ((0.0, 0.0), *DRIFTS):
        for points in POINTS if any(drift) else POINTS[1:]:
            runs = [mean_error(seed, drift, points) for seed in SEEDS]
            robot = np.array([error for error, _ in runs])
            ratio = robot / still
            print(
                f"| {drift[0] * 1e3:.1f} mm, {drift[1] * 1e3:.1f} mrad | {points} | "
                f"{rms(robot) * 1e6:.2f} | {rms(robot) / rms(still):.2f} ({ratio.min():.2f} to "
                f"{ratio.max():.2f}) | {sum(named for _, named in runs)} of {len(runs)} |",
                flush=True,
            )


def frames() -> None:
    """Print the tables of corrected targets and of knocked points."""
    print("| motion | points | single measurements, um | fit, um | stated, um |")
    print("|---|---|---|---|---|")
    for kind, points in product(MOTIONS, POINTS[1:]):
        single, left, stated = [], [], []
        for seed in SEEDS:
            read = readings(kind, points, seed)
            single.append(errors_of_single_measurements(read, kind, seed))
            apart, deviation = errors(fitted(read), kind, seed)
            left.append(apart)
            stated.append(deviation)
        figures = " | ".join(f"{rms(each) * 1e6:.1f}" for each in (single, left, stated))
        print(f"| {kind} | {points} | {figures} |", flush=True)
    print()
    print("| knocked by | points | named | another named | none named |")
    print("|---|---|---|---|---|")
    for size, points in product((1e-4, 2e-4, 1e-3), (3, 4, 5, 6)):
        right, wrong = 0, 0
        for seed in range(KNOCKS):
            rng, read = np.random.default_rng([seed, 9]), readings("linear", points, seed)
            point, way = int(rng.integers(points)), rng.standard_normal(3)
            read[int(rng.integers(20, 100)) :, point] += size * way / np.linalg.norm(way)
            sigma, elapsed = np.full(read.shape[:2], SIGMA), np.ones(len(read) - 1)
            knocks = fit_with_knocks(read, sigma, elapsed)[1]
            named = {knock.point for knock in knocks}
            right, wrong = right + (named == {point}), wrong + bool(named - {point})
        none = KNOCKS - right - wrong
        print(f"| {size * 1e3:.1f} mm | {points} | {right} | {wrong} | {none} |", flush=True)


if __name__ == "__main__":
    frames() if "--frames" in sys.argv else robots()

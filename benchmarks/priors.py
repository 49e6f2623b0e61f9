"""Errors of poses that were not fitted, for several priors of a DH length and of a DH angle.

    python -m benchmarks.priors --data ../shared/real_robots          # ten minutes of one core

Every prior has the tails of Student's distribution. Measured robots as in benchmarks.real_robots,
from few and from many poses; simulated tables of 30 and 60 points on robots with errors of the
sizes of thesis Table 3.1, a tenth of them, and the first with the zero of axis 3 lost by 20 mrad;
recordings of a ball-bar with every error source on and of measured lengths, with the same sizes.
Writes docs/studies/priors.csv, a row for each set, robot and prior. `covered` is the share of poses
within their stated 95 % regions; `over_stated` the error of a recording's TCP over the workspace
over its stated uncertainty.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd

from ballbar.acquisition.recording import read_recording
from ballbar.cell.chain import Chain
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.poses import PoseTable
from ballbar.ident.estimator import priors
from ballbar.ident.identify import identify_together
from ballbar.ident.recording_fit import Logs
from ballbar.ident.table_fit import fit_table
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.truth.compare import identification_against_truth
from benchmarks import real_robots as real
from benchmarks import real_robots_tables as tables
from benchmarks.study import SCENARIOS, STUDIES, study_parser, write_table
from tests.helpers.still_poses import TrueRobot, angles, table_of, true_robot

PRIORS = ((0.3, 1.0), (0.7, 2.0), (2.0, 3.0), (5.0, 5.0))  # [mm], [mrad]
LENGTH_SIZE, ANGLE_SIZE = 1.1e-3, 0.7e-3  # [m], [rad] root mean squares of thesis Table 3.1
MOTOR_TURNS = 50.0  # about, of a motor of these robots for a turn of its joint
SIZES = {"Table 3.1": (1.0, 0.0), "a tenth": (0.1, 0.0), "zero lost": (1.0, 0.02)}  # share, [rad]
RECORDINGS = ("irb2400_full", "nj220_full", "irb2400_drawwire")

Row = dict[str, object]
Case = tuple[str, str, Callable[[], Row]]  # set, robot, what identifies and judges


def measured(folder: Path, splits: int) -> Iterator[Case]:
    """Measured robots, judged by other poses or other sites than those fitted."""
    grid, series = tables.ur5_grid(folder), tables.ur10_b(folder)
    for seed in range(splits):
        for name, table, counts in (
            ("UR5", grid, (30, 60, 600)),
            ("UR10 B", series, (30, 60, series.size // 2)),
        ):
            for count in counts:
                parts = real.split_by_pose(table, count, seed)
                yield f"{name}, {count}", f"split {seed}", partial(by_poses, *parts)
    for robot in ("panda_3", "panda_6"):
        table = tables.panda(folder, robot)
        sites = real.sites_of(table)
        for site in sites:
            one = real.with_sites(table, [site])
            rest = real.with_sites(table, [s for s in sites if s != site])
            yield f"{robot}, one site", site, partial(by_sockets, one, rest)


def simulated(folder: Path, splits: int) -> Iterator[Case]:
    """Points of a tracker at drawn robots."""
    del folder
    for seed in range(splits):
        for robot in ("ur5", "irb2400", "panda"):
            for size, (share, lost) in SIZES.items():
                true = resized(true_robot(robot, seed=seed), share, lost)
                rest = table_of(true, q=angles(robot, 500, 100 + seed), noise=1e-6)
                for count in (30, 60):
                    fitted = table_of(true, count=count, seed=seed)
                    name = f"tracker, {size}, {count}"
                    yield name, f"{robot} {seed}", partial(by_poses, fitted, rest)


def resized(true: TrueRobot, share: float, lost: float) -> TrueRobot:
    """The robot with errors of the size of Table 3.1 times a share, and axis 3 off by `lost`."""
    nominal, rows = nominal_chain(true.robot), {}
    for field in fields(Chain):
        start = getattr(nominal, field.name)
        drawn = LENGTH_SIZE / 3e-4 if field.name in ("a", "d") else ANGLE_SIZE / 5e-4
        rows[field.name] = start + share * drawn * (getattr(true.chain, field.name) - start)
    rows["theta"][2] += lost
    return replace(true, chain=Chain(**rows))


def recordings(folder: Path, splits: int) -> Iterator[Case]:
    """One recording of each drawn robot."""
    del folder
    for seed in range(1, splits + 1):
        for name in RECORDINGS:
            for size, (share, lost) in SIZES.items():
                base = load_scenario(SCENARIOS / f"{name}.yaml")
                changed = base.model_dump(mode="json", by_alias=True, exclude_none=True)
                changed["errors"]["static"] = {
                    "sigma_m": share * LENGTH_SIZE,
                    "sigma_rad": share * ANGLE_SIZE,
                }
                if lost:
                    changed["errors"]["motor_offsets"] = {"sigma_rad": MOTOR_TURNS * lost}
                changed["seed"] = seed
                scenario = Scenario.model_validate(changed, strict=False)
                yield f"{name}, {size}", str(seed), by_truth(scenario)


def by_poses(fitted: PoseTable, rest: PoseTable) -> Row:
    """Errors of other poses of the same seats."""
    result = fit_table(fitted)
    error = real.norms(result, rest)
    return {"mean_mm": error.mean(), "covered": result.within(rest).mean()}


def by_sockets(fitted: PoseTable, rest: PoseTable) -> Row:
    """Errors at other sites."""
    error, covered = real.judged_sockets(fit_table(fitted), rest)
    return {"mean_mm": error.mean(), "covered": covered}


def by_truth(scenario: Scenario) -> Callable[[], Row]:
    """A function that identifies a recording of the scenario, which is simulated once."""
    simulation = simulate(scenario, relative_to=SCENARIOS)
    with tempfile.TemporaryDirectory() as work:
        write_recording(simulation, scenario, Path(work) / "recording")
        read = read_recording(Path(work) / "recording")
    logs = Logs(read.robot_log, read.ballbar_log, read.force_log, length=read.length_log)

    def judged() -> Row:
        result = identify_together(simulation.cell, [logs])
        error = identification_against_truth(result, simulation.truth).tcp.mean
        over = error / float(result.robot.tcp_sigma.mean())
        return {
            "mean_mm": error * real.MM,
            "over_stated": over,
            "status": str(result.verdict.status),
        }

    return judged


def shown(rows: pd.DataFrame) -> str:
    """Means over the robots of every set and prior; of `over_stated` the root mean square."""
    rows = rows.assign(over_stated=rows["over_stated"] ** 2)
    means = rows.pivot_table(
        index="set", columns="prior", values=["mean_mm", "covered", "over_stated"], sort=False
    )
    means["over_stated"] = np.sqrt(means["over_stated"])
    return str(means.round(4).to_string())


def main() -> None:
    """Writes the rows as they come and prints their means."""
    parser = study_parser(__doc__)
    parser.add_argument("--data", type=Path, default=tables.DATA)
    parser.add_argument("--splits", type=int, default=3)
    options = parser.parse_args()
    rows: list[Row] = []
    for cases in (measured, simulated, recordings):
        for name, robot, judged in cases(options.data, options.splits):
            for length, angle in PRIORS:
                with (
                    patch.object(priors, "LENGTH_PRIOR", 1e-3 * length),
                    patch.object(priors, "ANGLE_PRIOR", 1e-3 * angle),
                ):
                    found = judged()
                prior = f"{length:g} mm, {angle:g} mrad"
                rows.append({"set": name, "robot": robot, "prior": prior, **found})
        columns = ("set", "robot", "prior", "mean_mm", "covered", "over_stated", "status")
        write_table(STUDIES / "priors.csv", rows, ".4g", columns)
    print(shown(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()

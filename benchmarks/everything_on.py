"""Calibration with every error source on: many drawn robots, two paths each, from files to errors.

    python -m benchmarks.everything_on               # 12 IRB 2400, all load signals; ten minutes
    python -m benchmarks.everything_on --robot nj220 --signals torque
    python -m benchmarks.everything_on --robot nj220,irb2400 --first 13 --signals torque --out FILE

Every robot has its own geometry (1 mm, 1 mrad), plate, ball-bar axes, masses, stiffness, backlash,
ripple, one order of it in no list, encoders and gains; its two recordings share all of that. Writes
docs/studies/everything_on_ROBOT_COUNT.csv, or --out, a row for each robot and load signal. `scale
known` is the error without the scale that plate and ball-bar axes leave open. Stated uncertainty is
wrong in both directions: too small (ratio above, intervals below the target) and too large.
`bound_mm` is what it would be by priors and white noise alone, as planning predicts it.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions, ForceSource
from ballbar.ident.result import Identification
from ballbar.sim.truth import Truth
from ballbar.truth.compare import identification_against_truth
from benchmarks.study import STUDIES, study_parser, write_table
from tests.helpers.drawn_robots import recorded, scenario_of
from tests.helpers.stated_uncertainty import stated_uncertainty, white_tcp_sigma

FORCES: dict[str, ForceSource] = {"none": "none", "torque": "torque", "sensor": "sensor"}
ROD_SIGMA = 5e-6  # [m] of a measured rod
COLUMNS = (
    "robot", "seed", "paths", "signal", "status", "tcp_mean_mm", "tcp_max_mm",
    "scale_known_mean_mm", "scale_known_max_mm", "tcp_sigma_mm", "bound_mm", "over_stated",
    "chi2", "autocorrelation", "stiffness_median_percent", "stiffness_worst_percent",
    "clock_us", "skew_ppm", "geometry_covered", "stiffness_covered",
)  # fmt: skip


def robot_rows(
    robot: str, seed: int, signals: tuple[str, ...], duration: float
) -> list[dict[str, object]]:
    """All rows of one robot: both paths with each signal, and of none the first path alone too."""
    with tempfile.TemporaryDirectory() as folder:
        made = [recorded(scenario_of(robot, p, seed, duration), Path(folder) / p) for p in "ab"]
    cell, truth = made[0][0], made[0][2]
    rows = []
    for signal in signals:
        force, _, rod = signal.partition("+")
        logs = [m[1] for m in made]
        stands, rod_sigma = (measured_rod(cell, truth, seed), ROD_SIGMA) if rod else (cell, None)
        options = FitOptions(model="complete", force=FORCES[force], rod_sigma=rod_sigma)
        found = identify_together(stands, logs, options=options)
        rows.append(row(robot, seed, "a+b", signal, found, [m[2] for m in made]))
    if "none" not in signals:
        return rows
    alone = identify_together(
        cell, [made[0][1]], options=FitOptions(model="complete", force="none")
    )
    rows.append(row(robot, seed, "a", "none", alone, [truth]))
    return rows


def measured_rod(cell: Cell, truth: Truth, seed: int) -> Cell:
    """The cell with a rod length that was measured, with its error."""
    d = cell.ballbar.d.copy()
    d[2] = truth.geometry["bd3"] + ROD_SIGMA * np.random.default_rng(seed).standard_normal()
    return replace(cell, ballbar=replace(cell.ballbar, d=d))


def row(
    robot: str, seed: int, paths: str, signal: str, found: Identification, truths: list[Truth]
) -> dict[str, object]:
    """Figures of one fit against the truth."""
    truth = truths[0]
    compared = identification_against_truth(found, truth)
    stiffness = np.array(truth.plant.gear_stiffness_N_m_per_rad)
    elastic = {
        v.name: (v.value, v.sigma)
        for c in found.robot.corrections
        if c.name == "joint_compliance"
        for v in c.coefficients
    }
    share, wide = (
        stiffness * np.array([elastic.get(f"compliance{i + 1}", (0.0, 0.0)) for i in range(6)]).T
    )
    wrong = np.abs(share - 1.0)
    clocks = [
        (abs(f.clock.offset - t.clock.offset_s), abs(f.clock.skew - t.clock.skew))
        for f, t in zip(found.recordings, truths, strict=True)
        if f.clock
    ]
    sigma = np.array([found.sigma[name] for name in compared.deviations])
    inside = np.abs(np.array(list(compared.deviations.values()))) < 1.96 * sigma
    scale_known, stated = compared.tcp.error_without_scale, float(found.robot.tcp_sigma.mean())
    bound = float(white_tcp_sigma(found).mean())
    return dict(
        zip(
            COLUMNS,
            (
                robot, seed, paths, signal, found.verdict.status, compared.tcp.mean * 1e3,
                compared.tcp.maximum * 1e3, float(scale_known.mean()) * 1e3,
                float(scale_known.max()) * 1e3, stated * 1e3, bound * 1e3,
                compared.tcp.mean / stated,
                found.fit.chi2_per_dof, found.fit.autocorrelation, float(np.median(wrong)) * 100,
                float(wrong.max()) * 100, max(c[0] for c in clocks) * 1e6,
                max(c[1] for c in clocks) * 1e6, float(inside.mean()),
                float((wrong < 1.96 * wide).mean()),
            ),
            strict=True,
        )
    )  # fmt: skip


def main() -> None:
    """Draws, identifies, writes the rows and prints medians and worst cases."""
    parser = study_parser(__doc__)
    parser.add_argument("--robot", default="irb2400", help="names, by comma")
    parser.add_argument("--robots", type=int, default=12, help="of each name")
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    parser.add_argument("--signals", default="none,torque,sensor,torque+rod")
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    signals = tuple(options.signals.split(","))
    rows: list[dict[str, object]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        jobs = [
            pool.submit(robot_rows, robot, seed, signals, options.duration)
            for robot in options.robot.split(",")
            for seed in range(options.first, options.first + options.robots)
        ]
        for job in jobs:
            rows += job.result()
            said = (f"{r['paths']} {r['signal']} {r['tcp_mean_mm']:.4f}" for r in job.result())
            print(f"{rows[-1]['robot']} {rows[-1]['seed']}: {', '.join(said)}", flush=True)
    out = options.out or STUDIES / f"everything_on_{options.robot}_{options.robots}.csv"
    write_table(out, rows, ".5g")
    kinds = [(str(r["robot"]), str(r["paths"]), str(r["signal"])) for r in rows]
    for kind in sorted(set(kinds)):
        _say(kind, [row for row, own in zip(rows, kinds, strict=True) if own == kind])


def _say(kind: tuple[str, str, str], rows: list[dict[str, object]]) -> None:
    def column(name: str) -> np.ndarray:
        return np.array([r[name] for r in rows], dtype=float)

    def millimetres(kind: str) -> str:
        mean, largest = column(f"{kind}_mean_mm"), column(f"{kind}_max_mm")
        return (
            f"median robot {np.median(mean):.4f} / {np.median(largest):.4f}, "
            f"worst {mean.max():.4f} / {largest.max():.4f}"
        )

    covered = {kind: column(f"{kind}_covered") for kind in ("geometry", "stiffness")}
    print(
        f"{kind[0]} {kind[1]:4} {kind[2]:12} TCP mean / max [mm]: {millimetres('tcp')}; "
        f"scale known: {millimetres('scale_known')}; "
        f"stated sigma {np.median(column('tcp_sigma_mm')):.4f}, "
        f"of which priors and white noise alone {np.median(column('bound_mm')):.4f}\n"
        f"    {stated_uncertainty(column('over_stated'), covered)}\n"
        f"    stiffness median {np.median(column('stiffness_median_percent')):.1f} %, "
        f"worst {column('stiffness_worst_percent').max():.1f} %; "
        f"clock {np.median(column('clock_us')):.1f} us, "
        f"{np.median(column('skew_ppm')):.2f} ppm"
    )


if __name__ == "__main__":
    main()

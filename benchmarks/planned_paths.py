"""The gain of planning against random paths and a manual one: predicted, and in identifications.

    python -m benchmarks.planned_paths predicted    # 200 random paths that can be run, both robots
    python -m benchmarks.planned_paths identified   # 10 drawn robots, everything on, all paths

Paths: scenarios/paths/ROBOT_planned.yaml; ROBOT_a.yaml, the manual path of the thesis's kind
(notes/plant sec. 10); and of the random ones those in the middle, one for each drawn robot (ranks
96 to 105 of 200), so that no single path stands for the median. Four encoders, 120 s, one recording
a fit, no force or torque signal. Writes docs/studies/planned_paths_random_ROBOT.csv, which holds
the random paths themselves, and planned_paths_identified_ROBOT.csv.
"""

from __future__ import annotations

import csv
import io
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from ballbar.cell.files import write_yaml
from ballbar.cell.geometry import BAR_ROWS
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.planning.candidate import PathCandidate, rounded
from ballbar.planning.coarse import BATCH
from ballbar.planning.crlb import predict
from ballbar.planning.evaluation import Evaluator, check, evaluators, tcp_rms
from ballbar.planning.files import path_data
from ballbar.planning.force import predicted_forces
from ballbar.planning.limits import violations
from ballbar.planning.request import load_request
from ballbar.planning.screen import screen
from ballbar.planning.trajectory import trajectories
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.path_files import load_lissajous
from ballbar.truth.compare import identification_against_truth
from benchmarks.study import in_words, study_parser, write_table
from tests.helpers.drawn_robots import ROOT, SCENARIOS, recorded

ROBOTS = ("irb2400", "nj220")
PATHS = ("planned", "a", "random")
RANDOM = 200
KEYS = ("centre_deg", "amplitude_deg", "cycles", "phase_deg")  # of a path file
STUDIES = ROOT / "docs" / "studies"


def random_paths(robot: str) -> list[dict[str, object]]:
    """RANDOM feasible random paths: predicted TCP sigma, numbers of the path, ball-bar pose."""
    evaluator = _evaluator(robot)
    space, around = evaluator.space, evaluator.request.cell
    rng, paths = np.random.default_rng(evaluator.request.seed + 1000), list[PathCandidate]()
    while len(paths) < RANDOM:
        genomes = rng.random((BATCH, space.size))
        screened = screen(evaluator.cell, around, space, evaluator.limits, genomes)
        some = [space.candidate(genome) for genome in genomes[screened.excess <= 0.0]]
        paths += [rounded(c) for c in some if not check(evaluator, c).violations]
    return [
        {"random_path": k + 1, "tcp_sigma_um": predicted_at(evaluator, path) * 1e6} | _numbers(path)
        for k, path in enumerate(paths[:RANDOM])
    ]


def _numbers(candidate: PathCandidate) -> dict[str, object]:
    """A candidate as columns of a table."""
    data = path_data(candidate)
    columns = {
        f"{key}_b{j + 1}": str(data[key][j])  # type: ignore[index]
        for key in KEYS
        for j in range(BAR_ROWS)
    }
    return columns | {
        f"ballbar_{axis}_m": str(value)
        for axis, value in zip("xyz", candidate.position.tolist(), strict=True)
    }


def middle_path(robot: str, seed: int) -> tuple[dict[str, object], list[float]]:
    """A random path of median rank, off by a few with the seed: path file and base position [m]."""
    with (STUDIES / f"planned_paths_random_{robot}.csv").open() as file:
        rows = sorted(csv.DictReader(file), key=lambda row: float(row["tcp_sigma_um"]))
    row = rows[len(rows) // 2 - 5 + (seed - 1) % 10]
    read = {"cycles": int}
    path = {
        key: [read.get(key, float)(row[f"{key}_b{j + 1}"]) for j in range(BAR_ROWS)] for key in KEYS
    }
    return {"schema": "ballbar-path/1", **path}, [float(row[f"ballbar_{axis}_m"]) for axis in "xyz"]


def predicted_of(robot: str, path: str) -> float:
    """[m] predicted TCP sigma of a path of scenarios/paths in its scenario, limits aside."""
    scenario = _scenario(robot, path)
    shape = load_lissajous(SCENARIOS / scenario.path.file)
    return predicted_at(
        _evaluator(robot), PathCandidate(shape, np.array(scenario.cell.ballbar_position_m))
    )


def predicted_at(evaluator: Evaluator, candidate: PathCandidate) -> float:
    """[m] predicted TCP sigma, median of the robots of ballbar.planning.force."""
    cell, limits = evaluator.cell, evaluator.limits
    trajectory = min(
        trajectories(cell, candidate, evaluator.request.timing),
        key=lambda t: sum(v.excess for v in violations(cell, limits, t)),
    )
    sigmas = [
        tcp_rms(evaluator, predict(evaluator.predictor, trajectory, tension))
        for tension in predicted_forces(evaluator.force_model, trajectory).tension
    ]
    return float(np.median(sigmas))


def identified(robot: str, path: str, seed: int) -> dict[str, object]:
    """TCP error of one drawn robot, identified from one recording of one path."""
    changed = _scenario(robot, path).model_dump(mode="json", by_alias=True, exclude_none=True)
    changed["errors"]["static"] = {"sigma_m": 1e-3, "sigma_rad": 1e-3, "parameters": "thesis"}
    with tempfile.TemporaryDirectory() as folder:
        if path == "random":
            data, changed["cell"]["ballbar_position_m"] = middle_path(robot, seed)
            changed["path"]["file"] = str(Path(folder) / "path.yaml")
            write_yaml(Path(folder) / "path.yaml", data)
        scenario = Scenario.model_validate(changed | {"seed": seed}, strict=False)
        cell, logs, truth = recorded(scenario, Path(folder) / "recording")
    options = FitOptions(model="complete", force="none")
    found = identify_together(cell, [logs], options=options)
    tcp = identification_against_truth(found, truth).tcp
    return {
        "robot": robot, "path": path, "seed": seed, "status": found.verdict.status,
        "tcp_mean_mm": tcp.mean * 1e3, "tcp_max_mm": tcp.maximum * 1e3,
        "tcp_mean_without_scale_mm": float(tcp.error_without_scale.mean()) * 1e3,
        "tcp_sigma_mm": float(found.robot.tcp_sigma.mean()) * 1e3,
        "chi2": found.fit.chi2_per_dof, "autocorrelation": found.fit.autocorrelation,
    }  # fmt: skip


def kept(robot: str, paths: set[str]) -> list[dict[str, object]]:
    """Rows of an earlier run."""
    file = STUDIES / f"planned_paths_identified_{robot}.csv"
    return [
        dict(row) for row in csv.DictReader(io.StringIO(file.read_text())) if row["path"] in paths
    ]


def _evaluator(robot: str) -> Evaluator:
    request = load_request(SCENARIOS / "plans" / f"{robot}.yaml")
    return evaluators(request)[request.cell.ballbar]


def _scenario(robot: str, path: str) -> Scenario:
    return load_scenario(
        SCENARIOS / (f"{robot}_full.yaml" if path == "a" else f"{robot}_planned.yaml")
    )


def main() -> None:
    """Runs one half of the study and prints what it comes to."""
    parser = study_parser(__doc__)
    parser.add_argument("half", choices=("predicted", "identified"))
    parser.add_argument("--robot", choices=ROBOTS, action="append", help="default both")
    parser.add_argument(
        "--path",
        choices=PATHS,
        action="append",
        help="to identify; the rows of the others stay as they are; default all",
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    robots = options.robot or list(ROBOTS)
    with ProcessPoolExecutor(options.workers) as pool:
        if options.half == "predicted":
            for robot, rows in zip(robots, pool.map(random_paths, robots), strict=True):
                _say_predicted(robot, rows)
        else:
            for robot in robots:
                paths = options.path or list(PATHS)
                rows = kept(robot, set(PATHS) - set(paths))
                jobs = [
                    (robot, path, seed) for path in paths for seed in range(1, options.seeds + 1)
                ]
                for row in pool.map(identified, *zip(*jobs, strict=True)):
                    rows.append(row)
                    print(in_words(row), flush=True)
                    write_table(STUDIES / f"planned_paths_identified_{robot}.csv", rows, ".5g")
                _say_identified(robot, rows)


def _say_predicted(robot: str, rows: list[dict[str, object]]) -> None:
    write_table(STUDIES / f"planned_paths_random_{robot}.csv", rows, ".5g")
    figures = [float(str(row["tcp_sigma_um"])) for row in rows]
    planned, hand = (predicted_of(robot, path) * 1e6 for path in ("planned", "a"))
    median, best = float(np.median(figures)), min(figures)
    print(
        f"{robot}: predicted TCP sigma [um rms]: planned {planned:.1f}, "
        f"manual {hand:.1f} ({hand / planned:.2f} times), "
        f"{len(figures)} random ones median {median:.1f} ({median / planned:.2f} times), "
        f"best {best:.1f}",
        flush=True,
    )


def _say_identified(robot: str, rows: list[dict[str, object]]) -> None:
    def column(path: str, name: str) -> np.ndarray:
        return np.array([float(str(row[name])) for row in rows if row["path"] == path])

    for name in ("tcp_mean_mm", "tcp_max_mm", "tcp_mean_without_scale_mm"):
        planned = column("planned", name)
        for rival, words in (("random", "random"), ("a", "by hand")):
            other = column(rival, name)
            print(
                f"{robot} {name}: {words} {other.mean():.4f}, planned {planned.mean():.4f}, "
                f"{other.mean() / planned.mean():.2f} times smaller; "
                f"medians {np.median(other):.4f}, {np.median(planned):.4f}, "
                f"{np.median(other) / np.median(planned):.2f} times "
                f"({planned.size} robots)",
                flush=True,
            )


if __name__ == "__main__":
    main()

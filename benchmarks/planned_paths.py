"""What planning gains: predicted, against random paths and the hand-made one; and confirmed, by identifying simulated recordings.

    python -m benchmarks.planned_paths predicted                # 200 random paths that can be run, both robots: minutes
    python -m benchmarks.planned_paths identified               # 10 drawn robots with everything on, both robots: half an hour

Paths: scenarios/paths/ROBOT_planned.yaml as `ballbar plan scenarios/plans/ROBOT.yaml` found it, and ROBOT_a.yaml, the hand-made path of
the thesis's kind. Four encoders, 120 s, one recording a fit, no force or torque signal. Writes docs/studies/planned_paths_random.csv and
docs/studies/planned_paths_identified.csv.
"""

from __future__ import annotations

import argparse
import csv
import io
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from ballbar.compare import identification_against_truth
from ballbar.scenario import Scenario, load_scenario
from benchmarks.everything_on import ROOT, SCENARIOS, recorded
from cell.files import write_whole
from ident.identify import identify_together
from planning.candidate import Candidate
from planning.course import course_over
from planning.force import predicted_forces
from planning.judge import Judge, judges, tcp_rms
from planning.limits import violations
from planning.predict import predict
from planning.request import load_request
from planning.sample import sampled
from sim.simulate import load_lissajous

ROBOTS = ("irb2400", "nj220")
RANDOM = 200
STUDIES = ROOT / "docs" / "studies"


def random_figures(robot: str) -> list[float]:
    """[m] predicted TCP sigma of RANDOM random paths that can be run."""
    judge = _judge(robot)
    return sampled(judge, seed=judge.request.seed + 1000, seconds=3600.0, wanted=RANDOM).tcp


def predicted_of(robot: str, path: str) -> float:
    """[m] predicted TCP sigma of a path of scenarios/paths, where its scenario puts the ball-bar; limits are not asked about."""
    judge, scenario = _judge(robot), _scenario(robot, path)
    shape = load_lissajous(SCENARIOS / scenario.path.file)
    courses = course_over(judge.cell, Candidate(shape, np.array(scenario.cell.ballbar_position_m)), judge.request.timing)
    course = min(courses, key=lambda c: sum(v.excess for v in violations(judge.cell, judge.limits, c)))
    figures = [tcp_rms(judge, predict(judge.predictor, course, tension)) for tension in predicted_forces(judge.forces, course).tension]
    return float(np.median(figures))


def identified(robot: str, path: str, seed: int) -> dict[str, object]:
    """TCP error of one drawn robot, identified from one recording of one path."""
    asked = _scenario(robot, path).model_dump(mode="json", by_alias=True, exclude_none=True)
    asked["errors"]["static"] = {"sigma_m": 1e-3, "sigma_rad": 1e-3, "parameters": "thesis"}
    scenario = Scenario.model_validate(asked | {"seed": seed}, strict=False)
    with tempfile.TemporaryDirectory() as folder:
        cell, logs, truth = recorded(scenario, Path(folder) / "recording")
    found = identify_together(cell, [logs], model="complete", force="none")[0]
    tcp = identification_against_truth(found, truth).tcp
    return {
        "robot": robot, "path": path, "seed": seed, "status": found.verdict.status, "tcp_mean_mm": tcp.mean * 1e3,
        "tcp_max_mm": tcp.maximum * 1e3, "stated_sigma_mm": float(found.tcp_sigma.mean()) * 1e3,
        "rod_force_min_N": truth.rod_force_min, "rod_force_max_N": truth.rod_force_max,
    }  # fmt: skip


def _judge(robot: str) -> Judge:
    request = load_request(SCENARIOS / "plans" / f"{robot}.yaml")
    return judges(request)[request.cell.ballbar]


def _scenario(robot: str, path: str) -> Scenario:
    return load_scenario(SCENARIOS / (f"{robot}_planned.yaml" if path == "planned" else f"{robot}_full.yaml"))


def main() -> None:
    """Runs one half of the study and prints what it comes to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("half", choices=("predicted", "identified"))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers) as pool:
        if asked.half == "predicted":
            _say_predicted(dict(zip(ROBOTS, pool.map(random_figures, ROBOTS), strict=True)))
        else:
            jobs = [(r, p, s) for r in ROBOTS for s in range(1, asked.seeds + 1) for p in ("a", "planned")]
            rows = []
            for row in pool.map(identified, *zip(*jobs, strict=True)):
                rows.append(row)
                print(", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
            write_whole(STUDIES / "planned_paths_identified.csv", _csv(rows))
            _say_identified(rows)


def _say_predicted(figures: dict[str, list[float]]) -> None:
    rows = [{"robot": robot, "random_path": k + 1, "tcp_sigma_um": f * 1e6} for robot, all_ in figures.items() for k, f in enumerate(all_)]
    write_whole(STUDIES / "planned_paths_random.csv", _csv(rows))
    for robot, all_ in figures.items():
        planned, by_hand = (predicted_of(robot, path) * 1e6 for path in ("planned", "a"))
        median, best = float(np.median(all_)) * 1e6, min(all_) * 1e6
        print(
            f"{robot}: predicted TCP sigma [um rms]: planned {planned:.1f}, by hand {by_hand:.1f} ({by_hand / planned:.2f} times), "
            f"{len(all_)} random ones median {median:.1f} ({median / planned:.2f} times), best {best:.1f}"
        )


def _say_identified(rows: list[dict[str, object]]) -> None:
    for robot in ROBOTS:
        means = {
            p: np.array([float(str(r["tcp_mean_mm"])) for r in rows if r["robot"] == robot and r["path"] == p]) for p in ("a", "planned")
        }
        largest = {p: np.array([float(str(r["tcp_max_mm"])) for r in rows if r["robot"] == robot and r["path"] == p]) for p in means}
        print(
            f"{robot}: TCP error mean over {means['a'].size} robots: by hand {means['a'].mean():.4f}, planned "
            f"{means['planned'].mean():.4f} mm ({means['a'].mean() / means['planned'].mean():.2f} times smaller; medians {np.median(means['a']):.4f}, "
            f"{np.median(means['planned']):.4f}: {np.median(means['a']) / np.median(means['planned']):.2f} times); largest, median robot: "
            f"{np.median(largest['a']):.4f}, {np.median(largest['planned']):.4f} mm"
        )


def _csv(rows: list[dict[str, object]]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows)
    return text.getvalue().encode()


if __name__ == "__main__":
    main()

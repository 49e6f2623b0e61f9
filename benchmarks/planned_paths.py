"""What planning gains: predicted, against random paths and the hand-made one; and confirmed, by identifying simulated recordings.

    python -m benchmarks.planned_paths predicted                # 200 random paths that can be run, both robots: minutes
    python -m benchmarks.planned_paths identified               # 10 drawn robots with everything on, both robots: ten minutes

Paths: scenarios/paths/ROBOT_planned.yaml, and ROBOT_a.yaml, the hand-made path of the thesis's kind (mujoco_facts sec. 10). Four
encoders, 120 s, one recording a fit, no force or torque signal; the hand-made path's fits are those of benchmarks.everything_on, of the
same drawn robots. Writes docs/studies/planned_paths_random_ROBOT.csv and planned_paths_identified_ROBOT.csv.
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


def identified(robot: str, seed: int) -> dict[str, object]:
    """TCP error of one drawn robot, identified from one recording of the planned path."""
    asked = _scenario(robot, "planned").model_dump(mode="json", by_alias=True, exclude_none=True)
    asked["errors"]["static"] = {"sigma_m": 1e-3, "sigma_rad": 1e-3, "parameters": "thesis"}
    scenario = Scenario.model_validate(asked | {"seed": seed}, strict=False)
    with tempfile.TemporaryDirectory() as folder:
        cell, logs, truth = recorded(scenario, Path(folder) / "recording")
    found = identify_together(cell, [logs], model="complete", force="none")[0]
    tcp = identification_against_truth(found, truth).tcp
    return {
        "robot": robot, "path": "planned", "seed": seed, "status": found.verdict.status, "tcp_mean_mm": tcp.mean * 1e3,
        "tcp_max_mm": tcp.maximum * 1e3, "tcp_sigma_mm": float(found.tcp_sigma.mean()) * 1e3,
    }  # fmt: skip


def by_hand(robot: str, seeds: int) -> list[dict[str, object]]:
    """The same robots identified from the hand-made path alone, as benchmarks.everything_on left them."""
    columns = ("robot", "seed", "status", "tcp_mean_mm", "tcp_max_mm", "tcp_sigma_mm")
    with (STUDIES / f"everything_on_{robot}.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["paths"] == "a" and row["signal"] == "none" and int(row["seed"]) <= seeds]
    return [{"robot": row["robot"], "path": "a"} | {c: row[c] for c in columns[1:]} for row in rows]


def _judge(robot: str) -> Judge:
    request = load_request(SCENARIOS / "plans" / f"{robot}.yaml")
    return judges(request)[request.cell.ballbar]


def _scenario(robot: str, path: str) -> Scenario:
    return load_scenario(SCENARIOS / (f"{robot}_planned.yaml" if path == "planned" else f"{robot}_full.yaml"))


def main() -> None:
    """Runs one half of the study and prints what it comes to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("half", choices=("predicted", "identified"))
    parser.add_argument("--robot", choices=ROBOTS, action="append", help="default both")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    robots = asked.robot or list(ROBOTS)
    with ProcessPoolExecutor(asked.workers) as pool:
        if asked.half == "predicted":
            for robot, figures in zip(robots, pool.map(random_figures, robots), strict=True):
                _say_predicted(robot, figures)
        else:
            for robot in robots:
                rows = by_hand(robot, asked.seeds)
                for row in pool.map(identified, [robot] * asked.seeds, range(1, asked.seeds + 1)):
                    rows.append(row)
                    print(", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
                    write_whole(STUDIES / f"planned_paths_identified_{robot}.csv", _csv(rows))
                _say_identified(robot, rows)


def _say_predicted(robot: str, figures: list[float]) -> None:
    rows = [{"random_path": k + 1, "tcp_sigma_um": figure * 1e6} for k, figure in enumerate(figures)]
    write_whole(STUDIES / f"planned_paths_random_{robot}.csv", _csv(rows))
    planned, hand = (predicted_of(robot, path) * 1e6 for path in ("planned", "a"))
    median, best = float(np.median(figures)) * 1e6, min(figures) * 1e6
    print(
        f"{robot}: predicted TCP sigma [um rms]: planned {planned:.1f}, by hand {hand:.1f} ({hand / planned:.2f} times), "
        f"{len(figures)} random ones median {median:.1f} ({median / planned:.2f} times), best {best:.1f}",
        flush=True,
    )


def _say_identified(robot: str, rows: list[dict[str, object]]) -> None:
    def column(path: str, name: str) -> np.ndarray:
        return np.array([float(str(row[name])) for row in rows if row["path"] == path])

    for name in ("tcp_mean_mm", "tcp_max_mm"):
        hand, planned = column("a", name), column("planned", name)
        print(
            f"{robot} {name}: by hand {hand.mean():.4f}, planned {planned.mean():.4f}, {hand.mean() / planned.mean():.2f} times smaller; "
            f"medians {np.median(hand):.4f}, {np.median(planned):.4f}, {np.median(hand) / np.median(planned):.2f} times "
            f"({planned.size} robots)",
            flush=True,
        )


def _csv(rows: list[dict[str, object]]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows)
    return text.getvalue().encode()


if __name__ == "__main__":
    main()

"""The gain of `ballbar plan --after`: the second path of drawn robots, three ways.

    python -m benchmarks.paths_after                 # 10 IRB 2400, half an hour on two cores
    python -m benchmarks.paths_after --first planned

Each robot has everything on (tests/helpers/drawn_robots.py), and motor torque. It is identified
from its first path: that of irb2400_full.yaml (manual), or the best path of a search (planned).
Then a second one is recorded, and both are identified together: (after) planned from that result,
as `ballbar plan --after` does with scenarios/plans/irb2400.yaml; (alone) the best path of the same
search without the result, which after a planned path is that path once more; (random) one of the
random paths of median rank, another for each robot (docs/studies/planned_paths_random_irb2400.csv).
Writes docs/studies/paths_after_FIRST.csv, a row for each robot and kind of second path, `none`
without one.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.cell.files import write_yaml
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.evaluation import evaluators
from ballbar.planning.files import path_data
from ballbar.planning.known import Known, known_of
from ballbar.planning.plan import PathPlan, assess, plans
from ballbar.planning.request import PlanRequest, load_request
from ballbar.scenario import Scenario
from ballbar.sim.path_files import load_lissajous
from ballbar.sim.truth import Truth
from ballbar.truth.compare import identification_against_truth
from benchmarks.planned_paths import middle_path
from benchmarks.study import STUDIES, in_words, study_parser, write_table
from tests.helpers.drawn_robots import SCENARIOS, recorded, scenario_of

ROBOT = "irb2400"
FIRST = ("manual", "planned")
KINDS = ("none", "after", "alone", "random")
OPTIONS = FitOptions(model="complete", force="torque")
LONGEST = 600.0  # [s] of a search, which its evaluations end


def planned(request: PlanRequest, evaluations: int, known: Known | None) -> PathPlan:
    """The best path of a search; known : from results of the machine."""
    begun = time.monotonic()
    return next(
        plans(
            request,
            relative_to=SCENARIOS / "plans",
            workers=os.cpu_count() or 1,
            seconds=LONGEST,
            evaluations=evaluations,
            since=lambda: time.monotonic() - begun,
            known=known,
        )
    )


def along(
    scenario: Scenario, folder: Path, path: dict[str, object], position: list[float]
) -> tuple[Cell, Logs, Truth]:
    """A recording along another path, with the ball-bar at a position [m]."""
    data = scenario.model_dump(mode="json", by_alias=True, exclude_none=True)
    folder.mkdir()
    write_yaml(folder / "path.yaml", path)
    data["path"]["file"], data["cell"]["ballbar_position_m"] = str(folder / "path.yaml"), position
    return recorded(Scenario.model_validate(data, strict=False), folder / "recording")


def of_plan(plan: PathPlan) -> tuple[dict[str, object], list[float]]:
    """Path file and base position [m] of the ball-bar."""
    candidate = plan.evaluation.candidate
    return path_data(candidate), candidate.position.tolist()


def robot_rows(
    seed: int, duration: float, evaluations: int, alone: PathPlan, first_path: str
) -> Iterator[dict[str, object]]:
    """The rows of one robot."""
    one, two = (scenario_of(ROBOT, path, seed, duration) for path in "ab")  # recordings 1 and 2
    request = load_request(SCENARIOS / "plans" / f"{ROBOT}.yaml")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if first_path == "planned":
            cell, first, truth = along(one, folder / "first", *of_plan(alone))
        else:
            cell, first, truth = recorded(one, folder / "first")
        found = identify_together(cell, [first], options=OPTIONS)
        yield row(seed, "none", found, truth, None)
        known = known_of([found.machine])
        after, (evaluator,) = (
            planned(request, evaluations, known),
            evaluators(request, known).values(),
        )
        seconds = {
            "after": of_plan(after),
            "alone": of_plan(alone),
            "random": middle_path(ROBOT, seed),
        }
        for kind, (path, position) in seconds.items():
            _, logs, _ = along(two, folder / kind, path, position)
            shape = load_lissajous(folder / kind / "path.yaml")
            plan = assess(evaluator, PathCandidate(shape, np.array(position)))
            found = identify_together(cell, [first, logs], options=OPTIONS)
            yield row(seed, kind, found, truth, plan)


def row(
    seed: int, kind: str, found: Identification, truth: Truth, plan: PathPlan | None
) -> dict[str, object]:
    """Figures of one identification against the truth."""
    tcp = identification_against_truth(found, truth).tcp
    return {
        "robot": ROBOT, "seed": seed, "second": kind, "status": found.verdict.status,
        "tcp_mean_mm": tcp.mean * 1e3, "tcp_max_mm": tcp.maximum * 1e3,
        "tcp_mean_without_scale_mm": float(tcp.error_without_scale.mean()) * 1e3,
        "tcp_max_without_scale_mm": float(tcp.error_without_scale.max()) * 1e3,
        "tcp_sigma_mm": float(found.robot.tcp_sigma.mean()) * 1e3,
        "sigma_without_scale_mm": float(found.robot.tcp.without_scale.mean()) * 1e3,
        "predicted_without_scale_mm": "" if plan is None else float(np.median(plan.tcp)) * 1e3,
    }  # fmt: skip


def main() -> None:
    """Draws, plans, identifies, writes the rows and prints what they come to."""
    parser = study_parser(__doc__)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--first", choices=FIRST, default=FIRST[0])
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--evaluations", type=int, default=20_000, help="of each search")
    options = parser.parse_args()
    request = load_request(SCENARIOS / "plans" / f"{ROBOT}.yaml")
    alone = planned(request, options.evaluations, None)
    rows: list[dict[str, object]] = []
    arguments = options.duration, options.evaluations, alone, options.first
    for seed in range(1, options.robots + 1):
        for found in robot_rows(seed, *arguments):
            rows.append(found)
            print(in_words(found), flush=True)
            write_table(STUDIES / f"paths_after_{options.first}.csv", rows, ".5g")
    say(rows)


def say(rows: list[dict[str, object]]) -> None:
    """Prints medians over the robots, and how many times the others are of `after`."""
    for name in ("tcp_mean_mm", "tcp_max_mm", "tcp_mean_without_scale_mm", "tcp_sigma_mm"):
        by_kind = {
            kind: np.array([float(str(r[name])) for r in rows if r["second"] == kind])
            for kind in KINDS
        }
        after = by_kind["after"]
        print(
            f"{name}: "
            + "; ".join(
                f"{kind} {np.median(v):.4f} (mean {v.mean():.4f}), "
                f"{np.median(v) / np.median(after):.2f} times ({v.mean() / after.mean():.2f})"
                for kind, v in by_kind.items()
            )
        )


if __name__ == "__main__":
    main()

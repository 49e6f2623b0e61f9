"""Plans of still poses against random ones: predicted, and on robots with drawn errors.

    python -m benchmarks.pose_plans

For each robot and instrument: the predicted mean TCP error of ten random sets (median) and of the
plan, and the geometric mean over five drawn robots of the real error after identification from
random poses (median of five sets) over that from the plan. Once with smooth joint errors that the
identification does not fit, once without.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ballbar.ident.options import FitOptions
from ballbar.ident.table_fit import fit_table
from ballbar.planning.feasible_poses import Candidates, random_candidates
from ballbar.planning.pose_plan import PosePlan, pose_plan
from ballbar.planning.pose_request import POSE_SCHEMA, PosePlanRequest
from ballbar.planning.stations import setup_of
from tests.helpers.measured_plans import RIPPLE, DrawnRobot, drawn_robot

ROBOTS, SETS = 5, 5
REFLECTOR = {"position_m": [0.05, 0.0, 0.1], "axis": [1, 0, 0], "cone_deg": 60}
TRACKER = {"seats": [{"position_m": [3.0, 0.0, 0.5]}], "targets": [REFLECTOR], "poses": 40}
POINTS = {"instrument": "tracker_point", **TRACKER}
ABOVE = {"axis": [0, 0, 1], "cone_deg": 80}
SOCKETS = (("a", 0.45, 0.0), ("b", 0.45, 0.05), ("c", 0.3, 0.4), ("d", 0.35, 0.4))


def requests() -> Iterator[PosePlanRequest]:
    """The requests that are planned."""
    cases: list[dict[str, object]] = [
        {"robot": name, **POINTS} for name in ("irb2400", "irb1600", "irb120", "ur5", "panda")
    ]
    cases.append({"robot": "irb2400", "instrument": "tracker_pose", **TRACKER})
    wires = [{"name": n, "position_m": [1.5, y, 0.1]} for n, y in (("left", 0.8), ("right", -0.8))]
    hook = [{"position_m": [0.05, 0.0, 0.1]}]
    of_wire = {"instrument": "drawwire_2m", "seats": wires, "targets": hook}
    cases.append({"robot": "irb2400", **of_wire, "poses": 60})
    bars = [
        {"name": "a", "position_m": [0.7, 0.2, 0.4]},
        {"name": "b", "position_m": [0.7, -0.3, 0.8]},
    ]
    ball = [{"position_m": [0.0, 0.0, 0.15]}]
    of_bar = {"instrument": "qc20w_300", "seats": bars, "targets": ball}
    cases.append({"robot": "irb1600", **of_bar, "poses": 60})
    holes = [{"name": n, "position_m": [x, y, 0.1], **ABOVE} for n, x, y in SOCKETS]
    pairs = [{"pairs": [["a", "b"], ["c", "d"]]}]
    of_sockets = {"instrument": "socket_pair_50", "seats": holes, "targets": ball}
    cases.append({"robot": "panda", **of_sockets, "distances": pairs, "poses": 60})
    for case in cases:
        text = json.dumps({"schema": f"{POSE_SCHEMA}/1", "name": "case", **case})
        yield PosePlanRequest.model_validate_json(text)


def real_gain(plan: PosePlan, ripple: float) -> float:
    """Error from random poses over that from the plan, geometric mean over drawn robots."""
    setup, count = plan.setup, plan.poses.size
    rng = np.random.default_rng(setup.request.seed)
    candidates = random_candidates(setup, setup.request.candidates, rng)
    ratios = []
    for seed in range(ROBOTS):
        rng = np.random.default_rng(100 + seed)
        robot = drawn_robot(setup, rng, ripple=ripple)
        sets = [candidates.part(rng.permutation(candidates.size)[:count]) for _ in range(SETS)]
        random = np.median([_error(robot, poses, rng) for poses in sets])
        ratios.append(random / _error(robot, plan.poses, rng))
    return float(np.exp(np.mean(np.log(ratios))))


def _error(robot: DrawnRobot, poses: Candidates, rng: np.random.Generator) -> float:
    result = fit_table(robot.measured(poses, rng), FitOptions(joint_errors="none"))
    return robot.error_of(result.identified_robot()).mean


if __name__ == "__main__":
    columns = ("robot, instrument", "poses", "random [um]", "plan [um]", "gain", "real gain")
    print(f"| {' | '.join((*columns, 'without joint errors', 'search [s]'))} |")
    print("|---|---|---|---|---|---|---|---|")
    for request in requests():
        setup = setup_of(request, relative_to=Path())
        begin = time.monotonic()
        plan = pose_plan(setup, seconds=100.0, since=lambda begin=begin: time.monotonic() - begin)
        cells = (
            f"{request.robot}, {request.instrument}",
            f"{request.poses}",
            f"{np.median(plan.random) * 1e6:.0f}",
            f"{plan.prediction.tcp_sigma.mean() * 1e6:.0f}",
            f"{plan.gain:.2f}",
            f"{real_gain(plan, RIPPLE):.2f}",
            f"{real_gain(plan, 0.0):.2f}",
            f"{plan.seconds:.0f}",
        )
        print(f"| {' | '.join(cells)} |", flush=True)

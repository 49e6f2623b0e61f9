"""Files of a plan of still poses: the table, poses.yaml, programs and predicted numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.files import DESCRIPTIONS, write_whole, write_yaml
from planning.export import SUFFIXES, program_files, without_program
from planning.files import REQUEST
from planning.pose_plan import PosePlan
from planning.pose_programs import krl_poses, pdl2_poses, pose_table, poses_data, rapid_poses
from planning.pose_request import PosePlanRequest

TABLE, DESCRIPTION, NUMBERS = "poses.csv", "poses.yaml", "plan.yaml"
PROGRAMS = {"rapid": rapid_poses, "pdl2": pdl2_poses, "krl": krl_poses}


def output_names(request: PosePlanRequest) -> set[str]:
    """Names of all files that a plan may write."""
    return {TABLE, DESCRIPTION, NUMBERS, REQUEST, DESCRIPTIONS, *program_files(request.name)}


def numbers_data(plan: PosePlan) -> dict[str, object]:
    """All predictions of the plan in SI units."""
    setup, layout = plan.setup, plan.information.layout
    sigma = np.sqrt(np.diag(plan.information.covariance(plan.rows)))
    priors = zip(layout.names, layout.sigma.tolist(), sigma.tolist(), strict=True)
    return {
        "schema": "ballbar-pose-plan-result/1",
        "name": setup.request.name,
        "robot": setup.request.robot,
        "instrument": setup.request.instrument,
        "poses": plan.poses.size,
        "tcp_sigma_m": {
            "mean": float(plan.sigma.mean()),
            "largest": float(plan.sigma.max()),
            "catalogue_mean": float(plan.information.catalogue_sigma().mean()),
            "random_mean_median": float(np.median(plan.random)),
            "random_mean_best": float(plan.random.min()),
        },
        "axes_not_covered": list(plan.narrow),
        "moves": {
            "seconds_at_top_speed": round(plan.route.seconds, 1),
            "over_intermediate_poses": [k + 1 for k in plan.route.passing],
            "too_close": [k + 1 for k in plan.route.blocked],
            "out_of_stroke": [k + 1 for k in plan.route.released],
        },
        "search": {"seconds": round(plan.seconds, 1), "seed": setup.request.seed},
        "sigma": {name: {"prior": p, "predicted": s} for name, p, s in priors},
    }


def write_pose_plan(plan: PosePlan, folder: Path, *, relative_to: Path) -> list[str]:
    """Write all files; relative_to : folder of the request. Returns their names."""
    setup, name = plan.setup, plan.setup.request.name
    texts = {TABLE: pose_table(plan)}
    language = setup.robot.program_language
    if language and not without_program(setup.robot):
        texts[f"{name}.{SUFFIXES[language]}"] = PROGRAMS[language](plan)
    for file, text in texts.items():
        write_whole(folder / file, text.encode())
    description = poses_data(setup, TABLE, relative_to=relative_to, folder=folder)
    write_yaml(folder / DESCRIPTION, description)
    write_yaml(folder / NUMBERS, numbers_data(plan))
    return [*texts, DESCRIPTION, NUMBERS]

"""Files of a plan: path or poses, scenario, predicted numbers, and programs of the controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ballbar.cell.closed_form import has_closed_form
from ballbar.cell.extended_yaml import load_extended, portable
from ballbar.cell.files import DESCRIPTIONS, portable_name, write_whole, write_yaml
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.instruments.base import Kind
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.planning import programs
from ballbar.planning.candidate import DECIMALS, PathCandidate
from ballbar.planning.crlb import PredictedInformation
from ballbar.planning.evaluation import OF_CLOSED_FORM, OF_OTHER_ARMS
from ballbar.planning.plan import PathPlan
from ballbar.planning.planned_scenario import PATH, scenario_data
from ballbar.planning.pose_plan import PosePlan
from ballbar.planning.pose_request import PosePlanRequest
from ballbar.planning.request import OF_BALLBARS, REQUESTS, PlanRequest
from ballbar.planning.stations import PoseSetup
from ballbar.planning.trajectory import Targets, targets_of

SCENARIO, NUMBERS, TABLE, REQUEST = "scenario.yaml", "plan.yaml", "path.csv", "request.yaml"
POSE_TABLE, POSES, JOINTS = "poses.csv", "poses.yaml", "joints.csv"
PICTURES = ("plan.svg", "what_if.svg", "plate.svg")
UNITS = {"m": "mm", "rad": "deg"}  # of the columns of poses.csv that are filled in


def output_names(request: PlanRequest | PosePlanRequest) -> set[str]:
    """Names of all files that a plan may write."""
    names = {
        NUMBERS,
        REQUEST,
        DESCRIPTIONS,
        *(f"{request.name}.{end}" for end in programs.SUFFIXES.values()),
    }
    if isinstance(request, PosePlanRequest):
        return names | {POSE_TABLE, POSES, JOINTS}
    return names | {PATH, SCENARIO, TABLE, "what_if.csv", *PICTURES}


def path_data(candidate: PathCandidate) -> dict[str, object]:
    """A path file of schema ballbar-path/1, for the first configuration that keeps the ranges."""
    shape = candidate.shape
    rod = [
        {"amplitude_m": h.amplitude, "cycles": h.cycles, "phase_deg": float(np.degrees(h.phase))}
        for h in shape.rod
    ]
    return {
        "schema": "ballbar-path/1",
        "centre_deg": np.degrees(shape.centre).round(DECIMALS).tolist(),
        "amplitude_deg": np.degrees(shape.amplitude).round(DECIMALS).tolist(),
        "cycles": shape.cycles.astype(int).tolist(),
        "phase_deg": np.degrees(shape.phase).round(DECIMALS).tolist(),
        "ballbar_position_m": candidate.position.tolist(),
        **({"rod": rod} if rod else {}),
    }


def planned_path_data(plan: PathPlan) -> dict[str, object]:
    """The path file of a plan, in the configuration of the arm that was planned."""
    first = joints_to_axes(plan.evaluator.cell.robot, plan.trajectory.q[0])
    return {
        **path_data(plan.evaluation.candidate),
        "first_axes_deg": np.degrees(first).round(DECIMALS).tolist(),
    }


def cell_data(plan: PathPlan, folder: Path) -> dict[str, object]:
    """The cell of the plan, as a scenario in a folder states it.

    Files of one's own are copied into the folder.
    """
    rod = "instrument" if plan.request.telescoping else "ballbar"
    names = {"robot": plan.request.cell.robot, rod: plan.rod, "plate": plan.request.cell.plate}
    return {
        **{k: portable_name(n, k, relative_to=Path(), folder=folder) for k, n in names.items()},
        "ballbar_position_m": plan.evaluation.candidate.position.tolist(),
    }


def numbers_data(plan: PathPlan, targets: Targets, cell: dict[str, object]) -> dict[str, object]:
    """All predictions of the plan in SI units; cell : as the scenario names it."""
    typical, request = plan.typical, plan.request
    closed = has_closed_form(nominal_chain(plan.evaluator.cell.robot))
    excluded = set(OF_OTHER_ARMS if closed else OF_CLOSED_FORM)
    if request.telescoping:
        excluded |= set(OF_BALLBARS["limits"])
    return {
        "schema": "ballbar-plan-result/1",
        "name": request.name,
        "cell": cell,
        "tcp_sigma_m": {
            "rms_median_robot": float(np.median(plan.tcp)),
            "rms_worst_robot": float(plan.tcp.max()),
            **tcp_data(typical),
            "scale_adds": plan.scale_adds,
        }
        | ({} if (before := plan.tcp_before) is None else {"by_results_before": before}),
        "observability": plan.indices(),
        "sphere_covered": plan.coverage,
        **_rod_data(plan),
        "sag_between_targets_m": targets.sag,
        "search": {
            "evaluated": plan.evaluated,
            "seconds": round(plan.seconds, 1),
            "seed": request.seed,
            "stopped": plan.stopped,
        },
        "limits": request.limits.model_dump(exclude=excluded),
        "sigma": sigma_data(typical),
    }


def tcp_data(prediction: PredictedInformation) -> dict[str, float]:
    """[m] mean and largest predicted TCP sigma over the workspace."""
    sigma = prediction.tcp_sigma
    return {"mean": float(sigma.mean()), "largest": float(sigma.max())}


def sigma_data(prediction: PredictedInformation) -> dict[str, object]:
    """[SI] standard deviation of each unknown, before and as predicted."""
    prior = prediction.prior
    return {n: {"prior": prior[n], "predicted": value} for n, value in prediction.sigma.items()}


def _rod_data(plan: PathPlan) -> dict[str, object]:
    """Expected force in the rod of a ball-bar, or length of a telescoping bar."""
    data: dict[str, object] = {}
    if plan.forces is not None:
        data["load_sign_changes"] = [int(n) for n in plan.reversals]
        data["rod_force_N"] = list(plan.forces.interval)
        if keys := plan.evaluator.typical.keys:
            data["typical"] = list(keys)  # keys of the robot's file
    if plan.lengths is not None:
        length = plan.lengths.length
        data["length_m"] = {
            "expected": [float(length.min()), float(length.max())],
            "stroke": list(plan.lengths.stroke),
            "robots": len(length),
            "robots_that_leave_the_stroke": plan.lengths.leaving,
        }
        data["length_sigma_m"] = plan.request.sensors.length_sigma_m
    return data


def limit_lines(plan: PathPlan) -> list[str]:
    """The limits that a program's header states."""
    limit, free = plan.request.limits, plan.gauge != programs.BALLBAR
    return [
        f"Planned within: {limit.axis_margin_deg:g} deg inside each axis range, "
        f"{limit.axis_speed_share:.0%} of axis speed, tool {limit.tcp_speed_m_per_s:g} m/s, "
        f"{'' if free else f'rod force {limit.force_N:g} N on soft servo, '}"
        f"clearance {limit.clearance_m * 1e3:g} mm."
        f"{' The bar must not leave its stroke.' if plan.gauge == programs.TELESCOPING else ''}"
    ]


def write_request(file: Path, folder: Path, *, overrides: Sequence[str]) -> None:
    """Writes request.yaml: the request that is planned, complete and without `extends`.

    overrides : texts `KEY=VALUE` that replace values of the file.
    """
    data = load_extended(file, REQUESTS, overrides=overrides).data
    write_yaml(folder / REQUEST, portable(data, REQUESTS, file.parent, folder, folder))


def write_plan(plan: PathPlan, folder: Path) -> list[str]:
    """Write all files but the pictures. Returns their names.

    A program is in the language of the robot's controller, where `without_program` is empty.
    """
    robot, request = plan.evaluator.cell.robot, plan.request
    targets = targets_of(plan.evaluator.cell, plan.trajectory, request.timing)
    path = programs.ProgrammedPath(request.name, robot, targets, limit_lines(plan), plan.gauge)
    cell = cell_data(plan, folder)
    write_yaml(folder / PATH, planned_path_data(plan))
    write_yaml(folder / SCENARIO, scenario_data(plan, cell))
    texts = {TABLE: programs.path_table(path)}
    if robot.program_language and not programs.without_program(robot):
        texts[f"{path.name}.{programs.SUFFIXES[robot.program_language]}"] = programs.path_program(
            robot.program_language, path
        )
    for file, text in texts.items():
        write_whole(folder / file, text.encode())
    write_yaml(folder / NUMBERS, numbers_data(plan, targets, cell))
    return [PATH, SCENARIO, *texts, NUMBERS]


def value_columns(kind: Kind) -> list[str]:
    """Columns of poses.csv that are filled in, with their units."""
    return [f"{n}_{UNITS[unit]}" for n, unit in zip(kind.names, kind.units, strict=True)]


def poses_data(setup: PoseSetup, *, relative_to: Path, folder: Path) -> dict[str, object]:
    """poses.yaml of the filled table; folder : where it stands, relative_to : the request's.

    Files of one's own are copied into the folder.
    """
    request, kind = setup.request, setup.instrument.kind
    entry: dict[str, object] = {
        "files": [POSE_TABLE],
        "joints": {"columns": programs.axis_columns(setup.robot), "unit": "deg", "angles": "axes"},
    }
    if columns := value_columns(kind):
        entry["values"] = {
            "columns": columns,
            **({"unit": UNITS["m"]} if "m" in kind.units else {}),
            **({"angle_unit": UNITS["rad"]} if "rad" in kind.units else {}),
            **({"rotation": "XYZ"} if kind.target_turns else {}),
        }
    entry |= {"seat": {"column": "seat"}, "target": {"column": "target"}}
    data: dict[str, object] = {
        "schema": "ballbar-poses/1",
        "kind": "real",
        "robot": portable_name(request.robot, "robot", relative_to=relative_to, folder=folder),
        "instrument": portable_name(
            request.instrument, "instrument", relative_to=relative_to, folder=folder
        ),
        "tables": [entry],
    }
    if request.distances:
        data["distances"] = [
            d.model_dump(mode="json", exclude_none=True) for d in request.distances
        ]
    data["notes"] = (
        "Planned poses. Fill in what was measured, and replace the angles by those that the "
        "controller showed. Rows without values are left out."
    )
    return data


def pose_numbers_data(plan: PosePlan) -> dict[str, object]:
    """All predictions of the plan in SI units."""
    setup = plan.setup
    return {
        "schema": "ballbar-pose-plan-result/1",
        "name": setup.request.name,
        "robot": setup.request.robot,
        "instrument": setup.request.instrument,
        "poses": plan.poses.size,
        "tcp_sigma_m": {
            **tcp_data(plan.prediction),
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
        "sigma": sigma_data(plan.prediction),
    }


def write_pose_plan(plan: PosePlan, folder: Path, *, relative_to: Path) -> list[str]:
    """Write all files; relative_to : folder of the request. Returns their names.

    Of pictures the table names them; what they show comes from `ballbar camera detect`.
    """
    setup, language = plan.setup, plan.setup.robot.program_language
    if setup.request.board is None:
        texts = {POSE_TABLE: programs.pose_table(plan, value_columns(setup.instrument.kind))}
        write_yaml(folder / POSES, poses_data(setup, relative_to=relative_to, folder=folder))
    else:
        texts = {JOINTS: programs.picture_table(plan)}
    if language and not programs.without_program(setup.robot):
        texts[f"{setup.request.name}.{programs.SUFFIXES[language]}"] = programs.pose_program(
            language, plan
        )
    for file, text in texts.items():
        write_whole(folder / file, text.encode())
    write_yaml(folder / NUMBERS, pose_numbers_data(plan))
    return [*texts, *([POSES] if POSE_TABLE in texts else []), NUMBERS]

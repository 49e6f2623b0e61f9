"""Files of a plan: path file, scenario, predicted numbers, and programs of the controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cell.closed_form import has_closed_form
from cell.descriptions import Key, Robot
from cell.extended_yaml import load_extended, portable
from cell.files import DESCRIPTIONS, portable_name, write_whole, write_yaml
from cell.geometry import nominal_chain
from cell.robot_angles import joints_to_axes
from planning.candidate import DECIMALS, PathCandidate
from planning.evaluation import OF_CLOSED_FORM, OF_OTHER_ARMS
from planning.export import BALLBAR, SUFFIXES, TELESCOPING, pdl2, rapid, table, without_program
from planning.force import ERROR
from planning.krl import krl
from planning.plan import PathPlan
from planning.request import OF_BALLBARS, REQUESTS, PlanRequest
from planning.stroke import Lengths
from planning.targets import Targets, targets_of
from sim.plant.mjcf import ROBOT_JOINTS

PATH, SCENARIO, NUMBERS, TABLE = "path.yaml", "scenario.yaml", "plan.yaml", "path.csv"
REQUEST = "request.yaml"
PICTURES = ("plan.svg", "what_if.svg", "plate.svg")
OUTPUTS = frozenset(
    {PATH, SCENARIO, NUMBERS, TABLE, REQUEST, "what_if.csv", *PICTURES, DESCRIPTIONS}
)
PROGRAMS = {"rapid": rapid, "pdl2": pdl2, "krl": krl}
PLANT_AXES = len(ROBOT_JOINTS)
PLANT_KEYS: tuple[Key, ...] = ("links", "servo", "gears", "rotor_inertia_kg_m2")
# All error sources of a real cell, as in scenarios/irb2400_full.yaml, where none is by table.
EVERYTHING_ON: dict[str, object] = {
    "static": {"sigma_m": 1e-3, "sigma_rad": 1e-3, "parameters": "robot"},
    "joint_compliance": {"spread": 0.3},
    "gear_backlash": {"spread": 0.3},
    "joint_noise": {"sigma_rad": 2e-6},
    "ballbar_axes": {"parameters": "all"},
    **{
        name: {}
        for name in (
            "transmission_error",
            "unlisted_ripple",
            "gear_friction",
            "resolver_error",
            "rod_strain",
            "rod_backlash",
            "bar_friction",
            "plate_bending",
            "base_compliance",
            "masses",
            "payload",
            "base_tilt",
            "plate_length",
            "motor_offsets",
            "joint_lag",
            "mounting_eccentricity",
            "encoder_eccentricity",
            "subdivisional_error",
            "signal_noise",
            "frozen_bits",
        )
    },
}
TWO_CLOCKS: dict[str, object] = {  # likewise
    "offset_s": 0.508,
    "skew": 5.0e-5,
    "overrun_probability": 0.005,
    **{
        name: {} for name in ("wander", "robot_wander", "jitter", "dropped_rows", "duplicated_rows")
    },
}


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


def scenario_data(plan: PathPlan, cell: dict[str, object]) -> dict[str, object]:
    """A scenario that runs the path with all error sources of a ball-bar; cell : its content."""
    request, sensors = plan.request, plan.request.sensors
    common = {
        "name": f"{request.name}_planned",
        "cell": cell,
        "path": {"kind": "lissajous", "file": PATH, **request.timing.model_dump()},
        "seed": request.seed,
    }
    if plan.lengths is not None:
        return common | length_data(plan.lengths, plan.evaluator.cell.robot)
    return {
        **common,
        "plant": {"servo": request.servo},
        "errors": EVERYTHING_ON,
        "encoders": {
            "fitted": list(sensors.encoders),
            "bits": 12,
            "noise_sigma_rad": sensors.encoder_noise_sigma_rad,
        },
        "clocks": TWO_CLOCKS,
    }


def length_data(lengths: Lengths, robot: Robot) -> dict[str, object]:
    """Plant and errors with which a telescoping bar is simulated: those that its stroke takes.

    They are of an elastic robot in MuJoCo, as in scenarios/irb2400_telescoping.yaml, or of a rigid
    one where its file lacks what MuJoCo needs.
    """
    size = float(f"{min(ERROR, lengths.scale * ERROR):.1g}")
    errors: dict[str, object] = {
        "static": {"sigma_m": size, "sigma_rad": size},
        "joint_noise": {"sigma_rad": 5e-6},
    }
    dynamic = robot.joints == PLANT_AXES and not any(robot.lacks(key) for key in PLANT_KEYS)
    if dynamic:
        errors["joint_compliance"] = {}
    return {
        "plant": {"kind": "mujoco", "servo": "stiff"} if dynamic else {"kind": "kinematic"},
        "errors": errors,
        "length": {"rate_hz": 100},
        "clocks": {"offset_s": 0.137, "skew": 5.0e-5},
    }


def cell_data(plan: PathPlan, folder: Path) -> dict[str, object]:
    """The cell of the plan, as a scenario in a folder states it.

    Files of one's own are copied into the folder.
    """
    held = "instrument" if plan.request.telescoping else "ballbar"
    names = {"robot": plan.request.cell.robot, held: plan.rod, "plate": plan.request.cell.plate}
    return {
        **{k: portable_name(n, k, relative_to=Path(), folder=folder) for k, n in names.items()},
        "ballbar_position_m": plan.evaluation.candidate.position.tolist(),
    }


def numbers_data(plan: PathPlan, targets: Targets, cell: dict[str, object]) -> dict[str, object]:
    """All predictions of the plan in SI units; cell : as the scenario names it."""
    typical = plan.typical
    priors = dict(zip(typical.layout.names, typical.layout.sigma.tolist(), strict=True))
    return {
        "schema": "ballbar-plan-result/1",
        "name": plan.request.name,
        "cell": cell,
        "tcp_sigma_m": {
            "rms_median_robot": float(np.median(plan.tcp)),
            "rms_worst_robot": float(plan.tcp.max()),
            "mean": float(typical.tcp_sigma.mean()),
            "largest": float(typical.tcp_sigma.max()),
            "scale_adds": plan.scale_adds,
        }
        | ({} if (before := plan.tcp_before) is None else {"by_results_before": before}),
        "observability": plan.indices(),
        "sphere_covered": plan.coverage,
        **_held_data(plan),
        "sag_between_targets_m": targets.sag,
        "search": {
            "evaluated": plan.evaluated,
            "seconds": round(plan.seconds, 1),
            "seed": plan.request.seed,
            "stopped": plan.stopped,
        },
        "limits": limits_data(plan),
        "sigma": {
            n: {"prior": float(priors[n]), "predicted": value} for n, value in typical.sigma.items()
        },
    }


def _held_data(plan: PathPlan) -> dict[str, object]:
    """What is expected along the rod: force of a ball-bar, or length of a telescoping bar."""
    out: dict[str, object] = {}
    if plan.forces is not None:
        tension = plan.forces.tension
        out["load_sign_changes"] = [int(n) for n in plan.reversals]
        out["rod_force_N"] = [float(tension.min()), float(tension.max())]
    if plan.lengths is not None:
        length = plan.lengths.length
        out["length_m"] = {
            "expected": [float(length.min()), float(length.max())],
            "stroke": list(plan.lengths.stroke),
            "robots": len(length),
            "robots_that_leave_the_stroke": plan.lengths.leaving,
        }
        out["length_sigma_m"] = plan.request.sensors.length_sigma_m
    return out


def limits_data(plan: PathPlan) -> dict[str, object]:
    """The limits of a request that apply to its robot and its instrument."""
    closed = has_closed_form(nominal_chain(plan.evaluator.cell.robot))
    other = set(OF_OTHER_ARMS if closed else OF_CLOSED_FORM)
    if plan.request.telescoping:
        other |= set(OF_BALLBARS["limits"])
    return plan.request.limits.model_dump(exclude=other)


def limit_lines(request: PlanRequest) -> list[str]:
    """The limits that a program's header states."""
    limit = request.limits
    if request.telescoping:
        return [
            f"Planned within: {limit.axis_margin_deg:g} deg inside each axis range, "
            f"{limit.axis_speed_share:.0%} of axis speed, tool {limit.tcp_speed_m_per_s:g} m/s, "
            f"clearance {limit.clearance_m * 1e3:g} mm. The bar must not leave its stroke."
        ]
    return [
        f"Planned within: {limit.axis_margin_deg:g} deg inside each axis range, "
        f"{limit.axis_speed_share:.0%} of axis speed, tool {limit.tcp_speed_m_per_s:g} m/s, "
        f"rod force {limit.force_N:g} N on soft servo, clearance {limit.clearance_m * 1e3:g} mm."
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
    gauge = TELESCOPING if request.telescoping else BALLBAR
    targets = targets_of(plan.evaluator.cell, plan.trajectory, request.timing)
    name, limits = request.name, limit_lines(request)
    cell = cell_data(plan, folder)
    write_yaml(folder / PATH, planned_path_data(plan))
    write_yaml(folder / SCENARIO, scenario_data(plan, cell))
    texts = {TABLE: table}
    if robot.program_language and not without_program(robot):
        texts[f"{name}.{SUFFIXES[robot.program_language]}"] = PROGRAMS[robot.program_language]
    for file, write in texts.items():
        write_whole(folder / file, write(name, robot, targets, limits, gauge).encode())
    write_yaml(folder / NUMBERS, numbers_data(plan, targets, cell))
    return [PATH, SCENARIO, *texts, NUMBERS]

"""Scenario that runs a planned path: plant, errors, encoders and clocks of a real cell."""

from __future__ import annotations

from ballbar.cell.descriptions import Robot
from ballbar.cell.typical_machine import KEYS
from ballbar.planning.followed_path import RATE
from ballbar.planning.force import ERROR, Lengths
from ballbar.planning.plan import PathPlan

PATH = "path.yaml"  # of the plan, beside the scenario
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
TWO_CLOCKS: dict[str, object] = {  # of a real cell too
    "offset_s": 0.508,
    "skew": 5.0e-5,
    "overrun_probability": 0.005,
    **{
        name: {} for name in ("wander", "robot_wander", "jitter", "dropped_rows", "duplicated_rows")
    },
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
    if request.telescoping:
        return common | length_data(plan.lengths, plan.evaluator.cell.robot)
    plant: dict[str, object] = {"servo": request.servo}
    if plan.evaluator.typical.keys:
        plant["typical_spread"] = 1.0
        common["cell"] = {**cell, "ballbar_set": "without_strain"}
    return {
        **common,
        "plant": plant,
        "errors": EVERYTHING_ON,
        "encoders": {
            "fitted": list(sensors.encoders),
            "bits": 12,
            "noise_sigma_rad": sensors.encoder_noise_sigma_rad,
        },
        "clocks": TWO_CLOCKS,
    }


def length_data(lengths: Lengths | None, robot: Robot) -> dict[str, object]:
    """Plant and errors with which a telescoping bar is simulated: those that its stroke takes.

    lengths : None where an instrument follows the robot. They are of an elastic robot in MuJoCo, as
    in scenarios/irb2400_telescoping.yaml, or of a rigid one where its file lacks what MuJoCo needs.
    """
    scale = 1.0 if lengths is None else lengths.scale
    size = float(f"{min(ERROR, scale * ERROR):.1g}")
    errors: dict[str, object] = {
        "static": {"sigma_m": size, "sigma_rad": size},
        "joint_noise": {"sigma_rad": 5e-6},
    }
    dynamic = not any(robot.lacks(key) for key in KEYS)
    if dynamic:
        errors["joint_compliance"] = {}
    clock = {"offset_s": 0.137, "skew": 5.0e-5}
    logged: dict[str, object] = {"length": {"rate_hz": 100}, "clocks": clock}
    if lengths is None:
        logged = {"logs": {"tracker": {"rate_hz": RATE, **clock}}}
    return {
        "plant": {"kind": "mujoco", "servo": "stiff"} if dynamic else {"kind": "kinematic"},
        "errors": errors,
        **logged,
    }

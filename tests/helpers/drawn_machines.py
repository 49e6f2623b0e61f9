"""Machines with drawn geometry and ripple on the kinematic plant, and recordings of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_geometry
from ballbar.cell.load import load_cell
from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.cell.robot_angles import joints_to_motors, motors_to_joints
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Machine
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.errors.sensor_effects import ResolverEffects, encoder_effects, resolver_effects
from ballbar.sim.errors.static_errors import true_geometry
from ballbar.sim.path import reference_path
from ballbar.sim.path_files import load_lissajous
from ballbar.sim.plant.effects import PlantEffects, plant_effects
from ballbar.sim.plant.kinematic_plant import run_kinematic
from tests.helpers.drawn_robots import DRAWN, SCENARIOS

OPTIONS = FitOptions(model="complete", corrections=("gear_ripple", "encoder_harmonics"))
ENCODERS = (1, 2, 4, 5)
NOISE = 1e-5  # [rad] of every row
ROW = 0.01  # [s]
PLACED, TILTED = 3e-3, 1e-3  # [m], [rad] standard deviations of the ball-bar's base


@dataclass(frozen=True, eq=False)
class Truth:
    """One drawn robot and ball-bar."""

    cell: Cell
    geometry: Geometry
    effects: PlantEffects
    resolvers: ResolverEffects
    scenario: Scenario


def drawn(seed: int) -> Truth:
    """A robot of the scenario irb2400_full without forces."""
    base = load_scenario(SCENARIOS / "irb2400_full.yaml")
    data = base.model_dump(mode="json", by_alias=True, exclude_none=True)
    kept = (
        "transmission_error", "unlisted_ripple", "resolver_error", "ballbar_axes", "plate_length",
        "motor_offsets", "encoder_eccentricity", "mounting_eccentricity", "subdivisional_error",
    )  # fmt: skip
    data["errors"] = {"static": DRAWN} | {key: data["errors"][key] for key in kept}
    data |= {"seed": seed, "logs": {}, "plant": {"kind": "kinematic"}}
    data["accept"] = {}
    scenario = Scenario.model_validate(data, strict=False)
    chosen, errors = scenario.cell, scenario.errors
    cell = load_cell(chosen.robot, chosen.ballbar, chosen.plate)
    nominal = nominal_geometry(cell, np.array(chosen.ballbar_position_m))
    geometry = true_geometry(nominal, errors, cell, seed=seed)
    resolvers = resolver_effects(errors.resolver_error, joints=cell.robot.joints, seed=seed)
    assert resolvers is not None
    return Truth(cell, geometry, plant_effects(errors, cell, seed), resolvers, scenario)


def recorded(truth: Truth, path: str, duration: float, rng: np.random.Generator) -> Logs:
    """Logs of one path, the ball-bar's base placed and its encoders mounted again."""
    cell, true = truth.cell, truth.geometry
    place = {name: true[name] + PLACED * rng.standard_normal() for name in ("ox", "oy", "oz")}
    place |= {name: TILTED * rng.standard_normal() for name in ("otx", "oty")}
    geometry = true.replaced(place)
    shape = load_lissajous(SCENARIOS / "paths" / f"irb2400_{path}.yaml")
    nominal = nominal_geometry(cell, true.origin)
    followed = reference_path(
        cell.robot, nominal, shape, duration=duration, dwell=2.0, stops=0, step=ROW
    )
    motion = run_kinematic(cell.robot, geometry, truth.effects, followed)
    motors = truth.resolvers.read_angles(joints_to_motors(cell.robot, motion.shown))
    q = motors_to_joints(cell.robot, motors)
    robot = RobotLog(motion.t, q + NOISE * rng.standard_normal(q.shape))
    clock = Clock(float(rng.uniform(0.2, 1.0)), float(rng.uniform(-5e-5, 5e-5)))
    rows = motion.t >= clock.offset
    t = clock.ballbar_time(motion.t[rows])
    angles = []
    for joint in ENCODERS:
        lines = cell.ballbar.encoder_lines
        effects = encoder_effects(
            truth.scenario.errors, joint, lines=lines, bits=12, seed=truth.scenario.seed
        )
        b = effects.read_angle(motion.b[rows, joint - 1], t)
        angles.append(b + rng.uniform(-np.pi, np.pi) + NOISE * rng.standard_normal(t.size))
    return Logs(robot, BallBarLog(t, np.column_stack(angles), ENCODERS), name=path)


def identified(truth: Truth) -> Machine:
    """The robot identified from 120 s of path a."""
    rng = np.random.default_rng([truth.scenario.seed, 0])
    logs = recorded(truth, "a", 120.0, rng)
    return identify_together(truth.cell, [logs], options=OPTIONS).machine

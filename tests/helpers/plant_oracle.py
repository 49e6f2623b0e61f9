"""Held poses in MuJoCo against the statics oracle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry
from sim.path import ReferencePath
from sim.plant.deflection import deflect
from sim.plant.effects import PlantEffects
from sim.plant.mjcf import plant_model
from sim.plant.mujoco_plant import PlantRun, roll_out, state_at_rest
from sim.plant.statics import rest

HOLD, TIMESTEP = 4.0, 1e-3  # [s]
CELLS = {
    "irb2400": ("lund_600", (0.70, 0.0, 0.54), "irb2400_a"),
    "nj220": ("lund_900", (1.5, 0.0, 0.7), "nj220_a"),
}
EFFECTS: dict[str, dict[str, object]] = {
    "rigid": {},
    "joint_compliance": {"joint_compliance": {}},
    "gear_backlash": {"joint_compliance": {}, "gear_backlash": {}},
    "transmission_error": {"transmission_error": {}},
    "cycloid_ripple": {"cycloid_ripple": {}},
    "sinusoidal_gear_error": {"sinusoidal_gear_error": {"side": "input"}},
    "rod_strain": {"rod_strain": {}},
    "rod_backlash": {"rod_backlash": {}},
    "plate_bending": {"plate_bending": {}},
    "base_compliance": {"base_compliance": {}},
}
EFFECTS["everything"] = {
    name: value for effect in list(EFFECTS.values()) for name, value in effect.items()
}


@dataclass(frozen=True)
class Deviation:
    """MuJoCo against the oracle at one held pose."""

    link_angle: float  # [rad] largest of the six joints
    end_point: float  # [m]
    rod_force: float  # [N]
    in_backlash: bool  # whether a dead band is not taken up: the rest is then not unique


def held_against_oracle(
    cell: Cell, true: Geometry, effects: PlantEffects, path: ReferencePath, k: int
) -> Deviation:
    """Sample k of the path, held."""
    gains = cell.robot.servo["soft"]
    command = path.q[k] @ cell.robot.joint_to_gear
    oracle = rest(cell, true, effects, gains, command, path.q[k], path.b[k])
    plant = plant_model(cell, true, effects, gains, timestep=TIMESTEP)
    commands = np.repeat(command[None], round(HOLD / TIMESTEP), axis=0)
    x = roll_out(PlantRun(plant, state_at_rest(cell.robot, plant, oracle), commands, TIMESTEP))[0][
        -1, 1:
    ]
    q = x[plant.joints]
    plate, base = float(x[plant.plate].sum()), x[plant.base] if plant.base.size else np.zeros(3)
    stretch = float(x[plant.rod])
    there = _end(true, q, x[plant.bar], stretch, plate, base)
    force = effects.rod_stiffness * (
        stretch - np.clip(stretch, -effects.rod_backlash, effects.rod_backlash)
    )
    return Deviation(
        link_angle=float(np.abs(q - oracle.q).max()),
        end_point=float(
            np.linalg.norm(
                there - _end(true, oracle.q, oracle.b, oracle.stretch, oracle.plate, oracle.base)
            )
        ),
        rod_force=abs(float(force) - oracle.rod_force),
        in_backlash=oracle.in_backlash,
    )


def _end(
    geometry: Geometry, q: Array, b: Array, stretch: float, plate: float, base: Array
) -> Array:
    ends = deflect(
        geometry,
        q[None],
        b[None],
        stretch=np.array([stretch]),
        plate=np.array([plate]),
        base=base[None],
    )
    return np.asarray(ends.tool[:, 0])

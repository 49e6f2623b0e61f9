"""Held poses in MuJoCo against the statics oracle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.sim.motion import deflect
from ballbar.sim.path import ReferencePath
from ballbar.sim.plant.effects import Plant
from ballbar.sim.plant.mjcf import plant_model
from ballbar.sim.plant.mujoco_plant import PlantRun, equilibrium_state, roll_out
from ballbar.sim.plant.statics import equilibrium

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
    "unlisted_ripple": {"unlisted_ripple": {}},
}
EFFECTS["everything"] = {
    name: value for effect in list(EFFECTS.values()) for name, value in effect.items()
}
EFFECTS["masses"] = {"joint_compliance": {}, "masses": {}}  # another machine, no other effect


@dataclass(frozen=True)
class Deviation:
    """MuJoCo against the oracle at one held pose."""

    link_angle: float  # [rad] largest of the six joints
    end_point: float  # [m]
    rod_force: float  # [N]
    in_backlash: bool  # whether a dead band is not taken up: the rest is then not unique


def held_against_oracle(plant: Plant, path: ReferencePath, k: int) -> Deviation:
    """Deviation at sample k of the path, held for HOLD seconds."""
    true, effects = plant.geometry, plant.effects
    command = path.q[k] @ plant.cell.robot.joint_to_gear
    oracle = equilibrium(plant, command, path.q[k], path.b[k])
    compiled = plant_model(plant, timestep=TIMESTEP)
    start = equilibrium_state(plant, compiled, oracle)
    commands = np.repeat(command[None], round(HOLD / TIMESTEP), axis=0)
    x = roll_out(PlantRun(plant, compiled, start, commands, TIMESTEP))[0][-1, 1:]
    q = x[compiled.joints]
    plate = float(x[compiled.plate].sum())
    base = x[compiled.base] if compiled.base.size else np.zeros(3)
    stretch = float(x[compiled.rod[0]])
    there = _end(true, q, x[compiled.bar], stretch, plate, base)
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

"""Held poses in MuJoCo against the statics oracle: every effect alone and all together, both robots.

    python -m benchmarks.plant_oracle

Each pose starts at the oracle's equilibrium and is held for four seconds; what it drifts away by then is the disagreement.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cell.chain import Array
from cell.geometry import Geometry, nominal_geometry
from cell.load import load_cell
from sim.errors.plant_errors import PlantErrors
from sim.errors.static_errors import THESIS_3_1
from sim.path import ReferencePath, reference_path
from sim.path_files import load_lissajous
from sim.plant.deflection import deflect
from sim.plant.description import Plant
from sim.plant.effects import plant_effects
from sim.plant.mjcf import plant_model
from sim.plant.mujoco_plant import PlantRun, equilibrium_state, roll_out
from sim.plant.statics import equilibrium

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
    in_backlash: bool  # whether a dead band is not taken up: the equilibrium is then not unique


def held_against_oracle(plant: Plant, path: ReferencePath, k: int) -> Deviation:
    """Sample k of the path, held."""
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
    stretch = float(x[compiled.rod])
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


def main() -> None:
    """Prints the largest deviation of twenty poses for each robot and effect."""
    scenarios = Path(__file__).parent.parent / "scenarios"
    print(
        f"{'robot':8} {'effect':22} {'link angle urad':>15} {'end point um':>13} {'rod force N':>12} {'in play':>8}"
    )
    for robot, (bar, position, path_name) in CELLS.items():
        cell = load_cell(robot, bar, "plate_250")
        nominal = nominal_geometry(cell, np.array(position))
        true = nominal.replaced(
            {name: nominal[name] + value * 1e-3 for name, value in THESIS_3_1.items()}
        )
        shape = load_lissajous(scenarios / "paths" / f"{path_name}.yaml")
        path = reference_path(
            cell.robot, nominal, shape, duration=120.0, dwell=4.0, stops=2, step=0.01
        )
        for name, asked in EFFECTS.items():
            effects = plant_effects(PlantErrors.model_validate(asked), cell, seed=1)
            plant = Plant(cell, true, effects, cell.robot.servo["soft"])
            poses = [
                held_against_oracle(plant, path, k) for k in np.linspace(300, 11700, 20).astype(int)
            ]
            worst = [
                max(getattr(p, field) for p in poses)
                for field in ("link_angle", "end_point", "rod_force")
            ]
            print(
                f"{robot:8} {name:22} {worst[0] * 1e6:15.3f} {worst[1] * 1e6:13.3f} {worst[2]:12.4f} {sum(p.in_backlash for p in poses):8d}"
            )


if __name__ == "__main__":
    main()

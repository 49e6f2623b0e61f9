"""Held poses in MuJoCo against the statics oracle, each effect alone and all together.

    python -m benchmarks.plant_oracle

Each pose starts at the oracle's rest and is held for four seconds; what it drifts away by then is
the disagreement.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_cell
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.errors.static_errors import THESIS_3_1
from ballbar.sim.path import reference_path
from ballbar.sim.path_files import load_lissajous
from ballbar.sim.plant.effects import Plant, plant_effects
from tests.helpers.plant_oracle import CELLS, EFFECTS, held_against_oracle


def main() -> None:
    """Prints the largest deviation of twenty poses for each robot and effect."""
    scenarios = Path(__file__).parent.parent / "scenarios"
    print(
        f"{'robot':8} {'effect':22} {'link angle urad':>15} {'end point um':>13} "
        f"{'rod force N':>12} {'in backlash':>11}"
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
        for name, keys in EFFECTS.items():
            effects = plant_effects(PlantErrors.model_validate(keys), cell, seed=1)
            plant = Plant(cell, true, effects, cell.robot.servo["soft"])
            poses = [
                held_against_oracle(plant, path, k) for k in np.linspace(300, 11700, 20).astype(int)
            ]
            worst = [
                max(getattr(p, field) for p in poses)
                for field in ("link_angle", "end_point", "rod_force")
            ]
            print(
                f"{robot:8} {name:22} {worst[0] * 1e6:15.3f} {worst[1] * 1e6:13.3f} "
                f"{worst[2]:12.4f} {sum(p.in_backlash for p in poses):11d}"
            )


if __name__ == "__main__":
    main()

"""The MuJoCo plant of seven axes, of a robot whose file states no masses, gears or servo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_cell
from ballbar.cell.typical_machine import with_typical
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.path import Lissajous, ReferencePath, reference_path
from ballbar.sim.plant.effects import Plant, plant_effects
from ballbar.sim.plant.mujoco_plant import run_plant
from tests.helpers.plant_oracle import EFFECTS, held_against_oracle
from tests.helpers.simulated_recordings import perturbed

# first path of `ballbar plan` for the robot, an iiwa 14, alone
CENTRE, AMPLITUDE = (128.54, -77.23, -33.5, -140.75, 25.22), (10.83, 5.82, 9.95, 3.77, 6.81)
CYCLES, PHASE = (4.0, 4.0, 1.0, 1.0, 2.0), (210.72, 306.58, 322.49, 72.71, 176.29)
POSITION = (0.384, -0.109, 0.185)


def machine(effect: str, duration: float) -> tuple[Plant, ReferencePath]:
    cell = load_cell("iiwa14", "lund_600", "plate_250")
    cell = replace(cell, robot=with_typical(cell.robot)[0])
    nominal = nominal_geometry(cell, np.array(POSITION))
    numbers = (np.radians(CENTRE), np.radians(AMPLITUDE), np.array(CYCLES), np.radians(PHASE))
    path = reference_path(
        cell.robot, nominal, Lissajous(*numbers), duration=duration, dwell=1.0, stops=0, step=0.01
    )
    effects = plant_effects(PlantErrors.model_validate(EFFECTS[effect]), cell, seed=1)
    true = perturbed(nominal, np.random.default_rng(4))
    return Plant(cell, true, effects, cell.robot.required("servo")["soft"]), path


@pytest.mark.parametrize("effect", ["rigid", "everything"])
def test_held_poses_of_seven_axes_settle_where_the_statics_oracle_says(effect: str) -> None:
    """The oracle shares no code with MuJoCo."""
    plant, path = machine(effect, 60.0)
    for k in (1000, 4000):
        deviation = held_against_oracle(plant, path, k)
        assert deviation.rod_force < 0.02
        if not deviation.in_backlash:
            assert deviation.link_angle < 1e-6  # soft gears: ten times that of an IRB 2400's


def test_a_loop_of_seven_axes_stays_closed_as_it_moves() -> None:
    plant, path = machine("everything", 12.0)
    motion = run_plant(plant, path, timestep=1e-3)
    position, angle = motion.closure()
    assert motion.q.shape[1] == 7
    assert max(position.max(), angle.max()) < 0.5e-6

"""The true robot of a scenario, free of ball-bar and instrument, at joint targets.

The dynamic plant holds them in MuJoCo under the robot's own weight (sim.plant.held_poses); the
kinematic plant has no forces, so motors stand at their targets and gears err by their ripple.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.arrays import Array
from cell.chain import Frames
from cell.geometry import Geometry, nominal_geometry, robot_frames
from cell.inverse import pose_error
from sim.errors.sensor_effects import resolver_effects
from sim.errors.static_errors import true_geometry
from sim.plant.description import Plant, servo_gains
from sim.plant.effects import plant_effects
from sim.plant.held_poses import HeldPoses, hold_poses
from sim.scenario_cell import scenario_cell
from sim.settings import SimulationSettings


class HeldRobot:
    """The robot that every recording of a scenario's machine is of."""

    def __init__(self, settings: SimulationSettings, *, relative_to: Path) -> None:
        """relative_to : folder of the scenario, for the files that it names."""
        chosen, errors, seed = settings.cell, settings.errors, settings.seed
        self.cell = scenario_cell(chosen, relative_to=relative_to)
        self.nominal: Geometry = nominal_geometry(self.cell, np.array(chosen.ballbar_position_m))
        self.true: Geometry = true_geometry(
            self.nominal,
            errors,
            plate_sigma=self.cell.plate.length_sigma,
            transmission=self.cell.robot.transmission,
            seed=seed,
        )
        self.effects = plant_effects(errors, self.cell, seed)
        self.resolvers = resolver_effects(
            errors.resolver_error, joints=self.cell.robot.joints, seed=seed
        )
        self._dynamic = settings.plant.kind == "mujoco"

    def hold(self, targets: Array) -> HeldPoses:
        """Targets (N, J) [rad] held. Raises PlantError when the simulation diverges."""
        robot = self.cell.robot
        if self._dynamic:
            gains = servo_gains(robot, "stiff")
            plant = Plant(self.cell, self.true, self.effects, gains)
            return hold_poses(plant, targets, resolvers=self.resolvers)
        joints = self.effects.gear_outputs(targets @ robot.joint_to_gear) @ robot.gear_to_joint
        still = np.zeros_like(targets)
        tool = robot_frames(self.true, joints).poses()
        return HeldPoses(tool, joints, still, still[:, 0])


def pose_distance(wanted: Frames, held: HeldPoses) -> tuple[Array, Array]:
    """(N,) [m] and (N,) [rad] from the wanted to the held pose."""
    error = pose_error(held.tool[:, :3, :3].transpose(1, 2, 0), held.tool[:, :3, 3].T, wanted)
    return np.linalg.norm(error[:3], axis=0), np.linalg.norm(error[3:], axis=0)

"""The kinematic plant: the true mechanism follows the path without forces (thesis sec. 3.1, steps 1-4).

The ball-bar takes the path's angles, the robot follows by exact inverse kinematics of its true geometry; gears turn with
their harmonic errors, nothing gives way.
"""

from __future__ import annotations

import numpy as np

from cell.descriptions import Robot
from cell.errors import InputError
from cell.geometry import Geometry, bar_frames
from cell.inverse import refine
from sim.motion import Motion
from sim.path import ReferencePath
from sim.plant.effects import PlantEffects
from sim.settings import SimulationSettings

WITH_FORCES = (
    "joint_compliance",
    "gear_backlash",
    "gear_friction",
    "rod_strain",
    "rod_backlash",
    "bar_friction",
    "plate_bending",
    "base_compliance",
)


def refuse_forces(settings: SimulationSettings) -> None:
    """Raises InputError when a path, an error source or a log needs forces, which this plant has not."""
    asked = ["path.kind = push_pull"] * (settings.path.kind == "push_pull")
    asked += [
        f"errors.{name}" for name in WITH_FORCES if getattr(settings.errors, name) is not None
    ]
    asked += [
        f"logs.{name}"
        for name in ("torque", "force_sensor")
        if getattr(settings.logs, name) is not None
    ]
    if asked:
        raise InputError(
            f"{asked[0]}: needs forces, and plant.kind = kinematic has none. Use plant.kind = mujoco, or leave it out."
        )


def run_kinematic(
    robot: Robot, geometry: Geometry, effects: PlantEffects, path: ReferencePath
) -> Motion:
    """Motion of a rigid, force-free mechanism. Raises UnreachableError near a singularity of the robot."""
    q = refine(geometry.robot, path.q, bar_frames(geometry, path.b).poses())
    gears = q @ robot.joint_to_gear
    shown = (gears - effects.transmission_error(gears)) @ robot.gear_to_joint
    rigid = np.zeros(path.t.size)
    return Motion(path.t, q, shown, path.b, rigid, rigid, geometry)

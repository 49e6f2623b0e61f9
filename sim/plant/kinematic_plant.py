"""Kinematic plant: the true mechanism follows the path without forces (thesis sec. 3.1, steps 1-4).

The ball-bar takes the path's angles and the robot follows by exact inverse kinematics of its true
geometry. Gears have their harmonic errors; nothing is elastic.
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
    "masses",
    "payload",
)


def refuse_forces(settings: SimulationSettings) -> None:
    """Raise InputError when a path, an error source or a log requires forces."""
    stated = ["path.kind = push_pull"] * (settings.path.kind == "push_pull")
    stated += [f"errors.{name}" for name in WITH_FORCES if getattr(settings.errors, name)]
    stated += [
        f"logs.{name}" for name in ("torque", "force_sensor") if getattr(settings.logs, name)
    ]
    if stated:
        raise InputError(
            f"{stated[0]}: needs forces, and plant.kind = kinematic has none. "
            "Use plant.kind = mujoco, or leave it out."
        )


def run_kinematic(
    robot: Robot, geometry: Geometry, effects: PlantEffects, path: ReferencePath
) -> Motion:
    """Motion of a rigid mechanism without forces.

    Raises UnreachableError near a singularity of the robot.
    """
    q = refine(geometry.robot, path.q, bar_frames(geometry, path.b).poses())
    gears = q @ robot.joint_to_gear
    shown = (gears - effects.transmission_error(gears)) @ robot.gear_to_joint
    rigid = np.zeros(path.t.size)
    return Motion(
        t=path.t, q=q, shown=shown, b=path.b, rod_stretch=rigid, rod_force=rigid, geometry=geometry
    )

"""The free robot in MuJoCo, told joint targets and holding them: where does its tool really stand?

A position controller with integral action brings the motors' readings to the targets. Here the servo is proportional, so its
command is moved by what the readings miss, hold after hold, until none is left; what the gears, the resolvers and the robot's
weight do behind the readings stays. Each pose starts with gears in the middle of their play; the weight presses them to a side.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry
from cell.robot_angles import joints_to_motors, motors_to_joints
from sim.errors.sensor_effects import ResolverEffects
from sim.plant.effects import PlantEffects
from sim.plant.mjcf import ROBOT_JOINTS, ROTORS, free_robot_spec
from sim.plant.mujoco_plant import PlantError
from sim.plant.statics import gravity_torque

TIMESTEP = 1e-3  # [s]
HOLDS = (
    1.0,
    0.5,
    0.5,
    0.5,
)  # [s] the arm's slowest oscillation dies away by a factor of a thousand in the first
BATCH = 25  # poses a rollout call: 100 MB of states
_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """N targets as the plant held them."""

    tool: Array  # (N, 4, 4) T_base_tool
    joints: Array  # (N, 6) [rad] of the links
    miss: Array  # (N, 6) [rad] readings less targets, as joint angles: what the controller did not bring to rest
    drift: Array  # (N,) [m/s] speed of the tool at the end


def hold_poses(
    cell: Cell,
    geometry: Geometry,
    effects: PlantEffects,
    targets: Array,
    *,
    resolvers: ResolverEffects | None = None,
    servo: str = "stiff",
) -> HeldPoses:
    """Poses of the true robot at targets (N, 6) [rad, DH joint angles as the controller reads them].

    geometry : true kinematic parameters. servo : a gain set of the robot's description.

    Raises PlantError when the simulation diverges.
    """
    gains = cell.robot.servo[servo]
    model = free_robot_spec(cell, geometry, effects, gains, timestep=TIMESTEP).compile()
    model.site_sameframe[:] = (
        0  # MuJoCo takes a site within 1e-6 of its body frame for identical (notes/mujoco sec. 7.1)
    )
    parts = [
        _held(model, cell, geometry, effects, targets[k : k + BATCH], resolvers, gains.kp)
        for k in range(0, len(targets), BATCH)
    ]
    return HeldPoses(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("tool", "joints", "miss", "drift")
        )
    )


def _held(
    model: mujoco.MjModel,
    cell: Cell,
    geometry: Geometry,
    effects: PlantEffects,
    targets: Array,
    resolvers: ResolverEffects | None,
    kp: Array,
) -> HeldPoses:
    robot, data = cell.robot, mujoco.MjData(model)
    links = [int(model.joint(name).qposadr[0]) for name in ROBOT_JOINTS]
    elastic = effects.gear_stiffness is not None
    outputs = [int(model.joint(name).qposadr[0]) for name in ROTORS] if elastic else []
    wanted = targets @ robot.joint_to_gear
    weight = gravity_torque(cell, geometry, targets) @ robot.gear_to_joint.T
    command = wanted + weight / kp
    positions = np.zeros((len(targets), model.nq))
    positions[:, links] = targets
    positions[:, outputs] = wanted + effects.transmission_error(wanted) if elastic else 0.0
    states = np.stack([_state(model, data, x) for x in positions])
    for seconds in HOLDS:
        steps = round(seconds / TIMESTEP)
        control = np.repeat(command[:, None], steps, axis=1)
        states = rollout.rollout(model, data, states, control)[0][:, -1]
        if not np.isfinite(states).all():
            raise PlantError("simulation of held poses diverged; a softer servo may help")
        x = states[:, 1 : 1 + model.nq]
        gears = x[:, outputs] if elastic else x[:, links] @ robot.joint_to_gear
        shown = (gears - effects.transmission_error(gears)) @ robot.gear_to_joint
        motors = joints_to_motors(robot, shown)
        read = motors_to_joints(robot, resolvers.read_angles(motors) if resolvers else motors)
        command = command + (targets - read) @ robot.joint_to_gear
    tool, drift = np.zeros((len(targets), 4, 4)), np.zeros(len(targets))
    for k, state in enumerate(states):
        tool[k], drift[k] = _tool(model, data, state)
    return HeldPoses(tool, x[:, links], read - targets, drift)


def _state(model: mujoco.MjModel, data: mujoco.MjData, position: Array) -> Array:
    mujoco.mj_resetData(model, data)
    data.qpos[:] = position
    state = np.zeros(mujoco.mj_stateSize(model, _PHYSICS))
    mujoco.mj_getState(model, data, state, _PHYSICS)
    return state


def _tool(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> tuple[Array, float]:
    mujoco.mj_setState(model, data, state, _PHYSICS)
    mujoco.mj_forward(model, data)
    site = data.site("tool")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    speed = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site.id, speed, 0)
    return pose, float(np.linalg.norm(speed[3:]))

"""The unloaded robot in MuJoCo holds joint targets: the true poses of its tool.

A position controller with integral action brings the motors' readings to the targets. The servo
here is proportional, so its command is corrected by the remaining difference of the readings, one
hold after another, until none is left. The effects of gears, resolvers and weight behind the
readings remain. Each pose starts with gears in the middle of their backlash; the weight presses
them to a flank.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from cell.arrays import Array
from cell.robot_angles import joints_to_motors, motors_to_joints
from sim.errors.sensor_effects import ResolverEffects
from sim.plant.description import Plant
from sim.plant.mjcf import ROBOT_JOINTS, ROTORS, compiled, unloaded_robot_spec
from sim.plant.mujoco_plant import PlantError
from sim.plant.statics import gravity_torque

TIMESTEP = 1e-3  # [s] (notes/mujoco sec. 2)
# [s] the arm's slowest oscillation decays by a factor of a thousand in the first hold
HOLDS = (1.0, 0.5, 0.5, 0.5)
BATCH = 25  # poses per rollout call: 100 MB of states
_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """N targets as the plant held them."""

    tool: Array  # (N, 4, 4) T_base_tool
    joints: Array  # (N, 6) [rad] of the links
    miss: Array  # (N, 6) [rad] readings less targets as joint angles: the controller's remainder
    drift: Array  # (N,) [m/s] speed of the tool at the end


def hold_poses(
    plant: Plant, targets: Array, *, resolvers: ResolverEffects | None = None
) -> HeldPoses:
    """Poses of the true robot at joint targets.

    targets : (N, 6) [rad] DH joint angles as the controller reads them.

    Raises PlantError when the simulation diverges.
    """
    model = compiled(unloaded_robot_spec(plant, timestep=TIMESTEP))
    batches = [
        _held(model, plant, targets[k : k + BATCH], resolvers)
        for k in range(0, len(targets), BATCH)
    ]
    return HeldPoses(
        tool=np.concatenate([batch.tool for batch in batches]),
        joints=np.concatenate([batch.joints for batch in batches]),
        miss=np.concatenate([batch.miss for batch in batches]),
        drift=np.concatenate([batch.drift for batch in batches]),
    )


def _held(
    model: mujoco.MjModel, plant: Plant, targets: Array, resolvers: ResolverEffects | None
) -> HeldPoses:
    robot, effects, data = plant.cell.robot, plant.effects, mujoco.MjData(model)
    links = [int(model.joint(name).qposadr[0]) for name in ROBOT_JOINTS]
    elastic = effects.gear_stiffness is not None
    outputs = [int(model.joint(name).qposadr[0]) for name in ROTORS] if elastic else []
    gears = targets @ robot.joint_to_gear
    weight = gravity_torque(plant.cell, plant.geometry, targets) @ robot.gear_to_joint.T
    command = gears + weight / plant.gains.kp
    positions = np.zeros((len(targets), model.nq))
    positions[:, links] = targets
    positions[:, outputs] = gears + effects.transmission_error(gears) if elastic else 0.0
    states = np.stack([_state(model, data, x) for x in positions])
    for seconds in HOLDS:
        control = np.repeat(command[:, None], round(seconds / TIMESTEP), axis=1)
        states = rollout.rollout(model, data, states, control)[0][:, -1]
        if not np.isfinite(states).all():
            raise PlantError(
                f"simulation of held poses diverged within {seconds} s; a softer servo may help"
            )
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
    """Pose (4, 4) and speed [m/s] of the tool in a full physics state."""
    mujoco.mj_setState(model, data, state, _PHYSICS)
    mujoco.mj_forward(model, data)
    site = data.site("tool")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    speed = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site.id, speed, 0)
    return pose, float(np.linalg.norm(speed[3:]))

"""Poses at which a plant holds the true robot: by its servos, or still before an instrument.

A position controller with integral action brings the motors' readings to joint targets. The servo
here is proportional, so its command is corrected by the remaining difference of the readings, one
hold after another, until none is left. The effects of gears, resolvers and weight behind the
readings remain. Each pose starts with gears in the middle of their backlash; the weight presses
them to a flank. Without forces, motors stand at their targets and gears err by their ripple.

Before a rod or a wire, an arm is in static equilibrium: the motors stand
where the controller put them, so each gear is a spring from there, a fixed tendon over its joints.
Heavily damped, the arm comes to rest in half a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import link_bodies
from ballbar.cell.chain import Frames, row_placements
from ballbar.cell.errors import FailureError
from ballbar.cell.geometry import robot_frames
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.inverse import pose_error
from ballbar.cell.robot_angles import joints_to_motors, motors_to_joints
from ballbar.sim.errors.sensor_effects import ResolverEffects
from ballbar.sim.plant.effects import Plant, servo_gains
from ballbar.sim.plant.instrument_plant import add_instrument, is_wire, rod_position
from ballbar.sim.plant.mjcf import ROBOT_JOINTS, ROTORS, unloaded_robot_spec
from ballbar.sim.plant.mjcf_parts import add_gear_tendon, add_links, compiled, empty_spec
from ballbar.sim.plant.mujoco_plant import PHYSICS, PlantError, full_state
from ballbar.sim.plant.statics import gravity_torque
from ballbar.sim.settings import RodAndWire
from ballbar.sim.true_robot import TrueArm, TrueMachine
from ballbar.sim.truth import TruePlace

TIMESTEP = 1e-3  # [s] (notes/plant sec. 2)
# [s] the arm's slowest oscillation decays by a factor of a thousand in the first hold
HOLDS = (1.0, 0.5, 0.5, 0.5)
BATCH = 25  # poses per rollout call: 100 MB of states
DAMPING = 0.03  # [s] of the gears' stiffness: longer than the period of any joint
AT_REST = 1e-8  # [rad/s, m/s] of every coordinate
_STRETCH, _LONGEST = 200, 8000  # steps between two looks, and before a pose is given up


class NotAtRestError(FailureError):
    """A pose at which the simulated arm does not come to rest."""


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """N targets as the plant held them."""

    tool: Array  # (N, 4, 4) T_base_tool
    joints: Array  # (N, J) [rad] of the links
    miss: Array  # (N, J) [rad] readings less targets as joint angles: the controller's remainder
    drift: Array  # (N,) [m/s] speed of the tool at the end


def hold_machine(machine: TrueMachine, targets: Array) -> HeldPoses:
    """The machine's robot, free of ball-bar and instrument, at targets (N, J) [rad].

    Raises PlantError when the simulation diverges.
    """
    robot = machine.cell.robot
    if machine.dynamic:
        plant = Plant(machine.cell, machine.true, machine.effects, servo_gains(robot, "stiff"))
        return hold_poses(plant, targets, resolvers=machine.resolvers)
    joints = machine.effects.gear_outputs(targets @ robot.joint_to_gear) @ robot.gear_to_joint
    still = np.zeros_like(targets)
    return HeldPoses(robot_frames(machine.true, joints).poses(), joints, still, still[:, 0])


def hold_poses(
    plant: Plant, targets: Array, *, resolvers: ResolverEffects | None = None
) -> HeldPoses:
    """Poses in MuJoCo of the true robot at joint targets.

    targets : (N, J) [rad] DH joint angles as the controller reads them.

    Raises PlantError when the simulation diverges.
    """
    model = compiled(unloaded_robot_spec(plant, timestep=TIMESTEP))
    batches = [
        _held(model, plant, targets[k : k + BATCH], resolvers)
        for k in range(0, len(targets), BATCH)
    ]
    return HeldPoses(*(np.concatenate(parts) for parts in zip(*batches, strict=True)))


def _held(
    model: mujoco.MjModel, plant: Plant, targets: Array, resolvers: ResolverEffects | None
) -> tuple[Array, Array, Array, Array]:
    """Values of HeldPoses of one batch of targets."""
    robot, effects, data = plant.cell.robot, plant.effects, mujoco.MjData(model)
    links = [int(model.joint(name).qposadr[0]) for name in ROBOT_JOINTS[: robot.joints]]
    elastic = effects.gear_stiffness is not None
    outputs = (
        [int(model.joint(name).qposadr[0]) for name in ROTORS[: robot.joints]] if elastic else []
    )
    gears = targets @ robot.joint_to_gear
    weight = gravity_torque(plant.cell, plant.geometry, targets) @ robot.gear_to_joint.T
    command = gears + weight / plant.gains.kp
    states = np.zeros((len(targets), mujoco.mj_stateSize(model, PHYSICS)))
    rotors = gears + effects.transmission_error(gears) if elastic else np.zeros((len(targets), 0))
    for k, target in enumerate(targets):
        mujoco.mj_resetData(model, data)
        data.qpos[links], data.qpos[outputs] = target, rotors[k]
        states[k] = full_state(model, data)
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
    tool, drift = np.tile(np.eye(4), (len(targets), 1, 1)), np.zeros(len(targets))
    site, speed = data.site("tool"), np.zeros(6)
    for k, state in enumerate(states):
        mujoco.mj_setState(model, data, state, PHYSICS)
        mujoco.mj_forward(model, data)
        tool[k, :3, :3], tool[k, :3, 3] = site.xmat.reshape(3, 3), site.xpos
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site.id, speed, 0)
        drift[k] = np.linalg.norm(speed[3:])
    return tool, x[:, links], read - targets, drift


def pose_distance(wanted: Frames, held: HeldPoses) -> tuple[Array, Array]:
    """(N,) [m] and (N,) [rad] from the wanted to the held pose."""
    error = pose_error(held.tool[:, :3, :3].transpose(1, 2, 0), held.tool[:, :3, 3].T, wanted)
    return np.linalg.norm(error[:3], axis=0), np.linalg.norm(error[3:], axis=0)


def hold_with_instrument(
    arm: TrueArm,
    instrument: Instrument,
    settings: RodAndWire,
    *,
    seat: TruePlace,
    target: TruePlace,
    q: Array,
    friction: Array,
) -> tuple[Array, Array]:
    """Actual joint angles (N, J) [rad] of an arm of elastic gears at shown angles q (N, J) [rad].

    instrument : that measures a length. friction : (N,) [N] left in the slide of a rod, tension
        positive; of no effect on a wire.

    Also returns the force (N,) [N] along rod or wire, tension positive. Raises NotAtRestError where
    the arm does not come to rest.
    """
    model = compiled(_spec(arm, instrument, settings, seat, target))
    data, joints, rotors = mujoco.MjData(model), arm.robot.joints, arm.rotors(q)
    start, places = arm.joints(q), arm.target(q, target.position)
    has_rod = not is_wire(instrument)
    actual, force = np.zeros_like(q), np.zeros(len(q))
    for k, rotor in enumerate(rotors):
        mujoco.mj_resetData(model, data)
        model.tendon_lengthspring[:joints] = rotor[:, None]
        data.qpos[:joints] = start[k]
        if has_rod:
            length = float(model.site("rod_end").pos[2])
            data.qpos[joints : joints + 5] = rod_position(seat.position, places[k], length)
            data.qfrc_applied[joints + 3] = -friction[k]
        else:
            data.ctrl[:] = 1.0
        _to_rest(model, data, k)
        if has_rod:
            spring = float(model.jnt_stiffness[joints + 1]) * float(data.qpos[joints + 4])
            force[k] = spring + float(friction[k])
        else:
            force[k] = -float(model.actuator_gear[0, 0] * data.actuator_force[0])
        actual[k] = data.qpos[:joints]
    return actual, force


def _to_rest(model: mujoco.MjModel, data: mujoco.MjData, pose: int) -> None:
    for _ in range(0, _LONGEST, _STRETCH):
        mujoco.mj_step(model, data, _STRETCH)
        speed = float(np.abs(data.qvel).max())
        if speed < AT_REST:
            return
    raise NotAtRestError(
        f"pose {pose} (counted from 0): the arm still moves at {speed:.2g} rad/s or m/s after "
        f"{_LONGEST * TIMESTEP:g} s. Use plant.kind = kinematic, or stiffer gears."
    )


def _spec(
    arm: TrueArm, instrument: Instrument, settings: RodAndWire, seat: TruePlace, target: TruePlace
) -> mujoco.MjSpec:
    """Links with a spring over the joints that each gear turns, and the rod or the wire."""
    robot, stiffness = arm.robot, arm.effects.gear_stiffness
    assert stiffness is not None  # the caller's condition
    name = f"{robot.name} with {instrument.name}"
    spec = empty_spec(name, timestep=TIMESTEP, gravity=robot.gravity)
    last, rotation, position = add_links(spec, link_bodies(robot), row_placements(arm.chain))
    last.add_site(name="target", pos=position + rotation @ target.position)
    for i, coefficients in enumerate(robot.joint_to_gear.T):
        spring = add_gear_tendon(spec, f"gear{i + 1}", coefficients)
        spring.springlength = [0.0, 0.0]  # written for each pose
        spring.stiffness[0] = float(stiffness[i])
        spring.damping[0] = DAMPING * float(stiffness[i])
    add_instrument(spec, instrument, settings, seat=seat.position, site="target")
    return spec

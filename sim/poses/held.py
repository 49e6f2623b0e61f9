"""MuJoCo plant of still poses: the arm with its rod or wire in static equilibrium.

The motors stand where the controller put them, so each gear is a spring from there: a fixed tendon
over its joints. Rod and wire are those of sim.plant.rod_and_wire. Heavily damped, the arm comes to
rest in half a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from cell.arrays import Array
from cell.bodies import link_bodies
from cell.chain import row_placements
from cell.errors import FailureError
from cell.instrument import Instrument
from cell.rotation import quat_wxyz
from sim.plant.mjcf import SOLVER_TOLERANCE, UNUSED, compiled, set_inertia
from sim.plant.rod_and_wire import add_rod, add_wire, is_wire, rod_position
from sim.poses.settings import PosePlant
from sim.poses.true_arm import Place, TrueArm

TIMESTEP = 1e-3  # [s] (notes/mujoco sec. 2)
DAMPING = 0.03  # [s] of the gears' stiffness: longer than the period of any joint
AT_REST = 1e-8  # [rad/s, m/s] of every coordinate
_STRETCH, _LONGEST = 200, 8000  # steps between two looks, and before a pose is given up


class NotAtRestError(FailureError):
    """A pose at which the simulated arm does not come to rest."""


@dataclass(frozen=True, eq=False)
class HeldByInstrument:
    """N poses in equilibrium."""

    joints: Array  # (N, J) [rad] actual joint angles
    force: Array  # (N,) [N] along rod or wire, tension positive


def hold_with_instrument(
    arm: TrueArm,
    instrument: Instrument,
    settings: PosePlant,
    *,
    seat: Place,
    target: Place,
    q: Array,
    friction: Array,
) -> HeldByInstrument:
    """Actual joint angles of an arm of elastic gears, held at shown angles q (N, J) [rad].

    instrument : that measures a length. friction : (N,) [N] left in the slide of a rod, tension
        positive; of no effect on a wire.

    Raises NotAtRestError where the arm does not come to rest.
    """
    model = compiled(_spec(arm, instrument, settings, seat, target))
    data = mujoco.MjData(model)
    held = list(_each(model, data, arm, seat=seat, target=target, q=q, friction=friction))
    return HeldByInstrument(
        np.stack([joints for joints, _ in held]), np.array([force for _, force in held])
    )


def _each(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arm: TrueArm,
    *,
    seat: Place,
    target: Place,
    q: Array,
    friction: Array,
) -> Iterator[tuple[Array, float]]:
    """Joint angles [rad] and force [N] of each pose."""
    joints, rotors = arm.robot.joints, arm.rotors(q)
    start, places = arm.joints(q), arm.target(q, target.position)
    has_rod = model.njnt > joints
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
            force = spring + float(friction[k])
        else:
            force = -float(model.actuator_gear[0, 0] * data.actuator_force[0])
        yield data.qpos[:joints].copy(), force


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
    arm: TrueArm, instrument: Instrument, settings: PosePlant, seat: Place, target: Place
) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = f"{arm.robot.name} with {instrument.name}"
    spec.compiler.degree = False
    option = spec.option
    option.timestep = TIMESTEP
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = SOLVER_TOLERANCE
    option.gravity = arm.robot.gravity
    option.disableflags = int(UNUSED)
    _add_arm(spec, arm, target)
    if is_wire(instrument):
        add_wire(spec, settings.wire_tension_N, seat=seat.position, site="target")
    else:
        add_rod(spec, instrument.nominal, settings, seat=seat.position, site="target")
    return spec


def _add_arm(spec: mujoco.MjSpec, arm: TrueArm, target: Place) -> None:
    """Links, and a spring over the joints that each gear turns."""
    parent, robot = spec.worldbody, arm.robot
    rotation, position = np.eye(3), np.zeros(3)
    names = [f"q{i + 1}" for i in range(robot.joints)]
    rows = row_placements(arm.chain)
    for i, (link, row) in enumerate(zip(link_bodies(robot), rows, strict=True)):
        parent = parent.add_body(name=f"link{i + 1}", pos=position, quat=quat_wxyz(rotation))
        set_inertia(parent, link)
        parent.add_joint(name=names[i], type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        rotation, position = row
    parent.add_site(name="target", pos=position + rotation @ target.position)
    assert arm.gear_stiffness is not None  # the caller's condition
    for i, coefficients in enumerate(robot.joint_to_gear.T):
        spring = spec.add_tendon(name=f"gear{i + 1}")
        for name, coefficient in zip(names, coefficients, strict=True):
            if coefficient != 0.0:
                spring.wrap_joint(name, float(coefficient))
        spring.springlength = [0.0, 0.0]  # written for each pose
        spring.stiffness[0] = float(arm.gear_stiffness[i])
        spring.damping[0] = DAMPING * float(arm.gear_stiffness[i])

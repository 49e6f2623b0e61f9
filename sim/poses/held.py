"""MuJoCo plant of still poses: the arm with its rod or wire in static equilibrium.

The motors stand where the controller put them, so each gear is a spring from there: a fixed tendon
over its joints. A rod turns in two magnetic cups; along it act the spring of its length sensor, the
friction of its slide and its weight, and nothing closes the chain beyond that. A wire pulls the
target towards the seat with its tension. Heavily damped, the arm comes to rest in half a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from cell.arrays import Array
from cell.bodies import link_bodies
from cell.chain import row_placements
from cell.descriptions import Link
from cell.errors import FailureError
from cell.instrument import Instrument
from cell.rotation import quat_wxyz
from sim.plant.mjcf import SOLVER_TOLERANCE, UNUSED, WELD_SOLIMP, WELD_SOLREF, compiled
from sim.poses.settings import PosePlant
from sim.poses.true_arm import Place, TrueArm

TIMESTEP = 1e-3  # [s] (notes/mujoco sec. 2)
DAMPING = 0.03  # [s] of the gears' stiffness: longer than the period of any joint
AT_REST = 1e-8  # [rad/s, m/s] of every coordinate
_STRETCH, _LONGEST = 200, 8000  # steps between two looks, and before a pose is given up
_ROD_RADIUS = 0.01  # [m] for its inertia about itself, assumed
_CUP_DAMPING = 0.02  # [N m s/rad] of the cups: only how the rod comes to rest
_HINGE, _SLIDE, _BALL = (
    mujoco.mjtJoint.mjJNT_HINGE,
    mujoco.mjtJoint.mjJNT_SLIDE,
    mujoco.mjtJoint.mjJNT_BALL,
)


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


def is_wire(instrument: Instrument) -> bool:
    """Whether an instrument of lengths is a wire: its stroke is longer than its shortest length."""
    return instrument.upper > 2.0 * instrument.lower


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
            rod = places[k] - seat.position
            length = float(np.linalg.norm(rod))
            data.qpos[joints : joints + 4] = quat_wxyz(_with_z(rod / length))
            data.qpos[joints + 4] = length - float(model.site("rod_end").pos[2])
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
        _add_wire(spec, settings, seat)
    else:
        _add_rod(spec, instrument, settings, seat)
    return spec


def _add_arm(spec: mujoco.MjSpec, arm: TrueArm, target: Place) -> None:
    """Links, and a spring over the joints that each gear turns."""
    parent, robot = spec.worldbody, arm.robot
    rotation, position = np.eye(3), np.zeros(3)
    names = [f"q{i + 1}" for i in range(robot.joints)]
    rows = row_placements(arm.chain)
    for i, (link, row) in enumerate(zip(link_bodies(robot), rows, strict=True)):
        parent = parent.add_body(name=f"link{i + 1}", pos=position, quat=quat_wxyz(rotation))
        _set_inertia(parent, link)
        parent.add_joint(name=names[i], type=_HINGE, axis=[0, 0, 1])
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


def _add_rod(spec: mujoco.MjSpec, instrument: Instrument, settings: PosePlant, seat: Place) -> None:
    """Two halves of equal mass, the second on the slide; the end held in the tool's cup."""
    half, length = 0.5 * settings.rod_mass_kg, instrument.nominal
    across = half * (length**2 / 48.0 + _ROD_RADIUS**2 / 4.0)
    inertia = np.diag([across, across, half * _ROD_RADIUS**2 / 2.0])
    lower = spec.worldbody.add_body(name="rod_lower", pos=seat.position)
    _set_inertia(lower, Link(half, np.array([0.0, 0.0, 0.25 * length]), inertia))
    lower.add_joint(name="seat_cup", type=_BALL, damping=_CUP_DAMPING)
    upper = lower.add_body(name="rod_upper")
    _set_inertia(upper, Link(half, np.array([0.0, 0.0, 0.75 * length]), inertia))
    slide = upper.add_joint(name="slide", type=_SLIDE, axis=[0, 0, 1])
    slide.stiffness[0] = settings.rod_spring_N_per_m
    slide.damping[0] = 1.0
    upper.add_site(name="rod_end", pos=[0.0, 0.0, length])
    cup = spec.add_equality(
        name="tool_cup",
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1="rod_end",
        name2="target",
    )
    cup.solref, cup.solimp = WELD_SOLREF, WELD_SOLIMP


def _add_wire(spec: mujoco.MjSpec, settings: PosePlant, seat: Place) -> None:
    spec.worldbody.add_site(name="fairlead", pos=seat.position)
    wire = spec.add_tendon(name="wire")
    wire.wrap_site("fairlead")
    wire.wrap_site("target")
    pull = spec.add_actuator(name="tension", target="wire", trntype=mujoco.mjtTrn.mjTRN_TENDON)
    pull.set_to_motor()
    pull.gear[0] = -settings.wire_tension_N


def _set_inertia(body: mujoco.MjsBody, link: Link) -> None:
    body.mass, body.ipos, body.explicitinertial = link.mass, link.com, True
    body.fullinertia = link.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _with_z(direction: Array) -> Array:
    """(3, 3) a rotation whose z axis is a unit vector (3,)."""
    other = np.eye(3)[int(np.abs(direction).argmin())]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(direction, x), direction), axis=1)

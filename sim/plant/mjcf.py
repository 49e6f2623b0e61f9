"""The MuJoCo model of one cell: robot, offset plate and ball-bar, closed by a weld at the tool.

Every DH row becomes a body: body i stands at `Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)` of row i-1 in its parent and turns
about its own z, so all parameters of all rows, errors included, enter as doubles.

Gear i turns a combination of joints (parallel rod, wrist couplings). Elastic gears: the rotor of motor i is a body of its own
that turns by the gear's output angle (hinge `g`, the rotor's inertia seen at the output); servo, friction and ripple act on
it, and a fixed tendon over the joints and the rotor is the gear's spring, damper and play. Rigid gears: no rotors; what a
motor does acts on a fixed tendon over the joints. Recipes and their measurements: notes/mujoco secs. 1, 2, 4, 8, 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.bodies import bar_bodies, flange_on_link6, robot_bodies
from cell.chain import row_placements
from cell.descriptions import Cell, Link, ServoGains
from cell.geometry import BAR_ROWS, ROBOT_ROWS, Geometry
from cell.rotation import quat_wxyz
from sim.plant.effects import PlantEffects

WELD_SOLREF = (-1e9, -6e4)  # closure 0.1 um at 1 ms under `discrete` (notes/mujoco sec. 2)
WELD_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
SOLVER_TOLERANCE = 1e-4  # of the implicit solve; from 1e-3 down to 1e-14 no coordinate of 60 s moves by more than 1e-13
PASSIVE = 16  # dcmotor without a control input: mjtCtrlSpec "none" (notes/mujoco sec. 4)
BRISTLE_TRAVEL = (
    2e-5  # [rad] shortest pre-sliding of the friction model: below the gears' lost motion
)
BRISTLE_RATE = 200.0  # [rad/s] highest frequency of bristle and rotor: MuJoCo integrates them explicitly, above it they chatter
BRISTLE_DAMPING = 0.7  # damping ratio of bristle and rotor
HYSTERESIS_STIFFNESS = 4.0  # of the gear's: the friction element slips early in the loop
PLATE_ARMATURE = 0.02  # [kg m^2] a third of the plate's inertia about the hinge; the tip itself carries no mass in the model
PLATE_DAMPING = 1e-3  # [s] of the plate's stiffness
ROTOR_MASS, ROTOR_INERTIA = (
    1e-9,
    1e-9,
)  # [kg, kg m^2] of the body: the rotor's inertia is its joint's armature
RING_INERTIA = 2e-3  # [kg m^2] what a ball-bar joint turns at least, for its friction model
BASE_MASS = (
    5.0  # [kg] steel base adapter, assumed; its own weight is part of where the ball-bar stands
)
BASE_DAMPING = 1e-3  # [s] of the base's stiffness

ROBOT_JOINTS = tuple(f"q{i + 1}" for i in range(ROBOT_ROWS))
ROTORS = tuple(f"g{i + 1}" for i in range(ROBOT_ROWS))
BAR_JOINTS = tuple(f"b{i + 1}" for i in range(BAR_ROWS))
BASE_JOINTS = ("base_x", "base_y", "base_z")
ROD_JOINT, PLATE_JOINT = "rod", "plate"

_OFF = mujoco.mjtDisableBit
# nothing touches, nothing has a limit, the solve is linear; a divergence must show, not reset
UNUSED = (
    _OFF.mjDSBL_CONTACT
    | _OFF.mjDSBL_ISLAND
    | _OFF.mjDSBL_LIMIT
    | _OFF.mjDSBL_FRICTIONLOSS
    | _OFF.mjDSBL_CLAMPCTRL
    | _OFF.mjDSBL_WARMSTART
    | _OFF.mjDSBL_SENSOR
    | _OFF.mjDSBL_AUTORESET
)
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


@dataclass(frozen=True, eq=False)
class PlantModel:
    """A compiled model and where its coordinates are in qpos (empty where an effect is off)."""

    model: mujoco.MjModel
    joints: NDArray[np.intp]  # (6,) q1..q6
    rotors: NDArray[np.intp]  # (6,) or (0,) g1..g6
    bar: NDArray[np.intp]  # (5,) b1..b5
    rod: int
    plate: NDArray[np.intp]  # (1,) or (0,)
    base: NDArray[np.intp]  # (3,) or (0,)


def plant_model(
    cell: Cell, geometry: Geometry, effects: PlantEffects, gains: ServoGains, *, timestep: float
) -> PlantModel:
    """The compiled model of a cell with the given true geometry. Raises ValueError when MuJoCo refuses it."""
    model = plant_spec(cell, geometry, effects, gains, timestep=timestep).compile()
    model.site_sameframe[:] = (
        0  # MuJoCo takes a site within 1e-6 of its body frame for identical (notes/mujoco sec. 7.1)
    )
    names = {model.joint(i).name: int(model.jnt_qposadr[i]) for i in range(model.njnt)}

    def places(wanted: tuple[str, ...]) -> NDArray[np.intp]:
        return np.array([names[name] for name in wanted if name in names], dtype=np.intp)

    return PlantModel(
        model,
        places(ROBOT_JOINTS),
        places(ROTORS),
        places(BAR_JOINTS),
        names[ROD_JOINT],
        places((PLATE_JOINT,)),
        places(BASE_JOINTS),
    )


def plant_spec(
    cell: Cell, geometry: Geometry, effects: PlantEffects, gains: ServoGains, *, timestep: float
) -> mujoco.MjSpec:
    """The model as a specification: compile it, or write it as XML.

    geometry : true kinematic parameters, encoder zeros left out (they belong to the encoders).
    """
    spec = free_robot_spec(cell, geometry, effects, gains, timestep=timestep)
    spec.modelname = f"{cell.robot.name} with {cell.ballbar.name}"
    _add_bar(spec, cell, geometry, effects)
    weld = spec.add_equality(
        name="closure",
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1="bar_end",
        name2="tool",
    )
    weld.solref = WELD_SOLREF
    weld.solimp = WELD_SOLIMP
    return spec


def free_robot_spec(
    cell: Cell, geometry: Geometry, effects: PlantEffects, gains: ServoGains, *, timestep: float
) -> mujoco.MjSpec:
    """Robot and plate alone, as they are before and after the ball-bar is mounted; arguments as of `plant_spec`."""
    spec = mujoco.MjSpec()
    spec.modelname = cell.robot.name
    spec.compiler.degree = False
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = SOLVER_TOLERANCE
    option.gravity = cell.robot.gravity
    option.disableflags = UNUSED
    _add_robot(spec, cell, geometry, effects)
    _add_gears(spec, cell, effects, gains)
    return spec


def _add_robot(spec: mujoco.MjSpec, cell: Cell, geometry: Geometry, effects: PlantEffects) -> None:
    parent = spec.worldbody
    placements = row_placements(geometry.robot)
    pose = (np.eye(3), np.zeros(3))
    for i, link in enumerate(robot_bodies(cell)):
        body = parent.add_body(name=f"link{i + 1}", pos=pose[1], quat=quat_wxyz(pose[0]))
        _set_inertia(body, link)
        body.add_joint(name=ROBOT_JOINTS[i], type=_HINGE, axis=[0, 0, 1])
        parent, pose = body, placements[i]
    rotation, flange = flange_on_link6(cell)
    plate = parent.add_body(name="plate", pos=flange, quat=quat_wxyz(rotation))
    _set_inertia(plate, cell.plate.body)
    tool = (rotation.T @ pose[0], rotation.T @ (pose[1] - flange))
    if effects.plate_stiffness is None:
        plate.add_site(name="tool", pos=tool[1], quat=quat_wxyz(tool[0]))
    else:
        _add_bending_plate(plate, tool, geometry["ra6"], effects.plate_stiffness)
    if effects.force_sensor:
        plate.add_site(name="flange")
        for name, kind in (
            ("force", mujoco.mjtSensor.mjSENS_FORCE),
            ("torque", mujoco.mjtSensor.mjSENS_TORQUE),
        ):
            spec.add_sensor(
                name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="flange"
            )
        spec.option.disableflags &= ~int(_OFF.mjDSBL_SENSOR)


def plate_hinge_stiffness(length: float, tip_stiffness: float) -> float:
    """[N m/rad] of the hinge a third along a cantilever that deflects and tilts as the cantilever does under a tip load."""
    return tip_stiffness * (2.0 * length / 3.0) ** 2


def _add_bending_plate(
    flange: mujoco.MjsBody, tool: tuple[Array, Array], length: float, tip_stiffness: float
) -> None:
    """The tool on a hinge about the plate's y, two thirds of its length before the tool (notes/mujoco sec. 1)."""
    arm = np.array([2.0 * length / 3.0, 0.0, 0.0])
    tip = flange.add_body(name="plate_tip", pos=tool[1] - tool[0] @ arm, quat=quat_wxyz(tool[0]))
    tip.mass, tip.inertia, tip.explicitinertial = 1e-9, [1e-9, 1e-9, 1e-9], True
    hinge = tip.add_joint(name=PLATE_JOINT, type=_HINGE, axis=[0, 1, 0], armature=PLATE_ARMATURE)
    hinge.stiffness[0] = plate_hinge_stiffness(length, tip_stiffness)
    hinge.damping[0] = PLATE_DAMPING * hinge.stiffness[0]
    tip.add_site(name="tool", pos=arm)


def _add_gears(spec: mujoco.MjSpec, cell: Cell, effects: PlantEffects, gains: ServoGains) -> None:
    """Servo, rotor, friction and ripple of each motor; spring, damper and play of each gear."""
    joint_to_gear = cell.robot.joint_to_gear  # gears = joints @ joint_to_gear
    gears = cell.robot.gears
    motors = [
        _shaft(spec, f"motor{i + 1}", joint_to_gear[:, i])
        if effects.gear_stiffness is None
        else _elastic_gear(spec, i, joint_to_gear[:, i], effects, float(gears.damping[i]))
        for i in range(ROBOT_ROWS)
    ]
    for i, motor in enumerate(motors):
        motor.part.armature = float(cell.robot.armature[i])
        servo = spec.add_actuator(name=f"servo{i + 1}", target=motor.part.name, trntype=motor.kind)
        servo.set_to_position(kp=float(gains.kp[i]), kv=float(gains.kv[i]))
        if effects.friction_scale > 0.0:
            s = effects.friction_scale
            motor.part.damping[0] = s * float(gears.viscous[i])
            static = gears.static[i] if effects.stribeck else gears.coulomb[i]
            _friction(
                spec,
                motor,
                s * gears.coulomb[i],
                s * static,
                gears.stribeck[i],
                float(cell.robot.armature[i]),
            )
    for k, ripple in enumerate(effects.ripples):
        torque = [float(gains.kp[ripple.gear]) * ripple.amplitude, ripple.order, ripple.phase]
        _passive(spec, f"ripple{k}", motors[ripple.gear], cogging=torque)


@dataclass(frozen=True)
class _Shaft:
    """What a motor turns: its rotor; with rigid gears a joint, or the combination that parallel rod and wrist make of it."""

    part: mujoco.MjsJoint | mujoco.MjsTendon
    kind: mujoco.mjtTrn


def _elastic_gear(
    spec: mujoco.MjSpec, i: int, coefficients: Array, effects: PlantEffects, damping: float
) -> _Shaft:
    """Rotor i, and the spring between what its gear should turn the joints by and what they have turned by."""
    assert effects.gear_stiffness is not None
    body = spec.worldbody.add_body(name=f"rotor{i + 1}")
    body.mass, body.inertia, body.explicitinertial = ROTOR_MASS, [ROTOR_INERTIA] * 3, True
    rotor = body.add_joint(name=ROTORS[i], type=_HINGE, axis=[0, 0, 1])
    stiffness, slack, hysteresis = (
        float(v[i])
        for v in (effects.gear_stiffness, effects.gear_backlash, effects.gear_hysteresis)
    )
    spring = _tendon(spec, f"gear{i + 1}", coefficients, rotor=ROTORS[i])
    spring.springlength = [-slack, slack]
    spring.stiffness[0], spring.damping[0] = stiffness, damping
    if hysteresis > 0.0:
        friction = _tendon(spec, f"gear{i + 1}_friction", coefficients, rotor=ROTORS[i])
        friction.springlength = [0.0, 0.0]
        friction.stiffness[0] = HYSTERESIS_STIFFNESS * stiffness
        friction.springyield = hysteresis / HYSTERESIS_STIFFNESS
    return _Shaft(rotor, mujoco.mjtTrn.mjTRN_JOINT)


def _shaft(spec: mujoco.MjSpec, name: str, coefficients: Array) -> _Shaft:
    turned = np.flatnonzero(coefficients)
    if turned.size == 1 and coefficients[turned[0]] == 1.0:  # a joint costs a third of a tendon
        return _Shaft(spec.joint(ROBOT_JOINTS[turned[0]]), mujoco.mjtTrn.mjTRN_JOINT)
    return _Shaft(_tendon(spec, name, coefficients), mujoco.mjtTrn.mjTRN_TENDON)


def _tendon(
    spec: mujoco.MjSpec, name: str, coefficients: Array, rotor: str | None = None
) -> mujoco.MjsTendon:
    """The combination of joints that a gear turns, less what its rotor shows."""
    tendon = spec.add_tendon(name=name)
    for joint, coefficient in zip(ROBOT_JOINTS, coefficients, strict=True):
        if coefficient != 0.0:
            tendon.wrap_joint(joint, float(coefficient))
    if rotor is not None:
        tendon.wrap_joint(rotor, -1.0)
    return tendon


def _friction(
    spec: mujoco.MjSpec,
    shaft: _Shaft,
    coulomb: float,
    static: float,
    stribeck: float,
    inertia: float,
) -> None:
    """LuGre friction on a shaft of this inertia; below BRISTLE_TRAVEL or where the bristle would chatter it gives way elastically."""
    bristle = min(float(static) / BRISTLE_TRAVEL, inertia * BRISTLE_RATE**2)
    damping = 2.0 * BRISTLE_DAMPING * float(np.sqrt(bristle * inertia))
    lugre = [bristle, damping, float(coulomb), float(static), float(stribeck)]
    _passive(spec, f"friction_{shaft.part.name}", shaft, lugre=lugre)


def _passive(spec: mujoco.MjSpec, name: str, shaft: _Shaft, **torque: list[float]) -> None:
    """A torque that depends on position or speed only: a shorted motor without motor constant."""
    actuator = spec.add_actuator(name=name, target=shaft.part.name, trntype=shaft.kind)
    actuator.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, ctrlspec=PASSIVE, **torque)


def _add_bar(spec: mujoco.MjSpec, cell: Cell, geometry: Geometry, effects: PlantEffects) -> None:
    bar, parent = cell.ballbar, spec.worldbody
    placements = row_placements(geometry.bar)
    pose = (geometry.bar_base_rotation, geometry.origin)
    if effects.base_stiffness is not None:
        parent, pose = (
            _add_base(spec, geometry, effects.base_stiffness),
            (geometry.bar_base_rotation, np.zeros(3)),
        )
    for i, link in enumerate(bar_bodies(cell)):
        body = parent.add_body(name=f"bar{i + 1}", pos=pose[1], quat=quat_wxyz(pose[0]))
        _set_inertia(body, link)
        hinge = body.add_joint(
            name=BAR_JOINTS[i], type=_HINGE, axis=[0, 0, 1], damping=float(bar.joint_damping[i])
        )
        if i == 2:
            slide = body.add_joint(
                name=ROD_JOINT, type=_SLIDE, axis=[0, 0, 1], damping=bar.axial_damping
            )
            if effects.rod_backlash == 0.0:
                slide.stiffness[0] = effects.rod_stiffness
        if effects.bar_friction > 0.0:
            _friction(
                spec,
                _Shaft(hinge, mujoco.mjtTrn.mjTRN_JOINT),
                effects.bar_friction,
                effects.bar_friction,
                0.01,
                RING_INERTIA,
            )
        parent, pose = body, placements[i]
    if effects.rod_backlash > 0.0:
        rod = spec.add_tendon(name="rod_spring")
        rod.wrap_joint(ROD_JOINT, 1.0)
        rod.stiffness[0] = effects.rod_stiffness
        rod.springlength = [-effects.rod_backlash, effects.rod_backlash]
    parent.add_site(name="bar_end", pos=pose[1], quat=quat_wxyz(pose[0]))


def _add_base(spec: mujoco.MjSpec, geometry: Geometry, stiffness: float) -> mujoco.MjsBody:
    base = spec.worldbody.add_body(name="bar_base", pos=geometry.origin)
    base.mass, base.inertia, base.explicitinertial, base.gravcomp = (
        BASE_MASS,
        [0.01, 0.01, 0.01],
        True,
        1.0,
    )
    for axis, name in enumerate(BASE_JOINTS):
        slide = base.add_joint(name=name, type=_SLIDE, axis=np.eye(3)[axis])
        slide.stiffness[0], slide.damping[0] = stiffness, BASE_DAMPING * stiffness
    return base


def _set_inertia(body: mujoco.MjsBody, link: Link) -> None:
    body.mass, body.ipos, body.explicitinertial = link.mass, link.com, True
    body.fullinertia = link.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

"""MuJoCo model of one cell: robot, offset plate and ball-bar, closed by a weld at the tool.

Every DH row becomes a body: body i stands at `Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)` of row i-1
in its parent and turns about its own z, so that all parameters, errors included, enter as doubles.

Gear i turns a combination of joints (parallel rod, wrist couplings). With elastic gears, the rotor
of motor i is a body of its own that turns by the gear's output angle (hinge `g`, with the rotor's
inertia referred to the output). Servo, friction and ripple act on it; a fixed tendon over the
joints and the rotor is spring, damper and backlash of the gear. With rigid gears there are no
rotors, and the motor acts on a fixed tendon over the joints. Recipes and their measurements:
notes/plant secs. 1, 2, 4, 8, 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import bar_bodies, flange_on_last_link, link_bodies
from ballbar.cell.chain import row_placements
from ballbar.cell.geometry import BAR_ROWS, Geometry
from ballbar.cell.rotation import quat_wxyz
from ballbar.sim.plant.effects import Plant, PlantEffects
from ballbar.sim.plant.mjcf_parts import (
    add_gear_tendon,
    add_links,
    compiled,
    empty_spec,
    set_inertia,
)

WELD_SOLREF = (-1e9, -6e4)  # closure 0.1 um at 1 ms under `discrete` (notes/plant sec. 2)
WELD_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # (notes/plant sec. 2)
PASSIVE = 16  # dcmotor without a control input: mjtCtrlSpec "none" (notes/plant sec. 4)
BRISTLE_TRAVEL = 2e-5  # [rad] shortest pre-sliding of the friction model: below the gears' backlash
# [rad/s] highest natural frequency of bristle and rotor: MuJoCo integrates the bristle explicitly,
# and above this frequency it chatters (notes/plant sec. 4)
BRISTLE_RATE = 200.0
BRISTLE_DAMPING = 0.7  # damping ratio of bristle and rotor
HYSTERESIS_STIFFNESS = 4.0  # of the gear's: the friction element slips early in the loop
# [kg m^2] a third of the plate's inertia about the hinge; the tip itself has no mass in the model
PLATE_ARMATURE = 0.02
PLATE_DAMPING = 1e-3  # [s] of the plate's stiffness
ROTOR_MASS, ROTOR_INERTIA = 1e-9, 1e-9  # [kg, kg m^2] of the body: its joint's armature counts
RING_INERTIA = 2e-3  # [kg m^2] least inertia at a ball-bar joint, for its friction model
BAR_STRIBECK = 0.01  # [rad/s] of the ball-bar's bearings; no effect, static is Coulomb friction
BASE_MASS = 5.0  # [kg] steel base adapter, assumed; its weight belongs to the base pose
BASE_DAMPING = 1e-3  # [s] of the base's stiffness

MOST_AXES = 8  # of a robot's file (ballbar.cell.description_files)
ROBOT_JOINTS = tuple(f"q{i + 1}" for i in range(MOST_AXES))
ROTORS = tuple(f"g{i + 1}" for i in range(MOST_AXES))
BAR_JOINTS = tuple(f"b{i + 1}" for i in range(BAR_ROWS))
BASE_JOINTS = ("base_x", "base_y", "base_z")
ROD_JOINT, PLATE_JOINT = "rod", "plate"
SEAT_JOINT, SLIDE_JOINT = "seat_cup", "slide"  # of a telescoping rod

_OFF = mujoco.mjtDisableBit
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


@dataclass(frozen=True, eq=False)
class PlantModel:
    """A compiled model and the indices of its coordinates in qpos, empty where an effect is off."""

    model: mujoco.MjModel
    joints: NDArray[np.intp]  # (J,) q1..qJ
    rotors: NDArray[np.intp]  # (J,) or (0,) g1..gJ
    bar: NDArray[np.intp]  # (5,) b1..b5, or (0,)
    rod: NDArray[np.intp]  # (1,) or (0,) elongation of the ball-bar's rod
    slide: NDArray[np.intp]  # (1,) or (0,) of a telescoping rod
    plate: NDArray[np.intp]  # (1,) or (0,)
    base: NDArray[np.intp]  # (3,) or (0,)


def plant_model(plant: Plant, *, timestep: float) -> PlantModel:
    """The compiled model of a plant. Raises ValueError when MuJoCo refuses it."""
    return plant_model_of(plant_spec(plant, timestep=timestep))


def plant_model_of(spec: mujoco.MjSpec) -> PlantModel:
    """The compiled model of a specification. Raises ValueError when MuJoCo refuses it."""
    model = compiled(spec)
    address = {model.joint(i).name: int(model.jnt_qposadr[i]) for i in range(model.njnt)}

    def indices(joints: tuple[str, ...]) -> NDArray[np.intp]:
        return np.array([address[name] for name in joints if name in address], dtype=np.intp)

    return PlantModel(
        model=model,
        joints=indices(ROBOT_JOINTS),
        rotors=indices(ROTORS),
        bar=indices(BAR_JOINTS),
        rod=indices((ROD_JOINT,)),
        slide=indices((SLIDE_JOINT,)),
        plate=indices((PLATE_JOINT,)),
        base=indices(BASE_JOINTS),
    )


def plant_spec(plant: Plant, *, timestep: float) -> mujoco.MjSpec:
    """The model of a plant as a specification, to be compiled or written as XML."""
    spec = unloaded_robot_spec(plant, timestep=timestep)
    spec.modelname = f"{plant.cell.robot.name} with {plant.cell.ballbar.name}"
    _add_bar(spec, plant)
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


def unloaded_robot_spec(plant: Plant, *, timestep: float) -> mujoco.MjSpec:
    """Robot and plate without the ball-bar, as a specification."""
    robot = plant.cell.robot
    spec = empty_spec(robot.name, timestep=timestep, gravity=robot.gravity)
    if plant.effects.force_sensor:  # the sensors of the flange are all that is read
        spec.option.disableflags &= ~int(_OFF.mjDSBL_SENSOR)
    _add_robot(spec, plant)
    _add_gears(spec, plant)
    return spec


def _add_robot(spec: mujoco.MjSpec, plant: Plant) -> None:
    cell, geometry, effects = plant.loaded, plant.geometry, plant.effects
    placements = row_placements(geometry.robot)
    parent, rotation, position = add_links(spec, link_bodies(cell.robot), placements)
    turned, flange = flange_on_last_link(cell)
    plate = parent.add_body(name="plate", pos=flange, quat=quat_wxyz(turned))
    set_inertia(plate, cell.plate.body)
    tool = (turned.T @ rotation, turned.T @ (position - flange))
    if effects.plate_stiffness is None:
        plate.add_site(name="tool", pos=tool[1], quat=quat_wxyz(tool[0]))
    else:
        length = geometry[geometry.table.plate]
        _add_bending_plate(plate, tool, length, effects.plate_stiffness)
    if effects.force_sensor:
        plate.add_site(name="flange")
        site = mujoco.mjtObj.mjOBJ_SITE
        for name, kind in (
            ("force", mujoco.mjtSensor.mjSENS_FORCE),
            ("torque", mujoco.mjtSensor.mjSENS_TORQUE),
        ):
            spec.add_sensor(name=name, type=kind, objtype=site, objname="flange")


def _add_bending_plate(
    flange: mujoco.MjsBody, tool: tuple[Array, Array], length: float, tip_stiffness: float
) -> None:
    """The tool on a hinge about the plate's y, two thirds of its length from the tool.

    Under a load at the tip its deflection and tilt are those of a cantilever. tool : rotation
    (3, 3) and position (3,) [m] in the flange's frame. length : [m]. tip_stiffness : [N/m]. Source:
    notes/plant sec. 1.
    """
    rotation, position = tool
    arm = np.array([2.0 * length / 3.0, 0.0, 0.0])
    tip = flange.add_body(name="plate_tip", pos=position - rotation @ arm, quat=quat_wxyz(rotation))
    tip.mass, tip.inertia, tip.explicitinertial = 1e-9, [1e-9, 1e-9, 1e-9], True
    hinge = tip.add_joint(name=PLATE_JOINT, type=_HINGE, axis=[0, 1, 0], armature=PLATE_ARMATURE)
    hinge.stiffness[0] = tip_stiffness * arm[0] ** 2
    hinge.damping[0] = PLATE_DAMPING * hinge.stiffness[0]
    tip.add_site(name="tool", pos=arm)


def _add_gears(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Servo, rotor, friction and ripple of each motor; spring, damper and backlash of each gear."""
    robot, effects, gains = plant.cell.robot, plant.effects, plant.gains
    joint_to_gear, gears = robot.joint_to_gear, robot.required("gears")
    motors = []
    for i, turned in enumerate(joint_to_gear.T):
        if effects.gear_stiffness is None:
            motors.append(_shaft(spec, f"motor{i + 1}", turned))
        else:
            spring = (float(effects.gear_stiffness[i]), float(gears.damping[i]))
            motors.append(_elastic_gear(spec, i, turned, effects, spring))
    for i, motor in enumerate(motors):
        motor.part.armature = float(robot.required("rotor_inertia_kg_m2")[i])
        servo = spec.add_actuator(name=f"servo{i + 1}", target=motor.part.name, trntype=motor.kind)
        servo.set_to_position(kp=float(gains.kp[i]), kv=float(gains.kv[i]))
        if effects.friction_scale > 0.0:
            scale = effects.friction_scale
            motor.part.damping[0] = scale * float(gears.viscous[i])
            static = gears.static[i] if effects.stribeck else gears.coulomb[i]
            _friction(
                spec,
                motor,
                coulomb=scale * float(gears.coulomb[i]),
                static=scale * float(static),
                stribeck=float(gears.stribeck[i]),
                inertia=float(robot.required("rotor_inertia_kg_m2")[i]),
            )
    for k, ripple in enumerate(effects.ripples):
        torque = [float(gains.kp[ripple.gear]) * ripple.amplitude, ripple.order, ripple.phase]
        _passive(spec, f"ripple{k}", motors[ripple.gear], cogging=torque)


@dataclass(frozen=True)
class _Shaft:
    """The part that a motor turns: its rotor, or with rigid gears one or several joints."""

    part: mujoco.MjsJoint | mujoco.MjsTendon
    kind: mujoco.mjtTrn


def _elastic_gear(
    spec: mujoco.MjSpec,
    i: int,
    coefficients: Array,
    effects: PlantEffects,
    elasticity: tuple[float, float],
) -> _Shaft:
    """Rotor i, and the spring over what the joints have turned less what the rotor shows.

    elasticity : stiffness [N m/rad] and damping [N m s/rad].
    """
    stiffness, damping = elasticity
    backlash, hysteresis = float(effects.gear_backlash[i]), float(effects.gear_hysteresis[i])
    body = spec.worldbody.add_body(name=f"rotor{i + 1}")
    body.mass, body.inertia, body.explicitinertial = ROTOR_MASS, [ROTOR_INERTIA] * 3, True
    rotor = body.add_joint(name=ROTORS[i], type=_HINGE, axis=[0, 0, 1])
    spring = add_gear_tendon(spec, f"gear{i + 1}", coefficients, rotor=ROTORS[i])
    spring.springlength = [-backlash, backlash]
    spring.stiffness[0], spring.damping[0] = stiffness, damping
    if hysteresis > 0.0:
        friction = add_gear_tendon(spec, f"gear{i + 1}_friction", coefficients, rotor=ROTORS[i])
        friction.springlength = [0.0, 0.0]
        friction.stiffness[0] = HYSTERESIS_STIFFNESS * stiffness
        friction.springyield = hysteresis / HYSTERESIS_STIFFNESS
    return _Shaft(rotor, mujoco.mjtTrn.mjTRN_JOINT)


def _shaft(spec: mujoco.MjSpec, name: str, coefficients: Array) -> _Shaft:
    turned = np.flatnonzero(coefficients)
    if turned.size == 1 and coefficients[turned[0]] == 1.0:  # a joint costs a third of a tendon
        return _Shaft(spec.joint(ROBOT_JOINTS[turned[0]]), mujoco.mjtTrn.mjTRN_JOINT)
    return _Shaft(add_gear_tendon(spec, name, coefficients), mujoco.mjtTrn.mjTRN_TENDON)


def _friction(
    spec: mujoco.MjSpec,
    shaft: _Shaft,
    *,
    coulomb: float,
    static: float,
    stribeck: float,
    inertia: float,
) -> None:
    """LuGre friction on a shaft of this inertia.

    Its bristle is as stiff as BRISTLE_TRAVEL asks for, or softer where it would chatter.
    """
    bristle = min(static / BRISTLE_TRAVEL, inertia * BRISTLE_RATE**2)
    damping = 2.0 * BRISTLE_DAMPING * float(np.sqrt(bristle * inertia))
    lugre = [bristle, damping, coulomb, static, stribeck]
    _passive(spec, f"friction_{shaft.part.name}", shaft, lugre=lugre)


def _passive(spec: mujoco.MjSpec, name: str, shaft: _Shaft, **torque: list[float]) -> None:
    """A torque that depends on position or speed only: a shorted motor without motor constant."""
    actuator = spec.add_actuator(name=name, target=shaft.part.name, trntype=shaft.kind)
    actuator.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, ctrlspec=PASSIVE, **torque)


def _add_bar(spec: mujoco.MjSpec, plant: Plant) -> None:
    bar, geometry, effects = plant.cell.ballbar, plant.geometry, plant.effects
    parent, position = spec.worldbody, geometry.origin
    rotation = geometry.bar_base_rotation
    placements = row_placements(geometry.bar)
    if effects.base_stiffness is not None:
        parent, position = _add_base(spec, geometry, effects.base_stiffness), np.zeros(3)
    for i, link in enumerate(bar_bodies(plant.loaded)):
        parent = parent.add_body(name=f"bar{i + 1}", pos=position, quat=quat_wxyz(rotation))
        set_inertia(parent, link)
        damping = float(bar.joint_damping[i])
        hinge = parent.add_joint(name=BAR_JOINTS[i], type=_HINGE, axis=[0, 0, 1], damping=damping)
        if i == 2:
            slide = parent.add_joint(name=ROD_JOINT, type=_SLIDE, axis=[0, 0, 1])
            slide.damping[0] = bar.axial_damping
            if effects.rod_backlash == 0.0:
                slide.stiffness[0] = effects.rod_stiffness
        if effects.bar_friction > 0.0:
            _friction(
                spec,
                _Shaft(hinge, mujoco.mjtTrn.mjTRN_JOINT),
                coulomb=effects.bar_friction,
                static=effects.bar_friction,
                stribeck=BAR_STRIBECK,
                inertia=RING_INERTIA,
            )
        rotation, position = placements[i]
    if effects.rod_backlash > 0.0:
        rod = spec.add_tendon(name="rod_spring")
        rod.wrap_joint(ROD_JOINT, 1.0)
        rod.stiffness[0] = effects.rod_stiffness
        rod.springlength = [-effects.rod_backlash, effects.rod_backlash]
    parent.add_site(name="bar_end", pos=position, quat=quat_wxyz(rotation))


def _add_base(spec: mujoco.MjSpec, geometry: Geometry, stiffness: float) -> mujoco.MjsBody:
    base = spec.worldbody.add_body(name="bar_base", pos=geometry.origin)
    base.mass, base.inertia, base.explicitinertial = BASE_MASS, [0.01, 0.01, 0.01], True
    base.gravcomp = 1.0
    for axis, name in enumerate(BASE_JOINTS):
        slide = base.add_joint(name=name, type=_SLIDE, axis=np.eye(3)[axis])
        slide.stiffness[0], slide.damping[0] = stiffness, BASE_DAMPING * stiffness
    return base

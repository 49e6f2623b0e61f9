"""MuJoCo plant of a robot that no closed chain holds: before a telescoping bar, a draw-wire, or a
tracker that follows it.

The servos and gears are those of ballbar.sim.plant.mujoco_plant. The run begins once the arm has
come to rest under its first command. A rod turns in two magnetic cups, from a seat in the world to
a site on the robot; along it act the spring of its length sensor, the friction of its slide and its
weight. A wire pulls with its tension. A tracker exerts no force.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Link
from ballbar.cell.geometry import robot_frames
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.rotation import quat_wxyz
from ballbar.sim.motion import Motion, MotionCallback
from ballbar.sim.path import ReferencePath, axis_range_fault
from ballbar.sim.plant import mujoco_plant
from ballbar.sim.plant.effects import Plant
from ballbar.sim.plant.kinematic_plant import bar_at
from ballbar.sim.plant.mjcf import (
    SEAT_JOINT,
    SLIDE_JOINT,
    WELD_SOLIMP,
    WELD_SOLREF,
    PlantModel,
    plant_model_of,
    unloaded_robot_spec,
)
from ballbar.sim.plant.mjcf_parts import set_inertia
from ballbar.sim.settings import RodAndWire

# [s] the arm's slowest oscillation decays by a factor of a thousand in the first second (as in
# ballbar.sim.plant.held)
SETTLING = 2.0
_ROD_RADIUS = 0.01  # [m] for its inertia about itself, assumed
_CUP_DAMPING = 0.02  # [N m s/rad] of the cups: only how the rod comes to rest
_SLIDE_DAMPING = 1.0  # [N s/m] of the slide: only how the rod comes to rest


def run_with_instrument(
    plant: Plant,
    path: ReferencePath,
    *,
    instrument: Instrument,
    forces: RodAndWire,
    timestep: float,
    gravity_compensation: bool = True,
    on_motion: MotionCallback | None = None,
) -> Motion:
    """Motion of the true robot along a path; other arguments as of `run_plant`.

    Raises PlantError on divergence, when the rod's end leaves its cup by more than CLOSURE_LIMIT,
    or when an axis leaves its range.
    """
    model = _model(plant, instrument, forces, timestep)
    t = np.arange(round(path.t[-1] / timestep) + 1) * timestep
    command = mujoco_plant.servo_command(plant, path, t, gravity_compensation=gravity_compensation)
    if is_wire(instrument) and not instrument.follows:
        command = np.column_stack((command, np.ones(t.size)))
    start = _start(plant, model, instrument, path.q[0])
    run = mujoco_plant.PlantRun(plant, model, start, command, timestep)
    rest = replace(run, command=np.repeat(command[:1], round(SETTLING / timestep), axis=0))
    settled = mujoco_plant.roll_out(rest)[0][-1].copy()
    settled[0] = 0.0

    def on_states(states: Array) -> None:
        if on_motion is not None:
            q = states[:, 1 + model.joints]
            b = np.column_stack(bar_at(plant.geometry, q, mujoco_plant.bending(model, states)))
            on_motion(plant.cell, plant.geometry, states[:, 0], q, b)

    states, _ = mujoco_plant.roll_out(replace(run, start=settled), on_states)
    motion = _motion(run, 0.0 if instrument.follows else forces.wire_tension_N, forces, states)
    _check_cup(model, instrument, states, motion)
    if fault := axis_range_fault(plant.cell.robot, motion.t, motion.q):
        raise mujoco_plant.PlantError(fault[1])
    return motion


def _model(plant: Plant, instrument: Instrument, forces: RodAndWire, timestep: float) -> PlantModel:
    spec = unloaded_robot_spec(plant, timestep=timestep)
    slide = None
    if not instrument.follows:
        slide = add_instrument(spec, instrument, forces, seat=plant.geometry.origin, site="tool")
    if slide is not None:
        # Dry friction of the solver, stiff: it slides from micrometres a second on. A bristle
        # (LuGre) that can be integrated explicitly is so soft that a stroke of 0.3 mm hardly leaves
        # it.
        slide.frictionloss, slide.solimp_friction = forces.rod_friction_N, WELD_SOLIMP
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    return plant_model_of(spec)


def _start(plant: Plant, compiled: PlantModel, instrument: Instrument, q: Array) -> Array:
    """(nstate,) full physics state with the robot at joint angles q (6,) [rad], without loads."""
    model, robot, geometry = compiled.model, plant.cell.robot, plant.geometry
    data, gears = mujoco.MjData(model), q[None] @ robot.joint_to_gear
    data.qpos[compiled.joints] = q
    if compiled.rotors.size:
        data.qpos[compiled.rotors] = (gears + plant.effects.transmission_error(gears))[0]
    if compiled.slide.size:
        end = robot_frames(geometry, q[None]).tip[:, 0]
        cup = int(model.joint(SEAT_JOINT).qposadr[0])
        data.qpos[cup : cup + 5] = rod_position(geometry.origin, end, instrument.nominal)
    return mujoco_plant.full_state(model, data)


def _motion(run: mujoco_plant.PlantRun, pull: float, forces: RodAndWire, states: Array) -> Motion:
    compiled = run.compiled
    q, plate = states[:, 1 + compiled.joints], mujoco_plant.bending(compiled, states)
    shown, torque = mujoco_plant.servo_motion(run, states)
    b, stretch = bar_at(run.plant.geometry, q, plate)
    force = np.full(len(states), pull)
    if compiled.slide.size:
        force = forces.rod_spring_N_per_m * states[:, 1 + compiled.slide[0]]
    return Motion(
        t=np.arange(len(states), dtype=np.float64) * run.timestep,
        q=q,
        shown=shown,
        b=b,
        rod_stretch=stretch,
        rod_force=force,
        geometry=run.plant.geometry,
        torque=torque,
        plate=plate,
    )


def _check_cup(compiled: PlantModel, instrument: Instrument, states: Array, motion: Motion) -> None:
    """Raises PlantError where the rod does not end at the tool."""
    if not compiled.slide.size:
        return
    rod = instrument.nominal + states[:, 1 + compiled.slide[0]]
    open_by = np.abs(rod - motion.rod_stretch - motion.geometry["bd3"])
    if open_by.max() > mujoco_plant.CLOSURE_LIMIT:
        k = int(open_by.argmax())
        raise mujoco_plant.PlantError(
            f"not simulated exactly enough: the rod ends {open_by[k] * 1e6:.2f} um from the tool "
            f"at t = {motion.t[k]:.2f} s (limit {mujoco_plant.CLOSURE_LIMIT * 1e6:g} um). Halve "
            "plant.timestep_s, or lengthen path.duration_s"
        )


def is_wire(instrument: Instrument) -> bool:
    """Whether an instrument of lengths is a wire: its stroke is longer than its shortest length."""
    return instrument.upper > 2.0 * instrument.lower


def add_instrument(
    spec: mujoco.MjSpec, instrument: Instrument, settings: RodAndWire, *, seat: Array, site: str
) -> mujoco.MjsJoint | None:
    """Adds the rod or the wire of an instrument of lengths, from a seat (3,) [m] to a site.

    A rod is two halves of equal mass, the second on the slide, its end in the cup at the site; a
    wire pulls with its tension times its control.

    Returns the slide; None for a wire.
    """
    if is_wire(instrument):
        spec.worldbody.add_site(name="fairlead", pos=seat)
        wire = spec.add_tendon(name="wire")
        wire.wrap_site("fairlead")
        wire.wrap_site(site)
        pull = spec.add_actuator(name="tension", target="wire", trntype=mujoco.mjtTrn.mjTRN_TENDON)
        pull.set_to_motor()
        pull.gear[0] = -settings.wire_tension_N
        return None
    half, length = 0.5 * settings.rod_mass_kg, instrument.nominal
    across = half * (length**2 / 48.0 + _ROD_RADIUS**2 / 4.0)
    inertia = np.diag([across, across, half * _ROD_RADIUS**2 / 2.0])
    lower = spec.worldbody.add_body(name="rod_lower", pos=seat)
    set_inertia(lower, Link(half, np.array([0.0, 0.0, 0.25 * length]), inertia))
    lower.add_joint(name=SEAT_JOINT, type=mujoco.mjtJoint.mjJNT_BALL, damping=_CUP_DAMPING)
    upper = lower.add_body(name="rod_upper")
    set_inertia(upper, Link(half, np.array([0.0, 0.0, 0.75 * length]), inertia))
    slide = upper.add_joint(name=SLIDE_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    slide.stiffness[0] = settings.rod_spring_N_per_m
    slide.damping[0] = _SLIDE_DAMPING
    upper.add_site(name="rod_end", pos=[0.0, 0.0, length])
    cup = spec.add_equality(
        name="tool_cup",
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1="rod_end",
        name2=site,
    )
    cup.solref, cup.solimp = WELD_SOLREF, WELD_SOLIMP
    return slide


def rod_position(seat: Array, end: Array, length: float) -> Array:
    """(5,) coordinates of cup (wxyz) and slide [m] of a rod from seat (3,) to end (3,) [m]."""
    rod = end - seat
    distance = float(np.linalg.norm(rod))
    z = rod / distance
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    rotation = np.stack((x, np.cross(z, x), z), axis=1)
    return np.append(quat_wxyz(rotation), distance - length)

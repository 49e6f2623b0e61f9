"""Telescoping rod and draw-wire in MuJoCo, from a seat in the world to a site on the robot.

A rod turns in two magnetic cups; along it act the spring of its length sensor, the friction of its
slide and its weight, and nothing closes the chain beyond that. A wire pulls with its tension.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cell.arrays import Array
from cell.descriptions import Link
from cell.instrument import Instrument
from cell.rotation import quat_wxyz
from sim.plant.mjcf import SEAT_JOINT, SLIDE_JOINT, WELD_SOLIMP, WELD_SOLREF, set_inertia
from sim.settings import RodAndWire

_ROD_RADIUS = 0.01  # [m] for its inertia about itself, assumed
_CUP_DAMPING = 0.02  # [N m s/rad] of the cups: only how the rod comes to rest
_SLIDE_DAMPING = 1.0  # [N s/m] likewise


def is_wire(instrument: Instrument) -> bool:
    """Whether an instrument of lengths is a wire: its stroke is longer than its shortest length."""
    return instrument.upper > 2.0 * instrument.lower


def add_rod(
    spec: mujoco.MjSpec, length: float, settings: RodAndWire, *, seat: Array, site: str
) -> mujoco.MjsJoint:
    """Adds two halves of equal mass, the second on the slide, its end in the cup at a site.

    length : [m] where the slide is at 0. seat : (3,) [m]. Returns the slide.
    """
    half = 0.5 * settings.rod_mass_kg
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


def add_wire(spec: mujoco.MjSpec, tension: float, *, seat: Array, site: str) -> None:
    """Adds a wire that pulls a site to the seat (3,) [m] with a tension [N] times its control."""
    spec.worldbody.add_site(name="fairlead", pos=seat)
    wire = spec.add_tendon(name="wire")
    wire.wrap_site("fairlead")
    wire.wrap_site(site)
    pull = spec.add_actuator(name="tension", target="wire", trntype=mujoco.mjtTrn.mjTRN_TENDON)
    pull.set_to_motor()
    pull.gear[0] = -tension


def rod_position(seat: Array, end: Array, length: float) -> Array:
    """(5,) coordinates of cup (wxyz) and slide [m] of a rod from seat (3,) to end (3,) [m]."""
    rod = end - seat
    distance = float(np.linalg.norm(rod))
    return np.append(quat_wxyz(_with_z(rod / distance)), distance - length)


def _with_z(direction: Array) -> Array:
    """(3, 3) a rotation whose z axis is a unit vector (3,)."""
    other = np.eye(3)[int(np.abs(direction).argmin())]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(direction, x), direction), axis=1)

"""Parts that the MuJoCo models of all plants share: options, links, tendons of gears."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Link
from ballbar.cell.rotation import quat_wxyz

# Tolerance of the implicit solve; from 1e-3 down to 1e-14 no coordinate of 60 s moves by more than
# 1e-13.
SOLVER_TOLERANCE = 1e-4
_OFF = mujoco.mjtDisableBit
# There are no contacts and no limits, and the solve is linear; a divergence must show, not reset.
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


def empty_spec(name: str, *, timestep: float, gravity: Array) -> mujoco.MjSpec:
    """A specification without bodies, with the integrator and solver of all plants."""
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = SOLVER_TOLERANCE
    option.gravity = gravity
    option.disableflags = int(UNUSED)
    return spec


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a specification, every site at its own pose.

    MuJoCo takes a site within 1e-6 of its body's frame for identical with it (notes/plant
    sec. 7.1), which would be an error of 0.9 urad.
    """
    model = spec.compile()
    model.site_sameframe[:] = 0
    return model


def add_links(
    spec: mujoco.MjSpec, links: Sequence[Link], rows: Sequence[tuple[Array, Array]]
) -> tuple[mujoco.MjsBody, Array, Array]:
    """Adds the links of a robot, each turning about its own z.

    rows : rotation (3, 3) and position (3,) [m] of each DH row in the one before.

    Returns the last link, and rotation and position of the last row in it.
    """
    parent, rotation, position = spec.worldbody, np.eye(3), np.zeros(3)
    for i, (link, row) in enumerate(zip(links, rows, strict=True)):
        parent = parent.add_body(name=f"link{i + 1}", pos=position, quat=quat_wxyz(rotation))
        set_inertia(parent, link)
        parent.add_joint(name=f"q{i + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        rotation, position = row
    return parent, rotation, position


def add_gear_tendon(
    spec: mujoco.MjSpec, name: str, coefficients: Array, rotor: str | None = None
) -> mujoco.MjsTendon:
    """The combination of joints that a gear turns, less the angle of its rotor."""
    tendon = spec.add_tendon(name=name)
    for i in np.flatnonzero(coefficients):
        tendon.wrap_joint(f"q{i + 1}", float(coefficients[i]))
    if rotor is not None:
        tendon.wrap_joint(rotor, -1.0)
    return tendon


def set_inertia(body: mujoco.MjsBody, link: Link) -> None:
    """Gives a body the mass properties of a link, in the body's frame."""
    body.mass, body.ipos, body.explicitinertial = link.mass, link.com, True
    body.fullinertia = link.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

"""The MuJoCo model of one cell: robot, offset plate and ball-bar, closed by a weld at the tool.

Every DH row becomes a body: body i stands at `Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)` of row i-1 in its parent and turns
about its own z, so all parameters of all rows, errors included, enter as doubles. Rod and ball-bar joints are one spring:
a slide along the rod. Settings and their measurements: mujoco_facts secs. 1, 2, 8, 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from cell.chain import Array, Chain, forward
from cell.descriptions import Cell, Link, ServoGains
from cell.geometry import BAR_ROWS, ROBOT_ROWS, Geometry
from sim.bodies import bar_bodies, robot_bodies

WELD_SOLREF = (-1e9, -6e4)  # closure 0.1 um at 1 ms under `discrete` (mujoco_facts sec. 2)
WELD_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
SOLVER_TOLERANCE = 1e-14  # 0 would burn every iteration (mujoco_facts sec. 2)

ROBOT_JOINTS = tuple(f"q{i + 1}" for i in range(ROBOT_ROWS))
BAR_JOINTS = tuple(f"b{i + 1}" for i in range(BAR_ROWS))
ROD_JOINT = "rod"


@dataclass(frozen=True, eq=False)
class PlantModel:
    """A compiled model and where its joints are."""

    model: mujoco.MjModel
    robot: Array  # (6,) positions of q1..q6 in qpos and qvel
    bar: Array  # (5,) of b1..b5
    rod: int  # of the rod's stretch


def plant_spec(cell: Cell, geometry: Geometry, gains: ServoGains, *, timestep: float) -> mujoco.MjSpec:
    """The model as a specification: compile it, or write it as XML.

    geometry : true kinematic parameters, encoder zeros left out (they belong to the encoders).
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{cell.robot.name} with {cell.ballbar.name}"
    spec.compiler.degree = False
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = SOLVER_TOLERANCE
    option.gravity = cell.robot.gravity
    flags = mujoco.mjtDisableBit
    option.disableflags = flags.mjDSBL_CONTACT | flags.mjDSBL_ISLAND | flags.mjDSBL_AUTORESET
    _add_robot(spec, cell, geometry, gains)
    _add_bar(spec, cell, geometry)
    weld = spec.add_equality(name="closure", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_SITE, name1="bar_end", name2="tool")
    weld.solref = WELD_SOLREF
    weld.solimp = WELD_SOLIMP
    return spec


def plant_model(cell: Cell, geometry: Geometry, gains: ServoGains, *, timestep: float) -> PlantModel:
    """The compiled model of a cell with the given true geometry. Raises ValueError when MuJoCo refuses it."""
    model = plant_spec(cell, geometry, gains, timestep=timestep).compile()
    model.site_sameframe[:] = 0  # MuJoCo takes a site within 1e-6 of its body frame for identical (mujoco_facts sec. 7.1)
    addresses = [np.array([model.joint(name).qposadr[0] for name in names]) for names in (ROBOT_JOINTS, BAR_JOINTS)]
    return PlantModel(model, addresses[0], addresses[1], int(model.joint(ROD_JOINT).qposadr[0]))


def _add_robot(spec: mujoco.MjSpec, cell: Cell, geometry: Geometry, gains: ServoGains) -> None:
    robot, parent = cell.robot, spec.worldbody
    placements = row_placements(geometry.robot)
    pose = (np.eye(3), np.zeros(3))
    for i, links in enumerate(robot_bodies(cell).links):
        body = parent.add_body(name=f"link{i + 1}", pos=pose[1], quat=_quat_wxyz(pose[0]))
        _set_inertia(body, links)
        body.add_joint(
            name=ROBOT_JOINTS[i],
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            damping=float(robot.damping[i]),
            armature=float(robot.armature[i]),
        )
        actuator = spec.add_actuator(name=f"servo{i + 1}", target=ROBOT_JOINTS[i], trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=float(gains.kp[i]), kv=float(gains.kv[i]))
        parent, pose = body, placements[i]
    parent.add_site(name="tool", pos=pose[1], quat=_quat_wxyz(pose[0]))


def _add_bar(spec: mujoco.MjSpec, cell: Cell, geometry: Geometry) -> None:
    bar, parent = cell.ballbar, spec.worldbody
    placements = row_placements(geometry.bar)
    pose = (geometry.bar_base_rotation, geometry.origin)
    for i, links in enumerate(bar_bodies(cell).links):
        body = parent.add_body(name=f"bar{i + 1}", pos=pose[1], quat=_quat_wxyz(pose[0]))
        _set_inertia(body, links)
        body.add_joint(name=BAR_JOINTS[i], type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], damping=float(bar.joint_damping[i]))
        if i == 2:
            body.add_joint(
                name=ROD_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], stiffness=bar.axial_stiffness, damping=bar.axial_damping
            )
        parent, pose = body, placements[i]
    parent.add_site(name="bar_end", pos=pose[1], quat=_quat_wxyz(pose[0]))


def row_placements(chain: Chain) -> list[tuple[Array, Array]]:
    """(rotation (3, 3), translation (3,) [m]) of each row at joint angle zero, in the frame that turns with its joint."""
    out = []
    for i in range(chain.rows):
        row = Chain(*(values[i : i + 1] for values in (chain.a, chain.d, chain.alpha, chain.theta, chain.beta)))
        frames = forward(row, np.zeros((1, 1)))
        out.append((frames.rotation()[:, :, 0], frames.tip[:, 0]))
    return out


def _set_inertia(body: mujoco.MjsBody, links: tuple[Link, ...]) -> None:
    """One rigid body of all links: masses add up, inertias by the parallel axis theorem."""
    mass = sum(link.mass for link in links)
    com = sum(link.mass * link.com for link in links) / mass
    inertia = np.zeros((3, 3))
    for link in links:
        arm = link.com - com
        inertia += link.inertia + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    body.mass, body.ipos, body.explicitinertial = mass, com, True
    body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _quat_wxyz(rotation: Array) -> Array:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation).reshape(9))
    return quat

"""Statics of the closed mechanism without MuJoCo: where it comes to rest, and the force in the rod.

Minimises servo, gravity and rod energy over robot angles q, ball-bar angles b and rod stretch s, subject to the closed loop:

    V = 1/2 sum kp (q - u)^2 + V_gravity(q, b) + 1/2 k s^2,    c(q, b, s) = 0

by Newton steps on the Lagrangian with the servo and rod stiffness as Hessian. What that leaves out (the curvature of the
loop under the rod force, of gravity) is a few hundredths of the servo stiffness, so each step gains one to two digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.chain import Array, Chain, Frames, joint_screws, screw
from cell.descriptions import Cell, ServoGains
from cell.geometry import Geometry, bar_frames, robot_frames
from cell.inverse import pose_mismatch
from sim.bodies import MovingBodies, bar_bodies, gravity_load, robot_bodies

_MAX_STEPS = 200
_FORCE_TOLERANCE = 1e-9  # [N m] remaining generalised force
_CLOSURE_TOLERANCE = 1e-13  # [m, rad]


class NoEquilibriumError(ValueError):
    """The mechanism found no rest near the start."""


@dataclass(frozen=True, eq=False)
class Rest:
    """One held pose."""

    q: Array  # (6,) [rad]
    b: Array  # (5,) [rad]
    stretch: float  # [m] of the rod
    rod_force: float  # [N] tension positive


def gravity_torque(cell: Cell, geometry: Geometry, q: Array) -> Array:
    """(N, 6) [N m] torque that holds the free robot with its plate against gravity at q (N, 6) [rad]."""
    frames = robot_frames(geometry, q)
    return _gravity_gradient(geometry.robot, q, frames, robot_bodies(cell), cell.robot.gravity).T


def rest(cell: Cell, geometry: Geometry, gains: ServoGains, command: Array, q: Array, b: Array) -> Rest:
    """Where the mechanism rests when the servos are told `command` (6,) [rad]; q (6,), b (5,) [rad] is a start close by.

    Raises NoEquilibriumError when the steps do not converge.
    """
    bodies = (robot_bodies(cell), bar_bodies(cell))
    stiffness = np.concatenate((gains.kp, np.zeros(5), [cell.ballbar.axial_stiffness]))
    x = np.concatenate((q, b, [0.0]))
    goal = np.concatenate((command, np.zeros(6)))
    multipliers = np.zeros(6)
    for _ in range(_MAX_STEPS):
        closed, columns, load = _loop(geometry, bodies, cell.robot.gravity, x)
        force = stiffness * (x - goal) + load
        if np.abs(closed).max() < _CLOSURE_TOLERANCE and np.abs(force + columns.T @ multipliers).max() < _FORCE_TOLERANCE:
            return Rest(x[:6], x[6:11], float(x[11]), float(cell.ballbar.axial_stiffness * x[11]))
        system = np.block([[np.diag(stiffness), columns.T], [columns, np.zeros((6, 6))]])
        solution = np.linalg.solve(system, -np.concatenate((force, closed)))
        x, multipliers = x + solution[:12], solution[12:]
    raise NoEquilibriumError(f"statics: no equilibrium in {_MAX_STEPS} steps; loop open by {np.abs(closed).max():.3g}")


def _loop(geometry: Geometry, bodies: tuple[MovingBodies, MovingBodies], gravity: Array, x: Array) -> tuple[Array, Array, Array]:
    """Closure (6,), its Jacobian (6, 12) and the gravity gradient (12,) at x = (q, b, stretch)."""
    q, b = x[None, :6], x[None, 6:11]
    stretched = geometry.replaced({"bd3": geometry["bd3"] + float(x[11])})
    robot, bar = robot_frames(geometry, q), bar_frames(stretched, b)
    closed = pose_mismatch(bar.rotation(), bar.tip, robot)[:, 0]
    columns = np.concatenate((-joint_screws(robot), joint_screws(bar), screw(bar, "d", 2)[None]))[:, :, 0].T
    load = np.zeros(12)
    load[:6] = _gravity_gradient(geometry.robot, q, robot, bodies[0], gravity)[:, 0]
    load[6:11] = _gravity_gradient(stretched.bar, b, bar, bodies[1], gravity)[:, 0]
    rod_weight = sum(link.mass for links in bodies[1].links[2:] for link in links) * gravity
    load[11] = -float(rod_weight @ bar.z[2, :, 0])  # what rides on the slide is lifted as the rod stretches
    return closed, columns, load


def _gravity_gradient(chain: Chain, q: Array, frames: Frames, bodies: MovingBodies, gravity: Array) -> Array:
    """(J, N) [N m] derivative of the potential energy with respect to the joint angles."""
    turned = _turning_frames(chain, q, frames)
    return gravity_load(turned, frames.origin[:-1], frames.z[:-1], bodies, gravity)


def _turning_frames(chain: Chain, q: Array, frames: Frames) -> Array:
    """(J, 3, 3, N) frames that turn with each joint: frame i-1 turned by q_i about its z."""
    cos, sin = np.cos(q.T), np.sin(q.T)
    out = np.empty((chain.rows, 3, 3, q.shape[0]))
    for i in range(chain.rows):
        out[i, :, 0] = cos[i] * frames.x[i] + sin[i] * frames.y[i]
        out[i, :, 1] = cos[i] * frames.y[i] - sin[i] * frames.x[i]
        out[i, :, 2] = frames.z[i]
    return out

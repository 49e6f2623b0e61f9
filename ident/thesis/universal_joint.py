"""Angles b4, b5 of the universal joint against those of the robot's pose (thesis eq. 2.3).

Inverse kinematics of the ball-bar, from the robot's tool frame R alone. The robot holds the centre
of the universal joint at `c = R_P - ba5 x_R - bd5 z_R`. The gimbal (base, rows 1 and 2) turns by
b1hat and b2hat until the axis w of the rod passes through c, however long the rod is then. In R
that axis is v = R^T w, and the angles of an ideal universal joint between the two are `-v_x + i v_y
= -sin(b4hat) exp(i b5hat)`, `v_z = cos(b4hat)` (cell.inverse). Measured are only the sides of zero
on which b2 and b4 lie, the configuration of thesis sec. 5.2.

The thesis speaks of four-quadrant arctangents and a matrix inverse and prints neither. These steps
have its zero Jacobians (Table 3.3: balpha3-5, btheta3) and its dependencies (Table 3.2: bd2 and
balpha2 are separated, ra6 and ba5, rd6 and bd5 are not).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import Chain, Frames, cross, forward
from cell.geometry import ROD_ROW, Parameter, parameter_screw
from cell.inverse import UnreachableError
from ident.estimator.closure import Closure

GIMBAL_ROWS = 2  # b1 and b2 turn the rod; b3 turns about it
JOINT_ROWS = (3, 4)  # from 0: b4 and b5
STEPS, SETTLED = 20, 1e-12  # of the gimbal's angles [rad]; a nominal gimbal needs one step
SINGULAR = 1e-12  # [m^2] of rod squared times sin(b2), the volume that the three motions of c span


@dataclass(frozen=True, eq=False)
class UniversalJointAngles:
    """Measured minus predicted angles of N samples, and what their derivatives need."""

    closure: Closure
    error: Array  # (2, N) [rad] b4 - b4hat, b5 - b5hat, up to whole turns
    gimbal: Frames  # base, rows 1 and 2, and the rod up to c
    turns: Array  # (2, 3, N) [rad/m] b1hat, b2hat for a shift of c
    in_tool: Array  # (3, N) v, the rod's axis w in the robot's tool frame
    side: Array  # (N,) sign of sin(b4)


def universal_joint_angles(closure: Closure) -> UniversalJointAngles:
    """Measured angles b4, b5 minus those of the robot's pose.

    Raises UnreachableError where the gimbal's own axes coincide with the rod, at b2 = 0.
    """
    b4, b5 = (_joint_angle(closure.bar, row) for row in JOINT_ROWS)
    side = np.where(np.sin(b4) < 0.0, -1.0, 1.0)
    gimbal, turns = _gimbal_towards(closure)
    x, y, z = in_tool = _in_last_frame(closure.robot, gimbal.z[ROD_ROW])
    b4hat, b5hat = side * np.arctan2(np.hypot(x, y), z), np.arctan2(-side * y, side * x)
    return UniversalJointAngles(
        closure, np.stack((b4 - b4hat, b5 - b5hat)), gimbal, turns, in_tool, side
    )


def universal_joint_columns(
    angles: UniversalJointAngles, parameter: Parameter, motion: Array
) -> Array:
    """(2, N) change of the error per unit of a parameter.

    motion : (6, N) of the ball-bar's tool frame against the robot's, that of
    cell.geometry.parameter_screw with its sign.
    """
    columns = np.zeros((2, motion.shape[1]))
    if parameter.side == "bar" and parameter.row >= GIMBAL_ROWS:
        if parameter.kind == "theta" and parameter.row in JOINT_ROWS:
            columns[JOINT_ROWS.index(parameter.row)] = 1.0
            return columns
        if parameter.name not in ("ba5", "bd5"):
            return columns
    (x, y, z), (dx, dy, dz) = angles.in_tool, _change_in_tool(angles, parameter, motion)
    across = np.hypot(x, y)
    columns[0] = -angles.side * (z * (x * dx + y * dy) / across - across * dz)
    columns[1] = (x * dy - y * dx) / across**2
    return columns


def _change_in_tool(angles: UniversalJointAngles, parameter: Parameter, motion: Array) -> Array:
    """(3, N) change of v: the gimbal follows c, and R turns."""
    closure, gimbal = angles.closure, angles.gimbal
    if parameter.side == "robot":
        shift = cross(gimbal.tip - closure.robot.tip, motion[3:]) - motion[:3]
        turn = motion[3:].copy()
    elif parameter.side == "bar" and parameter.row >= GIMBAL_ROWS:  # ba5, bd5
        shift = -(closure.robot.x if parameter.kind == "a" else closure.robot.z)[-1]
        turn = np.zeros_like(shift)
    else:
        own = parameter_screw(closure.geometry, closure.robot, gimbal, parameter)
        shift, turn = -own[:3], own[3:]
    for axis, share in zip(gimbal.z, (angles.turns * shift).sum(axis=1), strict=False):
        turn += share * axis
    return _in_last_frame(closure.robot, cross(turn, gimbal.z[ROD_ROW]))


def _gimbal_towards(closure: Closure) -> tuple[Frames, Array]:
    """Frames of the gimbal whose rod passes through c, and its turns (2, 3, N) for a shift of c."""
    geometry, robot, bar = closure.geometry, closure.robot, closure.geometry.bar
    centre = robot.tip - bar.a[4] * robot.x[-1] - bar.d[4] * robot.z[-1]
    rows = slice(0, GIMBAL_ROWS)
    zero = np.zeros(ROD_ROW + 1)
    lengths, twists = (np.append(values[rows], 0.0) for values in (bar.a, bar.alpha))
    chain = Chain(lengths, np.append(bar.d[rows], 0.0), twists, zero, zero)
    x, y, z = geometry.bar_base_rotation.T @ (centre - geometry.origin[:, None])
    side = np.where(np.sin(_joint_angle(closure.bar, 1)) < 0.0, -1.0, 1.0)
    b = np.stack((np.arctan2(-side * y, -side * x), side * np.arctan2(np.hypot(x, y), z)))
    rod = np.linalg.norm(centre - geometry.origin[:, None], axis=0)
    for _ in range(STEPS):
        frames = forward(
            chain,
            np.append(b, np.zeros((1, rod.size)), axis=0).T,
            base_rotation=geometry.bar_base_rotation,
            base_origin=geometry.origin,
            slide=(ROD_ROW, rod),
        )
        along = frames.z[ROD_ROW]
        first, second = (cross(frames.z[row], frames.tip - frames.origin[row]) for row in (0, 1))
        turns = np.stack((cross(second, along), cross(along, first)))
        volume = (first * turns[0]).sum(axis=0)
        if np.abs(volume).min() <= SINGULAR:
            break
        turns /= volume
        step = (turns * (centre - frames.tip)).sum(axis=1)
        if np.abs(step).max() < SETTLED:
            return frames, turns
        b += step
        rod += ((centre - frames.tip) * along).sum(axis=0)
    raise UnreachableError(
        f"the gimbal does not point at the tool within {STEPS} steps: the rod lies along its first "
        "axis (b2 = 0). C_Ptheta has no value there; leave such samples out."
    )


def _joint_angle(frames: Frames, row: int) -> Array:
    """(N,) [rad] by which a joint is turned, zero included."""
    before, after, axis = frames.x[row], frames.x_link[row], frames.z[row]
    return np.asarray(
        np.arctan2((cross(before, after) * axis).sum(axis=0), (before * after).sum(axis=0))
    )


def _in_last_frame(frames: Frames, vector: Array) -> Array:
    """(3, N) components of a vector (3, N) of the base in the last frame."""
    return np.stack(
        [(axis * vector).sum(axis=0) for axis in (frames.x[-1], frames.y[-1], frames.z[-1])]
    )

"""Angles b4, b5 of the universal joint against those of the robot's pose (thesis eq. 2.3).

Inverse kinematics of the ball-bar, from the robot's tool frame R alone. The robot holds the centre
of the universal joint at `c = R_P - ba5 x_R - bd5 z_R`. The gimbal (base, rows 1 and 2) turns by
b1hat and b2hat until the axis w of the rod passes through c, however long the rod is then. In R
that axis is v = R^T w, and the angles of an ideal universal joint between the two are `-v_x + i v_y
= -sin(b4hat) exp(i b5hat)`, `v_z = cos(b4hat)` (ballbar.cell.inverse). Measured are only the sides
of zero on which b2 and b4 lie, the configuration of thesis sec. 5.2.

The thesis speaks of four-quadrant arctangents and a matrix inverse and prints neither. These steps
have its zero Jacobians (Table 3.3: balpha3-5, btheta3) and its dependencies (Table 3.2: bd2 and
balpha2 are separated, ra6 and ba5, rd6 and bd5 are not).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, cross, forward
from ballbar.cell.geometry import ROD_ROW, Parameter, parameter_screw
from ballbar.cell.inverse import UnreachableError
from ballbar.ident.estimator.closure import Closure

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

    @cached_property
    def per_motion_at_centre(self) -> Array:
        """(2, 6, N) change of the errors [rad/m, 1] for a shift and a turn of the base against R.

        The point that shifts is c. The gimbal follows it, so that w turns by the turn and by the
        share of b1hat and b2hat in the shift; `dv = R^T (turn x w)`.
        """
        x, y, z = self.in_tool
        across, zero = np.hypot(x, y), np.zeros_like(x)
        of_b4 = -self.side * np.stack((z * x / across, z * y / across, -across))
        of_b5 = np.stack((-y, x, zero)) / across**2
        robot, rod = self.closure.robot, self.gimbal.z[ROD_ROW]
        out = np.empty((2, 6, x.size))
        for per, of_v in zip(out, (of_b4, of_b5), strict=True):
            per[3:] = cross(
                rod, of_v[0] * robot.x[-1] + of_v[1] * robot.y[-1] + of_v[2] * robot.z[-1]
            )
            first, second = ((self.gimbal.z[row] * per[3:]).sum(axis=0) for row in (0, 1))
            per[:3] = -first * self.turns[0] - second * self.turns[1]
        return out

    @cached_property
    def per_motion_at_tool(self) -> Array:
        """(2, 6, N) the same where the point that shifts is the robot's tool."""
        out = self.per_motion_at_centre.copy()
        arm = self.gimbal.tip - self.closure.robot.tip
        for per in out:
            per[3:] += cross(arm, per[:3])
        return out


@lru_cache(maxsize=1)
def universal_joint_angles(closure: Closure) -> UniversalJointAngles:
    """Measured angles b4, b5 minus those of the robot's pose.

    Those of the last closure are kept: a fit asks for the residual of a step and, when it accepts
    the step, for its derivatives.

    Raises UnreachableError where the gimbal's own axes coincide with the rod, at b2 = 0.
    """
    b4, b5 = (_joint_angle(closure.bar, row) for row in JOINT_ROWS)
    side = np.where(np.sin(b4) < 0.0, -1.0, 1.0)
    gimbal, turns = _gimbal_towards(closure)
    tool, rod = closure.robot, gimbal.z[ROD_ROW]
    in_tool = np.stack([(axis[-1] * rod).sum(axis=0) for axis in (tool.x, tool.y, tool.z)])
    x, y, z = in_tool
    b4hat, b5hat = side * np.arctan2(np.hypot(x, y), z), np.arctan2(-side * y, side * x)
    return UniversalJointAngles(
        closure, np.stack((b4 - b4hat, b5 - b5hat)), gimbal, turns, in_tool, side
    )


def universal_joint_columns(
    angles: UniversalJointAngles, parameter: Parameter, motion: Array
) -> Array:
    """(2, N) change of the error per unit of a parameter.

    motion : (6, N) of the ball-bar's tool frame against the robot's, that of
    ballbar.cell.geometry.parameter_screw with its sign.
    """
    closure = angles.closure
    if parameter.side == "robot":
        return _change(angles.per_motion_at_tool, motion)
    if parameter.side == "bar" and parameter.row >= GIMBAL_ROWS:
        columns = np.zeros((2, motion.shape[1]))
        if parameter.kind == "theta" and parameter.row in JOINT_ROWS:
            columns[JOINT_ROWS.index(parameter.row)] = 1.0
        elif parameter.name in ("ba5", "bd5"):
            axis = (closure.robot.x if parameter.kind == "a" else closure.robot.z)[-1]
            columns[:] = _change(angles.per_motion_at_centre[:, :3], axis)
        return columns
    own = parameter_screw(closure.geometry, closure.robot, angles.gimbal, parameter)
    return _change(angles.per_motion_at_centre, own)


def _change(per_motion: Array, motion: Array) -> Array:
    """(2, N) change of the errors for a motion (K, N); per_motion : (2, K, N)."""
    return np.asarray(np.einsum("ekn,kn->en", per_motion, motion))


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

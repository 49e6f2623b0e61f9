"""Loop closure at a target: its position by an instrument against its position by the robot.

The target on the flange is reached through the robot, R(q), and through the instrument from its
seat. As for the double ball-bar (ballbar.ident.estimator.closure) the residual is what the
instrument measures minus what the robot predicts, six signed numbers in base coordinates, and
directions in which the instrument does not measure are eliminated afterwards by
`ballbar.ident.estimator.whitening`. Components that are not sensed take the predicted value: the
loop is closed as far as it can be. No direction becomes singular, as that of joints in their place
would (ballbar.cell.instruments.base).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross, joint_screws, screw
from ballbar.cell.geometry import Parameter
from ballbar.cell.instruments.base import Kind, Sight
from ballbar.cell.placement import Placement
from ballbar.cell.rotation import inverse_left_jacobian, left_jacobian, rotvec_from_matrix
from ballbar.ident.corrections.base import BAR, BEHIND_GEARS, GEAR


@dataclass(frozen=True, eq=False)
class TargetClosure:
    """The loop-closure error of N samples of one seat and one target."""

    robot: Frames  # its last frame is that of the target, the one before that of the flange
    seat: Placement
    sight: Sight
    error: Array  # (6, N) [m, m, m, rad, rad, rad] robot base frame

    @property
    def size(self) -> int:
        return int(self.error.shape[1])

    def part(self, samples: slice) -> TargetClosure:
        """The closure of some of the samples."""
        rotation = self.sight.rotation
        sight = Sight(
            self.sight.point[:, samples],
            self.sight.per_value[..., samples],
            None if rotation is None else rotation[..., samples],
        )
        return TargetClosure(self.robot.part(samples), self.seat, sight, self.error[:, samples])

    def screw(self, parameter: Parameter, out: Array) -> None:
        """Writes the motion (6, N) of the target per unit of a parameter to `out`.

        The robot's last row is that of a tool of its own, at which the target does not sit.
        """
        last = self.robot.x_link.shape[0] - 1
        if parameter.side == "robot" and parameter.row < last:
            screw(self.robot, parameter.kind, parameter.row, out)
        else:
            out[:] = 0.0

    @cached_property
    def joint_columns(self) -> Array:
        """(J, 6, N) change of the error per radian of each joint of the robot."""
        rows = self.robot.x_link.shape[0]
        return error_of_robot_motion(self.error, joint_screws(self.robot)[:rows])

    def columns(self, to_joint: Array) -> Array:
        """(J + 7, 6, N) change of the error for a unit of each error channel.

        Those of a ball-bar, its rod and its plate do not move the target.
        """
        joints = self.joint_columns
        out = np.zeros((len(joints) + BEHIND_GEARS, *self.error.shape))
        np.einsum("gj,jcn->gcn", to_joint, joints, out=out[GEAR:BAR])
        return out

    @property
    def rod_column(self) -> Array:
        """(6, N) zeros: no rod of a ball-bar is there."""
        return np.zeros_like(self.error)

    @property
    def plate_column(self) -> Array:
        """(6, N) zeros: no offset plate carries the target."""
        return np.zeros_like(self.error)

    def seat_columns(self, change: Array) -> Array:
        """(S, 6, N) change of the error per unit of a seat's unknowns, base axes.

        change : (3,) or (6,) [m, rad] value of the unknowns: a shift, and a rotation vector.
        """
        out = np.zeros((change.size, 6, self.size))
        out[[0, 1, 2], [0, 1, 2]] = 1.0
        if change.size == 6:
            arm = self.sight.point - self.seat.origin[:, None]
            for k in range(3):
                axis = np.eye(3)[k][:, None] * np.ones(self.size)
                out[3 + k, :3] = cross(axis, arm)
                out[3 + k, 3:] = inverse_left_jacobian(self.error[3:], axis)
        return _of_rotation_vector(out, change, 1.0)

    def target_columns(self, change: Array) -> Array:
        """(T, 6, N) change of the error per unit of a target's unknowns.

        A shift is along the flange's axes, a turn about those of the target. change : (3,) or (6,)
        [m, rad] value of the unknowns.
        """
        motion = np.zeros((change.size, 6, self.size))
        motion[:3, :3] = self.robot.rotation(-2).transpose(1, 0, 2)
        if change.size == 6:
            motion[3:, 3:] = self.robot.rotation(-1).transpose(1, 0, 2)
        return _of_rotation_vector(error_of_robot_motion(self.error, motion), change, -1.0)

    def value_columns(self, change: Array) -> Array:
        """(K, 6, N) change of the error for changes (N, 6, K) [m, rad] of measured poses: shifts
        and turns along the seat's axes.
        """
        turn = self.seat.rotation
        out = np.concatenate((turn @ change[:, :3], turn @ change[:, 3:]), axis=1)
        out = out.transpose(2, 1, 0)
        out[:, 3:] = inverse_left_jacobian(self.error[3:], out[:, 3:])
        return np.asarray(out)

    def sensor_columns(self, sigma: Array, factor: Array | None = None) -> Array:
        """(K, 6, N) change of the error for one standard deviation of each source of noise.

        sigma : (N, K) [m, rad], of the directions that are sensed and of three turns where the
        orientation is. factor : (N, K, K) of their correlation; None where they are independent.
        """
        if factor is not None:
            spread = np.zeros((self.size, 6, sigma.shape[1]))
            spread[:, : sigma.shape[1]] = sigma[:, :, None] * factor
            return self.value_columns(spread)
        per_value = self.sight.per_value
        out = np.zeros((sigma.shape[1], 6, self.size))
        out[: len(per_value), :3] = per_value * sigma[:, : len(per_value)].T[:, None]
        for k in range(len(per_value), len(out)):
            axis = self.seat.rotation[:, k - len(per_value), None]
            out[k, 3:] = axis * sigma[:, k]
        return out


def close_on_target(kind: Kind, values: Array, seat: Placement, robot: Frames) -> TargetClosure:
    """Loop closure of N samples.

    values : (N, M) [m, rad] as the kind of instrument gives them. robot : its frames, the last one
    that of the target (`ballbar.cell.placement.target_frames`).
    """
    sight = kind.sight(values, seat, robot.tip)
    error = np.zeros((6, robot.tip.shape[1]))
    error[:3] = sight.point - robot.tip
    if sight.rotation is not None:
        relative = np.einsum("ikn,jkn->ijn", sight.rotation, robot.rotation())
        error[3:] = rotvec_from_matrix(relative)
    return TargetClosure(robot, seat, sight, error)


def error_of_robot_motion(error: Array, motion: Array) -> Array:
    """(..., 6, N) change of an error (6, N) for a motion of the robot's last frame; in place."""
    motion[..., 3:, :] = inverse_left_jacobian(-error[3:], motion[..., 3:, :])
    return np.negative(motion, out=motion)


def _of_rotation_vector(columns: Array, change: Array, side: float) -> Array:
    """Columns per turn as columns per unit of the rotation vector among the unknowns; in place.

    side : 1 where the vector turns about the outer axes, -1 about the inner ones.
    """
    if len(columns) == 6:
        columns[3:] = np.einsum("ij,icn->jcn", left_jacobian(side * change[3:]), columns[3:])
    return columns

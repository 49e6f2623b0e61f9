"""Loop closure: the signed pose error between robot and ball-bar at the tool, and its derivatives.

At every sample the tool frame is reached through the robot, R(q), and through the ball-bar, B(b).
The residual is what the ball-bar measures minus what the robot predicts, `e = [p_B - p_R,
log(R_B R_R^T)]`: six signed numbers in base coordinates. Signed components keep the Jacobian alive
at the solution; the scalar costs of thesis eqs. 2.2 to 2.4, squared once more by least squares,
make it vanish there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross, joint_screws, screw
from ballbar.cell.geometry import (
    BAR_ROWS,
    Geometry,
    Parameter,
    bar_frames,
    parameter_screw,
    robot_frames,
)
from ballbar.cell.inverse import UnreachableError, bar_angles, bar_roll
from ballbar.cell.rotation import inverse_left_jacobian, rotvec_from_matrix
from ballbar.ident.corrections.base import BAR, BEHIND_GEARS, GEAR, PLATE, ROD
from ballbar.ident.estimator.target_closure import TargetClosure, error_of_robot_motion

CLOSING_STEPS, CLOSED = 20, 1e-12  # [m, rad] of an error that is zero but for rounding


@dataclass(frozen=True, eq=False)
class Closure:
    """The loop-closure error of N samples and the frames that its derivatives need."""

    geometry: Geometry
    robot: Frames
    bar: Frames
    error: Array  # (6, N) [m, m, m, rad, rad, rad] robot base frame

    def part(self, samples: slice) -> Closure:
        """The closure of some of the samples."""
        return Closure(
            self.geometry, self.robot.part(samples), self.bar.part(samples), self.error[:, samples]
        )

    def screw(self, parameter: Parameter, out: Array) -> None:
        """Writes the motion (6, N) of a parameter's tool frame per unit to `out`."""
        parameter_screw(self.geometry, self.robot, self.bar, parameter, out)

    @property
    def rod_column(self) -> Array:
        """(6, N) change of the error per metre of the rod's length."""
        return _error_of_bar_motion(self.error, screw(self.bar, "d", 2))

    @property
    def plate_column(self) -> Array:
        """(6, N) change of the error per radian of the plate's bending.

        The plate bends as a cantilever: a hinge a third of its length from the last axis
        (thesis sec. 4.5).
        """
        arm = 2.0 / 3.0 * self.geometry[self.geometry.table.plate] * self.robot.x[-1]
        return -np.concatenate((cross(self.robot.y[-1], arm), self.robot.y[-1]))

    def columns(self, to_joint: Array) -> Array:
        """(J + 7, 6, N) change of the error for a unit of each error channel.

        to_joint : (J, J), joints = gears @ to_joint.
        """
        joints = robot_joint_jacobian(self)
        columns = np.empty((len(joints) + BEHIND_GEARS, *self.error.shape))
        np.einsum("gj,jcn->gcn", to_joint, joints, out=columns[GEAR:BAR])
        columns[BAR:ROD] = bar_joint_jacobian(self)
        columns[ROD], columns[PLATE] = self.rod_column, self.plate_column
        return columns


def close_loop(geometry: Geometry, q: Array, b: Array) -> Closure:
    """Loop-closure error at robot angles q (N, J) and ball-bar angles b (N, 5) [rad].

    Of a bar whose rod is sensed b is (N, 6), as in ballbar.cell.geometry.bar_frames.

    The encoder offsets are parameters of the geometry (`btheta`), so b is what the encoders read.
    """
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    relative = np.einsum("ikn,jkn->ijn", bar.rotation(), robot.rotation())
    error = np.concatenate((bar.tip - robot.tip, rotvec_from_matrix(relative)))
    return Closure(geometry, robot, bar, error)


def parameter_jacobian(closure: Closure | TargetClosure, parameters: Sequence[Parameter]) -> Array:
    """(P, 6, N) derivative of the error with respect to parameters, each in its unit [m, rad]."""
    out = np.empty((len(parameters), 6, closure.error.shape[1]))
    for k, parameter in enumerate(parameters):
        closure.screw(parameter, out[k])
    for first, last, is_robot in runs_of_one_side(parameters):
        (error_of_robot_motion if is_robot else _error_of_bar_motion)(
            closure.error, out[first:last]
        )
    return out


def runs_of_one_side(parameters: Sequence[Parameter]) -> Iterator[tuple[int, int, bool]]:
    """Runs of parameters of one side: first, one past last, whether it is the robot's."""
    first = 0
    for is_robot, members in groupby(parameters, key=lambda p: p.side == "robot"):
        last = first + sum(1 for _ in members)
        yield first, last, is_robot
        first = last


def robot_joint_jacobian(closure: Closure) -> Array:
    """(J, 6, N) derivative of the error with respect to each robot joint angle [rad]."""
    return error_of_robot_motion(closure.error, joint_screws(closure.robot))


def bar_joint_jacobian(closure: Closure) -> Array:
    """(5, 6, N) derivative of the error with respect to each ball-bar angle [rad]."""
    return _error_of_bar_motion(closure.error, joint_screws(closure.bar))


def _error_of_bar_motion(error: Array, motion: Array) -> Array:
    """(..., 6, N) change of the error for a motion of the ball-bar's tool frame; in place."""
    motion[..., 3:, :] = inverse_left_jacobian(error[3:], motion[..., 3:, :])
    return motion


def closed_angles(geometry: Geometry, q: Array, b: Array) -> tuple[Array, Array]:
    """Robot and ball-bar angles (N, J), (N, 5) [rad] nearby at which the loop closes.

    b : (N, 5) [rad], or (N, 6) with the rod's extension [m], which stays.
    By Newton steps of least length from q and b. Raises UnreachableError if they do not converge.
    """
    count = q.shape[1] + BAR_ROWS
    angles = np.concatenate((q, b), axis=1)
    for _ in range(CLOSING_STEPS):
        closure = close_loop(geometry, angles[:, : q.shape[1]], angles[:, q.shape[1] :])
        if np.abs(closure.error).max() < CLOSED:
            return angles[:, : q.shape[1]], angles[:, q.shape[1] :]
        columns = np.concatenate((robot_joint_jacobian(closure), bar_joint_jacobian(closure)))
        inverse = np.linalg.pinv(columns.transpose(2, 1, 0))
        angles[:, :count] -= np.einsum("njk,kn->nj", inverse, closure.error)
    raise UnreachableError(
        "the nominal robot and the ball-bar cannot be closed at the poses of the recording. Check "
        "that both logs are of one run, and that robot and ball-bar are the declared ones."
    )


def pointing_bar(geometry: Geometry, q: Array, extension: Array) -> Array:
    """(N, 6) angles [rad] and extension [m] of a bar that points at the tool, in the tool's pose.

    q : (N, J) [rad] robot joint angles. extension : (N,) [m] sensed, of the rod beyond bd3. The
    loop then is open along the rod alone.
    """
    angles = bar_angles(robot_frames(geometry, q).poses(), geometry.origin) - geometry.bar.theta
    return np.column_stack((angles, extension))


def beside_rod(closure: Closure) -> Array:
    """(5, 6, N) changes of the error that the unsensed joints of a telescoping bar can make.

    Shifts of the tool across the rod [m], and every turn of it [rad]. They span what the five
    joints move, also where the rod is vertical or along the tool's axis and the joints' own columns
    lose a direction.
    """
    out = np.zeros((5, *closure.error.shape))
    out[0, :3], out[1, :3] = closure.bar.x[2], closure.bar.y[2]
    for axis in range(3):
        out[2 + axis, 3 + axis] = 1.0
    return out


def complete_bar_angles(
    geometry: Geometry, q: Array, measured: Array, encoders: tuple[int, ...]
) -> Array:
    """(N, 5) [rad] ball-bar angles: as measured, or from the robot's pose where unmeasured.

    q : (N, J) [rad] robot joint angles. measured : (N, E) [rad], one column for each of the
    `encoders` (joints 1 to 5). The unmeasured angles are those of an ideal ball-bar that holds the
    tool where the nominal robot puts it: starting values for `Whitening.unmeasured_step`.
    """
    columns = [joint - 1 for joint in encoders]
    b = np.zeros((q.shape[0], BAR_ROWS))
    b[:, columns] = measured
    if len(encoders) == BAR_ROWS:
        return b
    offsets = geometry.bar.theta
    poses = robot_frames(geometry, q).poses()
    ideal = bar_angles(poses, geometry.origin)
    total = b + offsets
    for pair in ((0, 1), (3, 4)):
        if not set(pair) <= set(columns):
            total[:, pair] = ideal[:, pair]
    if 2 not in columns:
        total[:, 2] = bar_roll(poses[:, :3, :3], total[:, 0], total[:, 1], total[:, 3], total[:, 4])
    unmeasured = [j for j in range(BAR_ROWS) if j not in columns]
    b[:, unmeasured] = total[:, unmeasured] - offsets[unmeasured]
    return b

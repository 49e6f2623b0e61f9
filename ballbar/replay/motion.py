"""What moved in one run, on the robot's clock: the identified cell at every instant shown, and where the truth says otherwise.

Drawn are rows of the robot's log, thinned, not smoothed. Ball-bar angles come from the encoders, put on the robot's clock by the
identified offset and skew; joints without encoder, and instants outside the ball-bar's log, follow from the robot's pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.chain import Frames
from cell.geometry import Geometry, bar_frames, robot_frames
from cell.logs import BallBarLog
from ident.estimator.closure import complete_bar_angles
from ident.identify import Identification, Residuals
from ident.robot.accuracy import accuracy_grid
from sim.simulate import Simulation

POSE_RATE = 30.0  # [Hz] smooth to the eye; the mechanism moves below 3 Hz
GAP_PERIODS = 3.0  # as ident.signals.smooth_log: a longer stretch without rows is not bridged


@dataclass(frozen=True, eq=False)
class CellMotion:
    """The identified mechanism over time."""

    t: Array  # (N,) [s] robot's clock, from the first row of its log
    q: Array  # (N, 6) [rad] logged robot joint angles
    robot: Frames
    b: Array  # (N, 5) [rad] ball-bar joint angles
    bar: Frames

    @property
    def tool(self) -> Array:
        """(N, 3) [m] identified tool position, robot base frame."""
        return self.robot.tip.T


@dataclass(frozen=True, eq=False)
class TrueTool:
    """Where the tool really was, and how far two models are from it at the true joint angles, base frames aligned."""

    position: Array  # (N, 3) [m] carried into the base frame of the identified robot
    nominal_error: Array  # (N, 3) [m] nominal robot's tool position minus the true one
    identified_error: Array  # (N, 3) [m]
    rod_force: Array  # (N,) [N] tension positive
    rod_strain: Array  # (N,) [m] longer than it is without force


def cell_motion(data: RunData) -> CellMotion:
    """Robot and ball-bar at the rows of the robot's log that are shown."""
    log, result = data.recording.robot_log, data.identification
    rows = np.arange(0, log.t.size, thinning(log.t))
    t, q = log.t[rows], log.q[rows]
    b = _bar_angles(result, data.recording.ballbar_log, t, q)
    return CellMotion(t, q, robot_frames(result.geometry, q), b, bar_frames(result.geometry, b))


def thinning(t: Array) -> int:
    """Every how many rows of a log give about POSE_RATE."""
    return max(1, round(1.0 / (POSE_RATE * float(np.median(np.diff(t))))))


def true_tool(simulation: Simulation, result: Identification, t: Array) -> TrueTool:
    """The truth at instants t (N,) [s] of the robot's clock."""
    times = simulation.times
    true_time = np.interp(t, times.robot_stamp - times.robot_stamp[0], times.robot_true)
    q, _ = simulation.motion.at(true_time)
    truth, grid = simulation.truth.geometry, accuracy_grid(result.cell.robot)
    actual = robot_frames(truth, q).tip.T
    turn, shift = base_alignment(result.geometry, truth, grid)
    return TrueTool(
        position=(actual - shift) @ turn,
        nominal_error=_aligned_tool(result.nominal, truth, grid, q) - actual,
        identified_error=robot_frames(result.geometry, q).tip.T @ turn.T + shift - actual,
        rod_force=np.interp(true_time, simulation.motion.t, simulation.motion.rod_force),
        rod_strain=np.interp(true_time, simulation.motion.t, simulation.motion.rod_stretch),
    )


def base_alignment(model: Geometry, truth: Geometry, grid: Array) -> tuple[Array, Array]:
    """(3, 3), (3,) [m] rigid motion that carries the model's base frame onto the true one, best over joint angles grid (G, 6).

    Without it a gauge would show as an error: parameters held fixed (`rd1`, `rtheta1`) leave the base where it is not.
    """
    predicted, actual = robot_frames(model, grid).tip.T, robot_frames(truth, grid).tip.T
    turn = np.asarray(
        Rotation.align_vectors(actual - actual.mean(axis=0), predicted - predicted.mean(axis=0))[
            0
        ].as_matrix()
    )
    return turn, actual.mean(axis=0) - turn @ predicted.mean(axis=0)


def on_robot_clock(result: Identification, t: Array) -> Array:
    """(N,) [s] ball-bar instants on the robot's clock; unchanged without encoders, where all instants are the robot's."""
    return t if result.clock is None else result.clock.robot_time(t)


def mechanism_angles(result: Identification, log: BallBarLog) -> Array:
    """(N, E) [rad] ball-bar joint angles that the encoders measured: found sense and identified zero applied, mean within half a turn."""
    zeros = np.array([result.geometry[f"btheta{joint}"] for joint in log.joints])
    angles = log.angles * np.array(result.signs) + zeros
    return np.asarray(angles - 2.0 * np.pi * np.round(angles.mean(axis=0) / (2.0 * np.pi)))


def residual_norms(residuals: Residuals) -> tuple[Array, Array]:
    """(N,) [m], (N,) [rad] size of the mismatch."""
    return np.linalg.norm(residuals.position, axis=1), np.linalg.norm(residuals.angle, axis=1)


def quat_xyzw(rotation: Array) -> Array:
    """(N, 4) quaternions, order x y z w as the viewer wants them, of (3, 3, N) rotation matrices."""
    return np.asarray(Rotation.from_matrix(rotation.transpose(2, 0, 1)).as_quat())


def _bar_angles(result: Identification, log: BallBarLog | None, t: Array, q: Array) -> Array:
    """(N, 5) [rad] angles that `bar_frames` takes, at rows of the robot's log."""
    follows = complete_bar_angles(result.geometry, q, np.zeros((t.size, 0)), ())
    if log is None or result.clock is None:
        return follows
    t_bar = result.clock.ballbar_time(t)
    angles = log.angles * np.array(result.signs)
    measured = np.stack([np.interp(t_bar, log.t, column) for column in angles.T], axis=1)
    completed = complete_bar_angles(result.geometry, q, measured, log.joints)
    return np.where(_covered(log.t, t_bar)[:, None], completed, follows)


def _covered(rows: Array, t: Array) -> Array:
    """(N,) whether a log has rows close by on both sides of each instant."""
    after = np.clip(np.searchsorted(rows, t), 1, rows.size - 1)
    near = rows[after] - rows[after - 1] <= GAP_PERIODS * np.median(np.diff(rows))
    return np.asarray((t >= rows[0]) & (t <= rows[-1]) & near)


def _aligned_tool(model: Geometry, truth: Geometry, grid: Array, q: Array) -> Array:
    turn, shift = base_alignment(model, truth, grid)
    return np.asarray(robot_frames(model, q).tip.T @ turn.T + shift)

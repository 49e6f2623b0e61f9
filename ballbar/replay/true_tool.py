"""The true tool of a simulated run beside the identified and the nominal one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from cell.arrays import Array
from cell.geometry import Geometry, robot_frames
from ident.result import RecordingEstimate
from ident.robot.accuracy import accuracy_grid

if TYPE_CHECKING:
    from sim.simulate import Simulation


@dataclass(frozen=True, eq=False)
class TrueTool:
    """True tool position, and the errors of two models at the true joint angles, bases aligned."""

    position: Array  # (N, 3) [m] carried into the base frame of the identified robot
    nominal_error: Array  # (N, 3) [m] nominal robot's tool position minus the true one
    identified_error: Array  # (N, 3) [m]
    rod_force: Array  # (N,) [N] tension positive
    rod_strain: Array  # (N,) [m] axial elongation of the rod


def true_tool(simulation: Simulation, estimate: RecordingEstimate, t: Array) -> TrueTool:
    """The truth at instants t (N,) [s] of the robot's clock."""
    times = simulation.times
    true_time = np.interp(t, times.robot_stamp - times.robot_stamp[0], times.robot_true)
    q = simulation.motion.shown_at(true_time)
    truth, grid = simulation.truth.geometry, accuracy_grid(simulation.cell.robot)
    actual = robot_frames(truth, q).tip.T
    rotation, shift = base_alignment(estimate.geometry, truth, grid)
    nominal_rotation, nominal_shift = base_alignment(estimate.nominal, truth, grid)
    nominal = robot_frames(estimate.nominal, q).tip.T @ nominal_rotation.T + nominal_shift
    return TrueTool(
        position=(actual - shift) @ rotation,
        nominal_error=nominal - actual,
        identified_error=robot_frames(estimate.geometry, q).tip.T @ rotation.T + shift - actual,
        rod_force=np.interp(true_time, simulation.motion.t, simulation.motion.rod_force),
        rod_strain=np.interp(true_time, simulation.motion.t, simulation.motion.rod_stretch),
    )


def base_alignment(model: Geometry, truth: Geometry, grid: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) [m] that carry the model's base frame onto the true one.

    The best over joint angles grid (G, 6) [rad]. Without it a gauge would show as an error:
    parameters held fixed (`rd1`, `rtheta1`) leave the base where it is not.
    """
    predicted, actual = robot_frames(model, grid).tip.T, robot_frames(truth, grid).tip.T
    centred = actual - actual.mean(axis=0), predicted - predicted.mean(axis=0)
    rotation = np.asarray(Rotation.align_vectors(*centred)[0].as_matrix())
    return rotation, actual.mean(axis=0) - rotation @ predicted.mean(axis=0)

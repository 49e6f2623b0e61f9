"""Measured poses in the robot's base frame, beside where a model of the robot commands them.

The seat of the instrument, and a target that the result does not know, are fitted to the identified
robot over all poses of a group: six or nine of their coordinates, so that its errors at few poses
come out small. The nominal robot has the same tool, and the base frame that fits the identified
robot's best over the workspace, so its errors are those that are predicted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup
from ballbar.cell.rigid_fit import kabsch, nearest_rotation
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from ballbar.ident.performance.characteristics import not_stated
from ballbar.ident.performance.predicted import Prediction, length_moments

ROUNDS = 30  # of Gauss-Newton from a seat by points to seat and target
NOT_CORRECTED = not_stated("measured at targets that were not corrected")


def noise_remark(group: PoseGroup) -> str:
    """Sentence on the repeatability that the stated noise of the instrument alone would make."""
    mean, deviation = length_moments(np.diag((group.sigma[:, :3] ** 2).mean(axis=0)))
    size = (mean + 3.0 * deviation) * 1e3
    return f"{size:.2g} mm would follow from the instrument's stated noise alone"


@dataclass(frozen=True, eq=False)
class Attained:
    """N measured poses of a group in the robot's base frame, and where a model commands them."""

    commanded: Array  # (N, 3) [m]
    points: Array  # (N, 3) [m]
    turns: Array | None  # (N, 3) [rad] of the target from the commanded orientation; None: not seen


def attained(
    prediction: Prediction, group: PoseGroup, known: Placement | None
) -> tuple[Attained, Attained]:
    """The poses of a group by the nominal and by the identified robot.

    known : the target in the frame of the identified robot's last row.
    """
    values, (turn, shift) = group.values, prediction.alignment
    nominal, identified = (
        model.ends(group.q) for model in (prediction.nominal.identified, prediction.robot)
    )
    seat, origin, target = _seat_and_target(identified, values[:, :3], known)
    seen = own = None
    if group.kind.target_turns:
        seen = seat @ matrix_from_rotvec(values[:, 3:].T).transpose(2, 0, 1)
        own = nearest_rotation((identified[:, :3, :3].transpose(0, 2, 1) @ seen).sum(axis=0))
    points = values[:, :3] @ seat.T + origin
    return (
        _attained(
            nominal, target, points @ turn.T + shift, None if seen is None else turn @ seen, own
        ),
        _attained(identified, target, points, seen, own),
    )


def _attained(
    ends: Array, target: Array, points: Array, seen: Array | None, own: Array | None
) -> Attained:
    """Poses by a model with ends (N, 4, 4), its target (3,) [m] of orientation `own` (3, 3), and
    what was seen of them in its base frame: points (N, 3) [m], orientations (N, 3, 3).
    """
    turns = None
    if seen is not None and own is not None:
        turned = np.einsum("nij,nkl,lj->ikn", seen, ends[:, :3, :3], own)
        turns = rotvec_from_matrix(turned).T
    return Attained(ends[:, :3, 3] + ends[:, :3, :3] @ target, points, turns)


def _seat_and_target(
    ends: Array, values: Array, known: Placement | None
) -> tuple[Array, Array, Array]:
    """Rotation (3, 3) and origin (3,) [m] of the seat, and the target (3,) [m] in the last row's
    frame, with the least squares of points; of poses that leave some of them open the nearest.
    """
    target = np.zeros(3) if known is None else known.origin
    commanded = ends[:, :3, 3] + ends[:, :3, :3] @ target
    mean = values.mean(axis=0)
    turn = kabsch(values - mean, commanded - commanded.mean(axis=0))
    middle = commanded.mean(axis=0)
    columns = np.zeros((len(values), 3, 9))
    for _ in range(ROUNDS):
        arms = (values - mean) @ turn.T
        left = ends[:, :3, 3] + ends[:, :3, :3] @ target - middle - arms
        columns[:, :, :3] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
        columns[:, :, 3:6] = np.eye(3)
        columns[:, :, 6:] = 0.0 if known is not None else -ends[:, :3, :3]
        step = np.linalg.lstsq(columns.reshape(-1, 9), left.ravel(), rcond=1e-7)[0]
        turn = matrix_from_rotvec(step[:3, None])[:, :, 0] @ turn
        middle, target = middle + step[3:6], target + step[6:]
        if np.abs(step).max() < 1e-12:
            break
    return turn, middle - turn @ mean, target

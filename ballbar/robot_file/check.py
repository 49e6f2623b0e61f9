"""The written description against its source: tip poses of both at random joint angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.robot_file.draft import RobotDraft
from cell.chain import forward
from cell.descriptions import Robot
from cell.geometry import nominal_chain
from cell.robot_angles import controller_to_joints
from cell.rotation import rotvec_from_matrix

POSES = 100
LARGEST = 1e-9  # [m, rad] allowed; rounding of the written decimals gives 1e-12
_SEED = 2


@dataclass(frozen=True)
class Difference:
    """Largest difference of the tip poses."""

    position: float  # [m]
    angle: float  # [rad]

    @property
    def acceptable(self) -> bool:
        return self.position <= LARGEST and self.angle <= LARGEST


def difference(robot: Robot, draft: RobotDraft) -> Difference:
    """Tip poses of a description as it is read back, against those of the source."""
    axes = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (POSES, robot.joints))
    chain = nominal_chain(robot)
    flange = forward(chain, controller_to_joints(robot, axes)).poses()
    poses = draft.form.T_base_dh @ flange @ draft.form.T_flange_tip
    expected = draft.tip_poses(axes)
    shift = np.linalg.norm(poses[:, :3, 3] - expected[:, :3, 3], axis=1)
    turn = np.einsum("nik,njk->ijn", poses[:, :3, :3], expected[:, :3, :3])
    angle = np.linalg.norm(rotvec_from_matrix(turn), axis=0)
    return Difference(float(shift.max()), float(angle.max()))

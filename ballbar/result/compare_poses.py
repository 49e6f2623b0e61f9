"""A robot identified from still poses against the truth that they were simulated from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cell.geometry import nominal_chain
from ident.pose_result import PoseIdentification
from ident.robot.accuracy import TcpError, position_error

if TYPE_CHECKING:  # an identification of poses does without the simulation
    from sim.poses.truth import PoseTruth


@dataclass(frozen=True, eq=False)
class PoseComparison:
    """How far the first target is from where the true robot has it, base frames aligned."""

    target: str
    tcp: TcpError  # of the identified robot
    tcp_nominal: TcpError  # of the nominal one, its target fitted to the same poses


def compare_poses_with_truth(result: PoseIdentification, truth: PoseTruth) -> PoseComparison:
    """TCP error over random poses within the fitted ranges of all joints."""
    name, arm = result.target, result.arm()
    q = arm.workspace()
    actual = truth.arm.target(q, truth.targets[name].position)
    before = result.nominal
    bare = replace(
        arm,
        chain=nominal_chain(arm.robot),
        corrections=(),
        values=np.zeros(0),
        target=before.model.unknowns.target(before.x, name),
    )
    return PoseComparison(
        name, position_error(arm.tool(q), actual), position_error(bare.tool(q), actual)
    )

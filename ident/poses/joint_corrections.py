"""Corrections of joint angles at still poses: their regressors and what they move.

The same corrections as those of logs (ident.corrections), at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cell.arrays import Array
from cell.bodies import link_bodies
from cell.chain import forward
from cell.descriptions import Robot
from cell.dynamics import joint_torques
from cell.geometry import nominal_chain
from ident.corrections.base import Correction, State
from ident.loads.gear_loads import no_loads


def regressors_at(robot: Robot, corrections: Sequence[Correction], q: Array) -> Array:
    """(C, N) regressor of every coefficient at joint angles q (N, J) [rad], the robot at rest."""
    n = len(q)
    loads = no_loads(q.shape[1], n)
    if any(correction.slopes is not None for correction in corrections):
        loads = replace(loads, gear=resting_loads(robot, q))
    gears = (q @ robot.joint_to_gear).T
    state = State(
        t=np.zeros(n),
        recording=-1,
        gears=gears,
        bar=np.zeros((0, n)),
        loads=loads,
        tension=np.zeros(n),
        width=np.zeros(q.shape[1]),
        gear_speed=np.zeros_like(gears),
        gear_acceleration=np.zeros_like(gears),
    )
    rows = [regressor for c in corrections for regressor in c.regressors(state)]
    return np.stack(rows) if rows else np.zeros((0, n))


def resting_loads(robot: Robot, q: Array) -> Array:
    """(J, N) [N m] at the gears' outputs under the weight of the links at q (N, J) [rad]."""
    bodies = [[link] for link in link_bodies(robot)]
    chain = nominal_chain(robot)
    torques = joint_torques(forward(chain, q), bodies, q, gravity=robot.gravity)
    return np.asarray(robot.gear_to_joint @ torques)


def joint_displacements(
    robot: Robot, corrections: Sequence[Correction], values: Array, regressors: Array
) -> Array:
    """(N, J) [rad] what the corrections add to the joint angles.

    values : (C,) coefficients. regressors : (C, N), `regressors_at`.
    """
    moved = np.zeros((robot.a.size, regressors.shape[1]))
    np.add.at(moved, channels(corrections), values[:, None] * regressors)
    return np.asarray(moved.T @ robot.gear_to_joint)


def channel_columns(robot: Robot, corrections: Sequence[Correction], joint_columns: Array) -> Array:
    """(C, 6, N) change of the error per unit displacement of each coefficient's gear.

    joint_columns : (J, 6, N) per radian of each joint.
    """
    gears = np.einsum("gj,jcn->gcn", robot.gear_to_joint, joint_columns)
    return np.asarray(gears[channels(corrections)])


def channels(corrections: Sequence[Correction]) -> list[int]:
    """Gear of every coefficient, from 0."""
    every = [c.channel for correction in corrections for c in correction.coefficients]
    return [channel for channel in every if isinstance(channel, int)]

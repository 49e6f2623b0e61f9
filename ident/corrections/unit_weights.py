"""Sag of a robot whose masses nobody knows: unit weights at the frames' origins.

A weight at the origin of frame k loads every joint j before it with the torque z_{j-1} x (O_k -
O_{j-1}) . g; the joint yields by that torque times an unknown coefficient, which stands for mass
times compliance. Gear compliance, and the links' bending where it acts like it, are both in it.
The ball-bar's weight and the tension of its rod are not: of logs it stands for sag alone.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade

# [rad/m] of a coefficient; still poses have Student tails about it (docs/studies/sag_prior.csv)
PRIOR = 3e-3
_LEVER = 1e-3  # [m] a torque that varies less over all poses, or from another's, is not felt
_TRIALS = 200  # poses at which levers are compared
_SEED = 6


@remade
def unit_weights(robot: Robot) -> Correction:
    """One coefficient [rad/m] for each joint and frame whose weight its axis can feel."""
    chain = nominal_chain(robot)
    down = robot.gravity / np.linalg.norm(robot.gravity)
    rng = np.random.default_rng(_SEED)
    q = rng.uniform(-np.pi, np.pi, (_TRIALS, chain.rows))
    pairs = _felt(torques(forward(chain, q), down))

    def regressors(state: State) -> list[Array]:
        joints = state.gears.T @ robot.gear_to_joint
        levers = torques(forward(chain, joints), down)
        return [levers[j, k] for j, k in pairs]

    coefficients = tuple(
        Coefficient(f"weight{k + 1}_joint{j + 1}", "rad/m", 0.0, PRIOR, GEAR + j) for j, k in pairs
    )
    return Correction(
        "unit_weights", "sag under unknown weights", coefficients, regressors, one_scale=True
    )


def torques(frames: Frames, down: Array) -> Array:
    """(J, J, N) [m] torque about axis j of a unit weight at the origin of frame k + 1.

    down : (3,) direction of gravity. Zero where the frame is not behind the joint.
    """
    rows, n = frames.x_link.shape[0], frames.tip.shape[1]
    out = np.zeros((rows, rows, n))
    for j in range(rows):
        pull = cross(down[:, None] * np.ones(n), frames.z[j])  # (z x r) . g = r . (g x z)
        for k in range(j, rows):
            out[j, k] = ((frames.origin[k + 1] - frames.origin[j]) * pull).sum(axis=0)
    return out


def _felt(levers: Array) -> list[tuple[int, int]]:
    """Joints and frames, from 0, whose torques vary and differ from each other's."""
    pairs: list[tuple[int, int]] = []
    for j in range(len(levers)):
        others: list[Array] = []
        for k in range(j, len(levers)):
            varying = levers[j, k] - levers[j, k].mean()
            if varying.std() > _LEVER and all((varying - o).std() > _LEVER for o in others):
                others.append(varying)
                pairs.append((j, k))
    return pairs

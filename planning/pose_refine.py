"""Refinement of selected poses: random changes of their angles, accepted where they gain.

The candidates are a few thousand points of a space of six dimensions; between them better poses
lie. Each round draws some neighbours of every pose, screens them like candidates, and takes the
best one where it lowers the objective. The changes shrink from round to round.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from ident.estimator.gauss_newton import inverse
from planning.feasible_poses import Candidates, Screen, feasible, joined
from planning.pose_design import APART, decrease
from planning.pose_information import Information

NEIGHBOURS = 24  # of each pose in a round
ROUNDS = 20
FIRST, LAST = 0.5, 0.03  # [rad] standard deviation of the changes


def refined(
    information: Information,
    poses: Candidates,
    rng: np.random.Generator,
    going: Callable[[], bool] = lambda: True,
) -> Candidates:
    """The poses with their angles improved; going : asked before every round whether to go on."""
    axes, rows = poses.axes.copy(), information.rows(poses)
    for scale in np.geomspace(FIRST, LAST, ROUNDS):
        if not going():
            break
        drawn, owner = _neighbours(information, Candidates(axes, poses.station), scale, rng)
        if not drawn.size:
            continue
        drawn_rows = information.rows(drawn)
        for place in range(poses.size):
            own = np.flatnonzero(owner == place)
            if own.size:
                _improve(information, place, axes, rows, drawn.axes[own], drawn_rows[own])
    return Candidates(axes, poses.station)


def _improve(
    information: Information, place: int, axes: Array, rows: Array, drawn: Array, drawn_rows: Array
) -> None:
    """Put the best of drawn poses (D, J) [rad] in its place of axes and rows, if it gains."""
    others = np.arange(len(axes)) != place
    flat = rows[others].reshape(-1, rows.shape[2])
    covariance = inverse(information.prior + flat.T @ flat)
    tried = np.concatenate((rows[place][None], drawn_rows))
    gain = decrease(tried, covariance, information.root)
    apart = np.abs(drawn[:, None] - axes[others][None]).max(axis=2).min(axis=1) >= APART
    gain[1:][~apart] = -np.inf
    best = int(gain.argmax())
    if best:
        axes[place], rows[place] = drawn[best - 1], drawn_rows[best - 1]


def _neighbours(
    information: Information, poses: Candidates, scale: float, rng: np.random.Generator
) -> tuple[Candidates, NDArray[np.intp]]:
    """Feasible poses near those selected, and of which of them each is a neighbour."""
    setup, parts, owners = information.setup, list[Candidates](), list[NDArray[np.intp]]()
    for k in np.unique(poses.station):
        own = np.repeat(np.flatnonzero(poses.station == k), NEIGHBOURS)
        changed = poses.axes[own] + scale * rng.standard_normal((own.size, setup.robot.joints))
        changed = np.clip(changed, setup.lower, setup.upper)
        axes, source = feasible(setup, int(k), changed, rng, Screen())
        parts.append(Candidates(axes, np.full(len(axes), k, dtype=np.intp)))
        owners.append(own[source])
    return joined(parts), np.concatenate(owners)

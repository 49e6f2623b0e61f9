"""Screening of many candidates at a few phases each, without time.

Reach, ranges of the arm and of axis 5, and singularities are checked. Limits that require turns or
speeds are left to planning.limits.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, bar_frames, nominal_geometry
from cell.inverse import robot_branches
from cell.robot_angles import joints_to_axes
from planning.candidate import Space
from planning.limits import from_singular
from planning.request import PlanLimits

PHASES = 24  # per candidate: enough to reject most of those that planning.limits would
# Excess of a candidate that the robot does not reach at all; less, the more of it it reaches.
UNREACHED = 10.0
ARM = (0, 1, 2, 4)  # axes whose range is less than a turn


@dataclass(frozen=True, eq=False)
class Screened:
    """Outcome of M candidates."""

    excess: Array  # (M,) of the best configuration of the arm; zero or less if limits are kept
    reason: NDArray[np.str_]  # (M,) the limit that is violated most


REASONS = (
    "out of reach",
    *(f"range of axis {axis + 1}" for axis in ARM),
    "wrist near its singularity",
)


def screen(cell: Cell, space: Space, limits: PlanLimits, genomes: Array) -> Screened:
    """Screening of the candidates of genomes (M, S) [-] at PHASES phases."""
    shapes, positions = space.many(genomes)
    m = genomes.shape[0]
    s = np.arange(PHASES) / PHASES
    turn = 2.0 * np.pi * shapes.cycles[:, None, :] * s[None, :, None] + shapes.phase[:, None, :]
    b = shapes.centre[:, None, :] + shapes.amplitude[:, None, :] * np.sin(turn)  # (M, S, 5)
    nominal = nominal_geometry(cell, np.zeros(3))
    poses = bar_frames(nominal, b.reshape(-1, BAR_ROWS)).poses()
    poses[:, :3, 3] += np.repeat(positions, PHASES, axis=0)
    branches = robot_branches(nominal.robot, poses)  # (4, M S, 6)
    axes = joints_to_axes(cell.robot, branches)[:, :, ARM]
    low, high = (limit[list(ARM)] for limit in (cell.robot.axis_lower, cell.robot.axis_upper))
    margin = np.radians(limits.axis_margin_deg)
    over = np.maximum(low + margin - axes, axes - high + margin)
    wrist = np.radians(limits.wrist_margin_deg) - from_singular(branches[:, :, 4])
    lost = np.isnan(branches[0]).any(axis=1).reshape(m, PHASES)
    all_over = np.concatenate((over, wrist[:, :, None]), axis=2).reshape(4, m, PHASES, -1)
    worst = np.nanmax(np.where(lost[None, :, :, None], -np.pi, all_over), axis=2)  # (4, M, 5)
    total = np.maximum(worst, 0.0).sum(axis=2)
    best = total.argmin(axis=0)
    at_best = worst[best, np.arange(m)]
    unreached = lost.mean(axis=1)
    excess = np.where(
        unreached > 0.0,
        UNREACHED * (0.1 + unreached),
        np.where(total.min(axis=0) > 0.0, total.min(axis=0), at_best.max(axis=1)),
    )
    which = np.where(unreached > 0.0, 0, 1 + at_best.argmax(axis=1))
    return Screened(np.asarray(excess), np.array(REASONS)[which])


def tally(reasons: Counter[str]) -> str:
    """The most frequent reasons with their shares, as part of a sentence."""
    total = sum(reasons.values())
    if not total:
        return "nothing was tried"
    return ", ".join(f"{reason} {count / total:.0%}" for reason, count in reasons.most_common(4))

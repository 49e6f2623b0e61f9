"""Screening of many candidates at a few phases each, without time.

Reach, ranges of the arm and of axis 5, and singularities are checked. Limits that require turns or
speeds are left to ballbar.planning.limits.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import has_closed_form, robot_branches
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import BAR_ROWS, Geometry, nominal_geometry
from ballbar.cell.numerical_inverse import best_branches, dexterity, in_range, led
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.planning.candidate import Space, shape_of
from ballbar.planning.limits import UNIT_ANGLE, UNIT_SINGULAR, from_singular, leans
from ballbar.planning.request import PlanCell, PlanLimits
from ballbar.sim.path import Lissajous, tool_poses

PHASES = 24  # per candidate: enough to reject most of those that ballbar.planning.limits would
LED_PHASES, LED = 24, 2  # of an arm without closed form, and its configurations: each takes longer
# Excess of a candidate that the robot does not reach at all; less, the more of it it reaches.
UNREACHED = 10.0
ARM = (0, 1, 2, 4)  # axes whose range is less than a turn


@dataclass(frozen=True, eq=False)
class Screened:
    """Outcome of M candidates."""

    excess: Array  # (M,) of the best configuration of the arm; zero or less if limits are kept
    reason: NDArray[np.str_]  # (M,) the limit that is violated most
    # (M, 4) configurations of an arm with closed form that keep the limits; of others all
    allowed: NDArray[np.bool_]


REASONS = (
    "out of reach",
    *(f"range of axis {axis + 1}" for axis in ARM),
    "wrist near its singularity",
)


def screen(
    cell: Cell, around: PlanCell, space: Space, limits: PlanLimits, genomes: Array
) -> Screened:
    """Screening of the candidates of genomes (M, S) [-] at PHASES phases."""
    shapes, positions = space.many(genomes)
    nominal = nominal_geometry(cell, np.zeros(3))
    screened = _screened_arm(cell, nominal, limits, shapes, positions)
    b = shapes.angles(np.arange(PHASES) / PHASES).reshape(-1, BAR_ROWS)
    for key, cup, angle in leans(around, nominal, b):
        over = angle.reshape(-1, PHASES).max(axis=1) - np.radians(cup.cone_deg)
        total = np.maximum(screened.excess, 0.0) + np.maximum(over, 0.0)
        worse = over > np.maximum(screened.excess, 0.0)
        screened = Screened(
            np.where(over > 0.0, total, screened.excess),
            np.where(worse, f"cone of the {key}", screened.reason),
            screened.allowed,
        )
    return screened


def _screened_arm(
    cell: Cell, nominal: Geometry, limits: PlanLimits, shapes: Lissajous, positions: Array
) -> Screened:
    """Screening by the arm alone."""
    if not has_closed_form(nominal.robot):
        return _screened_by_leading(cell, nominal, limits, shapes, positions)
    m = len(positions)
    poses = _poses(nominal, shapes, positions, PHASES)
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
    return Screened(np.asarray(excess), np.array(REASONS)[which], (total <= 0.0).T)


def _poses(
    nominal: Geometry, shapes: Lissajous, positions: Array, phases: int, share: float = 1.0
) -> Array:
    """(M S, 4, 4) tool frames of M shapes at S phases, their motion scaled by a share of 1."""
    rigid = replace(shapes, rod=())
    poses = tool_poses(nominal, rigid, np.arange(phases) / phases, share)
    poses[:, :3, 3] += np.repeat(positions, phases, axis=0)
    return poses


def _screened_by_leading(
    cell: Cell, nominal: Geometry, limits: PlanLimits, shapes: Lissajous, positions: Array
) -> Screened:
    """Screening of an arm without closed form, led from the middle of each path to LED_PHASES."""
    robot, chain, m = cell.robot, nominal.robot, len(positions)
    starts = best_branches(robot, chain, _poses(nominal, shapes, positions, 1, 0.0), count=LED)
    branch, which = np.nonzero(~np.isnan(starts).any(axis=2))
    some = shape_of(shapes, which)
    begin = np.repeat(starts[branch, which], LED_PHASES, axis=0)
    q = led(chain, begin, lambda w: _poses(nominal, some, positions[which], LED_PHASES, w))
    lost = np.asarray(np.isnan(q).any(axis=1))
    joints = np.where(lost[:, None], begin, q)
    axes = joints_to_axes(robot, in_range(robot, joints.reshape(-1, LED_PHASES, chain.rows)))
    margin = np.radians(limits.axis_margin_deg)
    over = np.maximum(robot.axis_lower + margin - axes, axes - robot.axis_upper + margin)
    far = dexterity(chain, joints).reshape(-1, LED_PHASES)
    singular = (limits.singular_value - far) * UNIT_ANGLE / UNIT_SINGULAR
    worst = np.column_stack((over.max(axis=1), singular.max(axis=1)))  # (K, J + 1)
    unreached = lost.reshape(-1, LED_PHASES).mean(axis=1)
    outside = np.maximum(worst, 0.0).sum(axis=1)
    excesses = np.where(
        unreached > 0.0,
        UNREACHED * (0.1 + unreached),
        np.where(outside > 0.0, outside, worst.max(axis=1)),
    )
    ranges = (f"range of axis {axis + 1}" for axis in range(chain.rows))
    names = np.array(["out of reach", *ranges, "near a singular posture"])
    reason = names[np.where(unreached > 0.0, 0, 1 + worst.argmax(axis=1))]
    excess, why = np.full(m, 1.1 * UNREACHED), np.full(m, names[0], dtype=names.dtype)
    for k in np.argsort(-excesses):  # the best configuration comes last
        excess[which[k]], why[which[k]] = excesses[k], reason[k]
    return Screened(excess, why, np.ones((m, 4), dtype=np.bool_))


def tally(reasons: Counter[str]) -> str:
    """The most frequent reasons with their shares, as part of a sentence."""
    total = sum(reasons.values())
    if not total:
        return "nothing was tried"
    return ", ".join(f"{reason} {count / total:.0%}" for reason, count in reasons.most_common(4))

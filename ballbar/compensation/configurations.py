"""Which of the arm's configurations a cartesian target means, and its data after the correction.

RAPID's confdata has the quadrants of axes 1, 4 and 6 (0 from 0 to 90 deg, -1 from -90 to 0) and
cfx, whose bits are: axis 5 negative, wrist behind the lower arm, wrist behind axis 1. KRL's S has
the bits: wrist behind axis 1, wrist in front of the line through axes 2 and 3, axis 5; T has a bit
for every axis with a negative angle. Quadrants, turns and the arm's two bits of S decide. cfx, and
the wrist's bit of S, decide only between solutions that have all of these right: their meaning
differs from robot to robot.

Sources: ABB, Technical reference manual, RAPID, confdata (3HAC050917-001); KUKA System Software
8.3, Operating and Programming Instructions for System Integrators, Status and Turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.closed_form import arm_branches
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.numerical_inverse import pose_branches
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.compensation.program_source import ProgramTarget
from ballbar.compensation.program_text import Number, ProgramError

QUADRANTS = (0, 3, 5)  # axes that confdata has the quadrant of, from 0
# [deg] beyond its quadrant that an axis may stand for the rounding of a target's numbers
ROUNDING = 0.5
SAME = 0.1  # [deg] of all axes within which two solutions are one
STILL = 1e-6  # [deg] of an axis that the correction does not move
FULL_TURN = 360.0


def axes_of_pose(robot: Robot, pose: Array, target: ProgramTarget) -> Array:
    """(J,) [deg] axis angles of the nominal robot at a pose (4, 4) of its flange.

    Raises ProgramError where there is none, or more than one, of the stated configuration.
    """
    if not target.configuration:
        raise ProgramError(
            target.line,
            f"{target.name}: states no configuration (S and T), and the arm reaches a pose in "
            "several, each with errors of its own; touch it up on the controller, which stores S "
            "and T, or state axis angles",
        )
    chain = nominal_chain(robot)
    closed = arm_branches(chain, pose[None])
    q = (pose_branches(chain, pose[None]) if closed is None else closed)[:, 0]
    q = q[~np.isnan(q).any(axis=1)]
    if not len(q):
        raise ProgramError(
            target.line,
            f"{target.name}: the nominal robot does not reach the pose, or stands at a singularity "
            "there; are tool, frame and robot the right ones?",
        )
    low, high = np.degrees(robot.axis_lower) - 1e-9, np.degrees(robot.axis_upper) + 1e-9
    axes = _on_stated_turns(robot, np.degrees(joints_to_axes(robot, q)), target)
    axes = _decided(robot, chain, axes[((axes >= low) & (axes <= high)).all(axis=1)], target)
    if not len(axes):
        raise ProgramError(
            target.line,
            f"{target.name}: no solution within the axis ranges has the configuration "
            f"{_shown(target.configuration)}; are tool, frame and robot the right ones?",
        )
    return np.asarray(axes[0])


def configuration_changes(
    robot: Robot, target: ProgramTarget, before: Array, after: Array
) -> list[tuple[Number, str]]:
    """New numbers of the configuration where an axis that moves ends beyond a limit of it.

    It is the stated number that `after` is compared with: at a limit the solved `before` is on
    either side of it by rounding.

    before, after : (J,) [deg] axis angles. Raises ProgramError where the posture itself changes.
    """
    if not target.configuration:
        return []
    changed = np.abs(after - before) > STILL
    chain = nominal_chain(robot)
    if _posture(robot, chain, before) != _posture(robot, chain, after):
        raise ProgramError(
            target.line, f"{target.name}: the correction passes a singularity; move the target"
        )
    if len(target.configuration) == 2:  # S, T
        turn = target.configuration[1]
        stated = int(turn.value)
        bits = stated
        for j in np.flatnonzero(changed).tolist():
            bits = (bits & ~(1 << j)) | (int(after[j] < 0.0) << j)
        return [(turn, turn.with_integer(bits))] if bits != stated else []
    changes = []
    for number, axis in zip(target.configuration, QUADRANTS, strict=False):
        if changed[axis] and _outside(after[axis], int(number.value)) > 0.0:
            changes.append((number, number.with_integer(int(np.floor(after[axis] / 90.0)))))
    return changes


def _on_stated_turns(robot: Robot, axes: Array, target: ProgramTarget) -> Array:
    """Solutions (K, J) [deg] on the turns that the configuration states, of the right ones."""
    data = [int(number.value) for number in target.configuration]
    axes = axes - FULL_TURN * np.round(axes / FULL_TURN)
    if len(data) == 2:
        negative = (data[1] >> np.arange(axes.shape[1])) & 1
        small = np.abs(axes) < ROUNDING
        wrong = ((axes < 0.0) != negative.astype(bool)) & ~small
        return np.asarray(axes + np.where(wrong, np.where(negative, -FULL_TURN, FULL_TURN), 0.0))
    right = np.ones(len(axes), dtype=bool)
    for quadrant, axis in zip(data, QUADRANTS, strict=False):
        centre = 90.0 * quadrant + 45.0
        axes[:, axis] += FULL_TURN * np.round((centre - axes[:, axis]) / FULL_TURN)
        right &= [_outside(angle, quadrant) <= ROUNDING for angle in axes[:, axis]]
    others = [j for j in range(axes.shape[1]) if j not in QUADRANTS]
    low, high = np.degrees(robot.axis_lower), np.degrees(robot.axis_upper)
    for j in others:
        axes[:, j] += FULL_TURN * np.ceil((low[j] - axes[:, j]) / FULL_TURN).clip(0.0)
        axes[:, j] -= FULL_TURN * np.ceil((axes[:, j] - high[j]) / FULL_TURN).clip(0.0)
    return np.asarray(axes[right])


def _decided(robot: Robot, chain: Chain, axes: Array, target: ProgramTarget) -> Array:
    """The solution that cfx or S tells from the others; none that S says the arm is not in.

    cfx is not held against a solution that is alone with its quadrants; bit 2 of S neither, since
    T tells the wrist's two postures apart.
    """
    data = [int(number.value) for number in target.configuration]
    krl = len(data) == 2
    if not len(axes) or (len(axes) == 1 and not krl):
        return axes
    stated = data[0] if krl else data[-1]
    postures = [_posture(robot, chain, row) for row in axes]  # behind, in front, negative
    bits = np.array([[b, f, not n] if krl else [n, not f, b] for b, f, n in postures])
    differs = bits != [(stated >> k) & 1 for k in range(3)]
    if krl:
        right = ~differs[:, :2].any(axis=1)
        axes, differs = axes[right], differs[right]
        if len(axes) < 2:
            return axes
    missed = differs.sum(axis=1)
    best = axes[missed == missed.min()]
    if np.ptp(best, axis=0).max() > SAME:
        raise ProgramError(
            target.line,
            f"{target.name}: {len(best)} solutions of the nominal robot agree with the "
            f"configuration {_shown(target.configuration)}; state it as axis angles",
        )
    return np.asarray(best[:1])


def _posture(robot: Robot, chain: Chain, axes: Array) -> tuple[bool, bool, bool]:
    """The posture at axis angles (J,) [deg].

    Whether the wrist is behind axis 1, and in front of the line through axes 2 and 3; and whether
    axis 5 is negative.
    """
    frames = forward(chain, controller_to_joints(robot, np.radians(axes))[None])
    forward_axis, up = frames.x_link[0][:, 0], np.array([0.0, 0.0, 1.0])
    wrist = frames.origin[4][:, 0]
    lower = frames.origin[2][:, 0] - frames.origin[1][:, 0]
    to_wrist = wrist - frames.origin[1][:, 0]
    front = (lower @ up) * (to_wrist @ forward_axis) - (lower @ forward_axis) * (to_wrist @ up)
    return bool(wrist @ forward_axis < 0.0), bool(front > 0.0), bool(axes[4] < 0.0)


def _outside(angle: float, quadrant: int) -> float:
    """[deg] by which an angle leaves a quadrant."""
    return max(0.0, 90.0 * quadrant - angle, angle - 90.0 * (quadrant + 1))


def _shown(configuration: Sequence[Number]) -> str:
    return f"[{', '.join(number.text for number in configuration)}]"

"""Violated limits of a trajectory.

Each limit gives an excess, zero or less where it is kept, in a unit in which 1 is gross. The excess
guides a search to where all limits are kept; the sentence informs a person.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import forward
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, Geometry, bar_frames, robot_frames
from cell.inverse import has_closed_form
from cell.numerical_inverse import dexterity, scaled_jacobian
from cell.robot_angles import joints_to_axes
from planning.request import Cup, PlanCell, PlanLimits
from planning.trajectory import Trajectory

UNIT_ANGLE = np.radians(30.0)  # [rad] a gross violation of an angle; only guides a search
UNIT_SINGULAR = 0.15  # [-] likewise of a singular value, of which 0.05 is some 10 deg
BAR_SINGULAR = (("b2", 1), ("b4", 3))


@dataclass(frozen=True)
class Violation:
    """One limit that a trajectory does not keep."""

    limit: str
    excess: float  # 1 is gross
    sentence: str


def violations(cell: Cell, limits: PlanLimits, trajectory: Trajectory) -> list[Violation]:
    """All limits of motion that a trajectory violates, worst first.

    planning.evaluation adds those of force, clearance and cups.
    """
    every = [*_axis_ranges(cell, limits, trajectory), *_axis_rates(cell, limits, trajectory)]
    if has_closed_form(trajectory.nominal.robot):
        wrist = ("axis 5", trajectory.q[:, 4], limits.wrist_margin_deg, "wrist_margin_deg")
        every += [*_singular_angle(*wrist, trajectory), *_reach(limits, trajectory)]
    else:
        every += _singular_value(limits, trajectory)
    if cell.ballbar.stroke is None:
        for name, j in BAR_SINGULAR:
            angle = (name, trajectory.b[:, j], limits.ballbar_margin_deg, "ballbar_margin_deg")
            every += _singular_angle(*angle, trajectory)
        every += _cables(limits, trajectory)
    return sorted((v for v in every if v.excess > 0.0), key=lambda v: -v.excess)


def _axis_ranges(cell: Cell, limits: PlanLimits, trajectory: Trajectory) -> list[Violation]:
    axes = joints_to_axes(cell.robot, trajectory.q)
    margin = np.radians(limits.axis_margin_deg)
    over = np.maximum(cell.robot.axis_lower + margin - axes, axes - cell.robot.axis_upper + margin)
    out = []
    for axis in range(cell.robot.joints):
        k = int(over[:, axis].argmax())
        low, high = np.degrees([cell.robot.axis_lower[axis], cell.robot.axis_upper[axis]])
        text = (
            f"axis {axis + 1} at {np.degrees(axes[k, axis]):.0f} deg, "
            f"range {low:.0f} to {high:.0f} less {limits.axis_margin_deg:g}"
        )
        out.append(_over("axis_margin_deg", over[k, axis] / UNIT_ANGLE, text, trajectory.t[k]))
    return out


def _axis_rates(cell: Cell, limits: PlanLimits, trajectory: Trajectory) -> list[Violation]:
    to_axis = cell.robot.joint_to_axis
    allowed = limits.axis_speed_share * cell.robot.axis_speed_max
    fastest = np.full(cell.robot.joints, limits.axis_acceleration_deg_per_s2)  # [deg/s^2]
    speed = np.abs(trajectory.speed @ to_axis) / allowed
    acceleration = np.abs(trajectory.acceleration @ to_axis) / np.radians(fastest)
    out = []
    for key, ratio, unit, top in (
        ("axis_speed_share", speed, "deg/s", np.degrees(allowed)),
        ("axis_acceleration_deg_per_s2", acceleration, "deg/s^2", fastest),
    ):
        k, axis = (int(i) for i in np.unravel_index(int(ratio.argmax()), ratio.shape))
        text = f"axis {axis + 1} at {ratio[k, axis] * top[axis]:.0f} {unit}, limit {top[axis]:.0f}"
        out.append(_over(key, ratio[k, axis] - 1.0, text, trajectory.t[k]))
    k = int(trajectory.tip_speed.argmax())
    limit = limits.tcp_speed_m_per_s
    text = f"tool at {trajectory.tip_speed[k]:.2f} m/s, limit {limit:g}"
    excess = trajectory.tip_speed[k] / limit - 1.0
    return [*out, _over("tcp_speed_m_per_s", excess, text, trajectory.t[k])]


def _singular_angle(
    name: str, angle: Array, margin: float, key: str, trajectory: Trajectory
) -> list[Violation]:
    """Violations of a margin [deg] by an angle (N,) [rad] that is singular at half turns."""
    away = from_singular(angle)
    k = int(away.argmin())
    text = f"{name} {np.degrees(away[k]):.0f} deg from its singularity, limit {margin:g}"
    out = [_over(key, (np.radians(margin) - away[k]) / UNIT_ANGLE, text, trajectory.t[k])]
    crossed = np.flatnonzero(np.sin(angle) * np.sin(angle[0]) < 0.0)
    if crossed.size:
        out.append(_over(key, 1.0, f"{name} passes its singularity", trajectory.t[crossed[0]]))
    return out


def _singular_value(limits: PlanLimits, trajectory: Trajectory) -> list[Violation]:
    """Violations by an arm of any structure, whose singular postures have no angle of their own."""
    chain, key = trajectory.nominal.robot, "singular_value"
    value = dexterity(chain, trajectory.q)
    k, limit = int(value.argmin()), limits.singular_value
    text = f"smallest singular value of the arm {value[k]:.3f}, limit {limit:g}"
    out = [_over(key, (limit - value[k]) / UNIT_SINGULAR, text, trajectory.t[k])]
    if chain.rows == 6:
        side = np.linalg.det(scaled_jacobian(chain, forward(chain, trajectory.q)))
        crossed = np.flatnonzero(side * side[0] < 0.0)
        if crossed.size:
            text = "the arm passes a singular posture"
            out.append(_over(key, 1.0, text, trajectory.t[crossed[0]]))
    return out


def leaning(around: PlanCell, trajectory: Trajectory) -> list[Violation]:
    """Violations of the cones of a telescoping bar's two cups."""
    out = []
    for key, cup, angle in leans(around, trajectory.nominal, trajectory.b):
        k = int(angle.argmax())
        text = f"rod {np.degrees(angle[k]):.0f} deg from the axis of the {key}"
        excess = (angle[k] - np.radians(cup.cone_deg)) / UNIT_ANGLE
        sentence = f"{text}, cone {cup.cone_deg:g}"
        out.append(_over(f"{key}.cone_deg", excess, sentence, trajectory.t[k]))
    return [v for v in out if v.excess > 0.0]


def leans(around: PlanCell, geometry: Geometry, b: Array) -> list[tuple[str, Cup, Array]]:
    """Each cup with its key and the angles (N,) [rad] between rod and axis at b (N, 5) [rad]."""
    if around.seat is None and around.target is None:
        return []
    frames = bar_frames(geometry, b)
    rod = frames.z[2]
    seen = -np.einsum("ijn,in->jn", frames.rotation(), rod)  # from the target, in its frame
    out = []
    for key, cup, direction in (("seat", around.seat, rod), ("target", around.target, seen)):
        if cup is not None:
            axis = np.array(cup.axis) / np.linalg.norm(cup.axis)
            out.append((key, cup, np.arccos(np.clip(axis @ direction, -1.0, 1.0))))
    return out


def from_singular(angle: Array) -> Array:
    """(N,) [rad] distance of angles (N,) [rad] from the nearest multiple of half a turn."""
    return np.asarray(np.arcsin(np.abs(np.sin(angle))))


def _reach(limits: PlanLimits, trajectory: Trajectory) -> list[Violation]:
    elbow, shoulder = arm_margins(trajectory.nominal, trajectory.q)
    k, s = int(elbow.argmin()), int(shoulder.argmin())
    angle, length = limits.elbow_margin_deg, limits.shoulder_margin_m
    stretched = f"elbow {np.degrees(elbow[k]):.0f} deg from stretched, limit {angle:g}"
    close = f"wrist {shoulder[s]:.2f} m from axis 1, limit {length:g}"
    excess = (np.radians(angle) - elbow[k]) / UNIT_ANGLE
    return [
        _over("elbow_margin_deg", excess, stretched, trajectory.t[k]),
        _over("shoulder_margin_m", (length - shoulder[s]) / 0.3, close, trajectory.t[s]),
    ]


def arm_margins(geometry: Geometry, q: Array) -> tuple[Array, Array]:
    """Distances of the arm from its singular postures at joint angles q (N, 6) [rad].

    Returns the angle of the elbow from stretched (N,) [rad], and the distance of the wrist's centre
    from axis 1 (N,) [m].
    """
    frames = robot_frames(geometry, q)
    shoulder, elbow, wrist = frames.origin[1], frames.origin[2], frames.origin[4]
    upper, fore = elbow - shoulder, wrist - elbow
    lengths = np.linalg.norm(upper, axis=0) * np.linalg.norm(fore, axis=0)
    cosine = (upper * fore).sum(axis=0) / lengths
    bend = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    return np.asarray(bend), np.hypot(wrist[0], wrist[1])


def _cables(limits: PlanLimits, trajectory: Trajectory) -> list[Violation]:
    allowed = 2.0 * np.pi * limits.cable_turns
    swept = np.ptp(trajectory.b, axis=0)
    return [
        Violation(
            "cable_turns",
            float(swept[j] - allowed) / UNIT_ANGLE,
            f"b{j + 1} sweeps {np.degrees(swept[j]):.0f} deg, "
            f"its cable allows {np.degrees(allowed):.0f}",
        )
        for j in range(BAR_ROWS)
    ]


def _over(limit: str, excess: float, text: str, t: float) -> Violation:
    return Violation(limit, float(excess), f"{text} (t = {t:.1f} s)")

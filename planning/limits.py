"""What a course violates: each limit as an excess, zero or less where it is kept, in units in which one is gross.

The excess leads a search to where everything is kept; the sentence tells a person what stands in the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, Geometry, robot_frames
from cell.robot_angles import joints_to_axes
from planning.course import Course
from planning.request import PlanLimits

UNIT_ANGLE = np.radians(30.0)
BAR_SINGULAR = (("b2", 1), ("b4", 3))


@dataclass(frozen=True)
class Violation:
    """One limit that a course does not keep."""

    limit: str
    excess: float  # of the limit's unit of grossness
    sentence: str


def violations(cell: Cell, limits: PlanLimits, course: Course) -> list[Violation]:
    """All limits of motion that a course violates, worst first; forces and clearance are judged elsewhere."""
    found = [
        *_axis_ranges(cell, limits, course),
        *_axis_rates(cell, limits, course),
        *_singularities(limits, course),
        *_reach(limits, course),
        *_cables(limits, course),
    ]
    return sorted((v for v in found if v.excess > 0.0), key=lambda v: -v.excess)


def _axis_ranges(cell: Cell, limits: PlanLimits, course: Course) -> list[Violation]:
    axes = joints_to_axes(cell.robot, course.q)
    margin = np.radians(limits.axis_margin_deg)
    over = np.maximum(cell.robot.axis_lower + margin - axes, axes - cell.robot.axis_upper + margin)
    out = []
    for axis in range(6):
        k = int(over[:, axis].argmax())
        low, high = np.degrees([cell.robot.axis_lower[axis], cell.robot.axis_upper[axis]])
        text = f"axis {axis + 1} at {np.degrees(axes[k, axis]):.0f} deg, range {low:.0f} to {high:.0f} less {limits.axis_margin_deg:g}"
        out.append(_over("axis_margin_deg", over[k, axis] / UNIT_ANGLE, text, course.t[k]))
    return out


def _axis_rates(cell: Cell, limits: PlanLimits, course: Course) -> list[Violation]:
    to_axis = cell.robot.joint_to_axis
    allowed = limits.axis_speed_share * cell.robot.axis_speed_max
    fast = np.abs(course.speed @ to_axis) / allowed
    hard = np.abs(course.acceleration @ to_axis) / np.radians(limits.axis_acceleration_deg_per_s2)
    out = []
    for key, ratio, unit, top in (
        ("axis_speed_share", fast, "deg/s", np.degrees(allowed)),
        (
            "axis_acceleration_deg_per_s2",
            hard,
            "deg/s^2",
            np.full(6, limits.axis_acceleration_deg_per_s2),
        ),
    ):
        k, axis = (int(i) for i in np.unravel_index(int(ratio.argmax()), ratio.shape))
        text = f"axis {axis + 1} at {ratio[k, axis] * top[axis]:.0f} {unit}, limit {top[axis]:.0f}"
        out.append(_over(key, ratio[k, axis] - 1.0, text, course.t[k]))
    k = int(course.tip_speed.argmax())
    text = f"tool at {course.tip_speed[k]:.2f} m/s, limit {limits.tcp_speed_m_per_s:g}"
    return [
        *out,
        _over(
            "tcp_speed_m_per_s",
            course.tip_speed[k] / limits.tcp_speed_m_per_s - 1.0,
            text,
            course.t[k],
        ),
    ]


def _singularities(limits: PlanLimits, course: Course) -> list[Violation]:
    out = []
    angles = [("axis 5", course.q[:, 4], limits.wrist_margin_deg, "wrist_margin_deg")]
    angles += [
        (name, course.b[:, j], limits.ballbar_margin_deg, "ballbar_margin_deg")
        for name, j in BAR_SINGULAR
    ]
    for name, angle, margin, key in angles:
        away = from_singular(angle)
        k = int(away.argmin())
        text = f"{name} {np.degrees(away[k]):.0f} deg from its singularity, limit {margin:g}"
        out.append(_over(key, (np.radians(margin) - away[k]) / UNIT_ANGLE, text, course.t[k]))
        crossed = np.flatnonzero(np.sin(angle) * np.sin(angle[0]) < 0.0)
        if crossed.size:
            out.append(_over(key, 1.0, f"{name} passes its singularity", course.t[crossed[0]]))
    return out


def from_singular(angle: Array) -> Array:
    """[rad] how far angles are from the nearest multiple of half a turn."""
    return np.asarray(np.arcsin(np.abs(np.sin(angle))))


def _reach(limits: PlanLimits, course: Course) -> list[Violation]:
    elbow, shoulder = arm_margins(course.nominal, course.q)
    k, s = int(elbow.argmin()), int(shoulder.argmin())
    return [
        _over(
            "elbow_margin_deg",
            (np.radians(limits.elbow_margin_deg) - elbow[k]) / UNIT_ANGLE,
            f"elbow {np.degrees(elbow[k]):.0f} deg from stretched, limit {limits.elbow_margin_deg:g}",
            course.t[k],
        ),
        _over(
            "shoulder_margin_m",
            (limits.shoulder_margin_m - shoulder[s]) / 0.3,
            f"wrist {shoulder[s]:.2f} m from axis 1, limit {limits.shoulder_margin_m:g}",
            course.t[s],
        ),
    ]


def arm_margins(geometry: Geometry, q: Array) -> tuple[Array, Array]:
    """(N,) [rad] of the arm from being stretched out, (N,) [m] of the wrist's centre from axis 1."""
    frames = robot_frames(geometry, q)
    shoulder, elbow, wrist = frames.origin[1], frames.origin[2], frames.origin[4]
    upper, fore = elbow - shoulder, wrist - elbow
    cosine = (upper * fore).sum(axis=0) / (
        np.linalg.norm(upper, axis=0) * np.linalg.norm(fore, axis=0)
    )
    bend = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    return np.asarray(bend), np.hypot(wrist[0], wrist[1])


def _cables(limits: PlanLimits, course: Course) -> list[Violation]:
    allowed = 2.0 * np.pi * limits.cable_turns
    swept = np.ptp(course.b, axis=0)
    return [
        Violation(
            "cable_turns",
            float(swept[j] - allowed) / UNIT_ANGLE,
            f"b{j + 1} sweeps {np.degrees(swept[j]):.0f} deg, its cable allows {np.degrees(allowed):.0f}",
        )
        for j in range(BAR_ROWS)
    ]


def _over(limit: str, excess: float, text: str, t: float) -> Violation:
    return Violation(limit, float(excess), f"{text} (t = {t:.1f} s)")

"""Violated limits of a trajectory.

Each limit gives an excess, zero or less where it is kept, in a unit in which 1 is gross. The excess
guides a search to where all limits are kept; the sentence informs a person.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, forward
from ballbar.cell.closed_form import has_closed_form
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames, nominal_chain
from ballbar.cell.numerical_inverse import dexterity, scaled_jacobian
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.planning.request import Cup, PlanCell, PlanLimits
from ballbar.planning.trajectory import Trajectory

GROSS_DEG = 30.0  # a gross violation of an angle; only guides a search
UNIT_ANGLE = np.radians(GROSS_DEG)
UNIT_SINGULAR = 0.15  # [-] a gross violation of a singular value, of which 0.05 is some 10 deg
UNIT_LENGTH = 0.3  # [m] a gross violation of the distance from axis 1
BAR_SINGULAR = (("b2", 1), ("b4", 3))
# [s] in which a servo catches up with what friction held back; in MuJoCo 0.18 s at the median
# reversal of an IRB 2400, 0.11 s of an NJ 220
CATCH_UP = 0.18
HELD = 0.2  # [s] from a reversal to when friction lets go, about
CROSSING = "side"  # in place of a unit: whether a singular posture was passed


@dataclass(frozen=True)
class Violation:
    """One limit that a trajectory does not keep."""

    limit: str
    excess: float  # 1 is gross
    sentence: str


@dataclass(frozen=True, eq=False)
class LimitedValue:
    """A value that has a limit, at every sample of a motion."""

    limit: str  # key of the request
    value: Array  # (N,)
    allowed: float
    unit: str
    gross: float  # by which a violation is gross; negative where `allowed` is the smallest
    text: Callable[[int], str]  # what was reached at a sample, and the limit

    @property
    def excess(self) -> Array:
        """(N,) zero or less where the limit is kept; 1 is gross."""
        return (self.value - self.allowed) / self.gross


def violations(
    cell: Cell,
    limits: PlanLimits,
    trajectory: Trajectory,
    around: PlanCell | None = None,
    held: Array | None = None,
) -> list[Violation]:
    """All limits of motion that a trajectory violates, worst first.

    around, held : as of `measures`. ballbar.planning.evaluation adds force and clearance.
    """
    worst = []
    for measure in measures(cell, limits, trajectory, around, held):
        k = int(measure.excess.argmax())
        text = f"{measure.text(k)} (t = {trajectory.t[k]:.1f} s)"
        worst.append(Violation(measure.limit, float(measure.excess[k]), text))
    if cell.ballbar.stroke is None:
        worst += _cables(limits, np.ptp(trajectory.b, axis=0))
    return sorted((v for v in worst if v.excess > 0.0), key=lambda v: -v.excess)


def _cables(limits: PlanLimits, swept: Array) -> list[Violation]:
    """Excess of each angle of the ball-bar by the range (5,) [rad] that it sweeps."""
    allowed = 2.0 * np.pi * limits.cable_turns
    return [
        Violation(
            "cable_turns",
            float(swept[j] - allowed) / UNIT_ANGLE,
            f"b{j + 1} sweeps {np.degrees(swept[j]):.0f} deg, "
            f"its cable allows {np.degrees(allowed):.0f}",
        )
        for j in range(BAR_ROWS)
    ]


def measures(
    cell: Cell,
    limits: PlanLimits,
    trajectory: Trajectory,
    around: PlanCell | None = None,
    held: Array | None = None,
) -> list[LimitedValue]:
    """Every limit of motion sample by sample, but the range of the cables over a whole run.

    around : states the cups of a telescoping bar. held : (J,) [rad] of `reversal`, where friction
    counts.
    """
    values = [*_axis_ranges(cell, limits, trajectory), *_rates(cell, limits, trajectory)]
    if has_closed_form(nominal_chain(cell.robot)):
        values += _postures(limits, trajectory)
    else:
        values += _singular_value(limits, trajectory)
    if cell.ballbar.stroke is None:
        for name, j in BAR_SINGULAR:
            angle = (name, trajectory.b[:, j], limits.ballbar_margin_deg, "ballbar_margin_deg")
            values += _singular_angle(*angle, trajectory)
    if held is not None:
        values.append(reversal(cell.robot, limits, trajectory, held))
    if around is not None:
        for key, cup, lean in leans(around, trajectory.nominal, trajectory.b):
            words = f"rod {{:.0f}} deg from the axis of the {key}"
            limit = (f"{key}.cone_deg", np.degrees(lean), cup.cone_deg, "deg")
            values.append(limited(*limit, GROSS_DEG, words))
    return values


def limited(
    limit: str, value: Array, allowed: float, unit: str, gross: float, words: str
) -> LimitedValue:
    """Values (N,) and the largest that is allowed, or the smallest, where `gross` is negative.

    words : of a value, which stands in their braces.
    """

    def text(k: int) -> str:
        return f"{words.format(value[k])}, limit {allowed:g}"

    return LimitedValue(limit, value, allowed, unit, gross, text)


def _axis_ranges(cell: Cell, limits: PlanLimits, trajectory: Trajectory) -> list[LimitedValue]:
    axes = np.degrees(joints_to_axes(cell.robot, trajectory.q))
    low, high = np.degrees(cell.robot.axis_lower), np.degrees(cell.robot.axis_upper)
    inside, margin = np.minimum(axes - low, high - axes), limits.axis_margin_deg

    def of_axis(axis: int) -> LimitedValue:
        def text(k: int) -> str:
            place = f"axis {axis + 1} at {axes[k, axis]:.0f} deg"
            return f"{place}, range {low[axis]:.0f} to {high[axis]:.0f} less {margin:g}"

        return LimitedValue("axis_margin_deg", inside[:, axis], margin, "deg", -GROSS_DEG, text)

    return [of_axis(axis) for axis in range(cell.robot.joints)]


def _rates(cell: Cell, limits: PlanLimits, trajectory: Trajectory) -> list[LimitedValue]:
    """Speeds and accelerations of the axes, and the speed of the tool."""
    to_axis, fastest = cell.robot.joint_to_axis, cell.robot.axis_speed_max

    def of_axes(key: str, rates: Array, unit: str, top: Array, rate_unit: str) -> LimitedValue:
        """Rates (N, J) as shares of their tops (J,), one of which is the limit."""
        allowed, share = getattr(limits, key), np.abs(rates) / top

        def text(k: int) -> str:
            axis = int(share[k].argmax())
            rate, most = np.degrees((abs(rates[k, axis]), allowed * top[axis]))
            return f"axis {axis + 1} at {rate:.0f} {rate_unit}, limit {most:.0f}"

        return LimitedValue(key, share.max(axis=1), allowed, unit, allowed, text)

    speed, bend = trajectory.speed @ to_axis, trajectory.acceleration @ to_axis
    degree = np.radians(np.ones(cell.robot.joints))  # as top: the share is the acceleration itself
    limit, unit = limits.tcp_speed_m_per_s, "deg/s^2"
    return [
        of_axes("axis_speed_share", speed, "", fastest, "deg/s"),
        of_axes("axis_acceleration_deg_per_s2", bend, unit, degree, unit),
        limited(
            "tcp_speed_m_per_s", trajectory.tip_speed, limit, "m/s", limit, "tool at {:.2f} m/s"
        ),
    ]


def reversal(robot: Robot, limits: PlanLimits, trajectory: Trajectory, held: Array) -> LimitedValue:
    """Accelerations of the axes after a gear reverses, with what its friction adds under the servo.

    held : (J,) [rad] that a gear stays behind until the servo overcomes its friction. At the
        acceleration a it stays for sqrt(2 held / a), then catches up with the speed of its target.
    """
    turned, there, later = reversing(robot, trajectory)
    caught_up = np.sign(turned) * np.sqrt(2.0 * held * np.abs(turned)) / CATCH_UP
    added = caught_up @ robot.gear_to_joint @ robot.joint_to_axis
    reached = np.maximum(np.abs(there + added), np.abs(later + added))
    rate = np.degrees(np.where(added, reached, 0.0))
    key = "axis_acceleration_deg_per_s2"
    allowed = getattr(limits, key)

    def text(k: int) -> str:
        axis = int(rate[k].argmax())
        reached = f"axis {axis + 1} at {rate[k, axis]:.0f} deg/s^2"
        return f"{reached} as friction lets go after a reversal, limit {allowed:.0f}"

    return LimitedValue(key, rate.max(axis=1), allowed, "deg/s^2", allowed, text)


def reversing(robot: Robot, trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """(N, J) [rad/s^2] of gears that reverse until the next sample, else 0; of the axes there, and
    HELD after that."""
    speed, bend = trajectory.speed @ robot.joint_to_gear, trajectory.acceleration
    turns = (speed[1:] * speed[:-1] < 0.0) & (np.diff(trajectory.first) == 0)[:, None]
    when = np.where(turns, speed[:-1] / np.where(turns, speed[:-1] - speed[1:], 1.0), 0.0)
    when, step = when.max(axis=1, keepdims=True), trajectory.t[1] - trajectory.t[0]
    there, later = (
        np.pad(bend[:-1] + share * np.diff(bend, axis=0), ((0, 1), (0, 0)))
        for share in (when, np.minimum(when + HELD / step, 1.0))
    )
    turned = np.pad(turns, ((0, 1), (0, 0))) * (there @ robot.joint_to_gear)
    return turned, there @ robot.joint_to_axis, later @ robot.joint_to_axis


def _singular_angle(
    name: str, angle: Array, margin: float, key: str, trajectory: Trajectory
) -> list[LimitedValue]:
    """An angle (N,) [rad] that is singular at half turns, and its margin [deg]."""
    away, words = np.degrees(from_singular(angle)), f"{name} {{:.0f}} deg from its singularity"
    return [
        limited(key, away, margin, "deg", -GROSS_DEG, words),
        _crossed(key, np.sin(angle), trajectory, f"{name} passes its singularity"),
    ]


def _crossed(key: str, side: Array, trajectory: Trajectory, text: str) -> LimitedValue:
    """A quantity (N,) that must keep the sign with which each run begins."""
    sign = np.where(side * side[trajectory.first] < 0.0, -1.0, 1.0)
    return LimitedValue(key, sign, 0.0, CROSSING, -1.0, lambda _: text)


def _singular_value(limits: PlanLimits, trajectory: Trajectory) -> list[LimitedValue]:
    """Smallest singular value of an arm whose singular postures show in no single angle."""
    chain, key, limit = trajectory.nominal.robot, "singular_value", limits.singular_value
    value, words = dexterity(chain, trajectory.q), "smallest singular value of the arm {:.3f}"
    values = [limited(key, value, limit, "", -UNIT_SINGULAR, words)]
    if chain.rows == 6:
        side = np.linalg.det(scaled_jacobian(chain, forward(chain, trajectory.q)))
        values.append(_crossed(key, side, trajectory, "the arm passes a singular posture"))
    return values


def leans(around: PlanCell, geometry: Geometry, b: Array) -> list[tuple[str, Cup, Array]]:
    """Each cup with its key and the angles (N,) [rad] between rod and axis at b (N, 5) [rad]."""
    if around.seat is None and around.target is None:
        return []
    frames = bar_frames(geometry, b)
    rod = frames.z[2]
    seen = -np.einsum("ijn,in->jn", frames.rotation(), rod)  # from the target, in its frame
    angles = []
    for key, cup, direction in (("seat", around.seat, rod), ("target", around.target, seen)):
        if cup is not None:
            axis = np.array(cup.axis) / np.linalg.norm(cup.axis)
            angles.append((key, cup, np.arccos(np.clip(axis @ direction, -1.0, 1.0))))
    return angles


def from_singular(angle: Array) -> Array:
    """(N,) [rad] distance of angles (N,) [rad] from the nearest multiple of half a turn."""
    return np.asarray(np.arcsin(np.abs(np.sin(angle))))


def _postures(limits: PlanLimits, trajectory: Trajectory) -> list[LimitedValue]:
    """Wrist, elbow and shoulder of an arm with closed form."""
    wrist, key = ("axis 5", trajectory.q[:, 4], limits.wrist_margin_deg), "wrist_margin_deg"
    elbow, shoulder = arm_margins(trajectory.robot)
    stretched = ("elbow_margin_deg", np.degrees(elbow), limits.elbow_margin_deg, "deg", -GROSS_DEG)
    above = ("shoulder_margin_m", shoulder, limits.shoulder_margin_m, "m", -UNIT_LENGTH)
    return [
        *_singular_angle(*wrist, key, trajectory),
        limited(*stretched, "elbow {:.0f} deg from stretched"),
        limited(*above, "wrist {:.2f} m from axis 1"),
    ]


def arm_margins(frames: Frames) -> tuple[Array, Array]:
    """Distances of an arm from its singular postures.

    Returns the angle of the elbow from stretched (N,) [rad], and the distance of the wrist's centre
    from axis 1 (N,) [m].
    """
    shoulder, elbow, wrist = frames.origin[1], frames.origin[2], frames.origin[4]
    upper, fore = elbow - shoulder, wrist - elbow
    lengths = np.linalg.norm(upper, axis=0) * np.linalg.norm(fore, axis=0)
    cosine = (upper * fore).sum(axis=0) / lengths
    bend = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    return np.asarray(bend), np.hypot(wrist[0], wrist[1])

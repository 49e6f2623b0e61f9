"""Reference paths: ball-bar angles over time, and the robot's command from inverse kinematics.

The five ball-bar angles are the five degrees of freedom of the closed mechanism, so a path written
in them stays on the sphere and away from the ball-bar's singularities by construction: `b_k = c_k +
A_k sin(2 pi n_k s + phi_k)`, with the phase s running from 0 to 1 (notes/mujoco sec. 10). The phase
is constant at the start, at the end and in every dwell between, and its acceleration is continuous,
so that both logs see the same dwells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError
from cell.geometry import Geometry, bar_frames
from cell.inverse import robot_branches
from cell.robot_angles import joints_to_axes

RAMP = 2.0  # [s] from a dwell to the cruising speed of the phase, and back: below 1 Hz


@dataclass(frozen=True)
class RodHarmonic:
    """One harmonic of the length of a telescoping rod: amplitude * sin(2 pi cycles s + phase)."""

    amplitude: float  # [m]
    cycles: int  # per run
    phase: float  # [rad]


@dataclass(frozen=True, eq=False)
class Lissajous:
    """Harmonics of the five ball-bar angles, and of the rod where it telescopes."""

    centre: Array  # (5,) [rad]
    amplitude: Array  # (5,) [rad]
    cycles: Array  # (5,) whole numbers per run
    phase: Array  # (5,) [rad]
    rod: tuple[RodHarmonic, ...] = ()

    def angles(self, s: Array) -> Array:
        """(N, 5) [rad] at phases s (N,)."""
        return self.centre + self.amplitude * np.sin(
            2.0 * np.pi * self.cycles * s[:, None] + self.phase
        )

    def lengthening(self, s: Array) -> Array:
        """(N,) [m] elongation of the commanded rod; 0 for a path on the sphere."""
        turn = 2.0 * np.pi * s
        waves = (h.amplitude * np.sin(h.cycles * turn + h.phase) for h in self.rod)
        return np.asarray(sum(waves, np.zeros_like(s)))


@dataclass(frozen=True, eq=False)
class ReferencePath:
    """The command of the controller."""

    t: Array  # (K,) [s] uniform, from 0
    b: Array  # (K, 5) [rad] ball-bar angles the nominal mechanism would take
    q: Array  # (K, 6) [rad] joint command, nominal inverse kinematics
    speed: Array  # (K, 6) [rad/s]


@dataclass(frozen=True, eq=False)
class PushPull:
    """One held pose, from which the command moves to and fro along the rod (thesis Fig. 5.8).

    The soft servo then pulls and pushes on the rod.
    """

    held: Array  # (5,) [rad] ball-bar angles
    travel: float  # [m] amplitude of the commanded length; the servo makes a force of it
    cycles: int  # per run

    def angles(self, s: Array) -> Array:
        """(N, 5) [rad] at phases s (N,): those of the held pose."""
        return np.tile(self.held, (s.size, 1))

    def lengthening(self, s: Array) -> Array:
        """(N,) [m] elongation of the commanded rod at phases s (N,)."""
        return np.asarray(self.travel * np.sin(2.0 * np.pi * self.cycles * s))


def phase_over_time(t: Array, *, duration: float, dwell: float, stops: int) -> Array:
    """(N,) phase 0..1 at times t (N,) [s] of a run of `duration` seconds.

    The phase dwells for `dwell` seconds at both ends and at `stops` places between, which divide it
    into equal pieces. Raises InputError when the dwells leave no time to move.
    """
    pieces = stops + 1
    moving = (duration - (stops + 2) * dwell) / pieces
    if moving <= 2.0 * RAMP:
        raise InputError(
            f"path.duration_s = {duration}: with {stops + 2} dwells of {dwell} s {moving:.1f} s "
            f"are left for each piece of the path, and {2 * RAMP} s go into its ramps. Take more "
            f"than {(stops + 2) * dwell + pieces * 2.0 * RAMP:g} s, or a shorter path.dwell_s."
        )
    phase = np.zeros_like(t)
    for k in range(pieces):
        phase += _piece((t - dwell - k * (moving + dwell)), moving) / pieces
    return phase


def _piece(t: Array, length: float) -> Array:
    """(N,) 0 to 1 over `length` seconds at times t (N,) [s] from its start.

    The speed rises and falls over RAMP with the smooth step 10x^3 - 15x^4 + 6x^5.
    """
    cruise = 1.0 / (length - RAMP)
    t = np.clip(t, 0.0, length)
    rising, falling = np.minimum(t, RAMP) / RAMP, np.maximum(0.0, t - (length - RAMP)) / RAMP
    between = np.clip(t, RAMP, length - RAMP) - RAMP
    ramps = RAMP * _ramp_integral(rising) + between + RAMP * (falling - _ramp_integral(falling))
    return cruise * ramps


def _ramp_integral(x: Array) -> Array:
    """Integral of the smooth step from 0 to x."""
    return np.asarray(2.5 * x**4 - 3.0 * x**5 + x**6)


def reference_path(
    robot: Robot,
    nominal: Geometry,
    shape: Lissajous | PushPull,
    *,
    duration: float,
    dwell: float,
    stops: int,
    step: float,
) -> ReferencePath:
    """The command of one run, sampled every `step` seconds; other times as in `phase_over_time`.

    Raises InputError naming time, joint and value where the path leaves the robot's reach, an axis
    range or a speed limit.
    """
    t: Array = np.arange(round(duration / step) + 1, dtype=np.float64) * step
    phase = phase_over_time(t, duration=duration, dwell=dwell, stops=stops)
    b = shape.angles(phase)
    frames = bar_frames(nominal, b)
    poses = frames.poses()
    poses[:, :3, 3] += (shape.lengthening(phase) * frames.z[2]).T
    q = _continuous_branch(robot, nominal, t, b, poses)
    speed = CubicSpline(t, q).derivative()(t)
    check_speeds(robot, t, speed)
    return ReferencePath(t, b, q, speed)


def _continuous_branch(robot: Robot, nominal: Geometry, t: Array, b: Array, poses: Array) -> Array:
    branches = robot_branches(nominal.robot, poses)
    lost = np.isnan(branches).any(axis=(0, 2))
    if lost.any():
        first = int(lost.argmax())
        raise InputError(
            f"path: out of reach at t = {t[first]:.2f} s (ball-bar angles "
            f"{np.degrees(b[first]).round(1)} deg); "
            "move the ball-bar (cell.ballbar_position_m, metres) or shrink the path"
        )
    faults = []
    for branch in branches:
        q = np.unwrap(branch, axis=0)
        for turn in range(6):
            q[:, turn] -= 2.0 * np.pi * np.round(q[:, turn].mean() / (2.0 * np.pi))
        fault = axis_range_fault(robot, t, q)
        if fault is None:
            return np.asarray(q)
        faults.append(fault)
    raise InputError(
        "path: every configuration of the arm leaves an axis range; "
        f"the nearest to feasible: {min(faults)[1]}"
    )


def axis_range_fault(robot: Robot, t: Array, q: Array) -> tuple[float, str] | None:
    """How far [rad] the worst sample leaves an axis range, and a sentence that says where.

    t : (N,) [s]. q : (N, 6) [rad] joint angles. Returns None where all axes stay in their ranges.
    """
    axes = joints_to_axes(robot, q)
    excess = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    if excess.max() <= 0.0:
        return None
    k, axis = (int(i) for i in np.unravel_index(int(excess.argmax()), excess.shape))
    limits = f"{np.degrees(robot.axis_lower[axis]):.0f}..{np.degrees(robot.axis_upper[axis]):.0f}"
    return (
        float(excess.max()),
        f"axis {axis + 1} at t = {t[k]:.2f} s: {np.degrees(axes[k, axis]):.1f} deg "
        f"outside {limits} deg; move the ball-bar or shrink the path",
    )


def check_speeds(robot: Robot, t: Array, speed: Array) -> None:
    """Raise InputError where joint speeds (N, 6) [rad/s] at times (N,) [s] exceed a limit."""
    ratio = np.abs(speed @ robot.joint_to_axis) / robot.axis_speed_max
    if ratio.max() > 1.0:
        k, axis = (int(i) for i in np.unravel_index(int(ratio.argmax()), ratio.shape))
        limit = np.degrees(robot.axis_speed_max[axis])
        raise InputError(
            f"path: axis {axis + 1} at t = {t[k]:.2f} s turns at "
            f"{ratio[k, axis] * limit:.0f} deg/s, limit {limit:.0f} deg/s; run it slower"
        )

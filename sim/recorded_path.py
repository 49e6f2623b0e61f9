"""Measured path: the motion of a recorded robot as reference of another run (thesis sec. 3.1).

The nominal robot's tool at the logged angles lies near the sphere but not on it, since the robot is
not nominal and the angles are noisy. The ball-bar angles are therefore those of an ideal ball-bar
that holds the tool's pose, smoothed over time; the mechanism that takes them is on the sphere.
Path, timing and the distribution of samples are those of the real run to within its errors (steps
1, 2).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline, CubicSpline

from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError
from cell.geometry import BAR_ROWS, Geometry, bar_frames, robot_frames
from cell.inverse import bar_angles, refine
from cell.logs import RobotLog
from cell.splines import DEGREE, smoothing_spline
from sim.path import ReferencePath, axis_range_fault, check_speeds

OFF_SPHERE = 0.020  # [m] ten times what an uncalibrated robot leaves (thesis sec. 5.4: 2 mm)
KNOT_SPACING = 0.1  # [s] keeps motion below 3 Hz, and a fifth of the noise of 4 ms rows
# b2 and b4 negative, as in the path files of this project; the log does not determine their signs.
BRANCH = (True, True)


def recorded_path(
    robot: Robot,
    nominal: Geometry,
    log: RobotLog,
    *,
    duration: float,
    step: float,
    telescopes: bool = False,
) -> ReferencePath:
    """The first `duration` seconds of a robot's log as a command, every `step` seconds.

    telescopes : whether the rod is as long as the log has it, and not rigid.

    Raises InputError when the log is shorter, the tool is not on the ball-bar's sphere, or the
    motion exceeds an axis range or a speed limit.
    """
    if duration > log.t[-1]:
        raise InputError(
            f"path.duration_s = {duration:g}: the recording's robot log lasts {log.t[-1]:.1f} s. "
            "Take no more than that."
        )
    poses = robot_frames(nominal, log.q).poses()
    off = np.linalg.norm(poses[:, :3, 3] - nominal.origin, axis=1) - nominal["bd3"]
    if not telescopes:
        _check_sphere(log.t, off)
        off = np.zeros_like(off)
    angles = np.unwrap(bar_angles(poses, nominal.origin, flipped=BRANCH), axis=0)
    smooth = _smoothed(log.t, np.column_stack((angles, off)))
    t: Array = np.arange(round(duration / step) + 1, dtype=np.float64) * step
    b = np.asarray(smooth(np.minimum(t, log.t[-1])))
    logged = np.stack([np.interp(t, log.t, angle) for angle in log.q.T], axis=1)
    q = refine(nominal.robot, logged, bar_frames(nominal, b).poses())
    if fault := axis_range_fault(robot, t, q):
        raise InputError(f"path: {fault[1]}")
    speed = CubicSpline(t, q).derivative()(t)
    check_speeds(robot, t, speed)
    return ReferencePath(t, b[:, :BAR_ROWS], q, speed)


def _check_sphere(t: Array, off: Array) -> None:
    """Raises InputError where the tool is far off the sphere; off : (N,) [m] beyond its radius."""
    k = int(np.abs(off).argmax())
    if abs(off[k]) > OFF_SPHERE:
        raise InputError(
            f"path.recording: at t = {t[k]:.1f} s the nominal tool is {off[k] * 1e3:+.0f} mm off "
            "the ball-bar's sphere. "
            "Were robot, ballbar, plate and ballbar_position_m those of the recording? Name those."
        )


def _smoothed(t: Array, angles: Array) -> BSpline:
    """Least-squares spline of angles (N, K) [rad]; stretches without rows carry no knots."""
    inner = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / KNOT_SPACING)) + 1)[1:-1]
    return smoothing_spline(t, angles, inner, rows=DEGREE + 1)

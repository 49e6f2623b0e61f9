"""Paired samples of both logs from the kinematic plant, without devices or clocks (thesis sec.
3.1).

    reference path -> sampling times -> true mechanism -> logged angles

The ball-bar takes the path's angles and the robot follows exactly, as in
ballbar.sim.plant.kinematic_plant; draws come from the streams of a recording with the same seed.
Errors that vary along the path have no mean in either log, since the thesis counts a mean as a
static error (sec. 3.1, steps 1-4). Encoder offsets are those of the static errors alone; none are
drawn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ballbar.cell.arrays import Array
from ballbar.cell.chain import cross, forward, joint_screws
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames
from ballbar.cell.inverse import refine
from ballbar.sim.errors.sample_errors import delay_of
from ballbar.sim.errors.sensor_effects import encoder_effects, resolver_effects
from ballbar.sim.errors.static_errors import true_geometry
from ballbar.sim.logging.encoders import motor_angles
from ballbar.sim.path import ReferencePath
from ballbar.sim.plant.effects import plant_effects
from ballbar.sim.plant.kinematic_plant import refuse_forces
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.streams import stream

# [rad/s] joint speed from which the robot counts as moving (ballbar.ident.estimator.samples)
MOVING = 1e-3
STICKING = 1e-3  # [m/s] speed below which friction keeps its sign; assumed
STRETCH = 2.0  # [s] mean time between two drawn changes of the rod's force; assumed
SETTLING = 0.2  # [s] around a sample at which the robot stands still, in which it does not move
CHORDS = 10  # steps with the nominal Jacobian; errors of 1 mm and 1 mrad need five
CONVERGED = 1e-13  # [rad] of a step (ballbar.cell.inverse.refine)
Instants = Literal["all", "standing", "moving", "constant_speed"]
COUNTED = (
    "signal_noise", "frozen_bits", "amplitude_errors", "slipped_periods", "outliers", "joint_lag",
    "thermal_growth",
)  # fmt: skip
STAMPED = (
    "wander", "robot_wander", "step", "quantum", "jitter", "dropped_rows", "duplicated_rows",
    "restart",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class SampledPath:
    """A reference path at N times, and the nominal robot that follows it; nothing is drawn."""

    cell: Cell
    nominal: Geometry
    t: Array  # (N,) [s] from the start of the path
    delay: float  # [s] by which the robot's angles are logged later than the ball-bar's
    b: Array  # (N, 5) [rad] ball-bar angles at these times
    # at the times at which the robot's angles are logged:
    b_later: Array  # (N, 5) [rad] ball-bar angles
    q: Array  # (N, 6) [rad] nominal joint angles
    rising: Array  # (N,) +1 while the rod's end rises, -1 while it sinks
    around: Array  # (N,) +1 while it moves counterclockwise around the base, -1 otherwise
    inverse: Array  # (N, 6, 6) inverse of the nominal robot's Jacobian


@dataclass(frozen=True, eq=False)
class KinematicSamples:
    """Paired samples as an identifier gets them, and their truth."""

    t: Array  # (N,) [s] from the start of the path
    q: Array  # (N, 6) [rad] logged robot angles
    b: Array  # (N, 5) [rad] logged ball-bar angles of all joints, fitted or not
    sign: Array  # (N,) sign of the rod's force: +1 under tension, where it is longer
    nominal: Geometry
    true: Geometry  # btheta holds the mechanical errors only


def sample_path(
    cell: Cell,
    nominal: Geometry,
    path: ReferencePath,
    count: int,
    *,
    delay: float = 0.0,
    instants: Instants = "all",
) -> SampledPath:
    """A path at `count` times, from the first to the last motion of the robot.

    delay : [s] by which the robot's angles are logged later than the ball-bar's. instants : which
        parts of the path the times are spread over evenly.

    Raises InputError if nothing moves, or if the path has no such instants.
    """
    moving = np.flatnonzero(np.abs(path.speed).max(axis=1) > MOVING)
    if not moving.size:
        raise InputError(
            "path: the robot does not move between start and end; there is nothing to sample. "
            "Take a path that moves."
        )
    t = np.linspace(path.t[moving[0]], path.t[moving[-1]], count)
    if instants != "all":
        rows = moving[0] + np.flatnonzero(_at(instants, path)[moving[0] : moving[-1] + 1])
        if not rows.size:
            raise InputError(
                f"identify.instants = {instants}: the path has none between its first and its last "
                "motion. Set path.stops and path.dwell_s, or choose others."
            )
        t = path.t[rows[np.linspace(0, rows.size - 1, count).round().astype(np.intp)]]
    return sample_path_at(cell, nominal, path, t, delay=delay)


def _at(instants: Instants, path: ReferencePath) -> NDArray[np.bool_]:
    """(K,) which rows of a path are such instants.

    At nearly constant speed the largest joint acceleration is in the lowest quarter of the motion.
    """
    moves = np.asarray(np.abs(path.speed).max(axis=1) > MOVING)
    if instants == "moving":
        return moves
    if instants == "standing":
        from scipy.ndimage import binary_dilation  # noqa: PLC0415  slow to import, and needed here alone

        width = 2 * round(SETTLING / (path.t[1] - path.t[0])) + 1
        moved: NDArray[np.bool_] = binary_dilation(moves, np.ones(width, dtype=bool))
        return np.logical_not(moved)
    acceleration = np.abs(np.gradient(path.speed, path.t, axis=0)).max(axis=1)
    return np.asarray(moves & (acceleration < np.quantile(acceleration[moves], 0.25)))


def sample_path_at(
    cell: Cell, nominal: Geometry, path: ReferencePath, t: Array, *, delay: float = 0.0
) -> SampledPath:
    """A path at times t (N,) [s]; other arguments as of `sample_path`."""
    later = np.clip(t + delay, path.t[0], path.t[-1])
    angles = CubicSpline(path.t, np.concatenate((path.b, path.q), axis=1))
    b_later, commanded = np.split(angles(later), [BAR_ROWS], axis=1)
    q = refine(nominal.robot, commanded, bar_frames(nominal, b_later).poses())
    jacobian = np.asarray(joint_screws(forward(nominal.robot, q)).transpose(2, 1, 0))
    tip = bar_frames(nominal, path.b).tip - nominal.origin[:, None]
    x, y, _ = tip
    velocity = CubicSpline(path.t, tip, axis=1)(path.t, 1)
    tangential = (x * velocity[1] - y * velocity[0]) / np.hypot(x, y)
    row = np.rint((later - path.t[0]) / (path.t[1] - path.t[0])).astype(np.intp)
    return SampledPath(
        cell=cell,
        nominal=nominal,
        t=t,
        delay=delay,
        b=angles(t)[:, :BAR_ROWS],
        b_later=b_later,
        q=q,
        rising=_held_sign(velocity[2])[row],
        around=_held_sign(tangential)[row],
        inverse=np.asarray(np.linalg.inv(jacobian), dtype=np.float64),
    )


def _held_sign(speed: Array) -> Array:
    """(K,) sign of a speed (K,) [m/s]; below STICKING the last holds, at the start the first."""
    slides = np.abs(speed) > STICKING
    if not slides.any():
        return np.ones_like(speed)
    last = np.maximum.accumulate(np.where(slides, np.arange(speed.size), -1))
    return np.sign(speed[np.where(last < 0, int(slides.argmax()), last)])


def kinematic_samples(settings: SimulationSettings, path: SampledPath) -> KinematicSamples:
    """The samples of one run.

    path : sampled with the delay of the settings (ballbar.sim.errors.sample_errors.delay_of).

    Raises ValueError for another delay, InputError for errors that samples do not have (forces,
    counters, stamps), and UnreachableError near a singularity of the robot.
    """
    delay = delay_of(settings.errors)
    if path.delay != delay:
        raise ValueError(f"path sampled with a delay of {path.delay} s, settings ask for {delay} s")
    refuse_forces(settings)
    errors, cell, seed = settings.errors, path.cell, settings.seed
    stated = [f"errors.{name}" for name in COUNTED if getattr(errors, name)]
    stated += [f"clocks.{name}" for name in STAMPED if getattr(settings.clocks, name) is not None]
    if stated:
        raise InputError(
            f"{stated[0]}: acts on device logs, and identify.data = samples has neither counters, "
            "stamps nor a machine that changes. Use identify.data = files, or leave it out."
        )
    true = true_geometry(path.nominal, errors, cell, seed=seed)
    rod, sign = errors.rod_deviation, path.rising
    if rod and rod.pulled == "drawn":
        rng = stream(seed, "rod_deviation")
        changes = rng.random(path.t.size) < np.gradient(path.t) / STRETCH
        sign = np.where(np.cumsum(changes) % 2 == 0, 1.0, -1.0)
    elif rod and rod.pulled == "counterclockwise":
        sign = path.around
    longer = rod.amplitude_m * without_mean(sign) if rod else np.zeros_like(path.t)
    q = _follow(true, path, longer)
    logged = q + without_mean(_robot_log(settings, cell, q) - q)
    b = path.b + without_mean(_ballbar_log(settings, cell, path) - path.b)
    if errors.truncation:
        step = errors.truncation.step_rad
        b = np.rint(b / step) * step
    return KinematicSamples(path.t, logged, b, sign, path.nominal, true)


def without_mean(error: Array) -> Array:
    """An error (N, ...) along the path without its mean.

    The mean would be a static error (thesis sec. 3.1).
    """
    return np.asarray(error - error.mean(axis=0))


def _follow(true: Geometry, path: SampledPath, longer: Array) -> Array:
    """(N, 6) [rad] joint angles that bring the true robot to the end of the true ball-bar.

    longer : (N,) [m] deviation of the rod from bd3. Raises UnreachableError.
    """
    target = bar_frames(true, path.b_later)
    tip = target.tip + longer * target.z[2]
    q, chain = path.q.copy(), true.robot
    for _ in range(CHORDS):
        frames = forward(chain, q)
        # twice the rotation, to first order, and exact where it vanishes
        turn = (
            cross(frames.x[-1], target.x[-1])
            + cross(frames.y[-1], target.y[-1])
            + cross(frames.z[-1], target.z[-1])
        )
        error = np.concatenate((tip - frames.tip, 0.5 * turn))
        step = np.einsum("nij,jn->ni", path.inverse, error)
        q += step
        if np.abs(step).max() < CONVERGED:
            return q
    poses = target.poses()
    poses[:, :3, 3] = tip.T
    return refine(chain, path.q, poses)


def _robot_log(settings: SimulationSettings, cell: Cell, q: Array) -> Array:
    """(N, 6) [rad] joint angles that the robot logs at true joint angles q (N, 6) [rad]."""
    robot, errors, seed = cell.robot, settings.errors, settings.seed
    gears = q @ robot.joint_to_gear
    ripple = plant_effects(errors, cell, seed).transmission_error(gears)
    shown = (gears - ripple) @ robot.gear_to_joint
    resolvers = resolver_effects(errors.resolver_error, joints=robot.joints, seed=seed)
    motors = motor_angles(robot, shown, errors, resolvers, settings.recording_seed)
    return np.asarray(motors @ robot.transmission)


def _ballbar_log(settings: SimulationSettings, cell: Cell, path: SampledPath) -> Array:
    """(N, 5) [rad] readings of encoders without counters at the path's angles."""
    encoders, lines, seed = settings.encoders, cell.ballbar.encoder_lines, settings.seed
    read = np.empty_like(path.b)
    for joint in range(1, BAR_ROWS + 1):
        effects = encoder_effects(
            settings.errors, joint, lines=lines, bits=encoders.bits, seed=seed
        )
        rng = stream(settings.recording_seed, f"encoder_noise_b{joint}")
        noise = rng.normal(0.0, encoders.noise_sigma_rad, path.t.size)
        read[:, joint - 1] = effects.read_angle(path.b[:, joint - 1], path.t) + noise
    return read

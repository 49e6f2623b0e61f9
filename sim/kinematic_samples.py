"""The kinematic plant at a few instants: paired samples of both logs, without devices or clocks (thesis sec. 3.1, steps 1-4).

    reference path -> instants -> true mechanism -> logged angles

The ball-bar takes the path's angles and the robot follows exactly, as in sim.plant.kinematic_plant; draws come from the same streams as those of
a recording with the same seed. What varies along the path has no mean, on either side: the thesis counts a mean as a static error
(sec. 3.1). Encoders stand at the zeros of the static errors alone; none is drawn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.chain import Chain, Frames, cross, forward, joint_screws
from cell.descriptions import Cell
from cell.errors import InputError
from cell.geometry import BAR_ROWS, Geometry, bar_frames
from cell.inverse import refine
from sim.errors.sample_errors import delay_of
from sim.errors.sensor_effects import encoder_effects, resolver_effects
from sim.errors.static_errors import true_geometry
from sim.logging.encoders import motor_angles
from sim.path import ReferencePath
from sim.plant.effects import plant_effects
from sim.plant.kinematic_plant import refuse_forces
from sim.settings import SimulationSettings
from sim.streams import stream

MOVING = (
    1e-3  # [rad/s] joint speed from which the robot counts as moving (ident.estimator.sampling)
)
STICKING = 1e-3  # [m/s] vertical speed below which friction keeps its sign
CHORDS = 10  # steps with the nominal Jacobian; errors of 1 mm and 1 mrad need five
ARRIVED = 1e-13  # [rad] of a step (cell.inverse.refine)
COUNTED = ("frozen_bits", "amplitude_errors", "slipped_periods", "outliers")
STAMPED = ("wander", "step", "quantum", "jitter", "dropped_rows", "duplicated_rows", "restart")


@dataclass(frozen=True, eq=False)
class SampledPath:
    """A reference path at N instants, and how the nominal robot follows it; nothing here is drawn."""

    cell: Cell
    nominal: Geometry
    t: Array  # (N,) [s] from the start of the path
    delay: float  # [s] by which the robot's angles are logged later than the ball-bar's
    b: Array  # (N, 5) [rad] ball-bar angles at these instants
    b_later: Array  # (N, 5) [rad] and when the robot's angles are logged
    q: Array  # (N, 6) [rad] nominal joint angles then
    rising: Array  # (N,) +1 while the rod's end rises then, -1 while it sinks
    inverse: Array  # (N, 6, 6) inverse of the nominal robot's Jacobian then


@dataclass(frozen=True, eq=False)
class KinematicSamples:
    """Paired samples as an identifier gets them, and the truth behind them."""

    t: Array  # (N,) [s] from the start of the path
    q: Array  # (N, 6) [rad] logged robot angles
    b: Array  # (N, 5) [rad] logged ball-bar angles of all joints, fitted or not
    sign: Array  # (N,) sign of the rod's force: +1 pulled, where it is longer
    nominal: Geometry
    true: Geometry  # btheta holds the mechanical errors: no zeros are drawn


def sample_path(
    cell: Cell, nominal: Geometry, path: ReferencePath, count: int, *, delay: float = 0.0
) -> SampledPath:
    """`count` instants evenly over the part of a path from where the robot first moves to where it last does.

    delay : [s] by which the robot's angles are logged later than the ball-bar's. Raises InputError if nothing moves.
    """
    moving = np.flatnonzero(np.abs(path.speed).max(axis=1) > MOVING)
    if not moving.size:
        raise InputError(
            "path: the robot stands still from start to end; there is nothing to sample"
        )
    return sample_path_at(
        cell, nominal, path, np.linspace(path.t[moving[0]], path.t[moving[-1]], count), delay=delay
    )


def sample_path_at(
    cell: Cell, nominal: Geometry, path: ReferencePath, t: Array, *, delay: float = 0.0
) -> SampledPath:
    """A path at chosen instants t (N,) [s]; as `sample_path`."""
    later = np.clip(t + delay, path.t[0], path.t[-1])
    course = CubicSpline(path.t, np.concatenate((path.b, path.q), axis=1))
    b_later, near = np.split(course(later), [BAR_ROWS], axis=1)
    q = refine(nominal.robot, near, bar_frames(nominal, b_later).poses())
    jacobian = np.asarray(joint_screws(forward(nominal.robot, q)).transpose(2, 1, 0))
    rising = _held_sign(CubicSpline(path.t, bar_frames(nominal, path.b).tip[2])(path.t, 1))
    row = np.rint((later - path.t[0]) / (path.t[1] - path.t[0])).astype(np.intp)
    return SampledPath(
        cell=cell,
        nominal=nominal,
        t=t,
        delay=delay,
        b=course(t)[:, :BAR_ROWS],
        b_later=b_later,
        q=q,
        rising=rising[row],
        inverse=np.asarray(np.linalg.inv(jacobian), dtype=np.float64),
    )


def _held_sign(speed: Array) -> Array:
    """(K,) sign of a speed (K,) [m/s], kept from before where the speed is too small to tell, and from after at the start."""
    sure = np.abs(speed) > STICKING
    if not sure.any():
        return np.ones_like(speed)
    last = np.maximum.accumulate(np.where(sure, np.arange(speed.size), -1))
    return np.sign(speed[np.where(last < 0, int(sure.argmax()), last)])


def kinematic_samples(settings: SimulationSettings, path: SampledPath) -> KinematicSamples:
    """The samples of one run.

    path : with the delay that the settings ask for (sim.errors.sample_errors.delay_of); ValueError if it has another.

    Raises InputError for what samples do not have (forces, counters, stamps), UnreachableError near a singularity of the robot.
    """
    if path.delay != delay_of(settings.errors):
        raise ValueError(
            f"path sampled with a delay of {path.delay} s, settings ask for {delay_of(settings.errors)} s"
        )
    refuse_forces(settings)
    _refuse_devices(settings)
    errors, cell, seed = settings.errors, path.cell, settings.seed
    true = true_geometry(path.nominal, errors, plate_sigma=cell.plate.length_sigma, seed=seed)
    rod = errors.rod_deviation
    longer = rod.amplitude_m * without_mean(path.rising) if rod else np.zeros_like(path.t)
    q = _follow(true, path, longer)
    logged = q + without_mean(_robot_log(settings, cell, q) - q)
    b = path.b + without_mean(_ballbar_log(settings, cell, path) - path.b)
    if errors.truncation:
        step = errors.truncation.step_rad
        b = np.rint(b / step) * step
    return KinematicSamples(path.t, logged, b, path.rising, path.nominal, true)


def without_mean(error: Array) -> Array:
    """An error along the path (N, ...) without its mean over the path, which would be a static error (thesis sec. 3.1)."""
    return np.asarray(error - error.mean(axis=0))


def _refuse_devices(settings: SimulationSettings) -> None:
    asked = [f"errors.{name}" for name in COUNTED if getattr(settings.errors, name)]
    asked += [f"clocks.{name}" for name in STAMPED if getattr(settings.clocks, name) is not None]
    if asked:
        raise InputError(
            f"{asked[0]}: acts on device logs, and identify.data = samples has neither counters nor stamps. "
            "Use identify.data = files, or leave it out."
        )


def _follow(true: Geometry, path: SampledPath, longer: Array) -> Array:
    """(N, 6) [rad] joint angles that bring the true robot to the true ball-bar's end, the rod `longer` (N,) [m] than bd3.

    Raises UnreachableError.
    """
    target = bar_frames(true, path.b_later)
    tip = target.tip + longer * target.z[2]
    q, chain = path.q.copy(), true.robot
    for _ in range(CHORDS):
        step = np.einsum(
            "nij,jn->ni", path.inverse, _small_mismatch(target, tip, forward(chain, q))
        )
        q += step
        if np.abs(step).max() < ARRIVED:
            return q
    return _newton(chain, path.q, target, tip)


def _newton(chain: Chain, near: Array, target: Frames, tip: Array) -> Array:
    poses = target.poses()
    poses[:, :3, 3] = tip.T
    return refine(chain, near, poses)


def _small_mismatch(target: Frames, tip: Array, frames: Frames) -> Array:
    """(6, N) [m, rad] from a frame to one close by; the rotation to first order, exact where it vanishes."""
    turn = (
        cross(frames.x[-1], target.x[-1])
        + cross(frames.y[-1], target.y[-1])
        + cross(frames.z[-1], target.z[-1])
    )
    return np.concatenate((tip - frames.tip, 0.5 * turn))


def _robot_log(settings: SimulationSettings, cell: Cell, q: Array) -> Array:
    """(N, 6) [rad] what the robot logs at true joint angles."""
    robot, errors = cell.robot, settings.errors
    gears = q @ robot.joint_to_gear
    shown = (
        gears - plant_effects(errors, cell, settings.seed).transmission_error(gears)
    ) @ robot.gear_to_joint
    resolvers = (
        resolver_effects(errors.resolver_error, seed=settings.seed)
        if errors.resolver_error
        else None
    )
    return np.asarray(
        motor_angles(robot, shown, errors, resolvers, settings.seed) @ robot.transmission
    )


def _ballbar_log(settings: SimulationSettings, cell: Cell, path: SampledPath) -> Array:
    """(N, 5) [rad] what encoders without counters read at the path's angles."""
    encoders, lines, seed = settings.encoders, cell.ballbar.encoder_lines, settings.seed
    read = np.empty_like(path.b)
    for joint in range(1, BAR_ROWS + 1):
        effects = encoder_effects(
            settings.errors, joint, lines=lines, bits=encoders.bits, seed=seed
        )
        noise = stream(seed, f"encoder_noise_b{joint}").normal(
            0.0, encoders.noise_sigma_rad, path.t.size
        )
        read[:, joint - 1] = effects.read_angle(path.b[:, joint - 1], path.t) + noise
    return read

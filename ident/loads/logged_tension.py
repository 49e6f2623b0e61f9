"""The rod's tension at the samples of a recording, from the signal that was logged.

A torque or force log is averaged over blocks of rows, so that noise and friction average out while
the motion hardly changes, and brought to the ball-bar's clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar
from scipy.sparse import block_diag, csr_array

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import ForceLog, RobotLog
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.loads.gear_loads import Loads, loads, mass_model
from ballbar.ident.loads.rod_tension import (
    ROUNDS,
    Tension,
    force_sensor,
    from_motor_torque,
    on_flange,
)

KNOTS_PER_SECOND = 1.25  # 150 in 120 s; 60 are too few (notes/identification sec. 4)
LEAST_KNOTS = 8
SPACING = 0.3  # [s] of samples that can follow the knots
APART = 4.0 / KNOTS_PER_SECOND  # [s] between samples that share no spline
AVERAGED = 0.08  # [s] of rows behind one value
BEYOND = 1.0  # [s] of torque rows used before the first and after the last sample
SENSOR_LAG = 2.0  # [s] the sensor's log may begin that much before or after the robot's
LAG_STEP = 0.05  # [s]
FORCE_PRIOR = 5.0  # [N] of each part; a wire pulls with 3 to 10 N (recalled), a rod with less
SLIDING = 3e-5  # [m/s] of the length, over which the friction changes its sign


def tension_splines(times: Array) -> csr_array:
    """(K, N) cubic B-splines over times (N,) [s], on uniform knots in each of their stretches."""
    apart = np.flatnonzero(np.diff(times) > APART) + 1
    return csr_array(block_diag([_splines(part) for part in np.split(times, apart)]))


def _splines(times: Array) -> csr_array:
    """(K, N) cubic B-splines on uniform knots over the times (N,) [s]."""
    last = max(times[-1], times[0] + 1.0 / KNOTS_PER_SECOND)
    count = max(LEAST_KNOTS, int(KNOTS_PER_SECOND * (last - times[0])))
    inner = np.linspace(times[0], last, count - 2)
    knots = np.concatenate((np.repeat(inner[0], 3), inner, np.repeat(inner[-1], 3)))
    return csr_array(BSpline.design_matrix(np.clip(times, inner[0], inner[-1]), knots, 3).T)


@dataclass(frozen=True, eq=False)
class LoggedTorque:
    """Motor torques in blocks of rows, and the motion that they drove."""

    times: Array  # (N,) [s] on the ball-bar's clock
    torque: Array  # (J, N) [N m] at the gears' outputs
    q: Array  # (N, J) [rad] joint angles
    speed: Array  # (J, N) [rad/s] of the gears
    acceleration: Array  # (J, N) [rad/s^2]
    carried: Loads  # of the mass model
    ballbar: Array  # (N, 5) [rad] as the encoders read


def torque_tension(
    cell: Cell, samples: Samples, geometry: Geometry, clock: Clock, log: RobotLog
) -> Array:
    """(N,) [N] at the samples, from the motor torques of a log.

    Arguments and errors as of `logged_torque`.
    """
    logged = logged_torque(cell, samples, geometry, clock, log)
    tension = from_motor_torque(
        cell, logged.torque, logged.carried, logged.speed, logged.acceleration
    )
    return np.interp(samples.times, logged.times, tension.force)


def logged_torque(
    cell: Cell,
    samples: Samples,
    geometry: Geometry,
    clock: Clock,
    log: RobotLog,
    *,
    most: int | None = None,
) -> LoggedTorque:
    """The motor torques of a recording; geometry, clock : as far as they are known.

    most : times, about, to which a longer recording is thinned out; by default it is not.

    Raises InputError when no torques were logged, or the robot's file lacks what they need.
    """
    if log.torque is None:
        raise InputError("the robot's log has no motor torques; choose force auto, sensor or none")
    cell.robot.required("links")  # the others are asked for where they are used
    middle, torque = _block_means(log.t, samples.robot.stamps, log.torque)
    times = clock.ballbar_time(middle)
    first, last = samples.times[0] - BEYOND, samples.times[-1] + BEYOND
    if samples.ballbar is not None:
        first, last = max(first, samples.ballbar.start), min(last, samples.ballbar.end)
    inside = np.flatnonzero((times > first) & (times < last))
    inside = inside[:: 1 if most is None else max(1, inside.size // most)]
    times, torque = times[inside], torque[inside]
    at = samples.robot_time(clock, times)
    q, speed = samples.robot.spline(at), samples.robot.speed(at)
    acceleration = np.asarray(samples.robot.arm(at, 2))
    ballbar = samples.ballbar_angles(geometry, clock, times)
    carried = loads(
        mass_model(cell), geometry, q=q, b=ballbar, speed=speed, acceleration=acceleration
    )
    to_gear = cell.robot.joint_to_gear
    return LoggedTorque(
        times=times,
        torque=torque.T,
        q=q,
        speed=(speed @ to_gear).T,
        acceleration=(acceleration @ to_gear).T,
        carried=carried,
        ballbar=ballbar,
    )


def sensor_tension(
    cell: Cell, samples: Samples, geometry: Geometry, clock: Clock, log: ForceLog | None
) -> Array:
    """(N,) [N] at the samples, from a force sensor, its clock aligned by its expected signal.

    Raises InputError when there is no such log.
    """
    if log is None:
        raise InputError("there is no log of a force sensor; choose force auto, torque or none")
    middle, wrench = _block_means(log.t, log.t, log.wrench)
    at = samples.robot_time(clock, samples.times)
    q, ballbar = samples.robot.spline(at), samples.ballbar_angles(geometry, clock)
    sensor = force_sensor(on_flange(cell, geometry, q, ballbar))

    def at_lag(lag: float, rounds: int = 1) -> tuple[Tension, float]:
        measured = np.stack([np.interp(at - lag, middle, column) for column in wrench.T])
        return sensor(measured, rounds)

    lags = np.arange(-SENSOR_LAG, SENSOR_LAG + 0.5 * LAG_STEP, LAG_STEP)
    best = float(lags[int(np.argmin([at_lag(float(lag))[1] for lag in lags]))])
    refined = minimize_scalar(
        lambda lag: at_lag(float(lag))[1],
        bounds=(best - LAG_STEP, best + LAG_STEP),
        method="bounded",
    )
    return at_lag(float(refined.x), ROUNDS)[0].force


def _block_means(t: Array, stamps: Array, values: Array) -> tuple[Array, Array]:
    """Means of blocks of rows: times (B,) [s] of the stamps (R,), values (B, C) of (R, C)."""
    rows = max(1, round(AVERAGED / float(np.median(np.diff(t)))))
    blocks = t.size // rows
    middle = stamps[: blocks * rows].reshape(blocks, rows).mean(axis=1)
    return middle, values[: blocks * rows].reshape(blocks, rows, -1).mean(axis=1)


def instrument_forces(samples: Samples, stroke: tuple[float, float]) -> csr_array:
    """(3, N) force [N] along a telescoping rod or a wire for 1 N of each part.

        F = F_0 + F_1 extension / range + F_2 sign(extension rate)

    A constant, the spring of the length's sensor, and its friction take the place of the tension's
    spline. Friction has the sign of the speed at which the length changes, so without it the arm's
    deflection passes for a clock offset: 1.4 ms for 0.3 N on the IRB 2400 and 0.3 mm/s.

    samples : of a sensed length. stroke : [m] shortest and longest length.
    """
    half = 0.5 * (stroke[1] - stroke[0])
    rate = samples.extension_rate
    return csr_array(
        np.stack((np.ones_like(rate), samples.extension / half, rate / np.hypot(rate, SLIDING)))
    )

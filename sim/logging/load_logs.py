"""Logged loads: motor torques of the robot, and a six-axis force sensor at the flange.

Torques are those that the motors exert, N m at the motor, positive along its angle; the gain error
is one number per axis. The sensor (such as the JR3 of thesis sec. 5.3) gives force and torque that
plate and ball-bar exert on the flange, in the flange's frame about its origin, on a clock of its
own.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from cell.arrays import Array
from cell.clock import Clock
from cell.descriptions import Robot
from cell.dialect import load_dialect
from cell.errors import DescriptionError
from cell.logs import SourceName
from cell.schema import NotNegative, Strict
from sim.logging.tracker import OpticalTracker
from sim.motion import Motion
from sim.streams import stream

SENSOR_EPOCH = 17.0  # [s] up-time of the sensor's logger at its first row


class TorqueLog(Strict):
    """Motor torques stand in the robot's log, in columns tau1..tau6."""

    noise_N_m: NotNegative = 2.0
    """Standard deviation of white noise at the outputs of gears 1-3 (notes/identification sec. 1).
    """
    wrist_noise_N_m: NotNegative = 0.3
    """Standard deviation of white noise at the outputs of gears 4-6."""
    gain_sigma: NotNegative = 0.02
    """Standard deviation of the gain error of each axis, drawn per run."""


class ForceSensor(Strict):
    """A six-axis force sensor at the flange is logged with its own rate and clock."""

    rate_hz: Annotated[float, Field(gt=0.0, le=10_000.0)] = 500.0
    """Rows per second."""
    noise_N: NotNegative = 1.0
    """Standard deviation of white noise of each force (notes/identification sec. 1)."""
    noise_N_m: NotNegative = 0.1
    """Standard deviation of white noise of each torque; assumed."""
    bias_N: NotNegative = 2.0
    """Standard deviation of the constant bias of each force; assumed."""
    bias_N_m: NotNegative = 0.2
    """Standard deviation of the constant bias of each torque; assumed."""
    gain_sigma: NotNegative = 0.01
    """Standard deviation of the gain error of each channel."""
    offset_s: float = 0.05
    """Time from the first row of the robot to the first of the sensor."""
    skew: Annotated[float, Field(ge=-2e-3, le=2e-3)] = 0.0
    """Seconds that the robot's clock gains in each second of the sensor's."""


def _dialect_of(source: SourceName) -> AfterValidator:
    """A check that a name is that of a dialect with logs of a source."""

    def check(name: str) -> str:
        try:
            dialect = load_dialect(name)
        except DescriptionError as error:
            raise ValueError(str(error)) from None
        if dialect.source != source:
            raise ValueError(f"{name} describes logs of a {dialect.source}, not of a {source}")
        return name

    return AfterValidator(check)


class RobotLog(Strict):
    """How the robot's controller logs its angles."""

    dialect: Annotated[str, _dialect_of("robot")] | None = None
    """A dialect of cell/dialects that holds a robot's angles; by default that of the robot's file.
    """
    rate_hz: Annotated[float, Field(ge=10.0, le=10_000.0)] | None = None
    """Rows per second; by default those that the dialect's file states."""


class BallbarLog(Strict):
    """How the ball-bar's encoders are logged: a PLC writes a row every two tasks."""

    dialect: Annotated[str, _dialect_of("ballbar")] = "twincat-plc"
    """A dialect of cell/dialects that holds a ball-bar's counters."""
    task_s: Annotated[float, Field(ge=1.0e-4, le=0.05)] = 0.005
    """Cycle of the PLC's task (thesis sec. 4.6)."""
    status: bool = True
    """Whether the status words of the terminals are logged."""


class LoadLogs(Strict):
    """Loads that are logged; each is absent unless named."""

    torque: TorqueLog | None = None
    force_sensor: ForceSensor | None = None


class DeviceLogs(LoadLogs):
    """What is logged beside angles, and in which form."""

    robot: RobotLog = RobotLog()
    ballbar: BallbarLog = BallbarLog()
    tracker: OpticalTracker | None = None


class DrawnLoads(Strict):
    """Gains and biases of the load signals; empty where a signal is not logged."""

    torque_gain: tuple[float, ...] = ()  # of each axis
    force_gain: tuple[float, ...] = ()  # of each channel
    force_bias: tuple[float, ...] = ()  # [N, N m]


def drawn_loads(logs: LoadLogs, seed: int) -> DrawnLoads:
    """Gains and biases of the signals that are logged."""
    torque_gain: tuple[float, ...] = ()
    force_gain: tuple[float, ...] = ()
    force_bias: tuple[float, ...] = ()
    if torque := logs.torque:
        gain = 1.0 + torque.gain_sigma * stream(seed, "torque_gain").standard_normal(6)
        torque_gain = tuple(gain.tolist())
    if sensor := logs.force_sensor:
        rng = stream(seed, "force_sensor_mounting")
        force_gain = tuple((1.0 + sensor.gain_sigma * rng.standard_normal(6)).tolist())
        sigma = np.repeat([sensor.bias_N, sensor.bias_N_m], 3)
        force_bias = tuple((rng.standard_normal(6) * sigma).tolist())
    return DrawnLoads(torque_gain=torque_gain, force_gain=force_gain, force_bias=force_bias)


def motor_torques(
    robot: Robot, motion: Motion, times: Array, *, log: TorqueLog, drawn: DrawnLoads, seed: int
) -> Array:
    """(N, 6) [N m] logged torques, at the motors, at true times (N,) [s].

    Raises ValueError if the plant of the motion has no torques.
    """
    noise = stream(seed, "torque_noise").standard_normal((times.size, 6))
    sigma = np.array([log.noise_N_m] * 3 + [log.wrist_noise_N_m] * 3)
    torque = _sampled(motion.t, motion.torque, times) * drawn.torque_gain + sigma * noise
    return np.asarray(torque * np.diag(robot.transmission))


def sensor_rows(
    motion: Motion, first: float, last: float, *, sensor: ForceSensor, drawn: DrawnLoads, seed: int
) -> tuple[Array, Array]:
    """Rows of the force sensor between true times `first` and `last` [s].

    Returns stamps (N,) [s] on the sensor's clock and readings (N, 6) [N, N m]. Raises ValueError if
    the flange of the motion has no sensor.
    """
    length = (last - first - sensor.offset_s) / (1.0 + sensor.skew)  # on its own clock
    elapsed = np.arange(int(length * sensor.rate_hz) + 1, dtype=np.float64) / sensor.rate_hz
    noise = stream(seed, "force_sensor_noise").standard_normal((elapsed.size, 6))
    noise = noise * np.repeat([sensor.noise_N, sensor.noise_N_m], 3)
    times = first + Clock(sensor.offset_s, sensor.skew).robot_time(elapsed)
    wrench = _sampled(motion.t, motion.wrench, times)
    return SENSOR_EPOCH + elapsed, np.asarray(wrench * drawn.force_gain + drawn.force_bias + noise)


def _sampled(t: Array, values: Array | None, times: Array) -> Array:
    """Loads (N, 6) at times (N,) [s], linear between plant steps t (K,) [s].

    Loads step at reversals, where a spline would ring.
    """
    if values is None:
        raise ValueError("this motion has no loads to log; they need plant.kind = mujoco")
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)

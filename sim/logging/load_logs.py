"""Logs other than angles: motor torques, a force sensor at the flange, an optical tracker.

Torques are those that the motors exert, N m at the motor, positive along its angle; the gain error
is one number per axis. The sensor (such as the JR3 of thesis sec. 5.3) gives force and torque that
plate and ball-bar exert on the flange, in the flange's frame about its origin, on a clock of its
own. The tracker (such as the Nikon K600 of the same section) logs where an LED on the tool is, in a
frame and on a clock of its own; it measures the true tool, deflection included, and nothing else in
the recording depends on it.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Robot
from ballbar.cell.dialect import load_dialect
from ballbar.cell.errors import DescriptionError
from ballbar.cell.instruments.base import Instrument, TrueStand
from ballbar.cell.logs import SourceName
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.cell.schema import NotNegative, Strict
from ballbar.sim.motion import Motion
from ballbar.sim.streams import stream

LedCoordinate = Annotated[float, Field(ge=-1.0, le=1.0)]
SENSOR_EPOCH = 17.0  # [s] up-time of the sensor's logger at its first row
TRACKER_EPOCH = 83.0  # [s] up-time of the tracker at its first row
DISTANCE = 3.0  # [m] of the tracker from the robot's base; assumed


class TorqueLog(Strict):
    """Motor torques stand in the robot's log, in columns tau1, tau2, ...."""

    noise_N_m: NotNegative = 2.0
    """Sigma of white noise at the outputs of the main gears (notes/identification sec. 1)."""
    wrist_noise_N_m: NotNegative = 0.3
    """The same of the last three gears."""
    gain_sigma: NotNegative = 0.02
    """Sigma of the gain error of each axis, drawn per run."""


class ForceSensor(Strict):
    """A six-axis force sensor at the flange is logged, with its own rate and clock."""

    rate_hz: Annotated[float, Field(gt=0.0, le=10_000.0)] = 500.0
    """Rows per second."""
    noise_N: NotNegative = 1.0
    """Sigma of white noise of each force (notes/identification sec. 1)."""
    noise_N_m: NotNegative = 0.1
    """Sigma of white noise of each torque."""
    bias_N: NotNegative = 2.0
    """Sigma of the bias of each force."""
    bias_N_m: NotNegative = 0.2
    """Sigma of the bias of each torque."""
    gain_sigma: NotNegative = 0.01
    """Sigma of the gain error of each channel."""
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


class RobotLogger(Strict):
    """How the robot's controller logs its angles."""

    dialect: Annotated[str, _dialect_of("robot")] | None = None
    """A dialect of cell/dialects; by default that of the robot's file."""
    rate_hz: Annotated[float, Field(ge=10.0, le=10_000.0)] | None = None
    """Rows per second; by default the dialect's."""


class BallbarLogger(Strict):
    """How the ball-bar's encoders are logged: a PLC writes a row every two tasks."""

    dialect: Annotated[str, _dialect_of("ballbar")] = "twincat-plc"
    """A dialect of cell/dialects."""
    task_s: Annotated[float, Field(ge=1.0e-4, le=0.05)] = 0.005
    """Cycle of the PLC's task (thesis sec. 4.6)."""
    status: bool = True
    """Status words of the terminals are logged."""


class OpticalTracker(Strict):
    """A tracker logs where a target on the tool is, in its own frame, with its own rate and clock:
    an LED beside a ball-bar, or what cell.instrument follows.
    """

    rate_hz: Annotated[float, Field(ge=10.0, le=10_000.0)] = 100.0
    """Rows per second. Assumed."""
    noise_m: Annotated[float, Field(ge=0.0, le=0.01)] = 9.0e-5
    """Sigma of white noise along each axis (thesis sec. 5.3: below 90 um). That of
    cell.instrument stands in its file.
    """
    led_m: Annotated[tuple[LedCoordinate, ...], Field(min_length=3, max_length=3)] = (
        -0.05,
        0.04,
        0.03,
    )
    """The LED in the tool's frame: x along the plate, away from the flange, from the centre of the
    universal joint. Assumed.
    """
    offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.2
    """Time from the first row of the robot to the first of the tracker."""
    skew: Annotated[float, Field(ge=-2e-3, le=2e-3)] = 0.0
    """Seconds that the robot's clock gains in each second of the tracker's."""
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """By so much a row is stamped late; the identified offset is as much less."""


class TrackerTruth(Strict):
    """The drawn frame of the tracker in the robot's base frame, its target, and its clock, latency
    included.
    """

    position_m: tuple[float, ...]
    rotation_vector_rad: tuple[float, ...]
    led_m: tuple[float, ...]
    offset_s: float
    skew: float

    def seen(self, points: Array) -> Array:
        """(N, 3) [m] in the tracker's frame of points (N, 3) [m] in the robot's base frame."""
        turn = matrix_from_rotvec(np.array(self.rotation_vector_rad)[:, None])[:, :, 0]
        return np.asarray((points - np.array(self.position_m)) @ turn)


class LoadLogs(Strict):
    """Loads that are logged; each is absent unless named."""

    torque: TorqueLog | None = None
    force_sensor: ForceSensor | None = None


class DeviceLogs(LoadLogs):
    """The form of the logs, and what is logged in addition to angles."""

    robot: RobotLogger = RobotLogger()
    ballbar: BallbarLogger = BallbarLogger()
    tracker: OpticalTracker | None = None


class DrawnLoads(Strict):
    """Gains and biases of the load signals; empty where a signal is not logged."""

    torque_gain: tuple[float, ...] = ()  # of each axis
    force_gain: tuple[float, ...] = ()  # of each channel
    force_bias: tuple[float, ...] = ()  # [N, N m]


def drawn_loads(logs: LoadLogs, joints: int, seed: int) -> DrawnLoads:
    """Gains and biases of the signals that are logged, of a robot of so many axes."""
    torque_gain: tuple[float, ...] = ()
    force_gain: tuple[float, ...] = ()
    force_bias: tuple[float, ...] = ()
    if torque := logs.torque:
        gain = 1.0 + torque.gain_sigma * stream(seed, "torque_gain").standard_normal(joints)
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
    """(N, J) [N m] logged torques, at the motors, at true times (N,) [s].

    Raises ValueError if the plant of the motion has no torques.
    """
    noise = stream(seed, "torque_noise").standard_normal((times.size, robot.joints))
    sigma = np.array([log.noise_N_m] * (robot.joints - 3) + [log.wrist_noise_N_m] * 3)
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


def drawn_tracker(tracker: OpticalTracker | None, seed: int) -> TrackerTruth | None:
    """A tracker at a place and in an orientation that are drawn; None without one."""
    if tracker is None:
        return None
    rng = stream(seed, "tracker_frame")
    direction, quaternion = rng.standard_normal(3), rng.standard_normal(4)
    turn, axis = 2.0 * np.arctan2(np.linalg.norm(quaternion[1:]), quaternion[0]), quaternion[1:]
    return TrackerTruth(
        position_m=tuple((DISTANCE * direction / np.linalg.norm(direction)).tolist()),
        rotation_vector_rad=tuple((turn * axis / np.linalg.norm(axis)).tolist()),
        led_m=tracker.led_m,
        offset_s=tracker.offset_s - (1.0 + tracker.skew) * tracker.latency_s,
        skew=tracker.skew,
    )


def tracker_rows(
    motion: Motion,
    times: tuple[float, float],
    *,
    tracker: OpticalTracker,
    drawn: TrackerTruth,
    seed: int,
    instrument: Instrument | None = None,
) -> tuple[Array, Array]:
    """(N,) [s] stamps on the clock of the tracker, and (N, 3 or 6) [m, rad] points or poses.

    Both are in the frame of the tracker.

    times : [s] true ones of the robot's first and last row; the tracker logs as long.
    instrument : what follows the target, its axes those of the tool; None for an LED.
    """
    first, last = times
    rows = int((last - first) * tracker.rate_hz) + 1
    elapsed = np.arange(rows, dtype=np.float64) / tracker.rate_hz
    rotation, tool = motion.tool_at(first + Clock(drawn.offset_s, drawn.skew).robot_time(elapsed))
    target = tool + np.einsum("ijn,j->in", rotation, np.array(drawn.led_m))
    points, rng = drawn.seen(target.T), stream(seed, "tracker_noise")
    if instrument is None:
        noise = rng.normal(0.0, tracker.noise_m, points.shape)
        return TRACKER_EPOCH + elapsed, np.asarray(points + noise)
    seat = matrix_from_rotvec(np.array(drawn.rotation_vector_rad)[:, None])[:, :, 0]
    stand = TrueStand(
        rod=points.T,
        distance=np.linalg.norm(points, axis=1),
        rotation=np.einsum("ji,jkn->ikn", seat, rotation),
    )
    noise = rng.standard_normal((6, rows))
    return TRACKER_EPOCH + elapsed, instrument.kind.measure(stand, noise, instrument)

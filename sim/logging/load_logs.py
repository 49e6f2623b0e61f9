"""Logged loads: motor torques beside the motor angles, and a six-axis force sensor at the flange with its own clock.

Torque is what the motor exerts, N m at the motor, positive along its angle; a robot's gain error is one number an axis. The
sensor (JR3-like, thesis sec. 5.3) gives the force and torque that plate and ball-bar exert on the flange, in the flange's
frame about its origin.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cell.arrays import Array
from cell.descriptions import Robot
from cell.schema import Strict
from sim.motion import Motion
from sim.streams import stream

NotNegative = Annotated[float, Field(ge=0.0)]
SENSOR_EPOCH = 17.0  # [s] up-time of the sensor's logger at its first row


class TorqueLog(Strict):
    """Motor torques in the robot log, columns tau1..tau6."""

    noise_N_m: NotNegative = Field(
        2.0, description="White, at the gear's output of axes 1-3 (notes/identification sec. 1)."
    )
    wrist_noise_N_m: NotNegative = Field(
        0.3, description="White, at the gear's output of axes 4-6."
    )
    gain_sigma: NotNegative = Field(
        0.02, description="Standard deviation of the gain error of each axis, drawn once a run."
    )


class ForceSensor(Strict):
    """Six-axis force sensor at the flange, logged with its own rate and clock."""

    rate_hz: Annotated[float, Field(gt=0.0, le=10_000.0)] = Field(
        500.0, description="Rows a second."
    )
    noise_N: NotNegative = Field(
        1.0, description="White, each force (notes/identification sec. 1)."
    )
    noise_N_m: NotNegative = Field(0.1, description="White, each torque; assumed.")
    bias_N: NotNegative = Field(
        2.0, description="Standard deviation of the constant bias of each force; assumed."
    )
    bias_N_m: NotNegative = Field(
        0.2, description="Standard deviation of the constant bias of each torque; assumed."
    )
    gain_sigma: NotNegative = Field(
        0.01, description="Standard deviation of the gain error of each channel."
    )
    offset_s: float = Field(
        0.05, description="How long after the robot log the sensor's log begins."
    )


class LoadLogs(Strict):
    """Extras that a logger may record; each absent unless named."""

    torque: TorqueLog | None = None
    force_sensor: ForceSensor | None = None


class DrawnLoads(Strict):
    """Gains and biases of the load signals; empty where a signal is not logged."""

    torque_gain: tuple[float, ...] = ()  # of each axis
    force_gain: tuple[float, ...] = ()  # of each channel
    force_bias: tuple[float, ...] = ()  # [N, N m]


def drawn_loads(logs: LoadLogs, seed: int) -> DrawnLoads:
    """Gains and biases of the signals that are logged."""
    drawn = DrawnLoads()
    if logs.torque:
        gain = 1.0 + logs.torque.gain_sigma * stream(seed, "torque_gain").standard_normal(6)
        drawn = drawn.model_copy(update={"torque_gain": tuple(gain.tolist())})
    if sensor := logs.force_sensor:
        rng = stream(seed, "force_sensor_mounting")
        gain = 1.0 + sensor.gain_sigma * rng.standard_normal(6)
        bias = rng.standard_normal(6) * np.repeat([sensor.bias_N, sensor.bias_N_m], 3)
        drawn = drawn.model_copy(
            update={"force_gain": tuple(gain.tolist()), "force_bias": tuple(bias.tolist())}
        )
    return drawn


def motor_torques(
    robot: Robot, motion: Motion, times: Array, log: TorqueLog, drawn: DrawnLoads, seed: int
) -> Array:
    """(N, 6) [N m at the motor] logged torques at true times (N,) [s]; `motion` must carry torques."""
    assert motion.torque is not None
    sigma = np.array([log.noise_N_m] * 3 + [log.wrist_noise_N_m] * 3)
    seen = _sampled(motion.t, motion.torque, times) * drawn.torque_gain + sigma * stream(
        seed, "torque_noise"
    ).standard_normal((times.size, 6))
    return np.asarray(seen * np.diag(robot.transmission))


def sensor_rows(
    motion: Motion, first: float, last: float, sensor: ForceSensor, drawn: DrawnLoads, seed: int
) -> tuple[Array, Array]:
    """Stamps (N,) [s, sensor's clock] and readings (N, 6) [N, N m] between true times `first` and `last` [s]."""
    assert motion.wrench is not None
    elapsed = (
        np.arange(int((last - first - sensor.offset_s) * sensor.rate_hz) + 1, dtype=np.float64)
        / sensor.rate_hz
    )
    noise = stream(seed, "force_sensor_noise").standard_normal((elapsed.size, 6)) * np.repeat(
        [sensor.noise_N, sensor.noise_N_m], 3
    )
    seen = _sampled(motion.t, motion.wrench, first + sensor.offset_s + elapsed)
    return SENSOR_EPOCH + elapsed, np.asarray(seen * drawn.force_gain + drawn.force_bias + noise)


def _sampled(t: Array, values: Array, times: Array) -> Array:
    """Linear between plant steps: loads jump at reversals, and a spline would ring there."""
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)

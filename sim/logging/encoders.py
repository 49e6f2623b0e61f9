"""Counter values of the ball-bar's encoders and motor angles of the robot, from true angles.

An incremental encoder has `lines` periods per turn, interpolated with `bits`, in a uint32 counter
that wraps. The counter reads 0 at power-up, so that `b = direction * 2 pi counts / (lines 2^bits) +
offset`. The errors of a sensor stand in ballbar.sim.errors.sensor_effects.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.robot_angles import joints_to_motors
from ballbar.sim.errors.base import with_logged_errors
from ballbar.sim.errors.sensor_effects import EncoderEffects, ResolverEffects
from ballbar.sim.errors.sensor_errors import JointLag, SignalNoise
from ballbar.sim.motion import Motion
from ballbar.sim.settings import ErrorSettings
from ballbar.sim.streams import stream

# Bits of a signal period that never freeze: of 12 bits set, 6 are left at the highest speed
# (notes/log_formats sec. A.3).
SURE_BITS = 6
WEAK_SIGNAL = 1 << 4 | 1 << 14  # amplitude error, and data suspect (EL5021 6001:05 and 6000:0F)


@dataclass(frozen=True)
class BarEncoder:
    """One fitted ball-bar encoder as it is, and as recording.yaml declares it."""

    joint: int  # 1..5
    lines: int
    bits: int
    direction: int  # +1 if the counter counts up with the DH angle, else -1
    declared: int  # the direction that recording.yaml states
    offset: float  # [rad] DH angle at which the counter reads 0
    noise_sigma: float  # [rad] white
    effects: EncoderEffects = field(default_factory=EncoderEffects)

    @property
    def counts_per_turn(self) -> int:
        return self.lines << self.bits

    def counts(self, angle: Array, t: Array, rng: np.random.Generator) -> NDArray[np.uint32]:
        """Counter values at true joint angles (N,) [rad] and run times (N,) [s], increasing."""
        read = self.effects.read_angle(angle, t) + rng.normal(0.0, self.noise_sigma, angle.shape)
        turned = self.direction * (read - self.offset)
        counted = np.rint(turned * (self.counts_per_turn / (2.0 * np.pi))).astype(np.int64)
        counted += self.effects.periods(t) << self.bits
        if self.effects.freezing_onset_Hz is not None:
            frequency = np.abs(np.gradient(angle, t)) * (self.lines / (2.0 * np.pi))
            frozen = frozen_bits(frequency, self.effects.freezing_onset_Hz, self.bits)
            counted = with_frozen_bits(counted, frozen)
        return counted.astype(np.uint32)

    def status(self, cycles: NDArray[np.int64], t: Array) -> NDArray[np.int64]:
        """(N,) EL5021 status words at PLC cycles (N,) and run times (N,) [s].

        Without a fault only the toggle, bit 15, changes with each cycle (notes/log_formats sec.
        A.1).
        """
        weak = np.where(self.effects.weak_signal(t), WEAK_SIGNAL, 0)
        return np.asarray((cycles & 1) << 15 | weak)


def read_counts(
    encoder: BarEncoder, angle: Array, t: Array, noise: SignalNoise | None, seed: int
) -> NDArray[np.uint32]:
    """Counter values of an encoder at true joint angles (N,) [rad] and run times (N,) [s].

    noise : of its signals. What is drawn for it and for its white noise are streams of its own.
    """
    if noise:
        sigma = noise.share / encoder.lines  # of the arctangent, at the shaft
        drawn = stream(seed, f"signal_noise_b{encoder.joint}").normal(0.0, sigma, angle.shape)
        angle = angle + drawn
    return encoder.counts(angle, t, stream(seed, f"encoder_noise_b{encoder.joint}"))


def frozen_bits(frequency: Array, onset: float, bits: int) -> NDArray[np.int64]:
    """(N,) number of frozen low bits at signal frequencies (N,) [Hz].

    One bit freezes from `onset` [Hz] on, and one more with each octave.
    """
    octaves = np.floor(np.log2(np.maximum(frequency, 1e-9) / onset))
    return np.asarray(np.clip(1 + octaves, 0, bits - SURE_BITS), dtype=np.int64)


def with_frozen_bits(counts: NDArray[np.int64], frozen: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) counts whose lowest `frozen` (N,) bits keep the values that they last had unfrozen."""
    held, rows = counts.copy(), np.arange(counts.size)
    for bit in range(int(frozen.max(initial=0))):
        last = np.maximum.accumulate(np.where(frozen <= bit, rows, 0))
        held = held & ~(1 << bit) | counts[last] & (1 << bit)
    return held


def motor_angles(
    robot: Robot, q: Array, errors: ErrorSettings, resolvers: ResolverEffects | None, seed: int
) -> Array:
    """(N, J) [rad] motor angles that the robot logs at joint angles q (N, J) [rad]."""
    sigma = errors.joint_noise.sigma_rad if errors.joint_noise else 0.0
    logged = with_logged_errors(errors, q, seed)
    logged = logged + stream(seed, "joint_noise").normal(0.0, sigma, q.shape)
    if errors.outliers:
        logged += errors.outliers.on_robot(len(q), q.shape[1], seed)
    motors = joints_to_motors(robot, logged)
    return resolvers.read_angles(motors) if resolvers else motors


def joint_lags(lag: JointLag | None, *, joints: int, seed: int) -> Array:
    """(J,) [s] drawn time constant of each motor's filter; (0,) without filters."""
    if lag is None:
        return np.zeros(0)
    z = stream(seed, "joint_lag").standard_normal(joints)
    return np.asarray(lag.time_constant_s * np.exp(lag.spread * z))


def with_lags(motion: Motion, robot: Robot, lags: Array) -> Motion:
    """The motion as the controller shows it, which begins at rest.

    lags : (J,) [s] of the motors, or (0,).
    """
    if not lags.size:
        return motion
    gears, step = motion.shown @ robot.joint_to_gear, motion.t[1] - motion.t[0]
    shown = np.stack(
        [_filtered(g, float(np.exp(-step / lag))) for g, lag in zip(gears.T, lags, strict=True)],
        axis=1,
    )
    return replace(motion, shown=shown @ robot.gear_to_joint)


def _filtered(values: Array, decay: float) -> Array:
    """(K,) exact response of the filter to values (K,) that are linear between steps."""
    # The output after a step of a ramp: decay y + (1 - decay) u0 + (1 - gain) (u1 - u0), with
    # gain = (1 - decay) / -log(decay).
    from scipy.signal import lfilter  # noqa: PLC0415  slow to import, and needed here alone

    gain = (decay - 1.0) / np.log(decay)
    taps = [1.0 - gain, gain - decay]
    out, _ = lfilter(taps, [1.0, -decay], values, zi=[gain * values[0]])
    return np.asarray(out)

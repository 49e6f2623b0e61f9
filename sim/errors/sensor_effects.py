"""What is wrong with one encoder or resolver: its harmonics, slips and faults, phases drawn.

Ball-bar encoder, from the joint's angle b to the angle that is counted:

    shaft = b + A sin(b + phi) + slip(t)                       clamped off centre; coupling slips
    scale = shaft + sum_k A_k sin(k shaft + phi_k), k = 1..3   graduation off centre, elliptic
    read  = scale + A_s sin(lines scale + phi_s)               sine and cosine imperfect: the signal's own phase counts

then white noise, quantisation, slipped periods and frozen bits (sim.logging.encoders).
Motor resolver: `read = m + sum_k A_k sin(k m + phi_k), k = 1, 2`, then the converter's steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.schema import Strict
from sim.errors.sensor_errors import (
    AmplitudeError,
    CouplingSlip,
    ResolverError,
    SensorErrors,
    SlippedPeriods,
)
from sim.streams import stream

# Signal frequency from which an EL5021 freezes low bits, by interpolation bits; +-15 % (notes/notes/log_formats sec. A.3).
FREEZING_ONSET_HZ = {8: 9000.0, 9: 4500.0, 10: 2500.0, 11: 1500.0, 12: 750.0, 13: 650.0}


class Harmonic(Strict):
    """amplitude * sin(order * angle + phase)."""

    order: int  # cycles a turn
    amplitude_rad: float
    phase_rad: float

    def at(self, angle: Array) -> Array:
        """(N,) [rad] at angles (N,) [rad]."""
        return np.asarray(self.amplitude_rad * np.sin(self.order * angle + self.phase_rad))


class EncoderEffects(Strict):
    """What is wrong with one ball-bar encoder."""

    mounting: tuple[Harmonic, ...] = ()
    own: tuple[Harmonic, ...] = ()
    subdivisional: tuple[Harmonic, ...] = ()
    freezing_onset_Hz: float | None = None
    amplitude_errors: tuple[AmplitudeError, ...] = ()
    slipped_periods: tuple[SlippedPeriods, ...] = ()
    coupling_slips: tuple[CouplingSlip, ...] = ()

    def read_angle(self, angle: Array, t: Array) -> Array:
        """(N,) [rad] what the encoder measures at joint angles (N,) [rad] and run times (N,) [s]."""
        shaft = angle + _sum(self.mounting, angle)
        for slip in self.coupling_slips:
            shaft = shaft + np.where(t >= slip.at_s, slip.angle_rad, 0.0)
        scale = shaft + _sum(self.own, shaft)
        return np.asarray(scale + _sum(self.subdivisional, scale))

    def periods(self, t: Array) -> NDArray[np.int64]:
        """(N,) signal periods that the counter is ahead."""
        ahead = np.zeros(t.shape, dtype=np.int64)
        for slip in self.slipped_periods:
            ahead += np.where(t >= slip.at_s, slip.periods, 0)
        return ahead

    def weak_signal(self, t: Array) -> NDArray[np.bool_]:
        """(N,) rows at which the terminal reports an amplitude error."""
        weak = np.zeros(t.shape, dtype=bool)
        for fault in self.amplitude_errors:
            weak |= (t >= fault.start_s) & (t < fault.end_s)
        return weak


class ResolverEffects(Strict):
    """What is wrong with the six resolvers."""

    motors: tuple[tuple[Harmonic, ...], ...]
    quantum_rad: float

    def read_angles(self, motors: Array) -> Array:
        """(N, 6) [rad] what the converters give at motor angles (N, 6) [rad]."""
        read = np.stack(
            [m + _sum(harmonics, m) for m, harmonics in zip(motors.T, self.motors, strict=True)],
            axis=1,
        )
        return np.asarray(
            np.rint(read / self.quantum_rad) * self.quantum_rad if self.quantum_rad else read
        )


def encoder_effects(
    errors: SensorErrors, joint: int, *, lines: int, bits: int, seed: int
) -> EncoderEffects:
    """The encoder of one joint as a scenario describes it; its phases come from its own streams."""
    own, mounting = errors.encoder_eccentricity, errors.mounting_eccentricity
    within, frozen = errors.subdivisional_error, errors.frozen_bits
    return EncoderEffects(
        mounting=_drawn(
            (1,), (mounting.amplitude_rad,), stream(seed, f"mounting_eccentricity_b{joint}")
        )
        if mounting
        else (),
        own=_drawn((1, 2, 3), own.amplitude_rad, stream(seed, f"encoder_eccentricity_b{joint}"))
        if own
        else (),
        subdivisional=_drawn(
            (lines,), (within.amplitude_rad,), stream(seed, f"subdivisional_error_b{joint}")
        )
        if within
        else (),
        freezing_onset_Hz=FREEZING_ONSET_HZ[bits] * frozen.onset_factor if frozen else None,
        amplitude_errors=tuple(e for e in errors.amplitude_errors if e.encoder == joint),
        slipped_periods=tuple(e for e in errors.slipped_periods if e.encoder == joint),
        coupling_slips=tuple(e for e in errors.coupling_slips if e.encoder == joint),
    )


def resolver_effects(asked: ResolverError, *, seed: int) -> ResolverEffects:
    """The six resolvers as a scenario describes them."""
    rng = stream(seed, "resolver_error")
    return ResolverEffects(
        motors=tuple(_drawn((1, 2), asked.amplitude_rad, rng) for _ in range(6)),
        quantum_rad=asked.quantum_rad,
    )


def _drawn(
    orders: tuple[int, ...], amplitudes: tuple[float, ...], rng: np.random.Generator
) -> tuple[Harmonic, ...]:
    phases = rng.uniform(0.0, 2.0 * np.pi, len(orders))
    return tuple(
        Harmonic(order=order, amplitude_rad=size, phase_rad=float(phase))
        for order, size, phase in zip(orders, amplitudes, phases, strict=True)
    )


def _sum(harmonics: tuple[Harmonic, ...], angle: Array) -> Array | float:
    return sum((harmonic.at(angle) for harmonic in harmonics), 0.0)

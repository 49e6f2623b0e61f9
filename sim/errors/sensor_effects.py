"""Errors of one encoder or resolver: harmonics with drawn phases, slips and faults.

Ball-bar encoder, from the joint's angle b to the angle that is counted:

    shaft = b + A sin(b + phi) + slip(t)                      mounted off centre; coupling slips
    scale = shaft + sum_k A_k sin(k shaft + phi_k), k = 1..3  graduation off centre, elliptic disc
    read  = scale + A_s sin(lines scale + phi_s)              imperfect sine and cosine signals

White noise, quantisation, slipped periods and frozen bits follow (ballbar.sim.logging.encoders).
Motor resolver: `read = m + sum_k A_k sin(k m + phi_k), k = 1, 2`, then rounding by the converter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.schema import Strict
from ballbar.sim.errors.sensor_errors import (
    AmplitudeError,
    CouplingSlip,
    ResolverError,
    SensorErrors,
    SlippedPeriods,
)
from ballbar.sim.streams import stream

# Signal frequency [Hz] from which an EL5021 freezes low bits, by interpolation bits; +-15 %
# (notes/log_formats sec. A.3).
FREEZING_ONSET_HZ = {8: 9000.0, 9: 4500.0, 10: 2500.0, 11: 1500.0, 12: 750.0, 13: 650.0}


class Harmonic(Strict):
    """One harmonic error: amplitude * sin(order * angle + phase)."""

    order: int  # cycles per turn
    amplitude_rad: float
    phase_rad: float

    def at(self, angle: Array) -> Array:
        """(N,) [rad] error at angles (N,) [rad]."""
        return np.asarray(self.amplitude_rad * np.sin(self.order * angle + self.phase_rad))


Harmonics = tuple[Harmonic, ...]


class EncoderEffects(Strict):
    """Errors of one ball-bar encoder."""

    mounting: Harmonics = ()
    own: Harmonics = ()
    subdivisional: Harmonics = ()
    freezing_onset_Hz: float | None = None
    amplitude_errors: tuple[AmplitudeError, ...] = ()
    slipped_periods: tuple[SlippedPeriods, ...] = ()
    coupling_slips: tuple[CouplingSlip, ...] = ()

    def read_angle(self, angle: Array, t: Array) -> Array:
        """(N,) [rad] measured angle at joint angles (N,) [rad] and run times (N,) [s]."""
        shaft = angle + _sum(self.mounting, angle)
        for slip in self.coupling_slips:
            shaft = shaft + np.where(t >= slip.at_s, slip.angle_rad, 0.0)
        scale = shaft + _sum(self.own, shaft)
        return np.asarray(scale + _sum(self.subdivisional, scale))

    def periods(self, t: Array) -> NDArray[np.int64]:
        """(N,) signal periods by which the counter leads at run times (N,) [s]."""
        ahead = np.zeros(t.shape, dtype=np.int64)
        for slip in self.slipped_periods:
            ahead += np.where(t >= slip.at_s, slip.periods, 0)
        return ahead

    def weak_signal(self, t: Array) -> NDArray[np.bool_]:
        """(N,) whether the terminal reports an amplitude error at run times (N,) [s]."""
        weak = np.zeros(t.shape, dtype=bool)
        for fault in self.amplitude_errors:
            weak |= (t >= fault.start_s) & (t < fault.end_s)
        return weak


class ResolverEffects(Strict):
    """Errors of the motors' resolvers."""

    motors: tuple[Harmonics, ...]
    quantum_rad: float

    def read_angles(self, motors: Array) -> Array:
        """(N, J) [rad] readings of the converters at motor angles (N, J) [rad]."""
        read = np.stack(
            [m + _sum(harmonics, m) for m, harmonics in zip(motors.T, self.motors, strict=True)],
            axis=1,
        )
        if self.quantum_rad:
            read = np.rint(read / self.quantum_rad) * self.quantum_rad
        return np.asarray(read)


def encoder_effects(
    errors: SensorErrors, joint: int, *, lines: int, bits: int, seed: int
) -> EncoderEffects:
    """Errors of one joint's encoder as a scenario states them; its phases have own streams."""
    disc, mounting = errors.encoder_eccentricity, errors.mounting_eccentricity
    within, frozen = errors.subdivisional_error, errors.frozen_bits
    mounted, graduation, signal = Harmonics(), Harmonics(), Harmonics()
    if mounting:
        rng = stream(seed, f"mounting_eccentricity_b{joint}")
        mounted = _drawn((1,), (mounting.amplitude_rad,), rng)
    if disc:
        rng = stream(seed, f"encoder_eccentricity_b{joint}")
        graduation = _drawn((1, 2, 3), disc.amplitude_rad, rng)
    if within:
        rng = stream(seed, f"subdivisional_error_b{joint}")
        signal = _drawn((lines,), (within.amplitude_rad,), rng)
    return EncoderEffects(
        mounting=mounted,
        own=graduation,
        subdivisional=signal,
        freezing_onset_Hz=FREEZING_ONSET_HZ[bits] * frozen.onset_factor if frozen else None,
        amplitude_errors=tuple(e for e in errors.amplitude_errors if e.encoder == joint),
        slipped_periods=tuple(e for e in errors.slipped_periods if e.encoder == joint),
        coupling_slips=tuple(e for e in errors.coupling_slips if e.encoder == joint),
    )


def resolver_effects(
    errors: ResolverError | None, *, joints: int, seed: int, turns: Array | None = None
) -> ResolverEffects | None:
    """Errors of the resolvers of so many motors by a scenario; None where it states none.

    turns : (J,) of each motor per turn of what the robot's file takes for its motor, the gear's
        output where it states no ratio; None for a file that states them.
    """
    if errors is None:
        return None
    rng, turns = stream(seed, "resolver_error"), np.ones(joints) if turns is None else turns
    drawn = [_drawn((1, 2), errors.amplitude_rad, rng) for _ in range(joints)]
    motors = [
        tuple(
            Harmonic(
                order=h.order * round(n), amplitude_rad=h.amplitude_rad / n, phase_rad=h.phase_rad
            )
            for h in harmonics
        )
        for harmonics, n in zip(drawn, turns.tolist(), strict=True)
    ]
    return ResolverEffects(
        motors=tuple(motors), quantum_rad=errors.quantum_rad / float(turns.min())
    )


def _drawn(
    orders: tuple[int, ...], amplitudes: tuple[float, ...], rng: np.random.Generator
) -> Harmonics:
    phases = rng.uniform(0.0, 2.0 * np.pi, len(orders))
    return tuple(
        Harmonic(order=order, amplitude_rad=size, phase_rad=float(phase))
        for order, size, phase in zip(orders, amplitudes, phases, strict=True)
    )


def _sum(harmonics: Harmonics, angle: Array) -> Array | float:
    return sum((harmonic.at(angle) for harmonic in harmonics), 0.0)

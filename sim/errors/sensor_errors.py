"""Error sources of encoders and resolvers: their keys in a scenario.

What they mean for one sensor stands in sim.errors.sensor_effects. Sizes: notes/parameters,
encoder_error_model and motor_position_sensor; shapes: Renishaw, The accuracy of rotary encoders.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from cell.schema import Strict

EncoderNumber = Annotated[int, Field(ge=1, le=5, description="The ball-bar joint it measures.")]
Amplitude = Annotated[float, Field(ge=0.0)]
RunTime = Annotated[float, Field(description="Seconds after the start of the path.")]


class EncoderEccentricity(Strict):
    """Low harmonics of the encoder itself, from a graduation off centre and an elliptic disc.
    They lie within the maker's accuracy of 18 arcsec.
    """

    amplitude_rad: tuple[Amplitude, Amplitude, Amplitude] = Field(
        (6.0e-5, 2.5e-5, 8.0e-6), description="Amplitudes of 1, 2 and 3 cycles per turn."
    )


class MountingEccentricity(Strict):
    """The encoder is mounted off the joint's axis, which adds one cycle per turn.
    The maker's specification does not include it.
    """

    amplitude_rad: Amplitude = Field(
        3.0e-4, description="Amplitude: lateral offset over the radius of the restraint."
    )


class SubdivisionalError(Strict):
    """Error within one signal period, from offset, gain and phase of sine and cosine."""

    amplitude_rad: Amplitude = Field(
        1.2e-5, description="Amplitude of one cycle per signal period."
    )


class SignalNoise(Strict):
    """Sine and cosine of the encoders have noise, by which the lowest of 13 bits fluctuate at rest
    (thesis sec. 4.6). Of 12 bits and fewer it is a quarter of a count and less.
    """

    share: Annotated[float, Field(ge=0.0)] = Field(
        3.5e-4,
        description="Standard deviation over the signal's amplitude: half a step of a converter "
        "of 12 bits. Assumed.",
    )


class FrozenBits(Strict):
    """The terminal freezes low bits at speed, one more with each octave of signal frequency.
    Its status word does not show it.
    """

    onset_factor: Annotated[float, Field(gt=0.0)] = Field(
        1.0, description="Factor on the documented onset frequency of the terminal (+-15 %)."
    )


class AmplitudeError(Strict):
    """The terminal reports a weak signal in status bit 4, and suspect data in bit 14.
    The counts remain right.
    """

    encoder: EncoderNumber
    start_s: RunTime
    end_s: RunTime

    @model_validator(mode="after")
    def _forwards(self) -> AmplitudeError:
        if self.end_s <= self.start_s:
            raise ValueError(
                f"end_s = {self.end_s:g} must be later than start_s = {self.start_s:g}"
            )
        return self


class SlippedPeriods(Strict):
    """The terminal loses or gains whole signal periods.
    A period is 2**bits counts, 0.1 deg of an encoder with 3600 lines.
    """

    encoder: EncoderNumber
    at_s: RunTime
    periods: int = Field(1, description="Number of periods, positive as the counter counts up.")


class CouplingSlip(Strict):
    """The clamp slips, so that the encoder's shaft turns against its joint.
    One sensor of the thesis was badly fastened (sec. 5.4).
    """

    encoder: EncoderNumber
    at_s: RunTime
    angle_rad: float = Field(
        1.0e-3, description="Step of the reading, positive along the joint's angle. Assumed."
    )


class ResolverError(Strict):
    """The motors' resolvers have harmonic errors, and their converters round."""

    amplitude_rad: tuple[Amplitude, Amplitude] = Field(
        (1.5e-3, 1.5e-3), description="Amplitudes of 1 and 2 cycles per motor turn, at the motor."
    )
    quantum_rad: Amplitude = Field(
        2.0 * np.pi / 65536,
        description="Resolution of the converter at the motor; 0 for no rounding.",
    )


class SensorErrors(Strict):
    """Error sources of the encoders and resolvers; each is absent unless named."""

    encoder_eccentricity: EncoderEccentricity | None = None
    mounting_eccentricity: MountingEccentricity | None = None
    subdivisional_error: SubdivisionalError | None = None
    signal_noise: SignalNoise | None = None
    frozen_bits: FrozenBits | None = None
    amplitude_errors: tuple[AmplitudeError, ...] = ()
    slipped_periods: tuple[SlippedPeriods, ...] = ()
    coupling_slips: tuple[CouplingSlip, ...] = ()
    resolver_error: ResolverError | None = None

    def fault_times(self) -> Iterator[tuple[tuple[str | int, ...], float]]:
        """Scenario key and time [s] of every fault that happens at a stated time."""
        for i, weak in enumerate(self.amplitude_errors):
            yield ("errors", "amplitude_errors", i, "start_s"), weak.start_s
        for i, lost in enumerate(self.slipped_periods):
            yield ("errors", "slipped_periods", i, "at_s"), lost.at_s
        for i, slip in enumerate(self.coupling_slips):
            yield ("errors", "coupling_slips", i, "at_s"), slip.at_s

    def fault_encoders(self) -> Iterator[tuple[tuple[str | int, ...], int]]:
        """Scenario key and encoder number of every fault that names one."""
        for key in ("amplitude_errors", "slipped_periods", "coupling_slips"):
            for i, fault in enumerate(getattr(self, key)):
                yield ("errors", key, i), fault.encoder

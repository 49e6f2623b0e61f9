"""Error sources of encoders and resolvers: what a scenario may ask for. What it means for one sensor: sim.errors.sensor_effects.

Sizes: notes/parameters, encoder_error_model and motor_position_sensor; shapes: Renishaw, The accuracy of rotary encoders.
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
    """Low harmonics of the encoder itself: graduation off centre, elliptic disc; inside the maker's 18 arcsec."""

    amplitude_rad: tuple[Amplitude, Amplitude, Amplitude] = Field(
        (6.0e-5, 2.5e-5, 8.0e-6), description="Of 1, 2 and 3 cycles a turn."
    )


class MountingEccentricity(Strict):
    """The encoder sits off the joint's axis: one cycle a turn, outside the maker's specification."""

    amplitude_rad: Amplitude = Field(
        3.0e-4, description="Lateral offset over the radius of the restraint."
    )


class SubdivisionalError(Strict):
    """Error within one signal period: offset, gain and phase of sine and cosine."""

    amplitude_rad: Amplitude = Field(1.2e-5, description="One cycle a signal period.")


class FrozenBits(Strict):
    """The terminal freezes low bits at speed, one more with each octave of signal frequency, and no status tells."""

    onset_factor: Annotated[float, Field(gt=0.0)] = Field(
        1.0, description="Onset frequency, times the terminal's documented one (+-15 %)."
    )


class AmplitudeError(Strict):
    """The terminal reports a weak signal: status bit 4, and bit 14 for suspect data. The counts stay right."""

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
    """The terminal loses or gains whole signal periods: 2**bits counts each, 0.1 deg of 3600 lines."""

    encoder: EncoderNumber
    at_s: RunTime
    periods: int = Field(1, description="Positive as the counter counts up.")


class CouplingSlip(Strict):
    """The clamp slips: the encoder's shaft turns against its joint (thesis sec. 5.4: one sensor was badly fastened)."""

    encoder: EncoderNumber
    at_s: RunTime
    angle_rad: float = Field(
        1.0e-3, description="How far the reading jumps, in the joint's sense. Assumed."
    )


class ResolverError(Strict):
    """Error of the motors' resolvers and steps of their converters."""

    amplitude_rad: tuple[Amplitude, Amplitude] = Field(
        (1.5e-3, 1.5e-3), description="Of 1 and 2 cycles a motor turn, at the motor."
    )
    quantum_rad: Amplitude = Field(
        2.0 * np.pi / 65536, description="Step of the converter at the motor; 0 for none."
    )


class SensorErrors(Strict):
    """Error sources of the encoders and resolvers; each absent unless named."""

    encoder_eccentricity: EncoderEccentricity | None = None
    mounting_eccentricity: MountingEccentricity | None = None
    subdivisional_error: SubdivisionalError | None = None
    frozen_bits: FrozenBits | None = None
    amplitude_errors: tuple[AmplitudeError, ...] = ()
    slipped_periods: tuple[SlippedPeriods, ...] = ()
    coupling_slips: tuple[CouplingSlip, ...] = ()
    resolver_error: ResolverError | None = None

    def fault_times(self) -> Iterator[tuple[tuple[str | int, ...], float]]:
        """Place in the scenario and time of every fault that happens at a stated time."""
        yield from (
            (("errors", "amplitude_errors", i, "start_s"), fault.start_s)
            for i, fault in enumerate(self.amplitude_errors)
        )
        yield from (
            (("errors", "slipped_periods", i, "at_s"), fault.at_s)
            for i, fault in enumerate(self.slipped_periods)
        )
        yield from (
            (("errors", "coupling_slips", i, "at_s"), fault.at_s)
            for i, fault in enumerate(self.coupling_slips)
        )

    def fault_encoders(self) -> Iterator[tuple[tuple[str | int, ...], int]]:
        """Place in the scenario and encoder of every fault that names one."""
        yield from (
            (("errors", "amplitude_errors", i), fault.encoder)
            for i, fault in enumerate(self.amplitude_errors)
        )
        yield from (
            (("errors", "slipped_periods", i), fault.encoder)
            for i, fault in enumerate(self.slipped_periods)
        )
        yield from (
            (("errors", "coupling_slips", i), fault.encoder)
            for i, fault in enumerate(self.coupling_slips)
        )

"""Error sources of encoders and resolvers: their keys in a scenario.

What they mean for one sensor stands in ballbar.sim.errors.sensor_effects. Sizes: notes/plant,
encoder_error_model and motor_position_sensor; shapes: Renishaw, The accuracy of rotary encoders.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.schema import NotNegative, Positive, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.sim.streams import stream

LEAD = 0.5  # [s] of the path before the first row of the later log, and after the last of both

Probability = Annotated[float, Field(ge=0.0, lt=0.5)]
RunTime = Annotated[float, Field(description="Seconds from the start of the path.")]


class ClockWander(Strict):
    """The rate of a clock does a random walk and decays after power-on.

    The deviation from the straight line that clock offset and skew describe has no trend.

    A random walk of 0.5 ppm in 10 min amounts to 0.1 ppm in 2 min. A quartz changes its rate by
    about 5 ppm in the first 10 min after power-on.
    """

    rate_rms_ppm: Annotated[float, Field(ge=0.0, le=100.0)] = 0.1
    """RMS of the random walk about its mean."""
    warm_up_ppm: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    """Excess rate at power-on; 5 ppm is usual."""
    warm_up_time_s: Annotated[float, Field(ge=10.0)] = 600.0
    """Time constant of its decay."""


class ClockStep(Strict):
    """The ball-bar's clock is set, which shifts all later stamps."""

    at_s: RunTime
    step_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.128
    """Size of the step."""


class StampQuantum(Strict):
    """Stamps, counted from the first row, are rounded; truncation differs by a clock offset."""

    robot_s: Annotated[float, Field(ge=0.0, le=0.1)] = 1.0e-3
    """EGM states whole ms; 0 for no rounding."""
    ballbar_s: Annotated[float, Field(ge=0.0, le=0.1)] = 1.0e-3
    """SYSTEMTIME states whole ms, which a 5 ms task does not show."""


class StampJitter(Strict):
    """The robot's rows are stamped a little early or late, all but the first."""

    sigma_s: Annotated[float, Field(ge=0.0, le=5.0e-4)] = 2.0e-4
    """Sigma; more would put rows out of order."""


class DroppedRows(Strict):
    """Some rows are missing from the files; the first one never is."""

    robot_probability: Probability = 1.0e-3
    """Share of the robot's rows."""
    ballbar_probability: Probability = 1.0e-3
    """Share of the ball-bar's rows."""


class DuplicatedRows(Strict):
    """Some rows stand in the files twice."""

    robot_probability: Probability = 1.0e-3
    """Share of the robot's rows."""
    ballbar_probability: Probability = 1.0e-3
    """Share of the ball-bar's rows."""


class LoggerRestart(Strict):
    """The ball-bar's logger starts a new file, the old one renamed ...Old.csv; counters and clock
    run on.
    """

    at_s: RunTime
    gap_s: Positive = 2.0
    """Time without rows."""


EncoderNumber = Annotated[int, Field(ge=1, le=5, description="The ball-bar joint it measures.")]


class EncoderEccentricity(Strict):
    """Low harmonics of the encoder itself, from a graduation off centre and an elliptic disc."""

    amplitude_rad: tuple[NotNegative, NotNegative, NotNegative] = (6.0e-5, 2.5e-5, 8.0e-6)
    """Amplitudes of 1, 2 and 3 cycles per turn."""


class MountingEccentricity(Strict):
    """The encoder is mounted off the joint's axis, which no maker's specification includes."""

    amplitude_rad: NotNegative = 3.0e-4
    """Amplitude: lateral offset over the radius of the restraint."""


class SubdivisionalError(Strict):
    """Error within a signal period, from offset, gain and phase of sine and cosine."""

    amplitude_rad: NotNegative = 1.2e-5
    """Amplitude of one cycle per signal period."""


class SignalNoise(Strict):
    """Sine and cosine of the encoders have noise, by which the lowest of 13 bits fluctuate at
    rest.
    """

    share: NotNegative = 3.5e-4
    """Sigma over the signal's amplitude: half a step of 12 bits, a quarter of a count. Assumed."""


class FrozenBits(Strict):
    """The terminal freezes low bits at speed, one more with each octave of signal frequency.
    The status word does not show it.
    """

    onset_factor: Positive = 1.0
    """Factor on the documented onset (+-15 %)."""


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
    """The terminal loses or gains whole signal periods, of 3600 lines 1.745 mrad each."""

    encoder: EncoderNumber
    at_s: RunTime
    periods: int = 1
    """Positive as the counter counts up."""


class CouplingSlip(Strict):
    """The clamp slips: the encoder's shaft turns against its joint (thesis sec. 5.4)."""

    encoder: EncoderNumber
    at_s: RunTime
    angle_rad: float = 1.0e-3
    """Step of the reading along the joint's angle. Assumed."""


class ResolverError(Strict):
    """The motors' resolvers have harmonic errors, and their converters round."""

    amplitude_rad: tuple[NotNegative, NotNegative] = (1.5e-3, 1.5e-3)
    """Amplitudes of 1 and 2 cycles per motor turn, at the motor."""
    quantum_rad: NotNegative = 2.0 * np.pi / 65536
    """Resolution of the converter at the motor; 0 for no rounding."""


class JointLag(Strict):
    """The robot logs its angles behind a low-pass filter of first order, one for each motor.
    The lag of axis 1 is part of the clock offset.
    """

    time_constant_s: Annotated[float, Field(gt=0.0, le=0.1)] = 0.01
    """Mean time constant (notes/log_formats sec. D)."""
    spread: NotNegative = 0.1
    """Sigma of its logarithm. Assumed."""


class JointNoise(Strict):
    """The logged robot angles have white noise."""

    sigma_rad: NotNegative
    """Sigma at the joint."""


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


Share = Annotated[float, Field(ge=0.0, le=0.5)]


class Outliers(Strict):
    """Some rows of a log have one grossly wrong value, or some readings at still poses do."""

    robot_probability: Share = 0.05
    """Share of the robot's rows."""
    ballbar_probability: Share = 0.05
    """Share of the ball-bar's rows."""
    size_rad: tuple[NotNegative, NotNegative] = (1.0e-3, 0.1)
    """Smallest and largest error of an angle. Assumed."""
    share: Share = 0.03
    """Share of the readings at still poses."""
    size_m: tuple[NotNegative, NotNegative] = (1.0e-3, 2.0e-2)
    """Smallest and largest error of a reading. Assumed."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.size_rad[0] <= self.size_rad[1]:
            raise ValueError(
                f"size_rad = [{self.size_rad[0]:g}, {self.size_rad[1]:g}]: the smallest comes first"
            )
        if not 0.0 < self.size_m[0] <= self.size_m[1]:
            raise wrong_key("size_m", message="expected the smallest size first, above 0")
        return self

    def on_robot(self, rows: int, joints: int, seed: int) -> Array:
        """(N, J) [rad] errors of the joint angles of N rows; 0 where a value is right."""
        return self._drawn(rows, joints, self.robot_probability, stream(seed, "outliers_robot"))

    def on_ballbar(self, rows: int, encoders: int, seed: int) -> Array:
        """(N, E) [rad] errors of what E encoders read in N rows; 0 where a value is right."""
        rng = stream(seed, "outliers_ballbar")
        return self._drawn(rows, encoders, self.ballbar_probability, rng)

    def _drawn(
        self, rows: int, channels: int, probability: float, rng: np.random.Generator
    ) -> Array:
        hit = rng.uniform(size=rows) < probability
        smallest, largest = np.maximum(self.size_rad, np.finfo(float).tiny)
        sizes = np.exp(rng.uniform(np.log(smallest), np.log(largest), rows))
        sizes = sizes * rng.choice((-1.0, 1.0), rows)
        out = np.zeros((rows, channels))
        hit &= max(self.size_rad) > 0.0
        out[np.arange(rows), rng.integers(0, channels, rows)] = np.where(hit, sizes, 0.0)
        return out

"""Error sources of the thesis's simulations (secs. 2.3, 3.1) that act on paired samples only.

They apply to the samples of the kinematic plant (ballbar.sim.kinematic_samples). In device logs the
clocks, the compliance of the rod and the counters of the encoders take their place.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ballbar.cell.errors import InputError
from ballbar.cell.schema import Strict

RodPulled = Literal["rising", "counterclockwise", "drawn"]

IN_LOGS = {
    "synchronisation": "state clocks.offset_s",
    "rod_deviation": "use rod_strain or rod_backlash with plant.kind = mujoco",
    "truncation": "choose encoders.bits",
}


class Synchronisation(Strict):
    """The robot's angles of a sample are logged later than the ball-bar's (thesis Fig. 3.4)."""

    delay_s: Annotated[float, Field(ge=-1.0, le=1.0)]
    """Delay of the robot's angles; positive if the robot has moved on."""


class RodDeviation(Strict):
    """The rod is longer while it is pulled and shorter while it is pushed (thesis Fig. 3.5).

    The mean over the path is removed, since a constant deviation is the length bd3. The thesis
    calls this ball-bar backlash and does not state where the force changes sign.
    """

    amplitude_m: Annotated[float, Field(ge=0.0, le=0.01)]
    """Largest deviation from the length bd3."""
    pulled: RodPulled = "rising"
    """While its end rises, or moves counterclockwise around the base, or over drawn stretches of
    2 s.
    """


class Truncation(Strict):
    """Ball-bar angles are rounded to multiples of a step (thesis Fig. 3.6).
    Truncation differs by half a step, which belongs to the encoder offset.
    """

    step_rad: Annotated[float, Field(gt=0.0, le=0.1)]
    """Smallest difference of two angles."""


class SampleErrors(Strict):
    """Error sources of paired samples; each is absent unless named."""

    synchronisation: Synchronisation | None = None
    rod_deviation: RodDeviation | None = None
    truncation: Truncation | None = None


def delay_of(errors: SampleErrors) -> float:
    """[s] delay with which the robot's angles of a sample are logged after the ball-bar's."""
    return errors.synchronisation.delay_s if errors.synchronisation else 0.0


def refuse_sample_errors(errors: SampleErrors) -> None:
    """Raise InputError when a scenario of device logs states an error source of samples."""
    for name, instead in IN_LOGS.items():
        if getattr(errors, name) is not None:
            raise InputError(
                f"errors.{name}: acts on samples (identify.data = samples), not on device logs. "
                f"There {instead}, or leave it out."
            )

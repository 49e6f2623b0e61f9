"""Error sources of the thesis's simulations (secs. 2.3, 3.1) that exist only where the samples of both logs are paired beforehand.

They act on the samples of the kinematic plant (sim.kinematic_samples), not on device logs, where other sources take their place:
clocks, a rod that gives way, encoders that count.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cell.errors import InputError
from cell.schema import Strict

IN_LOGS = {
    "synchronisation": "state clocks.offset_s",
    "rod_deviation": "use rod_strain or rod_backlash with plant.kind = mujoco",
    "truncation": "choose encoders.bits",
}


class Synchronisation(Strict):
    """The robot's angles of a sample are logged later than the ball-bar's (thesis Fig. 3.4)."""

    delay_s: Annotated[float, Field(ge=-1.0, le=1.0)] = Field(
        description="Positive: the robot has moved on."
    )


class RodDeviation(Strict):
    """The rod is longer or shorter by one amplitude, as friction at its end makes its force change sign (thesis Fig. 3.5).

    Longer while the rod's end rises, shorter while it sinks; what the path leaves of a mean is taken out, since that is bd3. The
    thesis calls it ball-bar backlash and says nothing of the order of signs.
    """

    amplitude_m: Annotated[float, Field(ge=0.0, le=0.01)] = Field(
        description="From the length bd3."
    )


class Truncation(Strict):
    """Ball-bar angles come in steps (thesis Fig. 3.6).

    Rounded to the nearest: cutting off instead is the same but for half a step, which is encoder zero.
    """

    step_rad: Annotated[float, Field(gt=0.0, le=0.1)] = Field(
        description="Smallest difference of two angles."
    )


class SampleErrors(Strict):
    """Error sources of paired samples; each absent unless named."""

    synchronisation: Synchronisation | None = None
    rod_deviation: RodDeviation | None = None
    truncation: Truncation | None = None


def delay_of(errors: SampleErrors) -> float:
    """[s] by which the robot's angles of a sample are logged later than the ball-bar's."""
    return errors.synchronisation.delay_s if errors.synchronisation else 0.0


def refuse_sample_errors(errors: SampleErrors) -> None:
    """Raises InputError when an error source is asked for that device logs do not have."""
    for name, instead in IN_LOGS.items():
        if getattr(errors, name) is not None:
            raise InputError(
                f"errors.{name}: acts on samples (identify.data = samples), not on device logs. There {instead}, or leave it out."
            )

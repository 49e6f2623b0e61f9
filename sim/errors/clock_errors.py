"""Error sources of clocks and loggers: what a scenario may ask for. What it does to the rows: sim.errors.wander, sim.logging.clocks, sim.logging.loggers.

Sizes: notes/log_formats sec. G; notes/parameters, logging. Times of events count from the start of the path.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cell.schema import Strict

LEAD = 0.5  # [s] the later log begins so long after the start of the path, and both end so long before its end

Probability = Annotated[float, Field(ge=0.0, lt=0.5)]
RunTime = Annotated[float, Field(description="Seconds after the start of the path.")]


class ClockWander(Strict):
    """The ball-bar clock's rate walks at random and warms up; the straight line through it stays offset and skew.

    0.1 ppm is what a walk of 0.5 ppm in 10 min does within 2 min. After power-on a quartz changes by about 5 ppm in 10 min.
    """

    rate_rms_ppm: Annotated[float, Field(ge=0.0, le=100.0)] = Field(
        0.1, description="Random walk of the rate: RMS about its mean."
    )
    warm_up_ppm: Annotated[float, Field(ge=-100.0, le=100.0)] = Field(
        0.0, description="Excess rate at power-on, decaying; 5 is usual."
    )
    warm_up_time_s: Annotated[float, Field(ge=10.0)] = Field(
        600.0, description="Time constant of the decay."
    )


class ClockStep(Strict):
    """The ball-bar clock is set: later stamps are shifted. A reader must refuse stamps that go back."""

    at_s: RunTime
    step_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = Field(
        0.128, description="NTP sets a clock that is off by more than 128 ms."
    )


class StampQuantum(Strict):
    """Stamps are rounded, counted from the first row. Truncation is the same but for a constant, which is offset."""

    robot_s: Annotated[float, Field(ge=0.0, le=0.1)] = Field(
        1.0e-3, description="EGM headers: whole ms; 0 for none."
    )
    ballbar_s: Annotated[float, Field(ge=0.0, le=0.1)] = Field(
        1.0e-3, description="SYSTEMTIME: whole ms, which a 5 ms task never shows."
    )


class StampJitter(Strict):
    """The robot's rows are stamped a little early or late; the first one, from which time counts, is not."""

    sigma_s: Annotated[float, Field(ge=0.0, le=5.0e-4)] = Field(
        2.0e-4, description="White; more would put rows out of order."
    )


class DroppedRows(Strict):
    """Rows that never reach the file; the first one always does."""

    robot_probability: Probability = Field(1.0e-3, description="Assumed: one row in a thousand.")
    ballbar_probability: Probability = Field(1.0e-3, description="Assumed: one row in a thousand.")


class DuplicatedRows(Strict):
    """Rows that are written twice, as a message that is read twice."""

    robot_probability: Probability = Field(1.0e-3, description="Assumed: one row in a thousand.")
    ballbar_probability: Probability = Field(1.0e-3, description="Assumed: one row in a thousand.")


class LoggerRestart(Strict):
    """The ball-bar logger stops and starts again in a new file, the old one renamed ...Old.csv; counters and clock run on."""

    at_s: RunTime
    gap_s: Annotated[float, Field(gt=0.0)] = Field(2.0, description="Without rows. Assumed.")

"""Error sources of clocks and loggers: their keys in a scenario.

What they do to the rows of a log stands in sim.logging.clocks, sim.logging.clocks and
sim.logging.clocks. Sizes: notes/log_formats sec. G and notes/parameters, logging. Times of events
count from the start of the path.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cell.schema import Positive, Strict

LEAD = 0.5  # [s] of the path before the first row of the later log, and after the last of both

Probability = Annotated[float, Field(ge=0.0, lt=0.5)]
RunTime = Annotated[float, Field(description="Seconds after the start of the path.")]


class ClockWander(Strict):
    """The rate of a clock does a random walk and decays after power-on.
    The deviation from the straight line that clock offset and skew describe has no trend.

    A random walk of 0.5 ppm in 10 min amounts to 0.1 ppm in 2 min. A quartz changes its rate by
    about 5 ppm in the first 10 min after power-on.
    """

    rate_rms_ppm: Annotated[float, Field(ge=0.0, le=100.0)] = 0.1
    """RMS of the random walk of the rate about its mean."""
    warm_up_ppm: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    """Excess rate at power-on, which then decays; 5 ppm is usual."""
    warm_up_time_s: Annotated[float, Field(ge=10.0)] = 600.0
    """Time constant of the decay."""


class ClockStep(Strict):
    """The ball-bar's clock is set, which shifts all later stamps.
    A reader must refuse stamps that go back.
    """

    at_s: RunTime
    step_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.128
    """Size of the step; NTP sets a clock that is off by more than 128 ms."""


class StampQuantum(Strict):
    """Stamps, counted from the first row, are rounded.
    Truncation would differ by a constant, which belongs to the clock offset.
    """

    robot_s: Annotated[float, Field(ge=0.0, le=0.1)] = 1.0e-3
    """EGM headers state whole milliseconds; 0 for no rounding."""
    ballbar_s: Annotated[float, Field(ge=0.0, le=0.1)] = 1.0e-3
    """SYSTEMTIME states whole milliseconds, which a 5 ms task does not show."""


class StampJitter(Strict):
    """The robot's rows are stamped a little early or late.
    The first row is not, since time counts from it.
    """

    sigma_s: Annotated[float, Field(ge=0.0, le=5.0e-4)] = 2.0e-4
    """Standard deviation of white jitter; more would put rows out of order."""


class DroppedRows(Strict):
    """Some rows are missing from the files; the first one never is."""

    robot_probability: Probability = 1.0e-3
    """Share of the robot's rows; one in a thousand is assumed."""
    ballbar_probability: Probability = 1.0e-3
    """Share of the ball-bar's rows; one in a thousand is assumed."""


class DuplicatedRows(Strict):
    """Some rows stand in the files twice, as if a message had been read twice."""

    robot_probability: Probability = 1.0e-3
    """Share of the robot's rows; one in a thousand is assumed."""
    ballbar_probability: Probability = 1.0e-3
    """Share of the ball-bar's rows; one in a thousand is assumed."""


class LoggerRestart(Strict):
    """The ball-bar's logger stops and starts again in a new file, the old one renamed ...Old.csv.
    Counters and clock run on.
    """

    at_s: RunTime
    gap_s: Positive = 2.0
    """Time without rows; assumed."""

"""Error sources of still poses: their keys in a scenario.

What they mean for one robot stands in ballbar.sim.true_robot, what they do to readings and logged
angles in ballbar.sim.instrument_readings.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ballbar.cell.schema import NotNegative, Strict
from ballbar.sim.errors.sensor_errors import Share

Axis = Annotated[int, Field(ge=1, le=8)]


class GeometryErrors(Strict):
    """Deviations of the DH parameters of all rows and of the Hayati angles of parallel axes."""

    sigma_m: NotNegative = 5.0e-4
    """Sigma of lengths. Assumed."""
    sigma_rad: NotNegative = 1.0e-3
    """Sigma of angles. Assumed."""


class JointZeros(Strict):
    """The zeros of the joints were set by eye."""

    sigma_rad: NotNegative = 0.03
    """Sigma of each. Assumed."""


class JointHarmonic(Strict):
    """An error of one gear: amplitude * sin(order * angle + phase), the phase drawn."""

    axis: Axis
    order: Annotated[int, Field(ge=1, le=400)]
    """Cycles a turn."""
    amplitude_rad: NotNegative


class DrawnHarmonics(Strict):
    """Harmonic errors of gears whose axes, orders and phases are drawn."""

    count: Annotated[int, Field(ge=1, le=50)] = 4
    order_max: Annotated[int, Field(ge=1, le=400)] = 40
    amplitude_rad: NotNegative = 1.0e-4
    """Amplitude of each harmonic. Assumed."""


class UnitWeights(Strict):
    """The arm sags under weights at the origins of its frames, for a robot whose masses are not
    known.
    """

    sigma_rad_per_m: NotNegative = 3.0e-4
    """Scale of what a joint yields per metre of lever. Assumed."""


class InstrumentNoise(Strict):
    """The readings have white noise as the instrument's file states it; a socket has its play."""

    scale: NotNegative = 1.0
    """Factor on every sigma of the file."""


class Unsettled(Strict):
    """The angles of some poses were read while the robot was still on its way."""

    share: Share = 0.05
    fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    """Share of the last move that was missing. Assumed."""


class Rounding(Strict):
    """The axis angles are written with few digits."""

    step_deg: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01


class Drift(Strict):
    """The seats move against the robot's base in proportion to time."""

    shift_m: NotNegative = 2.0e-4
    """From the first pose to the last. Assumed."""
    turn_rad: NotNegative = 0.0
    """From the first pose to the last, about the robot's base. Assumed."""


class ArmErrors(Strict):
    """Error sources of an arm at still poses; each is absent unless named."""

    geometry: GeometryErrors | None = None
    joint_zeros: JointZeros | None = None
    joint_harmonics: tuple[JointHarmonic, ...] = ()
    drawn_harmonics: DrawnHarmonics | None = None
    unit_weights: UnitWeights | None = None

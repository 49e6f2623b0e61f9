"""The simulated half of a scenario that stands still: cell, poses and errors.

Every key carries its unit. Every error source is absent by default. The docstrings and descriptions
are printed in the scenario reference.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cell.schema import NotNegative, Strict
from cell.schema_errors import wrong_key
from sim.errors.plant_errors import JointCompliance
from sim.errors.sensor_errors import JointNoise, Share
from sim.settings import Position, RodAndWire, Vector3

Axis = Annotated[int, Field(ge=1, le=8)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]


class PoseCell(Strict):
    """What stands in the cell."""

    robot: str
    """A file of cell/robots, or a path that ends in .yaml."""
    instrument: str
    """A file of cell/instruments, or a path."""


class PlacementSettings(Strict):
    """A place with a name."""

    name: Name
    position_m: Position
    rotvec_rad: Vector3 = (0.0, 0.0, 0.0)
    """Orientation, as rotation vector; only where it is measured."""


class PosesSettings(Strict):
    """The poses at which the robot stands, drawn at random within what robot and instrument reach.

    A tracker measures every target at each pose. A rod, a wire or a socket has poses of its own for
    each pair of seat and target; the robot is moved until the reading is within the range.
    """

    count: Annotated[int, Field(ge=10, le=100_000)]
    """Poses of each seat; of a rod, wire or socket for each target too."""
    seed: Annotated[int, Field(ge=0)] | None = None
    """Seed of the poses, to keep them while errors vary; by default seed."""
    dwell_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 10.0
    """Time from one pose to the next."""
    seats: Annotated[tuple[PlacementSettings, ...], Field(min_length=1)]
    """Placements of the instrument in the robot's base frame."""
    targets: Annotated[tuple[PlacementSettings, ...], Field(min_length=1)]
    """Balls or reflectors in the flange's frame."""
    reference: tuple[PlacementSettings, ...] = ()
    """Three or more fixed points in the robot's base frame, which a tracker reads once at each
    pose.
    """
    axis_lower_deg: tuple[float, ...] | None = None
    """Limits of the axis angles; by default those of the robot."""
    axis_upper_deg: tuple[float, ...] | None = None
    lowest_m: float = 0.0
    """Least height of flange and target in the robot's base frame."""
    elevation_min_deg: Annotated[float, Field(ge=-90.0, le=80.0)] = -90.0
    """Least elevation of a rod or wire over the horizontal."""
    tilt_max_deg: Annotated[float, Field(ge=10.0, le=180.0)] = 180.0
    """Largest angle between straight down and the line from flange to target."""

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        for key, places in (
            ("seats", self.seats),
            ("targets", self.targets),
            ("reference", self.reference),
        ):
            names = [place.name for place in places]
            if len(set(names)) < len(names):
                raise wrong_key(key, message=f"names must differ; there are {', '.join(names)}")
        return self


class PosePlant(RodAndWire):
    """What holds the robot at a pose."""

    kind: Literal["auto", "mujoco", "kinematic"] = "auto"
    """MuJoCo, in static equilibrium with the rod or wire; or kinematic, with the robot's own weight
    as only load. auto takes MuJoCo for a rod or wire on elastic gears.
    """


class GeometryErrors(Strict):
    """Deviations of the DH parameters of all rows and of the Hayati angles of parallel axes."""

    sigma_m: NotNegative = 5.0e-4
    """Standard deviation of lengths. Assumed."""
    sigma_rad: NotNegative = 1.0e-3
    """Standard deviation of angles. Assumed."""


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
    """Of each. Assumed."""


class UnitWeights(Strict):
    """The arm sags under weights at the origins of its frames, for a robot whose masses are not
    known. What a joint yields per metre of lever is drawn, positive.
    """

    sigma_rad_per_m: NotNegative = 3.0e-4
    """Scale of the drawn yields. Assumed."""


class InstrumentNoise(Strict):
    """The readings have white noise as the instrument's file states it; a socket has its play."""

    scale: NotNegative = 1.0
    """Factor on all standard deviations of the file."""


class PoseOutliers(Strict):
    """Some readings are grossly wrong: a broken beam, a mount that was not seated."""

    share: Share = 0.03
    size_m: tuple[NotNegative, NotNegative] = (1.0e-3, 2.0e-2)
    """Smallest and largest; drawn log-uniformly. Assumed."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not 0.0 < self.size_m[0] <= self.size_m[1]:
            message = "expected the smallest size first, above 0"
            raise wrong_key("size_m", message=message)
        return self


class Unsettled(Strict):
    """The angles of some poses were read while the robot was still on its way."""

    share: Share = 0.05
    fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    """Of the last move that was missing. Assumed."""


class Rounding(Strict):
    """The axis angles are written with few digits."""

    step_deg: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01


class Drift(Strict):
    """The seats move against the robot's base in proportion to time; directions are drawn."""

    shift_m: NotNegative = 2.0e-4
    """From the first pose to the last. Assumed."""
    turn_rad: NotNegative = 0.0
    """From the first pose to the last, about the robot's base. Assumed."""


class PoseErrors(Strict):
    """Error sources; each is absent unless named."""

    geometry: GeometryErrors | None = None
    joint_harmonics: tuple[JointHarmonic, ...] = ()
    drawn_harmonics: DrawnHarmonics | None = None
    unit_weights: UnitWeights | None = None
    joint_compliance: JointCompliance | None = None
    """Requires masses and gears in the robot's file."""
    joint_noise: JointNoise | None = None
    instrument_noise: InstrumentNoise | None = None
    outliers: PoseOutliers | None = None
    unsettled: Unsettled | None = None
    rounding: Rounding | None = None
    drift: Drift | None = None


class PoseSimulationSettings(Strict):
    """Everything that a simulated table of still poses is made from."""

    cell: PoseCell
    poses: PosesSettings
    plant: PosePlant = PosePlant()
    errors: PoseErrors = PoseErrors()
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of all drawn values; each error source has its own stream."""

"""The simulated half of a scenario: the cell, its motion or its still poses, its errors and logs.

Every key carries its unit. Every error source is absent by default. The docstrings are printed in
the scenario reference.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, create_model, model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.plugins import PluginTable
from ballbar.cell.schema import NotNegative, Positive, Strict
from ballbar.cell.schema_errors import missing_key, wrong_key
from ballbar.cell.temperature import Temperatures
from ballbar.sim.errors import sensor_errors
from ballbar.sim.errors.base import ErrorSource
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.errors.pose_errors import ArmErrors, Drift, InstrumentNoise, Rounding, Unsettled
from ballbar.sim.errors.sample_errors import SampleErrors
from ballbar.sim.errors.static_errors import CellErrors
from ballbar.sim.logging.load_logs import DeviceLogs, OpticalTracker
from ballbar.sim.streams import recording_seed

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]
Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Coordinate = Annotated[float, Field(ge=-20.0, le=20.0)]
Position = Annotated[tuple[Coordinate, ...], Field(min_length=3, max_length=3)]


class CellSettings(Temperatures):
    """The machines of the cell, where the instrument stands, and how warm they are."""

    robot: str
    """A file of cell/robots, or a path that ends in .yaml."""
    ballbar: str | None = None
    """A ball-bar with encoders: a file of cell/instruments, or a path."""
    instrument: str | None = None
    """In place of ballbar: a file of cell/instruments, or a path. Of a robot that moves it measures
    a length (telescoping ball-bar, draw-wire) or follows a target (tracker, motion capture).
    """
    plate: str = "plate_250"
    """A file of cell/plates, or a path."""
    ballbar_position_m: Position | None = None
    """Centre of the sphere, or seat of the instrument, in the robot's base frame. Beside a tracker
    the path's angles turn about it, too.
    """
    ballbar_set: Literal["at_position", "without_strain"] = "at_position"
    """The base of a ball-bar stands at ballbar_position_m with its error, or, as one sets it in a
    cell, where nothing strains the rod at the first pose of the path.
    """

    @model_validator(mode="after")
    def _ballbar_or_instrument(self) -> CellSettings:
        if (self.ballbar is None) == (self.instrument is None):
            raise wrong_key("ballbar", message="expected either ballbar or instrument")
        return self

    @property
    def measured_by(self) -> str:
        """The ball-bar or the instrument that holds the tool."""
        return self.ballbar or self.instrument or ""

    @property
    def position(self) -> Array:
        """(3,) [m] the stated ballbar_position_m."""
        return np.array(self.ballbar_position_m)


class PathSettings(Strict):
    """The reference path and its timing."""

    kind: Literal["lissajous", "push_pull", "recorded"]
    """A motion over the sphere, pull and push on the rod at one pose, or the motion of a recording.
    """
    file: str = ""
    """Path file for lissajous and push_pull, relative to the scenario. Lissajous without one takes
    the first feasible path that is found, and without ballbar_position_m a place for the ball-bar.
    """
    recording: str = ""
    """Folder of the recording for recorded, relative to the scenario."""
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)]
    """Duration with all dwells; for recorded, from the first row."""
    dwell_s: Annotated[float, Field(ge=1.0)] = 4.0
    """Dwell at both ends and at each stop; not for recorded."""
    stops: Annotated[int, Field(ge=0, le=50)] = 2
    """Dwells between the ends; not for recorded."""

    @model_validator(mode="after")
    def _of_its_kind(self) -> PathSettings:
        """The keys of the kind are given, and no others."""
        needed, unused = "file", ["recording"]
        if self.kind == "recorded":
            needed, unused = "recording", ["file", "dwell_s", "stops"]
        if not getattr(self, needed) and self.kind != "lissajous":
            raise ValueError(f"kind {self.kind} needs {needed}")
        for key in unused:
            if getattr(self, key) != PathSettings.model_fields[key].default:
                raise wrong_key(key, message=f"kind {self.kind} has no use for it; leave it out")
        return self


class RodAndWire(Strict):
    """Forces of a telescoping rod or a wire on the robot in MuJoCo."""

    rod_mass_kg: Positive = 0.25
    """Mass of a telescoping rod. Assumed."""
    rod_spring_N_per_m: NotNegative = 500.0
    """Spring of a rod's length sensor, without force at mid range. Assumed."""
    rod_friction_N: NotNegative = 0.3
    """Friction of a rod's slide; what is left of it at a still pose is drawn. Assumed."""
    wire_tension_N: Positive = 6.0
    """Tension of a draw-wire. Assumed."""


class PlantSettings(RodAndWire):
    """The model that turns the command into motion, or holds the robot at a pose."""

    kind: Literal["auto", "mujoco", "kinematic"] = "auto"
    """MuJoCo, or exact inverse kinematics without forces. In MuJoCo a still robot is in static
    equilibrium with the rod or wire; kinematic, its own weight is the only load. auto takes MuJoCo,
    but at still poses only for a rod or wire on elastic gears.
    """
    timestep_s: Annotated[float, Field(ge=1e-4, le=5e-3)] = 1e-3
    """Time step of MuJoCo."""
    servo: str = "soft"
    """A gain set of the robot's file."""
    gravity_compensation: bool = True
    """The servo command carries the robot's nominal weight."""
    typical_spread: NotNegative = 0.0
    """For MuJoCo: factor on the spread about what is typical of the robot's size, where its file
    states no masses, gears, servo or rotors (docs/how_to/own_robot.md).
    """


class ErrorSettings(CellErrors, PlantErrors, ArmErrors, sensor_errors.SensorErrors, SampleErrors):
    """Error sources; each is absent unless named."""

    joint_lag: sensor_errors.JointLag | None = None
    joint_noise: sensor_errors.JointNoise | None = None
    instrument_noise: InstrumentNoise | None = None
    outliers: sensor_errors.Outliers | None = None
    unsettled: Unsettled | None = None
    rounding: Rounding | None = None
    drift: Drift | None = None


PLUGINS = PluginTable[Any](
    "error_sources", ErrorSettings.model_fields, lambda kind: issubclass(kind, ErrorSource)
)
if not TYPE_CHECKING:
    ErrorSettings = create_model(
        "ErrorSettings",
        __base__=ErrorSettings,
        __doc__=ErrorSettings.__doc__,
        __module__=__name__,
        **{name: (PLUGINS[name] | None, None) for name in PLUGINS.added},
    )


class EncoderSettings(Strict):
    """Encoders of the ball-bar; their offsets are drawn."""

    fitted: tuple[sensor_errors.EncoderNumber, ...] = (1, 2, 3, 4, 5)
    """Joints with an encoder; [] for a ball-bar without encoders."""
    bits: Annotated[int, Field(ge=8, le=13)] = 12
    """Interpolation of one line (EL5021 8001:11)."""
    noise_sigma_rad: NotNegative = 0.0
    """Sigma of white noise, before quantisation."""
    directions: Literal["declared", "unknown"] = "declared"
    """Encoder directions are drawn; recording.yaml states them, or +1 for all."""

    @model_validator(mode="after")
    def _distinct(self) -> EncoderSettings:
        if list(self.fitted) != sorted(set(self.fitted)):
            raise ValueError("fitted encoders must be distinct and in increasing order")
        return self


class LengthSettings(Strict):
    """The sensor of a telescoping ball-bar or draw-wire; clocks holds for its log too."""

    noise_scale: NotNegative = 1.0
    """Factor on the white noise that the instrument's file states."""
    zero_scale: NotNegative = 1.0
    """Factor on the sigma of the zero that the instrument's file states."""
    resolution_m: Annotated[float, Field(ge=0.0, le=0.01)] = 1.0e-7
    """Step of the logged length; 0 for no rounding."""
    rate_hz: Annotated[float, Field(ge=1.0, le=10_000.0)] = 100.0
    """Rows per second."""


class ClockSettings(Strict):
    """The two clocks: t_robot = offset + (1 + skew) * t_ballbar.
    Both times count from the first row of their own log.
    """

    offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.0
    """Robot time at the first row of the ball-bar."""
    skew: Annotated[float, Field(ge=-2e-3, le=2e-3)] = 0.0
    """Seconds that the robot's clock gains in each second of the ball-bar's; 30 ppm is 3.0e-5."""
    overrun_probability: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.0
    """Share of the ball-bar's rows that come one 5 ms task late."""
    wander: sensor_errors.ClockWander | None = None
    """Wander of the ball-bar's clock."""
    robot_wander: sensor_errors.ClockWander | None = None
    """Wander of the robot's clock."""
    step: sensor_errors.ClockStep | None = None
    quantum: sensor_errors.StampQuantum | None = None
    jitter: sensor_errors.StampJitter | None = None
    dropped_rows: sensor_errors.DroppedRows | None = None
    duplicated_rows: sensor_errors.DuplicatedRows | None = None
    restart: sensor_errors.LoggerRestart | None = None

    def fault_times(self) -> Iterator[tuple[tuple[str, ...], float]]:
        """Scenario key and time [s] of every fault that happens at a stated time."""
        if self.step:
            yield ("clocks", "step", "at_s"), self.step.at_s
        if self.restart:
            yield ("clocks", "restart", "at_s"), self.restart.at_s
            yield ("clocks", "restart", "gap_s"), self.restart.at_s + self.restart.gap_s


class PlacementSettings(Strict):
    """A place with a name."""

    name: Name
    position_m: Position
    rotvec_rad: Vector3 = (0.0, 0.0, 0.0)
    """Orientation, as rotation vector; only where it is measured."""


class PictureSettings(Strict):
    """A camera sees a board; the seat and the target are it and the board.

    Poses are those at which a picture has the whole board.
    """

    camera: Literal["cell", "flange"] = "cell"
    """Where the camera stands: in the cell, with the board on the flange, or on the flange."""
    squares_x: Annotated[int, Field(ge=3, le=200)] = 9
    squares_y: Annotated[int, Field(ge=3, le=200)] = 7
    square_m: Annotated[float, Field(gt=0.0)] = 0.025
    sigma_m: Annotated[float, Field(gt=0.0)] = 5.0e-5
    """Sigma of its measurement. Assumed: a row of 200 mm to 0.4 mm."""
    lens_scale: NotNegative = 0.3
    """How far the true lens is from the camera's file, in its standard deviations."""
    tilt_max_deg: Annotated[float, Field(gt=0.0, lt=90.0)] = 60.0
    """Largest angle between the line of sight and the board's normal."""


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
    pictures: PictureSettings | None = None
    """Pictures of a camera."""
    reference: tuple[PlacementSettings, ...] = ()
    """Three or more fixed points in the robot's base frame, which a tracker reads at each pose."""
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


def _errors(*parts: type[Strict], but: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Keys of the error sources of some parts, but a few."""
    names = (name for part in parts for name in part.model_fields)
    return tuple(f"errors.{name}" for name in names if name not in but)


# Keys that belong to one kind of scenario: each with what it needs (`refuse_keys`).
OF_BALLBAR = (
    *("encoders", "clocks.overrun_probability", "logs.force_sensor", "logs.ballbar"),
    *_errors(sensor_errors.SensorErrors, SampleErrors, but=("resolver_error",)),
    *("errors.ballbar_axes", "errors.base_tilt", "errors.rod_strain", "errors.rod_backlash"),
    *("errors.bar_friction", "errors.base_compliance", "errors.outliers", "cell.ballbar_set"),
)
OF_LENGTH = ("length", *(f"plant.{name}" for name in RodAndWire.model_fields))
OF_PATH = (
    *("cell.ballbar", "cell.plate", "cell.ballbar_position_m", "cell.ballbar_set"),
    *("encoders", "length", "clocks", "logs", "recording"),
    *("plant.timestep_s", "plant.servo", "plant.gravity_compensation", "plant.typical_spread"),
    *_errors(CellErrors, PlantErrors, but=("joint_compliance", "gear_backlash")),
    *_errors(sensor_errors.SensorErrors, SampleErrors),
    *("errors.joint_lag", "errors.outliers.robot_probability"),
    *("errors.outliers.ballbar_probability", "errors.outliers.size_rad"),
)
OF_POSES = (
    *_errors(ArmErrors),
    *("errors.instrument_noise", "errors.unsettled", "errors.rounding", "errors.drift"),
    *("errors.outliers.share", "errors.outliers.size_m"),
)
A_PATH = "a robot that moves (path)"


def refuse_keys(settings: Strict, keys: Iterable[str], needed: str) -> None:
    """Raise for the first of some keys, with dots, that is stated; a default says nothing."""
    for key in keys:
        *sections, last = key.split(".")
        holder: Any = settings
        for section in sections:
            holder = getattr(holder, section, None)
        if holder and getattr(holder, last) != type(holder).model_fields[last].default:
            raise wrong_key(*sections, last, message=f"needs {needed}; leave it out")


class SimulationSettings(Strict):
    """Everything that a simulated recording, or a table of still poses, is made from."""

    cell: CellSettings
    path: PathSettings | None = None
    poses: PosesSettings | None = None
    plant: PlantSettings = PlantSettings()
    errors: ErrorSettings = ErrorSettings()
    encoders: EncoderSettings = EncoderSettings()
    length: LengthSettings = LengthSettings()
    clocks: ClockSettings = ClockSettings()
    logs: DeviceLogs = DeviceLogs()
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of all drawn values."""
    recording: Annotated[int, Field(ge=1)] = 1
    """Which recording of the machine of this seed: noise, clocks and lost rows are drawn again,
    nothing else.
    """

    @property
    def recording_seed(self) -> int:
        """Seed of noise, clocks and lost rows."""
        return recording_seed(self.seed, self.recording)

    def tracker(self, instrument: Instrument | None) -> OpticalTracker | None:
        """How the log of a tracker is made; None without one.

        instrument : in place of a ball-bar.
        """
        follows = instrument is not None and instrument.follows
        return self.logs.tracker or (OpticalTracker() if follows else None)

    @property
    def needed_path(self) -> PathSettings:
        """The path. Raises InputError for still poses."""
        if self.path is None:
            raise InputError(
                "a scenario of still poses, and this needs one with a path. `ballbar run` and "
                "`ballbar simulate` take it."
            )
        return self.path

    @property
    def needed_poses(self) -> PosesSettings:
        """The still poses. Raises InputError for a path."""
        if self.poses is None:
            raise InputError("a scenario with a path, and this needs one of still poses.")
        return self.poses

    @model_validator(mode="after")
    def _of_one_kind(self) -> Self:
        """The robot moves or stands still, and nothing is stated that belongs to another kind."""
        if (self.path is None) == (self.poses is None):
            raise wrong_key("path", message="expected either path or poses")
        of_length = self.cell.instrument is not None
        if self.path is None:
            refuse_keys(self, OF_PATH, A_PATH)
            return self
        refuse_keys(self, OF_POSES, "a robot that stands still (poses)")
        if of_length:
            refuse_keys(self, OF_BALLBAR, "a ball-bar with encoders (cell.ballbar)")
        else:
            refuse_keys(self, OF_LENGTH, "cell.instrument")
        if of_length and self.path.kind == "push_pull":
            raise wrong_key("path", "kind", message="push_pull needs a ball-bar with a rigid rod")
        searched = self.path.kind == "lissajous" and not self.path.file
        if self.cell.ballbar_position_m is None and not searched:
            raise missing_key("cell", "ballbar_position_m")
        return self

    @model_validator(mode="after")
    def _faults_happen(self) -> Self:
        """Each fault that is stated happens: its encoder is fitted, and its time is logged."""
        if self.path is None:
            return self
        first, last = sensor_errors.LEAD, self.path.duration_s - sensor_errors.LEAD
        for key, time in (*self.errors.fault_times(), *self.clocks.fault_times()):
            if not first < time < last:
                logged = f"the logs run from {first:g} to {last:g} s of the path"
                raise wrong_key(*key, message=f"t = {time:g} s is not logged; {logged}")
        for key, encoder in self.errors.fault_encoders():
            if encoder not in self.encoders.fitted:
                fitted = ", ".join(map(str, self.encoders.fitted)) or "none"
                message = f"joint {encoder} has no encoder; encoders.fitted are: {fitted}"
                raise wrong_key(*key, "encoder", message=message)
        return self

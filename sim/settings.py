"""The simulated half of a scenario: what stands in the cell, how it moves, what is wrong with it, how it is logged.

Every key carries its unit. Every error source is absent by default.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from cell.schema import Strict
from cell.schema_errors import wrong_key
from sim.errors.clock_errors import (
    LEAD,
    ClockStep,
    ClockWander,
    DroppedRows,
    DuplicatedRows,
    LoggerRestart,
    StampJitter,
    StampQuantum,
)
from sim.errors.outliers import Outliers
from sim.errors.plant_errors import PlantErrors
from sim.errors.sample_errors import SampleErrors
from sim.errors.sensor_errors import EncoderNumber, SensorErrors
from sim.logging.load_logs import LoadLogs

Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Place = Annotated[
    tuple[Annotated[float, Field(ge=-20.0, le=20.0)], ...], Field(min_length=3, max_length=3)
]
Vector5 = Annotated[tuple[float, ...], Field(min_length=5, max_length=5)]
Whole5 = Annotated[tuple[int, ...], Field(min_length=5, max_length=5)]


class CellSettings(Strict):
    """What stands in the cell, and where."""

    robot: str = Field(description="A file of cell/robots, or a path that ends in .yaml.")
    ballbar: str = Field(description="A file of cell/ballbars, or a path.")
    plate: str = Field("plate_250", description="A file of cell/plates, or a path.")
    ballbar_position_m: Place = Field(description="Sphere centre in the robot's base frame.")


class PathSettings(Strict):
    """The reference path and its timing."""

    kind: Literal["lissajous", "push_pull", "recorded"] = Field(
        description="A motion over the sphere, pull and push on the rod at one pose, or where the robot of a recording went."
    )
    file: str = Field(
        "", description="Path file of lissajous and push_pull, relative to the scenario."
    )
    recording: str = Field(
        "", description="Folder of the recording, relative to the scenario; of recorded only."
    )
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)] = Field(
        description="Of the whole run, standstills included; of a recording, from its first row."
    )
    dwell_s: Annotated[float, Field(ge=1.0)] = Field(
        4.0, description="Standstill at both ends and at each stop; a recording has its own."
    )
    stops: Annotated[int, Field(ge=0, le=50)] = Field(
        2, description="Standstills between the ends; a recording has its own."
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> PathSettings:
        """What the kind needs is given, and nothing that it would not look at."""
        recorded = self.kind == "recorded"
        needed, unused = (
            ("recording", ("file", "dwell_s", "stops")) if recorded else ("file", ("recording",))
        )
        if not getattr(self, needed):
            raise ValueError(f"kind {self.kind} needs {needed}")
        for key in unused:
            if getattr(self, key) != PathSettings.model_fields[key].default:
                raise wrong_key(key, message=f"kind {self.kind} has no use for it; leave it out")
        return self


class LissajousFile(Strict):
    """Path file: five ball-bar angles as centre + amplitude * sin(2 pi cycles s + phase), s from 0 to 1."""

    schema_: Annotated[Literal["ballbar-path/1"], Field(alias="schema")]
    centre_deg: Vector5
    amplitude_deg: Vector5
    cycles: Whole5
    phase_deg: Vector5
    ballbar_position_m: Place | None = Field(
        None, description="Where the path was planned for; only `ballbar plan` looks at it."
    )


class PushPullFile(Strict):
    """Path file: one pose of the ball-bar, and how far the command goes to and fro along the rod."""

    schema_: Annotated[Literal["ballbar-push/1"], Field(alias="schema")]
    angles_deg: Vector5
    travel_m: Annotated[float, Field(gt=0.0, le=0.1)]
    cycles: Annotated[int, Field(gt=0)]


class PlantSettings(Strict):
    """What turns the command into motion."""

    kind: Literal["mujoco", "kinematic"] = Field(
        "mujoco", description="MuJoCo, or exact inverse kinematics without forces."
    )
    timestep_s: Annotated[float, Field(gt=0.0, le=5e-3)] = Field(1e-3, description="MuJoCo step.")
    servo: str = Field("soft", description="A gain set of the robot's file.")
    gravity_compensation: bool = Field(
        True, description="Whether the servo command carries the robot's nominal weight."
    )


class StaticErrors(Strict):
    """Deviations of the true geometry from the nominal one: a table, or drawn."""

    table: Literal["thesis_3_1"] | None = Field(None, description="Thesis Table 3.1.")
    sigma_m: Annotated[float, Field(ge=0.0)] | None = Field(
        None, description="Standard deviation of drawn lengths."
    )
    sigma_rad: Annotated[float, Field(ge=0.0)] | None = Field(
        None, description="Standard deviation of drawn angles."
    )
    parameters: Literal["thesis", "all"] = Field(
        "thesis",
        description="Drawn: those of Table 3.1, or every one of robot, ball-bar and base but the plate's length.",
    )

    @model_validator(mode="after")
    def _table_or_sigmas(self) -> StaticErrors:
        drawn = self.sigma_m is not None and self.sigma_rad is not None
        if (self.table is None) != drawn:
            raise ValueError("give either table, or both sigma_m and sigma_rad")
        if self.table and self.parameters == "all":
            raise wrong_key(
                "parameters",
                message="Table 3.1 has its own; to draw all, give sigma_m and sigma_rad instead of table",
            )
        return self


class BallbarAxes(Strict):
    """Axes of gimbal and cardan that pass each other and are not square: drawn (notes/parameters, joints_mechanical)."""

    sigma_m: Annotated[float, Field(ge=0.0)] = Field(
        5.0e-6, description="Standard deviation of the intersection offsets."
    )
    sigma_rad: Annotated[float, Field(ge=0.0)] = Field(
        5.0e-5, description="Standard deviation of the squareness errors."
    )


class BaseTilt(Strict):
    """The ball-bar's base does not stand parallel to the robot's: two drawn angles (notes/parameters, base)."""

    sigma_rad: Annotated[float, Field(ge=0.0)] = Field(
        1.0e-3, description="Standard deviation about x and about y."
    )


class PlateLength(Strict):
    """The known length that fixes the scale is not quite known: drawn."""

    sigma_m: Annotated[float, Field(ge=0.0)] | None = Field(
        None, description="Standard deviation; default of the plate file."
    )


class JointNoise(Strict):
    """White noise of the logged robot angles."""

    sigma_rad: Annotated[float, Field(ge=0.0)] = Field(description="At the joint.")


class ErrorSettings(PlantErrors, SensorErrors, SampleErrors):
    """Error sources; each absent unless named."""

    static: StaticErrors | None = None
    ballbar_axes: BallbarAxes | None = None
    base_tilt: BaseTilt | None = None
    plate_length: PlateLength | None = None
    joint_noise: JointNoise | None = None
    outliers: Outliers | None = None


class EncoderSettings(Strict):
    """Ball-bar encoders. Their zeros are wherever power-up left them: always drawn."""

    fitted: tuple[EncoderNumber, ...] = Field(
        (1, 2, 3, 4, 5), description="Joints with an encoder; [] for a sensor-less bar."
    )
    bits: Annotated[int, Field(ge=8, le=13)] = Field(
        12, description="Interpolation of one line (EL5021 8001:11)."
    )
    noise_sigma_rad: Annotated[float, Field(ge=0.0)] = Field(
        0.0, description="White, before quantisation."
    )
    directions: Literal["declared", "unknown"] = Field(
        "declared",
        description="Senses of rotation are drawn; recording.yaml says which, or says +1 for all.",
    )

    @model_validator(mode="after")
    def _distinct(self) -> EncoderSettings:
        if list(self.fitted) != sorted(set(self.fitted)):
            raise ValueError("fitted encoders must be distinct and in increasing order")
        return self


class ClockSettings(Strict):
    """The two clocks: t_robot = offset + (1 + skew) * t_bar, both from the first row of their log."""

    offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = Field(
        0.0, description="Robot time at the first ball-bar row."
    )
    skew: Annotated[float, Field(ge=-2e-3, le=2e-3)] = Field(
        0.0,
        description="Seconds the robot's clock gains in each of the ball-bar's: 30 ppm is 3.0e-5.",
    )
    overrun_probability: Annotated[float, Field(ge=0.0, lt=0.5)] = Field(
        0.0, description="Chance that a ball-bar row comes one 5 ms task late."
    )
    wander: ClockWander | None = None
    step: ClockStep | None = None
    quantum: StampQuantum | None = None
    jitter: StampJitter | None = None
    dropped_rows: DroppedRows | None = None
    duplicated_rows: DuplicatedRows | None = None
    restart: LoggerRestart | None = None

    def fault_times(self) -> Iterator[tuple[tuple[str, ...], float]]:
        """Place in the scenario and time of every fault that happens at a stated time."""
        if self.step:
            yield ("clocks", "step", "at_s"), self.step.at_s
        if self.restart:
            yield ("clocks", "restart", "at_s"), self.restart.at_s
            yield ("clocks", "restart", "gap_s"), self.restart.at_s + self.restart.gap_s


class SimulationSettings(Strict):
    """Everything that makes a recording."""

    cell: CellSettings
    path: PathSettings
    plant: PlantSettings = PlantSettings()
    errors: ErrorSettings = ErrorSettings()
    encoders: EncoderSettings = EncoderSettings()
    clocks: ClockSettings = ClockSettings()
    logs: LoadLogs = LoadLogs()
    seed: Annotated[int, Field(ge=0)] = Field(
        0, description="Of every drawn value; each error source draws from its own stream."
    )

    @model_validator(mode="after")
    def _faults_happen(self) -> SimulationSettings:
        """Each fault that is stated happens: its encoder is fitted, and its time is logged."""
        first, last = LEAD, self.path.duration_s - LEAD
        for place, time in (*self.errors.fault_times(), *self.clocks.fault_times()):
            if not first < time < last:
                raise wrong_key(
                    *place,
                    message=f"t = {time:g} s is not logged; the logs run from {first:g} to {last:g} s of the path",
                )
        for place, encoder in self.errors.fault_encoders():
            if encoder not in self.encoders.fitted:
                fitted = ", ".join(map(str, self.encoders.fitted)) or "none"
                raise wrong_key(
                    *place,
                    "encoder",
                    message=f"joint {encoder} has no encoder; encoders.fitted are: {fitted}",
                )
        return self

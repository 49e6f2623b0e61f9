"""The simulated half of a scenario: what stands in the cell, how it moves, what is wrong with it, how it is logged.

Every key carries its unit. Every error source is absent by default.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

EncoderNumber = Annotated[int, Field(ge=1, le=5)]
Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Vector5 = Annotated[tuple[float, ...], Field(min_length=5, max_length=5)]
Whole5 = Annotated[tuple[int, ...], Field(min_length=5, max_length=5)]


class Strict(BaseModel):
    """Base of all schemas: unknown keys and infinities are refused, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CellSettings(Strict):
    """What stands in the cell, and where."""

    robot: str = Field(description="A file of cell/robots, or a path that ends in .yaml.")
    ballbar: str = Field(description="A file of cell/ballbars, or a path.")
    plate: str = Field("plate_250", description="A file of cell/plates, or a path.")
    ballbar_position_m: Vector3 = Field(description="Sphere centre in the robot's base frame.")


class PathSettings(Strict):
    """The reference path and its timing."""

    kind: Literal["lissajous"]
    file: str = Field(description="Path file, relative to the scenario.")
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)]
    dwell_s: Annotated[float, Field(ge=1.0)] = Field(4.0, description="Standstill at both ends and at each stop.")
    stops: Annotated[int, Field(ge=0, le=50)] = Field(2, description="Standstills between the ends.")


class LissajousFile(Strict):
    """Path file: five ball-bar angles as centre + amplitude * sin(2 pi cycles s + phase), s from 0 to 1."""

    schema_: Annotated[Literal["ballbar-path/1"], Field(alias="schema")]
    centre_deg: Vector5
    amplitude_deg: Vector5
    cycles: Whole5
    phase_deg: Vector5


class PlantSettings(Strict):
    """What turns the command into motion."""

    kind: Literal["mujoco", "kinematic"] = Field("mujoco", description="MuJoCo, or exact inverse kinematics without forces.")
    timestep_s: Annotated[float, Field(gt=0.0, le=5e-3)] = Field(1e-3, description="MuJoCo step.")
    servo: str = Field("soft", description="A gain set of the robot's file.")


class StaticErrors(Strict):
    """Deviations of the true geometry from the nominal one: a table, or drawn."""

    table: Literal["thesis_3_1"] | None = Field(None, description="Thesis Table 3.1.")
    sigma_m: Annotated[float, Field(ge=0.0)] | None = Field(None, description="Standard deviation of drawn lengths.")
    sigma_rad: Annotated[float, Field(ge=0.0)] | None = Field(None, description="Standard deviation of drawn angles.")

    @model_validator(mode="after")
    def _table_or_sigmas(self) -> StaticErrors:
        drawn = self.sigma_m is not None and self.sigma_rad is not None
        if (self.table is None) != drawn:
            raise ValueError("give either table, or both sigma_m and sigma_rad")
        return self


class JointNoise(Strict):
    """White noise of the logged robot angles."""

    sigma_rad: Annotated[float, Field(ge=0.0)] = Field(description="At the joint.")


class ErrorSettings(Strict):
    """Error sources; each absent unless named."""

    static: StaticErrors | None = None
    joint_noise: JointNoise | None = None


class EncoderSettings(Strict):
    """Ball-bar encoders. Their zeros are wherever power-up left them: always drawn."""

    fitted: tuple[EncoderNumber, ...] = Field((1, 2, 3, 4, 5), description="Joints with an encoder; [] for a sensor-less bar.")
    bits: Annotated[int, Field(ge=8, le=13)] = Field(12, description="Interpolation of one line (EL5021 8001:11).")
    noise_sigma_rad: Annotated[float, Field(ge=0.0)] = 0.0
    senses: Literal["declared", "unknown"] = Field(
        "declared", description="Senses of rotation are drawn; recording.yaml says which, or says +1 for all."
    )

    @model_validator(mode="after")
    def _distinct(self) -> EncoderSettings:
        if list(self.fitted) != sorted(set(self.fitted)):
            raise ValueError("fitted encoders must be distinct and in increasing order")
        return self


class ClockSettings(Strict):
    """The two clocks: t_robot = offset + (1 + skew) * t_bar, both from the first row of their log."""

    offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.0
    skew: Annotated[float, Field(ge=-2e-3, le=2e-3)] = 0.0
    overrun_probability: Annotated[float, Field(ge=0.0, lt=0.5)] = Field(
        0.0, description="Chance that a ball-bar row comes one 5 ms task late."
    )


class SimulationSettings(Strict):
    """Everything that makes a recording."""

    cell: CellSettings
    path: PathSettings
    plant: PlantSettings = PlantSettings()
    errors: ErrorSettings = ErrorSettings()
    encoders: EncoderSettings = EncoderSettings()
    clocks: ClockSettings = ClockSettings()
    seed: Annotated[int, Field(ge=0)] = 0

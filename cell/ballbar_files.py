"""Schemas of the files that describe ball-bars and offset plates.

Shipped ones lie in cell/instruments and cell/plates.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from ballbar.cell.description_files import (
    DHRowFile,
    ExpansionFile,
    Length,
    LinkFile,
    NotNegative5,
    metres,
)
from ballbar.cell.schema import EncoderLines, Line, NotNegative, Positive, Strict
from ballbar.cell.schema_errors import wrong_key


class BallBarLinksFile(Strict):
    """Bodies of the ball-bar with all angles zero (rod upright); com and axes in its base frame."""

    link1: LinkFile
    link2: LinkFile
    link3: LinkFile
    link4: LinkFile
    link5: LinkFile


class EncoderFile(Strict):
    """Resolution and noise of the ball-bar's encoders."""

    lines: EncoderLines
    bits: Annotated[int, Field(ge=8, le=13)]  # EL5021 object 8001:11
    noise_sigma_rad: NotNegative


class AxialStiffnessFile(Strict):
    """Stiffnesses in series along the rod of a ball-bar."""

    rod: Positive
    gimbal: Positive  # b1, b2, b3
    universal_joint: Positive  # b4, b5


class JointBacklashFile(Strict):
    """Total width of the play of a ball-bar's joints along the rod."""

    gimbal: NotNegative
    universal_joint: NotNegative


class BallBarFile(Strict):
    """Description of a ball-bar, cell/instruments/*.yaml."""

    schema_: Annotated[Literal["ballbar-bar/1"], Field(alias="schema")]
    title: Line
    dh: Annotated[tuple[DHRowFile, ...], Field(min_length=5, max_length=5)]
    length_tolerance_m: Positive = Field(description="Standard deviation of the rod's length.")
    axial_stiffness_N_per_m: AxialStiffnessFile
    axial_damping_N_s_per_m: NotNegative = Field(description="Damping along the rod.")
    joint_damping_N_m_s_per_rad: NotNegative5
    """Viscous friction of the five joints."""
    friction_torque_N_m: NotNegative = Field(description="Coulomb friction of each joint.")
    backlash_m: JointBacklashFile
    encoder: EncoderFile
    links: BallBarLinksFile
    expansion: ExpansionFile | None = Field(None, description="Thermal expansion of the rod.")

    @model_validator(mode="after")
    def _rod_has_a_length(self) -> Self:
        if self.dh[2].d_m <= 0.0:
            raise wrong_key("dh", 2, "d_m", message="expected the length of the rod, more than 0")
        return self


class PlateFile(Strict):
    """Description of an offset plate, cell/plates/*.yaml."""

    schema_: Annotated[Literal["ballbar-plate/1"], Field(alias="schema")]
    title: Line
    length_m: Annotated[float, Field(gt=0.0), AfterValidator(metres)]
    """Distance of the tool from the flange's axis, which fixes the scale."""
    length_sigma_m: Positive = Field(description="Standard deviation of length_m.")
    tool_offset_m: Length
    """Added to the flange's d: tool changer and part of the universal joint."""
    tip_stiffness_N_per_m: Positive = Field(description="Force at the tip over its deflection.")
    body: LinkFile  # com and axes in the robot's flange frame
    expansion: ExpansionFile | None = Field(None, description="Thermal expansion of length_m.")

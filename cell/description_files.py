"""Schemas of the YAML files of cell/robots, cell/ballbars and cell/plates.

Keys carry their unit; angles are in degrees, as data sheets print them. Matrices act on row vectors
(thesis App. A: `joints = motors @ T`). A ratio may be a fraction in quotes, "-5/648".
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from cell.schema import Strict
from cell.schema_errors import wrong_key

MAX_DH_LENGTH_M = 5.0  # [m] no link of an industrial robot is longer: a larger number is in mm
SMALLEST_TWIST_DEG = 7.0  # [deg] a nominal angle between 0 and 2 pi in number, but not 0, is in rad


def _ratio(value: Any) -> Any:
    """A fraction in text as its float; anything else is left to the number check."""
    if isinstance(value, str) and (parts := re.fullmatch(r"([-+]?\d{1,15})/(\d{1,15})", value)):
        if int(parts[2]) == 0:
            raise ValueError("a fraction cannot have denominator 0")
        return float(Fraction(int(parts[1]), int(parts[2])))
    return value


def _metres(value: float) -> float:
    if abs(value) > MAX_DH_LENGTH_M:
        raise ValueError(
            f"longer than {MAX_DH_LENGTH_M:g} m. Lengths are metres: for {value:g} mm write "
            f"{value / 1000:g}"
        )
    return value


def _degrees(value: float) -> float:
    if 0.0 < abs(value) < SMALLEST_TWIST_DEG:
        raise ValueError(
            f"looks like radians. Angles here are degrees: {value:g} rad is "
            f"{np.rad2deg(value):g} deg"
        )
    return value


Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Length = Annotated[float, AfterValidator(_metres)]
NominalAngle = Annotated[float, Field(ge=-360.0, le=360.0), AfterValidator(_degrees)]
Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Vector6 = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
Positive6 = Annotated[tuple[Positive, ...], Field(min_length=6, max_length=6)]
NotNegative6 = Annotated[tuple[NotNegative, ...], Field(min_length=6, max_length=6)]
NotNegative5 = Annotated[tuple[NotNegative, ...], Field(min_length=5, max_length=5)]
Ratio = Annotated[float, BeforeValidator(_ratio)]
Row6 = Annotated[tuple[Ratio, ...], Field(min_length=6, max_length=6)]
Matrix6 = Annotated[tuple[Row6, ...], Field(min_length=6, max_length=6)]


class DHRowFile(Strict):
    """One row of standard DH: `Rz(theta) Tz(d) Tx(a) Rx(alpha)`."""

    a_m: Length
    d_m: Length
    alpha_deg: NominalAngle
    theta_deg: NominalAngle


class LinkFile(Strict):
    """Mass properties of one body."""

    mass_kg: Positive
    com_m: Vector3
    inertia_kg_m2: Vector6  # xx, yy, zz, xy, xz, yz about the centre of mass

    @model_validator(mode="after")
    def _inertia_is_that_of_a_body(self) -> Self:
        xx, yy, zz, xy, xz, yz = self.inertia_kg_m2
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        values = f"principal moments {', '.join(f'{m:.4g}' for m in moments)} kg m^2"
        if moments[0] <= 0.0:
            raise wrong_key("inertia_kg_m2", message=f"{values} must all be positive")
        rounding = 1.0 + 1e-9  # a flat plate has equality
        if moments[2] > (moments[0] + moments[1]) * rounding:
            message = f"{values}: the largest exceeds the sum of the others"
            raise wrong_key("inertia_kg_m2", message=message)
        return self


class RobotLinksFile(Strict):
    """Bodies of the robot with all DH joint angles zero; com and axes in the robot base frame."""

    base: LinkFile
    link1: LinkFile
    link2: LinkFile
    link3: LinkFile
    link4: LinkFile
    link5: LinkFile
    link6: LinkFile


class ServoFile(Strict):
    """Gains of the proportional joint servos, referred to the joints."""

    kp_N_m_per_rad: Positive6
    kv_N_m_s_per_rad: NotNegative6


class FrictionFile(Strict):
    """Coulomb, static (Stribeck) and viscous friction of the gears."""

    static_N_m: NotNegative6
    coulomb_N_m: NotNegative6
    viscous_N_m_s_per_rad: NotNegative6
    stribeck_rad_per_s: Positive6


class TransmissionErrorFile(Strict):
    """Harmonic errors of the gears of some axes, over turns of their outputs and motors."""

    axes: tuple[Annotated[int, Field(ge=1, le=6)], ...]
    cycles_per_turn: tuple[Positive, ...]
    amplitude_rad: tuple[NotNegative, ...]
    input_amplitude_rad: NotNegative

    @model_validator(mode="after")
    def _one_amplitude_a_harmonic(self) -> Self:
        if len(self.amplitude_rad) != len(self.cycles_per_turn):
            raise wrong_key(
                "amplitude_rad",
                message=f"expected {len(self.cycles_per_turn)} values, one for each of "
                "cycles_per_turn",
            )
        return self


class GearsFile(Strict):
    """Elasticity, friction and ripple of the gears, at their outputs."""

    stiffness_N_m_per_rad: Positive6
    damping_N_m_s_per_rad: NotNegative6
    lost_motion_rad: NotNegative6
    friction: FrictionFile
    transmission_error: tuple[TransmissionErrorFile, ...]


class RobotFile(Strict):
    """Description of a robot, cell/robots/*.yaml."""

    schema_: Annotated[Literal["ballbar-robot/1"], Field(alias="schema")]
    title: str
    dh: Annotated[tuple[DHRowFile, ...], Field(min_length=6, max_length=6)]
    motor_to_joint: Matrix6  # joints = motors @ motor_to_joint
    controller_to_joint: Matrix6  # joints = axes @ controller_to_joint + controller_offset
    controller_offset_deg: Vector6
    axis_lower_deg: Vector6  # limits and speeds are those of the controller's axis angles
    axis_upper_deg: Vector6
    axis_speed_max_deg_per_s: Positive6
    accuracy_lower_deg: Vector6  # box of axis angles over which the TCP error is stated
    accuracy_upper_deg: Vector6
    rotor_inertia_kg_m2: NotNegative6  # motor side
    gears: GearsFile
    servo: dict[str, ServoFile]
    links: RobotLinksFile
    gravity_m_per_s2: Vector3

    @model_validator(mode="after")
    def _matrices_are_invertible(self) -> Self:
        for key in ("motor_to_joint", "controller_to_joint"):
            matrix = np.array(getattr(self, key))
            for i in range(6):
                if matrix[i, i] == 0.0:
                    raise wrong_key(key, i, i, message="the ratio of an axis to itself cannot be 0")
            if np.linalg.cond(matrix) > 1e9:  # real ones are below 100
                raise wrong_key(key, message="the matrix has no inverse: two axes are driven alike")
        return self

    @model_validator(mode="after")
    def _boxes_have_lower_below_upper(self) -> Self:
        for i in range(6):
            low, high = self.axis_lower_deg[i], self.axis_upper_deg[i]
            first, last = self.accuracy_lower_deg[i], self.accuracy_upper_deg[i]
            if not low < high:
                message = f"expected more than the lower limit {low:g}"
                raise wrong_key("axis_upper_deg", i, message=message)
            if not low <= first <= high:
                message = f"expected a value within the axis limits {low:g} to {high:g}"
                raise wrong_key("accuracy_lower_deg", i, message=message)
            if not first < last <= high:
                message = f"expected a value above {first:g} and up to the axis limit {high:g}"
                raise wrong_key("accuracy_upper_deg", i, message=message)
        return self


class BallBarLinksFile(Strict):
    """Bodies of the ball-bar with all angles zero (rod upright); com and axes in its base frame."""

    link1: LinkFile
    link2: LinkFile
    link3: LinkFile
    link4: LinkFile
    link5: LinkFile


class EncoderFile(Strict):
    """Resolution and noise of the ball-bar's encoders."""

    lines: Annotated[int, Field(gt=0)]
    bits: Annotated[int, Field(ge=8, le=13)]  # EL5021 object 8001:11
    noise_sigma_rad: NotNegative


class BallBarFile(Strict):
    """Description of a ball-bar, cell/ballbars/*.yaml."""

    schema_: Annotated[Literal["ballbar-bar/1"], Field(alias="schema")]
    title: str
    dh: Annotated[tuple[DHRowFile, ...], Field(min_length=5, max_length=5)]
    length_tolerance_m: Positive
    axial_stiffness_N_per_m: Positive
    axial_damping_N_s_per_m: NotNegative
    joint_damping_N_m_s_per_rad: NotNegative5
    friction_torque_N_m: NotNegative  # of each joint
    backlash_m: NotNegative  # total width along the rod
    encoder: EncoderFile
    links: BallBarLinksFile

    @model_validator(mode="after")
    def _rod_has_a_length(self) -> Self:
        if self.dh[2].d_m <= 0.0:
            raise wrong_key("dh", 2, "d_m", message="expected the length of the rod, more than 0")
        return self


class PlateFile(Strict):
    """Description of an offset plate, cell/plates/*.yaml."""

    schema_: Annotated[Literal["ballbar-plate/1"], Field(alias="schema")]
    title: str
    length_m: Annotated[Length, Field(gt=0.0)]
    length_sigma_m: Positive
    tool_offset_m: Length
    tip_stiffness_N_per_m: Positive
    body: LinkFile  # com and axes in the robot's flange frame

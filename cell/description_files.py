"""Schema of the YAML files of cell/robots, and the numbers that it shares with other descriptions.

A robot needs only its DH rows, 5 to 8 of them, and the limits of its axes. Lists and matrices of
its axes have one entry for each row.

Keys carry their unit; angles are in degrees, as data sheets print them. Matrices act on row vectors
(thesis App. A: `joints = motors @ T`). A ratio may be a fraction in quotes, "-5/648".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ballbar.cell.descriptions import Expansion, ProgramLanguage
from ballbar.cell.schema import Line, NotNegative, Positive, Strict
from ballbar.cell.schema_errors import Loc, wrong_key

MAX_DH_LENGTH_M = 5.0  # [m] no link of an industrial robot is longer: a larger number is in mm
SMALLEST_TWIST_DEG = 7.0  # [deg] a nominal angle between 0 and 2 pi in number, but not 0, is in rad


def _ratio(value: Any) -> Any:
    """A fraction in text as its float; anything else is left to the number check."""
    if isinstance(value, str) and (parts := re.fullmatch(r"([-+]?\d{1,15})/(\d{1,15})", value)):
        if int(parts[2]) == 0:
            raise ValueError("a fraction cannot have denominator 0")
        return float(Fraction(int(parts[1]), int(parts[2])))
    return value


def _matrix(value: Any) -> Any:
    """None for the word; lists as tuples, since strict mode takes no list behind a validator."""
    if isinstance(value, list):
        return tuple(tuple(row) if isinstance(row, list) else row for row in value)
    return None if value == "identity" else value


def metres(value: float) -> float:
    """A length that can be one in metres. Raises ValueError for one that must be in mm."""
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


Length = Annotated[float, AfterValidator(metres)]
NominalAngle = Annotated[float, Field(ge=-360.0, le=360.0), AfterValidator(_degrees)]
Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Inertia = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
Axes = tuple[float, ...]  # one value for each axis of the robot, as all lists of these three types
PositiveAxes = tuple[Positive, ...]
NotNegativeAxes = tuple[NotNegative, ...]
NotNegative5 = Annotated[tuple[NotNegative, ...], Field(min_length=5, max_length=5)]
Ratio = Annotated[float, BeforeValidator(_ratio, json_schema_input_type=float | str)]
Matrix = tuple[tuple[Ratio, ...], ...]  # one row and one column for each axis
# None, as the word `identity`, where each axis has a row of its own in the DH model
Coupling = Annotated[
    Matrix | None,
    BeforeValidator(_matrix, json_schema_input_type=Matrix | Literal["identity"] | None),
]


class DHRowFile(Strict):
    """One row of standard DH: `Rz(theta) Tz(d) Tx(a) Rx(alpha)`."""

    a_m: Length = Field(description="Distance of the axes along x.")
    d_m: Length = Field(description="Offset along z of the axis before.")
    alpha_deg: NominalAngle = Field(description="Angle between the axes about x.")
    theta_deg: NominalAngle = Field(description="Angle about z where the joint is at zero.")


class LinkFile(Strict):
    """Mass properties of one body."""

    mass_kg: Positive
    com_m: Vector3 = Field(description="Centre of mass.")
    inertia_kg_m2: Inertia = Field(description="xx, yy, zz, xy, xz, yz about the centre of mass.")

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


class ExpansionFile(Strict):
    """Linear thermal expansion: steel 11.5e-6, aluminium 23e-6, carbon fibre about 0."""

    per_K: Annotated[float, Field(ge=-1e-5, le=1e-4)]
    sigma_per_K: Annotated[NotNegative, Field(le=1e-4)]
    """Standard uncertainty of per_K."""

    def described(self) -> Expansion:
        """The same as a description."""
        return Expansion(self.per_K, self.sigma_per_K)


class ServoFile(Strict):
    """Gains of the proportional joint servos, referred to the joints."""

    kp_N_m_per_rad: PositiveAxes
    kv_N_m_s_per_rad: NotNegativeAxes


class FrictionFile(Strict):
    """Coulomb, static (Stribeck) and viscous friction of the gears."""

    static_N_m: NotNegativeAxes
    coulomb_N_m: NotNegativeAxes
    viscous_N_m_s_per_rad: NotNegativeAxes
    stribeck_rad_per_s: PositiveAxes


class TransmissionErrorFile(Strict):
    """Harmonic errors of the gears of some axes, over turns of their outputs and motors."""

    axes: tuple[Annotated[int, Field(ge=1)], ...]
    cycles_per_turn: tuple[Positive, ...]
    amplitude_rad: tuple[NotNegative, ...]
    input_amplitude_rad: NotNegative

    @model_validator(mode="after")
    def _one_amplitude_a_harmonic(self) -> Self:
        if len(self.amplitude_rad) != len(self.cycles_per_turn):
            message = f"expected {len(self.cycles_per_turn)}, one for each of cycles_per_turn"
            raise wrong_key("amplitude_rad", message=message)
        return self


class GearsFile(Strict):
    """Elasticity, friction and ripple of the gears, at their outputs."""

    stiffness_N_m_per_rad: PositiveAxes
    damping_N_m_s_per_rad: NotNegativeAxes
    lost_motion_rad: NotNegativeAxes
    friction: FrictionFile
    transmission_error: tuple[TransmissionErrorFile, ...]


class RobotFile(Strict):
    """Description of a robot, cell/robots/*.yaml."""

    schema_: Annotated[Literal["ballbar-robot/1"], Field(alias="schema")]
    title: Line
    dh: Annotated[tuple[DHRowFile, ...], Field(min_length=5, max_length=8)]
    """One row for each joint, from the base."""
    motor_to_joint: Coupling = None
    """joints = motors @ motor_to_joint; a row for each axis, or identity."""
    controller_to_joint: Coupling = None
    """joints = axes @ controller_to_joint + controller_offset_deg."""
    controller_offset_deg: Axes | None = None
    """Joint angles where the controller shows zero; zeros by default."""
    axis_lower_deg: Axes = Field(description="Lower limits of the controller's axis angles.")
    axis_upper_deg: Axes = Field(description="Upper limits of the controller's axis angles.")
    axis_speed_max_deg_per_s: PositiveAxes | None = None
    """Top speeds of the controller's axes."""
    accuracy_lower_deg: Axes | None = None
    """Lower corner of the box of axis angles over which the TCP error is stated."""
    accuracy_upper_deg: Axes | None = Field(None, description="Upper corner of that box.")
    rotor_inertia_kg_m2: NotNegativeAxes | None = None
    """Inertia of each rotor, at the motor."""
    gears: GearsFile | None = None
    servo: dict[str, ServoFile] | None = Field(None, description="Gain sets by their names.")
    links: dict[str, LinkFile] | None = None
    """base, link1, ... with all DH joint angles zero; centre of mass and axes in the robot's base
    frame.
    """
    log_dialect: str = "abb-motor"
    """Dialect of the controller's logs, in which the simulator writes them."""
    program_language: ProgramLanguage | None = None
    """Language of the controller, in which plans write a program; without it they write none."""
    expansion: ExpansionFile | None = Field(None, description="Thermal expansion of the arm.")
    gravity_m_per_s2: Vector3 = (0.0, 0.0, -9.81)
    """In the base frame, along x, y, z; standard gravity, rounded."""

    @property
    def link_names(self) -> tuple[str, ...]:
        """Keys of `links`, in the order of the chain."""
        return ("base", *(f"link{i + 1}" for i in range(len(self.dh))))

    @property
    def accuracy_box_deg(self) -> tuple[Axes, Axes]:
        """Lower and upper limits over which the TCP error is stated.

        Without the keys, the middle 60 % of each axis range, at most 120 deg to either side.
        """
        ranges = np.array((self.axis_lower_deg, self.axis_upper_deg))
        middle, half = ranges.mean(axis=0), np.minimum(0.3 * np.ptp(ranges, axis=0), 120.0)
        return (
            self.accuracy_lower_deg or tuple((middle - half).tolist()),
            self.accuracy_upper_deg or tuple((middle + half).tolist()),
        )

    @model_validator(mode="after")
    def _lists_have_one_entry_per_axis(self) -> Self:
        rows = len(self.dh)
        for loc, values in _axis_lists(self):
            if len(values) != rows:
                message = f"found {len(values)} values, expected {rows}, one for each row of dh"
                raise wrong_key(*loc, message=message)
        for i, harmonics in enumerate(self.gears.transmission_error if self.gears else ()):
            for k, axis in enumerate(harmonics.axes):
                if axis > rows:
                    loc = ("gears", "transmission_error", i, "axes", k)
                    raise wrong_key(*loc, message=f"expected an axis from 1 to {rows}")
        if self.links is not None and set(self.links) != set(self.link_names):
            given, expected = ", ".join(self.links) or "none", ", ".join(self.link_names)
            raise wrong_key("links", message=f"found {given}; expected {expected}")
        return self

    @model_validator(mode="after")
    def _matrices_are_invertible(self) -> Self:
        for key in ("motor_to_joint", "controller_to_joint"):
            if getattr(self, key) is None:
                continue
            matrix = np.array(getattr(self, key))
            for i, ratio in enumerate(np.diag(matrix)):
                if ratio == 0.0:
                    raise wrong_key(key, i, i, message="the ratio of an axis to itself cannot be 0")
            if np.linalg.cond(matrix) > 1e9:  # real ones are below 100
                raise wrong_key(key, message="the matrix has no inverse: two axes move as one")
        return self

    @model_validator(mode="after")
    def _boxes_have_lower_below_upper(self) -> Self:
        for i, (low, high) in enumerate(zip(self.axis_lower_deg, self.axis_upper_deg, strict=True)):
            if not low < high:
                message = f"expected more than the lower limit {low:g}"
                raise wrong_key("axis_upper_deg", i, message=message)
            first, last = (limits[i] for limits in self.accuracy_box_deg)
            if not low <= first <= high:
                message = f"expected a value within the axis limits {low:g} to {high:g}"
                raise wrong_key("accuracy_lower_deg", i, message=message)
            if not first < last <= high:
                message = f"expected a value above {first:g} and up to the axis limit {high:g}"
                raise wrong_key("accuracy_upper_deg", i, message=message)
        return self


_AXIS_LISTS = {
    *("motor_to_joint", "controller_to_joint", "controller_offset_deg"),
    *("axis_lower_deg", "axis_upper_deg", "axis_speed_max_deg_per_s"),
    *("accuracy_lower_deg", "accuracy_upper_deg", "rotor_inertia_kg_m2"),
    *("stiffness_N_m_per_rad", "damping_N_m_s_per_rad", "lost_motion_rad"),
    *("static_N_m", "coulomb_N_m", "viscous_N_m_s_per_rad", "stribeck_rad_per_s"),
    *("kp_N_m_per_rad", "kv_N_m_s_per_rad"),
}


def _axis_lists(part: Any, *loc: str | int) -> Iterator[tuple[Loc, tuple[Any, ...]]]:
    """Place and value of every list below a part of the file that has one entry for each axis."""
    for key, value in part.items() if isinstance(part, dict) else part:
        place = (*loc, key)
        if isinstance(value, Strict | dict):
            yield from _axis_lists(value, *place)
        elif key in _AXIS_LISTS and value is not None:
            yield place, value
            yield from (((*place, i), v) for i, v in enumerate(value) if isinstance(v, tuple))

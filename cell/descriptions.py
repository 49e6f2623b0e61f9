"""Checked descriptions of the cell: nominal robot, ball-bar and offset plate.

SI units and float64 throughout, arrays write-protected; `dataclasses.replace` makes a changed copy.
DH rows are standard, `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`; matrices act on row vectors,
`joints = motors @ T` (thesis App. A). Descriptions are read from files by ballbar.cell.load.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, overload

import numpy as np

from ballbar.cell.arrays import (
    Array,
    Matrix3,
    MatrixJ,
    Vector3,
    Vector5,
    VectorJ,
    protect_fields,
    read_only,
)
from ballbar.cell.errors import InputError


@dataclass(frozen=True, eq=False)
class Link:
    """Mass properties of one body, in the frame that its holder states."""

    mass: float  # [kg]
    com: Vector3  # [m] centre of mass
    inertia: Matrix3  # [kg m^2] about the centre of mass

    def __post_init__(self) -> None:
        protect_fields(self)


@dataclass(frozen=True)
class Expansion:
    """Linear thermal expansion of a length."""

    per_K: float  # [1/K] coefficient
    sigma: float  # [1/K] its standard uncertainty


@dataclass(frozen=True, eq=False)
class ServoGains:
    """Gains of proportional joint servos, referred to the joints."""

    kp: VectorJ  # [N m/rad]
    kv: VectorJ  # [N m s/rad]

    def __post_init__(self) -> None:
        protect_fields(self)


@dataclass(frozen=True, eq=False)
class Gears:
    """Elasticity, backlash, friction and ripple of the gears of all axes, at their outputs.

    Gear i is driven by motor i alone.
    """

    stiffness: VectorJ  # [N m/rad]
    damping: VectorJ  # [N m s/rad]
    lost_motion: VectorJ  # [rad] catalogue figure: total width of the hysteresis
    static: VectorJ  # [N m] break-away friction
    coulomb: VectorJ  # [N m]
    viscous: VectorJ  # [N m s/rad]
    stribeck: VectorJ  # [rad/s]
    # of each gear, pairs of (cycles per turn of the output, amplitude [rad])
    harmonics: tuple[tuple[tuple[float, float], ...], ...]

    def __post_init__(self) -> None:
        protect_fields(self)


ProgramLanguage = Literal["rapid", "pdl2", "krl"]  # of the controllers of ABB, Comau and KUKA
Key = Literal["links", "servo", "gears", "rotor_inertia_kg_m2"]  # optional, of a robot's file

_KINEMATIC = "or simulate with `plant: {kind: kinematic}`"
_NEEDED_FOR: dict[Key, str] = {  # what the data are, what needs them, the remedy
    "links": "(masses): the dynamic plant, the planning of paths, the loads of gears and exported "
    "models need them. "
    f"Give mass, centre of mass and inertia of the base and of every link, {_KINEMATIC}.",
    "servo": "(gains of the joint servos): the dynamic plant and the planning of paths need them. "
    f"Give kp and kv of each axis, {_KINEMATIC}.",
    "gears": "(elasticity, friction, backlash, ripple): the dynamic plant, the errors of gears and "
    f"the planning of paths need them. Give the gears of all axes, {_KINEMATIC}.",
    "rotor_inertia_kg_m2": "(of the motors): the dynamic plant and a logged motor torque need it. "
    f"Give one value for each axis, {_KINEMATIC}, without the errors and logs of loads.",
}


@dataclass(frozen=True, eq=False)
class Robot:
    """Nominal robot of J revolute axes.

    What only some computations need is None where the robot's file does not state it; `required`
    gives it or says what is missing.
    """

    name: str  # of its file
    title: str
    a: VectorJ  # [m]
    d: VectorJ  # [m] up to the bare flange
    alpha: VectorJ  # [rad]
    theta: VectorJ  # [rad] joint offset, added to the joint angle
    transmission: MatrixJ  # joints = motors @ transmission
    controller_to_joint: MatrixJ  # joints = axes @ controller_to_joint + controller_offset
    controller_offset: VectorJ  # [rad]
    axis_lower: VectorJ  # [rad] limits of the axis angles
    axis_upper: VectorJ  # [rad]
    axis_speed_max: Array  # (J,) [rad/s] inf where the file states none
    accuracy_lower: VectorJ  # [rad] box of axis angles over which the TCP error is stated
    accuracy_upper: VectorJ  # [rad]
    gravity: Vector3  # [m/s^2] in the robot base frame
    links: tuple[Link, ...] | None = None  # base, link 1..J; robot base frame, all q = 0
    servo: Mapping[str, ServoGains] | None = None  # by name: soft, stiff
    gears: Gears | None = None
    log_dialect: str = "abb-motor"  # of its controller's logs (ballbar.cell.dialect)
    program_language: ProgramLanguage | None = None  # of its controller, where plans write programs
    armature: VectorJ | None = None  # [kg m^2] rotor inertia referred to the gear's output
    expansion: Expansion | None = None  # of the arm's lengths

    def __post_init__(self) -> None:
        protect_fields(self)
        object.__setattr__(self, "axis_speed_max", read_only(self.axis_speed_max))
        sizes = {"axis_speed_max": self.axis_speed_max.size}
        if self.links is not None:
            sizes["links without the base"] = len(self.links) - 1
        if self.gears is not None:
            sizes["gears"] = self.gears.stiffness.size
        for name, gains in (self.servo or {}).items():
            sizes[f"servo {name}"] = gains.kp.size
        for key, size in sizes.items():
            if size != self.joints:
                raise ValueError(f"robot {self.name}: {key}: {size}, expected {self.joints}")

    @property
    def joints(self) -> int:
        """J, the number of axes."""
        return int(self.a.size)

    def lacks(self, key: Key) -> bool:
        """Whether the robot's file does not state these optional data."""
        return self._optional(key) is None

    def _optional(self, key: Key) -> object:
        return self.armature if key == "rotor_inertia_kg_m2" else getattr(self, key)

    @overload
    def required(self, key: Literal["links"]) -> tuple[Link, ...]: ...
    @overload
    def required(self, key: Literal["servo"]) -> Mapping[str, ServoGains]: ...
    @overload
    def required(self, key: Literal["gears"]) -> Gears: ...
    @overload
    def required(self, key: Literal["rotor_inertia_kg_m2"]) -> Array: ...
    @overload
    def required(self, key: Key) -> object: ...
    def required(self, key: Key) -> object:
        """Optional data of the robot, by their key in its file.

        Raises InputError that names the key, what needs it and the remedy if the file lacks it.
        """
        data = self._optional(key)
        if data is None:
            raise InputError(f"robot {self.name} has no `{key}` {_NEEDED_FOR[key]}")
        return data

    @property
    def gear_to_joint(self) -> Array:
        """(J, J) matrix of unit diagonal: joints = gear outputs @ gear_to_joint.

        It holds the parallel rod and the couplings of the wrist.
        """
        return self.transmission / np.diag(self.transmission)[:, None]

    @property
    def joint_to_gear(self) -> Array:
        """(J, J) inverse of `gear_to_joint`: gear outputs = joints @ joint_to_gear."""
        return np.asarray(np.linalg.inv(self.gear_to_joint), dtype=np.float64)

    @property
    def joint_to_axis(self) -> Array:
        """(J, J) inverse of `controller_to_joint`: axes = (joints - offset) @ joint_to_axis."""
        return np.asarray(np.linalg.inv(self.controller_to_joint), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class BallBar:
    """Nominal double ball-bar with encoders: gimbal b1 b2 b3, rod, universal joint b4 b5."""

    name: str
    title: str
    a: Vector5  # [m]
    d: Vector5  # [m] d[2] is the radius of the sphere
    alpha: Vector5  # [rad]
    theta: Vector5  # [rad]
    length_tolerance: float  # [m] largest deviation of the rod from its nominal length
    rod_stiffness: float  # [N/m] along the rod
    joint_stiffness: tuple[float, float]  # [N/m] along the rod: gimbal, universal joint
    axial_damping: float  # [N s/m]
    joint_damping: Vector5  # [N m s/rad]
    friction_torque: float  # [N m] of each joint
    joint_backlash: tuple[float, float]  # [m] total widths along the rod, of the same
    encoder_lines: int  # per turn
    encoder_bits: int  # interpolation of one line
    encoder_noise_sigma: float  # [rad] white, per sample
    links: tuple[Link, ...]  # link 1..5; ball-bar base frame, all b = 0
    # [m] shortest and longest length of a rod whose length is sensed; None for a rigid one
    stroke: tuple[float, float] | None = None
    expansion: Expansion | None = None  # of the rod

    def __post_init__(self) -> None:
        protect_fields(self)
        if len(self.links) != 5:
            raise ValueError(f"ball-bar {self.name}: {len(self.links)} links, expected 5")

    @property
    def length(self) -> float:
        """[m] nominal radius of the sphere, bd3."""
        return float(self.d[2])

    @property
    def axial_stiffness(self) -> float:
        """[N/m] of rod and both joints in series; infinite without compliance."""
        compliance = sum(1.0 / k for k in (self.rod_stiffness, *self.joint_stiffness))
        return 1.0 / compliance if compliance else np.inf

    @property
    def backlash(self) -> float:
        """[m] total width along the rod: of both joints, since one force passes through them."""
        return sum(self.joint_backlash)


@dataclass(frozen=True, eq=False)
class Plate:
    """Offset plate between flange and ball-bar: the known length that fixes the scale."""

    name: str
    title: str
    length: float  # [m] along the flange's x, added to a6
    length_sigma: float  # [m]
    tool_offset: float  # [m] tool changer and universal joint along the flange's z, added to d6
    tip_stiffness: float  # [N/m] bending, at the tip
    body: Link  # robot flange frame
    expansion: Expansion | None = None
    thermal_sigma: float = 0.0  # [m] part of length_sigma by the temperature

    @property
    def mass(self) -> float:
        """[kg] mass of plate and fittings."""
        return self.body.mass


@dataclass(frozen=True, eq=False)
class Cell:
    """Everything that stands in the cell."""

    robot: Robot
    ballbar: BallBar
    plate: Plate


def same_contents(first: object, second: object) -> bool:
    """Whether two descriptions, or parts of them, agree in every name and digit."""
    with np.printoptions(floatmode="unique", threshold=sys.maxsize):
        return repr(first) == repr(second)

"""What stands in the cell: nominal robot, ball-bar and offset plate, as checked descriptions.

SI units and float64 throughout, arrays write-protected; `dataclasses.replace` makes a changed copy.
DH rows are standard, `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`; matrices act on row vectors,
`joints = motors @ T` (thesis App. A). Descriptions are read from files by cell.load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array, Matrix3, Matrix6, Vector3, Vector5, Vector6, protect_fields


@dataclass(frozen=True, eq=False)
class Link:
    """Mass properties of one body, in the frame that its holder states."""

    mass: float  # [kg]
    com: Vector3  # [m] centre of mass
    inertia: Matrix3  # [kg m^2] about the centre of mass

    def __post_init__(self) -> None:
        protect_fields(self)


@dataclass(frozen=True, eq=False)
class ServoGains:
    """Gains of proportional joint servos, referred to the joints."""

    kp: Vector6  # [N m/rad]
    kv: Vector6  # [N m s/rad]

    def __post_init__(self) -> None:
        protect_fields(self)


@dataclass(frozen=True, eq=False)
class Gears:
    """Elasticity, backlash, friction and ripple of the six gears, at their outputs.

    Gear i is driven by motor i alone.
    """

    stiffness: Vector6  # [N m/rad]
    damping: Vector6  # [N m s/rad]
    lost_motion: Vector6  # [rad] catalogue figure: total width of the hysteresis
    static: Vector6  # [N m] break-away friction
    coulomb: Vector6  # [N m]
    viscous: Vector6  # [N m s/rad]
    stribeck: Vector6  # [rad/s]
    # of each gear, pairs of (cycles per turn of the output, amplitude [rad])
    harmonics: tuple[tuple[tuple[float, float], ...], ...]

    def __post_init__(self) -> None:
        protect_fields(self)


@dataclass(frozen=True, eq=False)
class Robot:
    """Nominal six-axis robot."""

    name: str  # of its file
    title: str
    a: Vector6  # [m]
    d: Vector6  # [m] up to the bare flange
    alpha: Vector6  # [rad]
    theta: Vector6  # [rad] joint offset, added to the joint angle
    transmission: Matrix6  # joints = motors @ transmission
    controller_to_joint: Matrix6  # joints = axes @ controller_to_joint + controller_offset
    controller_offset: Vector6  # [rad]
    axis_lower: Vector6  # [rad] limits of the axis angles
    axis_upper: Vector6  # [rad]
    axis_speed_max: Vector6  # [rad/s]
    accuracy_lower: Vector6  # [rad] box of axis angles over which the TCP error is stated
    accuracy_upper: Vector6  # [rad]
    links: tuple[Link, ...]  # base, link 1..6; robot base frame, all q = 0
    servo: Mapping[str, ServoGains]  # by name: soft, stiff
    gears: Gears
    armature: Vector6  # [kg m^2] rotor inertia referred to the gear's output
    gravity: Vector3  # [m/s^2] in the robot base frame

    def __post_init__(self) -> None:
        protect_fields(self)
        if len(self.links) != 7:
            raise ValueError(
                f"robot {self.name}: {len(self.links)} links, expected base and link 1 to 6"
            )

    @property
    def gear_to_joint(self) -> Array:
        """(6, 6) matrix of unit diagonal: joints = gear outputs @ gear_to_joint.

        It holds the parallel rod and the couplings of the wrist.
        """
        return self.transmission / np.diag(self.transmission)[:, None]

    @property
    def joint_to_gear(self) -> Array:
        """(6, 6) inverse of `gear_to_joint`: gear outputs = joints @ joint_to_gear."""
        return np.asarray(np.linalg.inv(self.gear_to_joint), dtype=np.float64)

    @property
    def joint_to_axis(self) -> Array:
        """(6, 6) inverse of `controller_to_joint`: axes = (joints - offset) @ joint_to_axis."""
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
    axial_stiffness: float  # [N/m] rod and all joints in series
    axial_damping: float  # [N s/m]
    joint_damping: Vector5  # [N m s/rad]
    friction_torque: float  # [N m] of each joint
    backlash: float  # [m] total width along the rod
    encoder_lines: int  # per turn
    encoder_bits: int  # interpolation of one line
    encoder_noise_sigma: float  # [rad] white, per sample
    links: tuple[Link, ...]  # link 1..5; ball-bar base frame, all b = 0

    def __post_init__(self) -> None:
        protect_fields(self)
        if len(self.links) != 5:
            raise ValueError(f"ball-bar {self.name}: {len(self.links)} links, expected 5")

    @property
    def length(self) -> float:
        """[m] nominal radius of the sphere, bd3."""
        return float(self.d[2])


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

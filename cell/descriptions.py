"""What stands in the cell: robot, ball-bar and offset plate, as checked descriptions with nominal values.

SI units and float64 throughout, arrays write-protected; `dataclasses.replace` makes a changed copy. DH rows are standard,
`Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`; matrices act on row vectors, `joints = motors @ T` (thesis App. A).

Three sets of robot angles: motor angles; axis angles, which the controller shows, logs and limits; joint angles q, of the
DH model. With a parallel rod, axis 3 is the forearm's angle against the horizontal, while q3 is its angle against the upper arm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cell.description_files import BallBarFile, DHRowFile, GearsFile, LinkFile, PlateFile, RobotFile
from cell.errors import DescriptionError
from cell.schema_errors import nearest
from cell.strict_yaml import load_model

Array = NDArray[np.float64]

_BLOCK = 4096  # rows of angles multiplied at a time
_FOLDER = Path(__file__).parent


@dataclass(frozen=True, eq=False)
class Link:
    """Mass properties of one body; frame as stated where it is held."""

    mass: float  # [kg]
    com: Array  # (3,) [m] centre of mass
    inertia: Array  # (3, 3) [kg m^2] about the centre of mass

    def __post_init__(self) -> None:
        _protect(self, com=(3,), inertia=(3, 3))


@dataclass(frozen=True, eq=False)
class ServoGains:
    """Gains of proportional joint servos, at the joints."""

    kp: Array  # (6,) [N m/rad]
    kv: Array  # (6,) [N m s/rad]

    def __post_init__(self) -> None:
        _protect(self, kp=(6,), kv=(6,))


@dataclass(frozen=True, eq=False)
class Gears:
    """What the gears of a robot do beyond turning, at their output. Gear i is driven by motor i alone."""

    stiffness: Array  # (6,) [N m/rad]
    damping: Array  # (6,) [N m s/rad]
    lost_motion: Array  # (6,) [rad] total width
    static: Array  # (6,) [N m] break-away friction
    coulomb: Array  # (6,) [N m]
    viscous: Array  # (6,) [N m s/rad]
    stribeck: Array  # (6,) [rad/s]
    harmonics: tuple[
        tuple[tuple[float, float], ...], ...
    ]  # per gear: (cycles a turn of the output, amplitude [rad])

    def __post_init__(self) -> None:
        six = "stiffness damping lost_motion static coulomb viscous stribeck"
        _protect(self, **dict.fromkeys(six.split(), (6,)))


@dataclass(frozen=True, eq=False)
class Robot:
    """A six-axis robot, nominal."""

    name: str  # of its file
    title: str
    a: Array  # (6,) [m]
    d: Array  # (6,) [m] up to the bare flange
    alpha: Array  # (6,) [rad]
    theta: Array  # (6,) [rad] offset added to the joint angle
    transmission: Array  # (6, 6) joints = motors @ transmission
    controller_to_joint: Array  # (6, 6) joints = axes @ controller_to_joint + controller_offset
    controller_offset: Array  # (6,) [rad]
    axis_lower: Array  # (6,) [rad] limits of the axis angles
    axis_upper: Array  # (6,) [rad]
    axis_speed_max: Array  # (6,) [rad/s]
    accuracy_lower: Array  # (6,) [rad] box of axis angles over which the TCP error is stated
    accuracy_upper: Array  # (6,) [rad]
    links: tuple[Link, ...]  # base, link 1..6; robot base frame, all q = 0
    servo: Mapping[str, ServoGains]  # by name: soft, stiff
    gears: Gears
    armature: Array  # (6,) [kg m^2] rotor inertia seen at the gear's output
    gravity: Array  # (3,) [m/s^2] in the robot base frame

    def __post_init__(self) -> None:
        six = "a d alpha theta controller_offset axis_lower axis_upper axis_speed_max accuracy_lower accuracy_upper armature"
        _protect(
            self,
            **dict.fromkeys(six.split(), (6,)),
            transmission=(6, 6),
            controller_to_joint=(6, 6),
            gravity=(3,),
        )
        if len(self.links) != 7:
            raise ValueError(
                f"robot {self.name}: {len(self.links)} links, expected base and link 1 to 6"
            )

    @property
    def gear_to_joint(self) -> Array:
        """(6, 6) joints = gear outputs @ gear_to_joint: parallel rod and wrist couplings, unit diagonal."""
        return self.transmission / np.diag(self.transmission)[:, None]

    @property
    def joint_to_gear(self) -> Array:
        """(6, 6) gear outputs = joints @ joint_to_gear, inverse of `gear_to_joint`."""
        return np.asarray(np.linalg.inv(self.gear_to_joint), dtype=np.float64)

    @property
    def joint_to_axis(self) -> Array:
        """(6, 6) inverse of `controller_to_joint`: axes = (joints - controller_offset) @ joint_to_axis."""
        return _inverse(self.controller_to_joint)


@dataclass(frozen=True, eq=False)
class BallBar:
    """A double ball-bar with encoders, nominal: gimbal b1 b2 b3, rod, cardan b4 b5."""

    name: str
    title: str
    a: Array  # (5,) [m]
    d: Array  # (5,) [m] d[2] is the sphere's radius
    alpha: Array  # (5,) [rad]
    theta: Array  # (5,) [rad]
    length_tolerance: float  # [m] how far the rod may be from its nominal length
    axial_stiffness: float  # [N/m] rod and all joints in series
    axial_damping: float  # [N s/m]
    joint_damping: Array  # (5,) [N m s/rad]
    friction_torque: float  # [N m] of each joint
    backlash: float  # [m] total width along the rod
    encoder_lines: int  # per turn
    encoder_bits: int  # interpolation of one line
    encoder_noise_sigma: float  # [rad] white, per sample
    links: tuple[Link, ...]  # link 1..5; ball-bar base frame, all b = 0

    def __post_init__(self) -> None:
        _protect(self, a=(5,), d=(5,), alpha=(5,), theta=(5,), joint_damping=(5,))
        if len(self.links) != 5:
            raise ValueError(f"ball-bar {self.name}: {len(self.links)} links, expected 5")

    @property
    def length(self) -> float:
        """[m] nominal radius of the sphere, bd3."""
        return float(self.d[2])


@dataclass(frozen=True, eq=False)
class Plate:
    """The offset plate between flange and ball-bar: the known length that fixes the scale."""

    name: str
    title: str
    length: float  # [m] along the flange's x, added to a6
    length_sigma: float  # [m]
    tool_offset: float  # [m] tool changer and cardan part along the flange's z, added to d6
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


def load_cell(robot: str, ballbar: str, plate: str, *, relative_to: Path | None = None) -> Cell:
    """The cell made of three descriptions; each a shipped name or a path as in `load_robot`."""
    return Cell(
        load_robot(robot, relative_to=relative_to),
        load_ballbar(ballbar, relative_to=relative_to),
        load_plate(plate, relative_to=relative_to),
    )


def load_robot(name_or_path: str, *, relative_to: Path | None = None) -> Robot:
    """A robot by its shipped name, or from a file.

    name_or_path : `irb2400`, or a path that ends in `.yaml`, taken from the folder `relative_to`.

    Raises DescriptionError if there is no such robot or its file is wrong.
    """
    path = _find(name_or_path, "robots", relative_to)
    file = load_model(path, RobotFile)
    transmission = np.array(file.motor_to_joint)
    links = file.links
    bodies = (
        links.base,
        links.link1,
        links.link2,
        links.link3,
        links.link4,
        links.link5,
        links.link6,
    )
    return Robot(
        name=path.stem,
        title=file.title,
        **_dh_columns(file.dh),
        transmission=transmission,
        controller_to_joint=np.array(file.controller_to_joint),
        controller_offset=np.deg2rad(file.controller_offset_deg),
        axis_lower=np.deg2rad(file.axis_lower_deg),
        axis_upper=np.deg2rad(file.axis_upper_deg),
        axis_speed_max=np.deg2rad(file.axis_speed_max_deg_per_s),
        accuracy_lower=np.deg2rad(file.accuracy_lower_deg),
        accuracy_upper=np.deg2rad(file.accuracy_upper_deg),
        links=tuple(_link(body) for body in bodies),
        servo={
            key: ServoGains(np.array(s.kp_N_m_per_rad), np.array(s.kv_N_m_s_per_rad))
            for key, s in file.servo.items()
        },
        gears=_gears(file.gears, 1.0 / np.abs(np.diag(transmission))),
        armature=np.array(file.rotor_inertia_kg_m2) / np.diag(transmission) ** 2,
        gravity=np.array(file.gravity_m_per_s2),
    )


def load_ballbar(name_or_path: str, *, relative_to: Path | None = None) -> BallBar:
    """A ball-bar by its shipped name (`lund_600`), or from a file, as in `load_robot`."""
    path = _find(name_or_path, "ballbars", relative_to)
    file = load_model(path, BallBarFile)
    links = file.links
    return BallBar(
        name=path.stem,
        title=file.title,
        **_dh_columns(file.dh),
        length_tolerance=file.length_tolerance_m,
        axial_stiffness=file.axial_stiffness_N_per_m,
        axial_damping=file.axial_damping_N_s_per_m,
        joint_damping=np.array(file.joint_damping_N_m_s_per_rad),
        friction_torque=file.friction_torque_N_m,
        backlash=file.backlash_m,
        encoder_lines=file.encoder.lines,
        encoder_bits=file.encoder.bits,
        encoder_noise_sigma=file.encoder.noise_sigma_rad,
        links=tuple(
            _link(body)
            for body in (links.link1, links.link2, links.link3, links.link4, links.link5)
        ),
    )


def load_plate(name_or_path: str, *, relative_to: Path | None = None) -> Plate:
    """An offset plate by its shipped name (`plate_250`), or from a file, as in `load_robot`."""
    path = _find(name_or_path, "plates", relative_to)
    file = load_model(path, PlateFile)
    return Plate(
        name=path.stem,
        title=file.title,
        length=file.length_m,
        length_sigma=file.length_sigma_m,
        tool_offset=file.tool_offset_m,
        tip_stiffness=file.tip_stiffness_N_per_m,
        body=_link(file.body),
    )


def robot_names() -> list[str]:
    """Names of the shipped robots."""
    return _names("robots")


def ballbar_names() -> list[str]:
    """Names of the shipped ball-bars."""
    return _names("ballbars")


def plate_names() -> list[str]:
    """Names of the shipped offset plates."""
    return _names("plates")


def motors_to_joints(robot: Robot, motors: ArrayLike) -> Array:
    """Joint angles (N, 6) [rad] of motor angles (N, 6) [rad]; also for one sample (6,), and for speeds."""
    return _times(_rows(motors), robot.transmission)


def joints_to_motors(robot: Robot, joints: ArrayLike) -> Array:
    """Motor angles (N, 6) [rad] of joint angles (N, 6) [rad]; inverse of `motors_to_joints`."""
    return _times(_rows(joints), _inverse(robot.transmission))


def controller_to_joints(robot: Robot, axes: ArrayLike) -> Array:
    """Joint angles (N, 6) [rad] of the controller's axis angles (N, 6) [rad]; also for one sample (6,)."""
    return _times(_rows(axes), robot.controller_to_joint) + robot.controller_offset


def joints_to_axes(robot: Robot, joints: ArrayLike) -> Array:
    """The controller's axis angles (N, 6) [rad], to which the limits apply; inverse of `controller_to_joints`.

    Angles, not speeds: those have no offset, `speeds @ robot.joint_to_axis`.
    """
    axes = _times(_rows(joints), robot.joint_to_axis)
    axes -= robot.controller_offset @ robot.joint_to_axis
    return axes


def _rows(angles: ArrayLike) -> Array:
    rows = np.asarray(angles, dtype=np.float64)
    if rows.ndim == 0 or rows.shape[-1] != 6:
        raise ValueError(f"angles have shape {rows.shape}, expected (N, 6) or (6,)")
    return rows


def _times(rows: Array, matrix: Array) -> Array:
    """rows @ matrix, a block at a time: BLAS spreads larger ones over threads that wait longer than they work."""
    if rows.ndim == 1 or len(rows) <= _BLOCK:
        return np.asarray(rows @ matrix)
    out = np.empty_like(rows)  # column by column where the rows are
    for begin in range(0, len(rows), _BLOCK):
        np.matmul(rows[begin : begin + _BLOCK], matrix, out=out[begin : begin + _BLOCK])
    return out


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _names(kind: str) -> list[str]:
    return sorted(path.stem for path in (_FOLDER / kind).glob("*.yaml"))


def _find(name_or_path: str, kind: str, relative_to: Path | None) -> Path:
    if name_or_path.endswith(".yaml"):
        return (relative_to or Path()) / name_or_path
    names = _names(kind)
    if name_or_path in names:
        return _FOLDER / kind / f"{name_or_path}.yaml"
    kind_name = kind.removesuffix("s")
    raise DescriptionError(
        f"unknown {kind_name} {name_or_path!r}.{nearest(name_or_path, names, noun='name')} A file of your own ends in .yaml."
    )


def _dh_columns(rows: Iterable[DHRowFile]) -> dict[str, Any]:
    a, d, alpha, theta = np.array([(r.a_m, r.d_m, r.alpha_deg, r.theta_deg) for r in rows]).T
    return {"a": a, "d": d, "alpha": np.deg2rad(alpha), "theta": np.deg2rad(theta)}


def _gears(file: GearsFile, ratio: Array) -> Gears:
    harmonics: list[tuple[tuple[float, float], ...]] = [()] * 6
    for group in file.transmission_error:
        for axis in group.axes:
            turns = (*group.cycles_per_turn, float(ratio[axis - 1]))
            harmonics[axis - 1] += tuple(
                zip(turns, (*group.amplitude_rad, group.input_amplitude_rad), strict=True)
            )
    friction = file.friction
    return Gears(
        stiffness=np.array(file.stiffness_N_m_per_rad),
        damping=np.array(file.damping_N_m_s_per_rad),
        lost_motion=np.array(file.lost_motion_rad),
        static=np.array(friction.static_N_m),
        coulomb=np.array(friction.coulomb_N_m),
        viscous=np.array(friction.viscous_N_m_s_per_rad),
        stribeck=np.array(friction.stribeck_rad_per_s),
        harmonics=tuple(harmonics),
    )


def _link(file: LinkFile) -> Link:
    xx, yy, zz, xy, xz, yz = file.inertia_kg_m2
    return Link(
        file.mass_kg, np.array(file.com_m), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    )


def _protect(description: object, **shapes: tuple[int, ...]) -> None:
    """Replaces each named field by a write-protected float64 copy of the stated shape; ValueError if it does not fit."""
    for name, shape in shapes.items():
        values = np.array(getattr(description, name), dtype=np.float64)
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(
                f"{type(description).__name__}.{name}: expected finite numbers of shape {shape}, got shape {values.shape}"
            )
        values.flags.writeable = False
        object.__setattr__(description, name, values)

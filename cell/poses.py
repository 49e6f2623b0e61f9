"""Poses: joint angles of the robot, and what an instrument measured there.

A table of still poses has no clock. Of a robot that moved while the instrument followed its target,
the joint angles are a function of time, and the instrument has a clock of its own. Groups are what
one placement of the instrument (seat) measured of one ball or reflector on the flange (target);
seats and targets may occur in several groups.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array, read_only
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Robot
from ballbar.cell.instruments import kind_named
from ballbar.cell.instruments.base import Kind

Measured = str  # name of a kind of instrument


class JointMotion(Protocol):
    """Motion of the robot's joints while an instrument followed its target
    (ballbar.ident.signals.motion).

    Times (N,) [s] are those of the robot's clock, angles those of the DH convention.
    """

    @property
    def name(self) -> str:
        """Whose clock it is: that of the recording."""

    @property
    def clock(self) -> Clock:
        """The instrument's clock against the robot's, about."""

    def angles(self, at: Array) -> Array:
        """(N, J) [rad]"""

    def speed(self, at: Array) -> Array:
        """(N, J) [rad/s]"""

    def arm(self, at: Array) -> tuple[Array, Array]:
        """Speed (N, J) [rad/s] and acceleration (N, J) [rad/s^2] of the arm as a rigid body."""

    def carried(self, at: Array) -> Array | None:
        """(J + 6, N) [N m] loads of the gears, and of the first three bearings about x and y.

        None where nothing holds the tool: they follow from the robot's masses alone.
        """

    def within(self, at: Array) -> Array:
        """The times, kept inside the robot's log."""

    def noise(self, spacing: float) -> tuple[Array, float]:
        """Standard deviation of the angles (J,) [rad] and of the stamps [s] of rows `spacing` [s]
        apart, as if they were independent.
        """

    def by(self, clock: Clock) -> JointMotion:
        """The motion with another clock of the instrument."""


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """Errors of an instrument that displace everything that it measured.

    Such as a camera's lens and its board: U values with a full covariance, `root @ root.T`. A fit
    has U unknowns of unit variance in their place, which `root` turns into errors of the values.
    """

    name: str  # of the instrument
    names: tuple[str, ...]  # of the values
    values: Array  # (U,)
    root: Array  # (U, U)
    noise: float  # of its readings, in their unit, as they show it; of a camera [px]
    declared: Array  # (U, 2) value and standard deviation before anything was measured
    doubts: tuple[str, ...] = ()  # sentences on what its readings contradict


@dataclass(frozen=True, eq=False)
class PoseGroup:
    """N poses of one target, measured from one seat of the instrument.

    The values are [m] and, of a pose, a rotation vector [rad], in the frame of the seat. Those of a
    socket are empty: the target stood at the seat's own point.
    """

    measured: str  # name of the kind of instrument
    seat: str
    target: str
    q: Array  # (N, J) [rad] DH joint angles
    values: Array  # (N, M) [m, rad], M as the kind's `columns`
    sigma: Array  # (N, M) [m, rad] declared standard deviation; (N, 3) [m] of a socket's play
    rows: NDArray[np.intp]  # (N,) line of each pose in its file, from 1
    file: str  # that file's name
    # (N,) [s] since the table's first pose; of a robot that moved on the instrument's clock
    time: Array | None = None
    temperature: Array | None = None  # (N,) [deg C]
    motion: JointMotion | None = None  # None: the robot stood still; else `q` is by its clock
    # (N, M, M) lower factor of the correlation of the values' errors; None: they are independent
    factor: Array | None = None
    common: CommonErrors | None = None
    # (N, M, U) change of the values per unit of each unknown of `common`; turns about seat axes
    by_common: Array | None = None
    # (N, J) flanks of the gears' backlash, -1 to 1, where the poses tell; None: friction and weight
    flanks: Array | None = None

    def __post_init__(self) -> None:
        for f in fields(self):
            values = getattr(self, f.name)
            if isinstance(values, np.ndarray):
                object.__setattr__(self, f.name, read_only(values, values.dtype.type))
        if self.values.shape != (len(self.q), self.kind.columns):
            raise ValueError(f"{self.measured}: values of shape {self.values.shape}")

    @property
    def size(self) -> int:
        return len(self.q)

    def with_common(self, unknowns: Array) -> Array:
        """(N, M) values for the unknowns (U,) of `common`."""
        if self.by_common is None or not unknowns.any():
            return self.values
        shift = self.by_common @ unknowns
        if self.values.shape[1] == 3:
            return self.values + shift[:, :3]
        rotation = Rotation.from_rotvec(self.values[:, 3:].copy())
        turned = Rotation.from_rotvec(shift[:, 3:]) * rotation
        return np.hstack((self.values[:, :3] + shift[:, :3], turned.as_rotvec()))

    @property
    def kind(self) -> Kind:
        """The kind of instrument that measured."""
        return kind_named(self.measured)

    @property
    def seat_fixed(self) -> bool:
        """Whether the seat is known as well as positions are, so that these may refer to it."""
        return self.kind.seat_fixed and self.common is None

    def by(self, clock: Clock) -> PoseGroup:
        """The poses of a robot that moved, by another clock of the instrument."""
        assert self.motion is not None  # the caller's condition
        q = self.q + self.motion.angles(self.at(clock)) - self.motion.angles(self.at())
        return replace(self, q=q, motion=self.motion.by(clock))

    def at(self, clock: Clock | None = None) -> Array:
        """(N,) [s] robot time of the poses of a robot that moved, kept inside its log.

        clock : of the instrument; that of `q` where it is not given.
        """
        assert self.motion is not None  # the caller's condition
        assert self.time is not None
        return self.motion.within((clock or self.motion.clock).robot_time(self.time))

    def part(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> PoseGroup:
        """The group of some of its poses."""
        arrays = {
            f.name: getattr(self, f.name)[chosen]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **arrays)


@dataclass(frozen=True)
class KnownDistance:
    """Distance between two seats that something else tells, such as the drawing of a fixture."""

    seats: tuple[str, str]
    length: float  # [m]
    sigma: float  # [m]


@dataclass(frozen=True, eq=False)
class PoseTable:
    """The poses of one robot."""

    name: str
    robot: Robot
    groups: tuple[PoseGroup, ...]
    distances: tuple[KnownDistance, ...] = ()

    @property
    def size(self) -> int:
        """Poses of all groups."""
        return sum(group.size for group in self.groups)

    @property
    def q(self) -> Array:
        """(N, J) [rad] DH joint angles of all poses, group after group."""
        return np.concatenate([group.q for group in self.groups])

    @property
    def seats(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(group.seat for group in self.groups))

    @property
    def targets(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(group.target for group in self.groups))

    @property
    def what(self) -> str:
        """Name of such poses, in the plural."""
        kinds = {group.motion is None for group in self.groups}
        return "poses" if len(kinds) > 1 else "still poses" if kinds == {True} else "followed poses"

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(N,) whether the robot moved at each pose."""
        return np.concatenate([np.full(g.size, g.motion is not None) for g in self.groups])

    def part(self, chosen: NDArray[np.bool_]) -> PoseTable:
        """The table of some of its poses; chosen : (N,) over all groups in their order."""
        ends = np.cumsum([group.size for group in self.groups])[:-1]
        parts = zip(self.groups, np.split(chosen, ends), strict=True)
        groups = tuple(group.part(own) for group, own in parts if own.any())
        return replace(self, groups=groups)

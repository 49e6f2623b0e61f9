"""Still poses: joint angles at which the robot stood, and what an instrument measured there.

A table of poses has no clock. Its groups are what one placement of the instrument (seat) measured
of one ball or reflector on the flange (target); seats and targets may occur in several groups.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array, read_only
from cell.descriptions import Robot
from cell.instruments import kind_named
from cell.instruments.base import Kind

Measured = str  # name of a kind of instrument


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
    time: Array | None = None  # (N,) [s] since the table's first pose
    temperature: Array | None = None  # (N,) [deg C]

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

    @property
    def kind(self) -> Kind:
        """The kind of instrument that measured."""
        return kind_named(self.measured)

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
    """The still poses of one robot."""

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

    def part(self, chosen: NDArray[np.bool_]) -> PoseTable:
        """The table of some of its poses; chosen : (N,) over all groups in their order."""
        ends = np.cumsum([group.size for group in self.groups])[:-1]
        parts = zip(self.groups, np.split(chosen, ends), strict=True)
        groups = tuple(group.part(own) for group, own in parts if own.any())
        return replace(self, groups=groups)

"""How an instrument measures a target: the behaviour that every kind of instrument has.

Each kind is one module of this folder, found by its name, and one or more descriptions
(cell/instruments/*.yaml). It says where the target is by its values, how that point moves with each
value, and whether the target's orientation is sensed. Everything else follows: directions in which
the point does not move with any value are free, and so are the turns of a target whose orientation
is not sensed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.board import Board
from ballbar.cell.camera import Camera
from ballbar.cell.chain import cross
from ballbar.cell.descriptions import Expansion
from ballbar.cell.placement import Placement
from ballbar.cell.rotation import matrix_from_rotvec

_MARGIN = 0.02  # of a picture, at its edges, where no corner shall be
_SMALLEST = 0.15  # of a picture's width, that a board shall be wide


@dataclass(frozen=True, eq=False)
class Sight:
    """Where an instrument has N targets, robot base frame.

    Components that it does not measure are set to those of the predicted target.
    """

    point: Array  # (3, N) [m]
    per_value: Array  # (D, 3, N) change of the point per unit of each value
    rotation: Array | None = None  # (3, 3, N) orientation of the target; None where not sensed

    @property
    def directions(self) -> Array:
        """(D, 3, N) unit vectors along which the point is sensed, perpendicular to each other."""
        return np.asarray(self.per_value / self._size[:, None])

    def position_sigma(self, sigma: Array) -> Array:
        """(N, D) [m] standard deviation of the point along each direction.

        sigma : (N, K) [m, rad] of the values, those of the point first.
        """
        return np.asarray(self._size.T * sigma[:, : len(self.per_value)])

    @property
    def _size(self) -> Array:
        """(D, N) how far the point moves per unit of each value."""
        size = np.linalg.norm(self.per_value, axis=1)
        return np.asarray(np.maximum(size, np.finfo(float).tiny))

    @property
    def free(self) -> Array:
        """(m, 6, N) shifts [m] and turns [rad] of the target that no value shows."""
        sensed = self.directions
        count, _, n = sensed.shape
        shifts = np.zeros((3 - count, 3, n))
        if count == 1:
            shifts[0], shifts[1] = across(sensed[0])
        elif count == 2:
            shifts[0] = cross(sensed[0], sensed[1])
        turns = np.repeat(np.eye(3)[:, :, None], n, axis=2) if self.rotation is None else None
        parts = [np.concatenate((shifts, np.zeros_like(shifts)), axis=1)]
        if turns is not None:
            parts.append(np.concatenate((np.zeros_like(turns), turns), axis=1))
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class TrueStand:
    """N targets as they truly stand, in the frame of the seat."""

    rod: Array  # (3, N) [m] from the seat to the target
    distance: Array  # (N,) [m] length of the rod
    rotation: Array  # (3, 3, N) orientation of the target


@dataclass(frozen=True, eq=False)
class View:
    """A flat board that a camera sees, and from which side of it."""

    board: Board
    carried: bool  # whether the camera is on the flange, and the board in the cell
    tilt: float = np.deg2rad(60.0)  # [rad] largest angle between line of sight and normal

    def corners(self, stand: TrueStand, points: Array) -> Array:
        """(N, C, 3) [m] points (C, 3) of the board in the frame of the camera."""
        turn, shift = stand.rotation.transpose(2, 0, 1), stand.rod.T[:, None]
        if self.carried:
            return np.asarray((points - shift) @ turn)
        return np.asarray(points @ turn.transpose(0, 2, 1) + shift)

    def seen(self, camera: Camera, stand: TrueStand) -> NDArray[np.bool_]:
        """(N,) whether a picture has the whole board, not tilted too far, nor too small to find."""
        flat = np.column_stack((self.board.points, np.zeros(len(self.board.points))))
        points = self.corners(stand, flat)
        pixels = camera.lens.image(points)[0]
        size, margin = np.array(camera.image) - 1.0, _MARGIN * np.array(camera.image)
        inside = ((pixels > margin) & (pixels < size - margin)).all(axis=(1, 2))
        middle = points.mean(axis=1)
        normal = stand.rotation[2] if self.carried else stand.rotation[:, 2]
        facing = np.einsum("ni,in->n", middle, normal) / np.linalg.norm(middle, axis=1)
        large = np.ptp(pixels, axis=1).max(axis=1) > _SMALLEST * camera.image[0]
        return np.asarray(
            inside & large & (points[..., 2].min(axis=1) > 0.0) & (facing > np.cos(self.tilt))
        )


class Kind(ABC):
    """A kind of instrument."""

    name: ClassVar[str]  # as tables and results call what it measures
    # joints from the floor to the target that such an instrument has, sensed ones marked with *
    chains: ClassVar[tuple[tuple[str, ...], ...]]
    noun: ClassVar[str]  # what it measures, in the plural, for reports
    names: ClassVar[tuple[str, ...]]  # of the values of one pose
    units: ClassVar[tuple[str, ...]]  # of each value, m or rad
    directions: ClassVar[int]  # measured directions of the target's position
    seat_turns: ClassVar[bool] = True  # whether the orientation of its seat matters
    target_turns: ClassVar[bool] = False  # whether that of the target does
    judged: ClassVar[str] = "position"  # what of a target's place its errors are of
    seat_fixed: ClassVar[bool] = True  # whether a turning seat is known in all six directions
    # whether the values are lengths or coordinates, which the scale of the instrument stretches
    scales: ClassVar[bool] = True
    # whether the robot has to be brought to it, so that it says little of other places
    local: ClassVar[bool] = False
    # whether something reaches from the seat to the target: a rod, a wire, a line of sight
    sighted: ClassVar[bool] = True

    @property
    def columns(self) -> int:
        """Number of values of one pose."""
        return len(self.units)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other)

    def __hash__(self) -> int:
        return hash(type(self))

    @property
    def equations(self) -> int:
        """Independent equations that one pose gives."""
        return self.directions + 3 * self.target_turns

    @abstractmethod
    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """Where the target is by values (N, M) [m, rad].

        seat : in the robot's base frame. predicted : (3, N) [m] position of the target there.
        """

    @abstractmethod
    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, M) [m, rad] values of targets as they stand.

        noise : (6, N) in the instrument's standard deviations: along the line of sight, twice
        across it, and about three axes.
        """

    @abstractmethod
    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, K) [m, rad] standard deviation of values (N, M), or where there are none of the
        target's place.
        """

    def seat_of(self, values: Array, points: Array) -> Placement | None:
        """Where the seat is about, by values (N, M) of known points (N, 3) [m], base frame.

        None for kinds that measure the whole position: a linear problem finds their seats
        (ballbar.ident.start.placements).
        """
        del values, points
        return None

    def brought(self, rod: Array, shares: Array, least: float, most: float) -> Array:
        """(N, 3) [m] nearby places at which it can measure a target, seat frame.

        rod : (N, 3) [m] where the targets are. shares : (N,) random, 0 to 1. least, most : [m] of
        its range.
        """
        del shares, least, most
        return rod


@dataclass(frozen=True)
class Instrument:
    """An instrument that measures one target, and its noise."""

    name: str
    title: str
    kind: Kind
    nominal: float  # [m] length at mid range; 0 for a socket
    lower: float  # [m] shortest and longest length
    upper: float
    sigma_length: float  # [m] of the sensed length, or play of a socket
    sigma_zero: float  # [m] of the sensed length's zero; 0: calibrated
    sigma_direction: float  # [rad] of the angles that point at the target, the largest of theirs
    sigma_rotation: float  # [rad] of the target's sensed orientation, each axis
    distance: tuple[float, float] | None  # [m] between two seats, and its sigma
    mass: float  # [kg] of a rod from seat to target
    expansion: Expansion | None = None  # of its lengths
    camera: Camera | None = None  # whose pictures of a board tell its pose
    view: View | None = None  # the board that its pictures are of, where it is known

    @property
    def follows(self) -> bool:
        """Whether it follows a target on a robot that moves, and holds it by nothing."""
        return self.kind.directions == 3 and not self.kind.local

    @property
    def measured(self) -> str:
        """Name of what it measures."""
        return self.kind.name

    def sigma(self, values: Array) -> Array:
        """(N, M) [m, rad] standard deviation of values as in ballbar.cell.poses.PoseGroup; 3
        columns of a socket.
        """
        return self.kind.sigma(values, self)

    def visible(self, stand: TrueStand) -> NDArray[np.bool_]:
        """(N,) whether it sees targets as they stand; without a board, all of them."""
        if self.view is None or self.camera is None:
            return np.ones(stand.distance.size, dtype=bool)
        return self.view.seen(self.camera, stand)


def across(along: Array) -> Array:
    """(2, 3, N) unit vectors perpendicular to unit vectors (3, N) and to each other."""
    least = np.eye(3)[np.abs(along).argmin(axis=0)].T
    first = cross(along, least)
    first /= np.linalg.norm(first, axis=0)
    return np.stack((first, cross(along, first)))


def seat_axes(seat: Placement, count: int) -> Array:
    """(3, 3, N) the axes of a seat's frame, one after the other, N times."""
    return np.repeat(seat.rotation.T[:, :, None], count, axis=2)


def position_in_seat(stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
    """(3, N) [m] measured position by a length and two angles, or by three lengths; arguments as of
    `Kind.measure`.
    """
    sight = stand.rod / stand.distance
    sideways = _across_sigma(stand.distance, instrument)
    first, second = across(sight)
    along = instrument.sigma_length * noise[0]
    return np.asarray(stand.rod + along * sight + sideways * (noise[1] * first + noise[2] * second))


def position_sigma(values: Array, instrument: Instrument) -> Array:
    """(N, 3) [m] standard deviation of positions (N, 3 or more), equal along the three axes."""
    sideways = _across_sigma(np.linalg.norm(values[:, :3], axis=1), instrument)
    each = np.sqrt((instrument.sigma_length**2 + 2.0 * sideways**2) / 3.0)
    return np.repeat(each[:, None], 3, axis=1)


def _across_sigma(distance: Array, instrument: Instrument) -> Array:
    """(N,) [m] standard deviation across the line of sight at distances (N,) [m].

    Three sensed slides have no sensed direction: their errors are equal along every axis.
    """
    if instrument.sigma_direction == 0.0:
        return np.full(distance.shape, instrument.sigma_length)
    return np.asarray(instrument.sigma_direction * distance)


def turned(stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
    """(3, 3, N) measured orientation of a target; arguments as of `Kind.measure`."""
    turn = matrix_from_rotvec(instrument.sigma_rotation * noise[3:])
    return np.asarray(np.einsum("ijn,jkn->ikn", turn, stand.rotation))

"""Cell of a request for still poses: robot, instrument, seats, targets and axis limits, in SI.

A station is a seat with a target: one placement of the instrument that measures one ball or
reflector on the flange. Poses are planned in the controller's axis angles, since limits apply to
them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.board import load_board
from ballbar.cell.chain import Chain, Frames, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.instruments.base import Instrument, TrueStand, View
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.placement import Placement, target_frames
from ballbar.cell.pose_file import known_distances
from ballbar.cell.poses import KnownDistance
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.planning.pose_request import PosePlanRequest, SeatEntry, TargetEntry
from ballbar.planning.workspace import check_axes, workspace_grid

TURN = 2.0 * np.pi  # [rad] an axis that turns further is planned over half a turn to either side


@dataclass(frozen=True, eq=False)
class Aim:
    """A direction and the largest angle from it; None where any direction will do."""

    axis: Array  # (3,) unit vector
    angle: float  # [rad]


@dataclass(frozen=True, eq=False)
class Station:
    """A seat and a target."""

    seat: str
    target: str
    origin: Array  # (3,) [m] of the seat, robot base frame
    point: Array  # (3,) [m] of the target, flange frame
    seat_aim: Aim | None  # base frame
    target_aim: Aim | None  # flange frame
    seat_rotation: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) base frame
    target_rotation: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) flange frame


@dataclass(frozen=True, eq=False)
class PoseSetup:
    """A request with its descriptions read and checked."""

    request: PosePlanRequest
    robot: Robot
    chain: Chain  # nominal
    instrument: Instrument
    stations: tuple[Station, ...]
    distances: tuple[KnownDistance, ...]
    lower: Array  # (J,) [rad] axis angles within which poses are planned
    upper: Array  # (J,) [rad]
    shortest: float  # [m] distance of a target from its seat; 0 for sockets
    longest: float  # [m]
    grid: Array  # (G, J) [rad] DH joint angles over which the TCP error counts

    @property
    def unexplained(self) -> ExcessNoise:
        """Noise of a position, and of a rotation if measured, that the model leaves unexplained."""
        turned = self.request.unexplained_rad if self.instrument.kind.target_turns else 0.0
        return ExcessNoise(position=self.request.unexplained_m, rotation=turned)


def setup_of(request: PosePlanRequest, *, relative_to: Path) -> PoseSetup:
    """The cell of a request; relative_to : folder of the request's file.

    Raises DescriptionError for a wrong description, InputError for limits that allow nothing
    or a workspace that the robot does not have.
    """
    robot = load_robot(request.robot, relative_to=relative_to)
    instrument = load_instrument(request.instrument, relative_to=relative_to)
    if (instrument.camera is None) != (request.board is None):
        raise InputError(
            f"{request.name}: state board of a camera, and of no other instrument; instrument is "
            f"{instrument.name}."
        )
    if (stated := request.board) is not None:
        board = load_board(relative_to / stated.file)
        tilt = float(np.radians(stated.tilt_max_deg))
        instrument = replace(instrument, view=View(board, stated.camera == "flange", tilt))
    lower, upper = _axis_box(request, robot)
    limits, stroke = request.limits, instrument.upper - instrument.lower
    margin = limits.stroke_margin_share * stroke if instrument.kind.local else 0.0
    return PoseSetup(
        request=request,
        robot=robot,
        chain=nominal_chain(robot),
        instrument=instrument,
        stations=tuple(
            Station(
                seat=seat.name,
                target=target.name,
                origin=np.array(seat.position_m),
                point=np.array(target.position_m),
                seat_aim=_aim(seat),
                target_aim=_aim(target),
                seat_rotation=_rotation(seat),
                target_rotation=_rotation(target),
            )
            for seat in request.seats
            for target in request.targets
        ),
        distances=known_distances(
            request.distances, instrument, (seat.name for seat in request.seats)
        ),
        lower=lower,
        upper=upper,
        shortest=instrument.lower + margin,
        longest=instrument.upper - margin,
        grid=workspace_grid(robot, request.workspace),
    )


def station_frames(setup: PoseSetup, station: Station, axes: Array) -> Frames:
    """Nominal frames at axis angles (N, J) [rad]; the last is that of the target."""
    flange = forward(setup.chain, controller_to_joints(setup.robot, axes))
    return target_frames(flange, Placement(station.target_rotation, station.point))


def nominal_stand(station: Station, frames: Frames) -> TrueStand:
    """Targets in the frame of the seat; frames : as of `station_frames`."""
    rod, seat = frames.tip - station.origin[:, None], station.seat_rotation
    turn = np.einsum("ji,jkn->ikn", seat, frames.rotation())
    return TrueStand(seat.T @ rod, np.linalg.norm(rod, axis=0), turn)


def _axis_box(request: PosePlanRequest, robot: Robot) -> tuple[Array, Array]:
    """Lowest and highest axis angles (J,) [rad]."""
    limits = request.limits
    margin = np.radians(limits.axis_margin_deg)
    lower, upper = robot.axis_lower + margin, robot.axis_upper - margin
    wide = upper - lower > TURN
    lower = np.where(wide, np.maximum(lower, -0.5 * TURN), lower)
    upper = np.where(wide, np.minimum(upper, 0.5 * TURN), upper)
    if limits.axis_lower_deg is not None:
        check_axes("limits.axis_lower_deg", limits.axis_lower_deg, robot)
        lower = np.maximum(robot.axis_lower + margin, np.radians(limits.axis_lower_deg))
    if limits.axis_upper_deg is not None:
        check_axes("limits.axis_upper_deg", limits.axis_upper_deg, robot)
        upper = np.minimum(robot.axis_upper - margin, np.radians(limits.axis_upper_deg))
    empty = np.flatnonzero(lower >= upper)
    if empty.size:
        axis = int(empty[0])
        raise InputError(
            f"{request.name}: limits leave axis {axis + 1} nothing between "
            f"{np.degrees(lower[axis]):.4g} and {np.degrees(upper[axis]):.4g} deg. Widen "
            "axis_lower_deg and axis_upper_deg, or reduce axis_margin_deg."
        )
    return lower, upper


def _rotation(part: SeatEntry | TargetEntry) -> Array:
    return matrix_from_rotvec(np.array(part.rotvec_rad)[:, None])[:, :, 0]


def _aim(part: SeatEntry | TargetEntry) -> Aim | None:
    if part.axis is None:
        return None
    axis = np.array(part.axis)
    return Aim(axis / np.linalg.norm(axis), np.radians(part.cone_deg))

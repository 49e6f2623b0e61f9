"""Tables of still poses of a robot whose errors are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, forward, joint_screws
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain, robot_geometry
from ballbar.cell.instruments import kind_named
from ballbar.cell.instruments.base import TrueStand
from ballbar.cell.load import instrument_names, load_instrument, load_robot
from ballbar.cell.placement import Placement, target_frames
from ballbar.cell.poses import KnownDistance, Measured, PoseGroup, PoseTable
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.build_unknowns import arm_parameters
from ballbar.ident.evidence import Evidence
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.rules import judge
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.verdict import Verdict

TARGET = Placement(np.eye(3), np.array([0.03, -0.02, 0.12]))
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SEAT = Placement(TURN, np.array([1.9, -0.7, 0.4]))


@dataclass(frozen=True, eq=False)
class TrueRobot:
    """A robot with drawn errors; it puts its target where the table says."""

    name: str
    robot: Robot  # nominal
    chain: Chain
    corrections: tuple[Correction, ...]
    values: Array

    def positions(self, q: Array, target: Placement = TARGET) -> Array:
        """(N, 3) [m] of a target in the base frame."""
        return self.frames(q, target).tip.T

    def frames(self, q: Array, target: Placement) -> Frames:
        """Frames of the robot; the last is that of a target."""
        nominal = robot_geometry(self.robot)
        joints = IdentifiedRobot(self.robot, nominal, self.corrections, self.values).joints(q)
        return target_frames(forward(self.chain, joints), target)


def true_robot(
    name: str = "ur5",
    *,
    seed: int = 1,
    orders: Sequence[tuple[int, int]] = (),
    amplitude: float = 2e-4,
    sag: float = 3e-4,
) -> TrueRobot:
    """Errors of 0.3 mm and 0.5 mrad in every parameter, and sag [rad/m]."""
    rng, robot = np.random.default_rng(seed), load_robot(name)
    nominal = nominal_chain(robot)
    rows = {f.name: getattr(nominal, f.name).copy() for f in fields(Chain)}
    for parameter in arm_parameters(robot):
        rows[parameter.kind][parameter.row] += rng.normal(
            0.0, 3e-4 if parameter.is_length else 5e-4
        )
    corrections: tuple[Correction, ...] = (unit_weights(robot),)
    values = [sag * rng.normal(size=len(corrections[0].coefficients))]
    if orders:
        corrections = (*corrections, joint_harmonics(orders))
        angle = rng.uniform(-np.pi, np.pi, len(orders))
        values.append(amplitude * np.column_stack((np.cos(angle), np.sin(angle))).reshape(-1))
    return TrueRobot(name, robot, Chain(**rows), corrections, np.concatenate(values))


def angles(name: str, count: int, seed: int = 0, share: float = 0.6) -> Array:
    """(N, J) [rad] random angles over the middle of each range."""
    robot = load_robot(name)
    half = np.minimum(0.5 * share * (robot.axis_upper - robot.axis_lower), 2.0)
    middle = 0.5 * (robot.axis_upper + robot.axis_lower)
    rng = np.random.default_rng([seed, 3])
    return middle + half * rng.uniform(-1.0, 1.0, (count, robot.a.size))


def table_of(
    true: TrueRobot,
    measured: Measured = "point",
    *,
    count: int = 200,
    noise: float = 2e-5,
    seed: int = 0,
    q: Array | None = None,
) -> PoseTable:
    """Poses measured with white noise [m]; lengths from three seats, sockets of three sites."""
    robot, rng = true.robot, np.random.default_rng([seed, 5])
    q = angles(true.name, count, seed) if q is None else q
    groups = []
    if measured in ("point", "pose"):
        frames = true.frames(q, TARGET)
        place = (frames.tip.T - SEAT.origin) @ SEAT.rotation
        place = place + rng.normal(0.0, noise, place.shape)
        if measured == "pose":
            turn = Rotation.from_matrix(np.einsum("ji,jkn->nik", SEAT.rotation, frames.rotation()))
            turn = Rotation.from_rotvec(rng.normal(0.0, 1e-4, (len(q), 3))) * turn
            place = np.hstack((place, turn.as_rotvec()))
        sigma = np.full(place.shape, noise)
        groups.append(group(measured, "tracker", q, place, sigma))
    if measured == "length":
        for k, seat in enumerate(([1.2, -0.9, 0.1], [-1.1, -0.8, 0.2], [0.2, 1.4, -0.1])):
            away = np.linalg.norm(true.positions(q) - seat, axis=1)[:, None]
            away = away + rng.normal(0.0, noise, away.shape)
            groups.append(group("length", f"seat {k}", q, away, np.full(away.shape, noise)))
    if not groups:
        for k, turn in enumerate((0.0, 1.0, 2.0)):
            rotation = Rotation.from_euler("zx", [turn, 0.4]).as_matrix()
            seat = Placement(rotation, np.array([1.6 - turn, -1.1, 0.3]))
            groups.append(group(measured, f"seat {k}", q, *_seen(true, measured, q, seat, noise)))
    return PoseTable(true.name, robot, tuple(groups))


def _seen(
    true: TrueRobot, measured: Measured, q: Array, seat: Placement, noise: float
) -> tuple[Array, Array]:
    """(N, M) values of any kind of instrument without noise, and their stated sigma."""
    kind, frames = kind_named(measured), true.frames(q, TARGET)
    rod = seat.rotation.T @ (frames.tip - seat.origin[:, None])
    turns = np.einsum("ji,jkn->ikn", seat.rotation, frames.rotation())
    stand = TrueStand(rod, np.linalg.norm(rod, axis=0), turns)
    name = next(n for n in instrument_names() if load_instrument(n).kind == kind)
    values = kind.measure(stand, np.zeros((6, len(q))), load_instrument(name))
    return values, np.full(values.shape, noise)


def socket_table(true: TrueRobot, *, count: int = 24, noise: float = 3e-5) -> PoseTable:
    """The target put into pairs of sockets 50 mm apart, by Newton steps on the true robot."""
    robot, rng = true.robot, np.random.default_rng(11)
    groups, distances = [], []
    for site in range(3):
        start = true.positions(angles(true.name, 1, seed=40 + site))[0]
        for hole in (0, 1):
            socket = start + 0.05 * hole * np.eye(3)[0]
            q = reached(true, socket + rng.normal(0.0, noise, (count, 3)), seed=100 + site)
            seat = f"{site}/{hole}"
            groups.append(
                group("socket", seat, q, np.zeros((len(q), 0)), np.full((len(q), 3), noise))
            )
        distances.append(KnownDistance((f"{site}/0", f"{site}/1"), 0.05, 2e-4))
    return PoseTable(true.name, robot, tuple(groups), tuple(distances))


def reached(true: TrueRobot, places: Array, *, seed: int) -> Array:
    """(N, J) [rad] angles at which the true target stands at places (N, 3) [m]: damped Newton."""
    q = angles(true.name, 4 * len(places), seed)
    wanted = np.tile(places, (4, 1))
    for _ in range(25):
        frames = true.frames(q, TARGET)
        jacobian = joint_screws(frames)[: q.shape[1], :3].transpose(2, 1, 0)
        error = wanted - frames.tip.T
        square = jacobian @ jacobian.transpose(0, 2, 1) + 1e-6 * np.eye(3)
        step = np.einsum("ncj,nc->nj", jacobian, np.linalg.solve(square, error[..., None])[..., 0])
        largest = np.abs(step).max(axis=1, keepdims=True)
        q = q + step * np.minimum(1.0, 0.3 / np.maximum(largest, 1e-12))
    close = np.linalg.norm(wanted - true.positions(q), axis=1) < 1e-7
    return q[np.flatnonzero(close)[: len(places)]]


def group(
    measured: Measured,
    seat: str,
    q: Array,
    values: Array,
    sigma: Array,
    target: str = "ball",
    file: str = "table.csv",
) -> PoseGroup:
    """A group of poses as from a file of one row each."""
    return PoseGroup(
        measured=measured,
        seat=seat,
        target=target,
        q=q,
        values=values,
        sigma=sigma,
        rows=np.arange(2, len(q) + 2),
        file=file,
    )


def with_group(table: PoseTable, **changes: Any) -> PoseTable:
    """The table with changes of its only group."""
    (group,) = table.groups
    return replace(table, groups=(replace(group, **changes),))


def verdict_of(poses: TableEstimate, *, elsewhere: bool = False) -> Verdict:
    """The verdict on still poses alone."""
    return judge([Evidence(table=poses, elsewhere=elsewhere)])

"""Where seats and targets are, by the nominal robot: starting values for the fit.

Where the whole position is sensed it is one linear least-squares problem: with R the seat's
rotation, o its origin and t the target on the flange, `O_i + R_i t = R m_i + o` is linear in the
nine elements of R, in o and in t. Sockets are the same without R. Poses that stand far off are left
out and the solution repeated, so that a few wrong ones do not spoil the start. Other instruments
say where their seat is about, by their values of known points (`Kind.seat_of`); several trial
targets are refined from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.errors import FailureError
from ballbar.cell.geometry import Geometry
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.rigid_fit import nearest_rotation
from ballbar.cell.rotation import left_jacobian
from ballbar.ident.estimator.build_unknowns import bare_flange, still_unknowns
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.model import still_model
from ballbar.ident.estimator.observations import rounding_noise
from ballbar.ident.estimator.robust_fit import fit_robustly
from ballbar.ident.estimator.unknowns import PlacedPoses

_ROUNDS = 5  # of leaving poses out
_FAR = 6.0  # medians of the distance beyond which a pose is left out
_GROSS = 10.0  # medians of the distance beyond which a pose does not count in a fit of few poses
_TRIAL = 0.15  # [m] of a trial target from the flange, in six directions


class PoseStartError(FailureError):
    """The measurements cannot be brought together with the declared robot."""


@dataclass(frozen=True, eq=False)
class _Poses:
    """The poses of one target that measure the same kind of thing."""

    groups: Sequence[PoseGroup]
    origin: Array  # (N, 3) [m] of the flange by the nominal robot
    rotation: Array  # (N, 3, 3)
    seat: NDArray[np.intp]  # (N,) number of each pose's seat
    names: tuple[str, ...]  # of the seats
    values: Array  # (N, M)


def start_of_poses(table: PoseTable, chain: Chain) -> PlacedPoses:
    """Seats and targets of a table. Raises PoseStartError where a mirrored frame fits instead."""
    seats: dict[str, Placement] = {}
    targets: dict[str, Placement] = {}
    for target in table.targets:
        groups = [g for g in table.groups if g.target == target]
        place: Placement | None = None
        for solve, turns in ((_points, True), (_sockets, False)):
            if same := [g for g in groups if g.kind.directions == 3 and g.kind.seat_turns == turns]:
                placed, place = solve(_gathered(same, chain))
                seats = placed | seats
        for kind in dict.fromkeys(g.kind for g in groups if g.kind.directions < 3):
            own = [g for g in groups if g.kind == kind]
            placed, place = _sighted(own, _gathered(own, chain), place)
            seats = placed | seats
        assert place is not None  # every target stands in a group
        whole = [g for g in groups if g.kind.target_turns]
        turn = _target_rotation(_gathered(whole, chain), seats) if whole else np.eye(3)
        targets[target] = Placement(turn, place.origin)
    return PlacedPoses(table, seats, targets)


def _gathered(groups: Sequence[PoseGroup], chain: Chain) -> _Poses:
    frames = forward(chain, np.concatenate([g.q for g in groups]))
    names = tuple(dict.fromkeys(g.seat for g in groups))
    width = min(g.values.shape[1] for g in groups)
    return _Poses(
        groups,
        frames.tip.T,
        frames.rotation().transpose(2, 0, 1),
        np.concatenate([np.full(g.size, names.index(g.seat)) for g in groups]),
        names,
        np.concatenate([g.values[:, :width] for g in groups]),
    )


def _points(poses: _Poses) -> tuple[dict[str, Placement], Placement]:
    """Placements from points: whole seat frames, by the linear problem, then proper rotations."""
    n, s = len(poses.origin), len(poses.names)
    matrix = np.zeros((n, 3, 12 * s + 3))
    for k in range(n):
        first = 12 * poses.seat[k]
        for i in range(3):
            matrix[k, i, first + 3 * i : first + 3 * i + 3] = poses.values[k, :3]
            matrix[k, i, first + 9 + i] = 1.0
    matrix[:, :, 12 * s :] = -poses.rotation
    solution = _without_far(matrix, poses.origin)
    linear = solution[: 12 * s].reshape(s, 4, 3)[:, :3]
    turn = np.stack([_seat_rotation(each, poses) for each in linear])
    moved = poses.origin - np.einsum("nij,nj->ni", turn[poses.seat], poses.values[:, :3])
    matrix = _placements_matrix(poses)
    solution = _without_far(matrix, moved)
    seats = {
        name: Placement(turn[j], solution[3 * j : 3 * j + 3]) for j, name in enumerate(poses.names)
    }
    return seats, Placement(np.eye(3), solution[3 * s :])


def _sockets(poses: _Poses) -> tuple[dict[str, Placement], Placement]:
    """Placements from sockets: `O_i = o - R_i t`."""
    s = len(poses.names)
    solution = _without_far(_placements_matrix(poses), poses.origin)
    seats = {
        name: Placement(np.eye(3), solution[3 * j : 3 * j + 3])
        for j, name in enumerate(poses.names)
    }
    return seats, Placement(np.eye(3), solution[3 * s :])


def _placements_matrix(poses: _Poses) -> Array:
    """(N, 3, 3 S + 3) of the origins of S seats, and of the target."""
    n, s = len(poses.origin), len(poses.names)
    matrix = np.zeros((n, 3, 3 * s + 3))
    for i in range(3):
        matrix[np.arange(n), i, 3 * poses.seat + i] = 1.0
    matrix[:, :, 3 * s :] = -poses.rotation
    return matrix


def _sighted(
    groups: Sequence[PoseGroup], poses: _Poses, known: Placement | None
) -> tuple[dict[str, Placement], Placement]:
    """Placements by kinds that find their seat from points, the best from several trial targets."""
    kind, s = groups[0].kind, len(poses.names)
    free = 6 if kind.seat_turns else 3
    trials = np.vstack((np.zeros((1, 3)), _TRIAL * np.eye(3), -_TRIAL * np.eye(3)))
    chosen = [poses.seat == j for j in range(s)]

    def placed(x: Array, begun: Sequence[Placement]) -> list[Placement]:
        parts = x[: free * s].reshape(s, free)
        return [b.moved(part, about_own_axes=False) for b, part in zip(begun, parts, strict=True)]

    def residual(x: Array, begun: Sequence[Placement]) -> Array:
        points = poses.origin + poses.rotation @ x[free * s :]
        out = []
        for seat, own in zip(placed(x, begun), chosen, strict=True):
            sight = kind.sight(poses.values[own], seat, points[own].T)
            error = sight.point - points[own].T
            out.append((sight.directions * error).sum(axis=1).ravel())
        return np.concatenate(out)

    def slope(x: Array, begun: Sequence[Placement]) -> Array:
        """Seat and points that move together leave the residual, points alone change it by what
        they move along the sensed directions.
        """
        turned = poses.rotation @ x[free * s :]
        out = []
        for j, (seat, own) in enumerate(zip(placed(x, begun), chosen, strict=True)):
            points = poses.origin[own] + turned[own]
            along = kind.sight(poses.values[own], seat, points.T).directions.transpose(0, 2, 1)
            rows = np.zeros((*along.shape[:2], x.size))
            change = rows[..., free * j : free * j + free]
            change[..., :3] = along
            if free == 6:
                turning = left_jacobian(x[free * j + 3 : free * j + 6])
                change[..., 3:] = np.cross(points - seat.origin, along) @ turning
            rows[..., free * s :] = -np.einsum("dni,nij->dnj", along, poses.rotation[own])
            out.append(rows.reshape(-1, x.size))
        return np.concatenate(out)

    best, cost, target = list[Placement](), np.inf, np.zeros(3)
    for trial in (*(trials if known is None else known.origin[None]), None):
        # once more from the best: where a wrong target hid it, a seat may stand the other way round
        begin = target if trial is None else trial
        points = poses.origin + poses.rotation @ begin
        begun = [kind.seat_of(poses.values[own], points[own]) for own in chosen]
        first = [place for place in begun if place is not None]
        if len(first) < s:
            raise PoseStartError(f"instruments of kind {kind.name} state no start of their seats")
        fitted = least_squares(
            residual,
            np.concatenate((np.zeros(free * s), begin)),
            slope,
            loss="soft_l1",
            f_scale=2e-3,
            max_nfev=60,
            args=(first,),
        )
        if fitted.cost < cost:
            best, cost, target = placed(fitted.x, first), fitted.cost, fitted.x[free * s :]
    return dict(zip(poses.names, best, strict=True)), Placement(np.eye(3), target)


def _without_far(matrix: Array, right: Array) -> Array:
    """Least squares of blocks (N, 3, U) against (N, 3), poses far off left out."""
    counting = np.ones(len(right), dtype=bool)
    for _ in range(_ROUNDS):
        rows = matrix[counting].reshape(-1, matrix.shape[2])
        solution = np.linalg.lstsq(rows, right[counting].reshape(-1), rcond=1e-9)[0]
        distance = np.linalg.norm(matrix @ solution - right, axis=1)
        limit = _FAR * np.median(distance[counting])
        now = distance <= limit
        if (now == counting).all() or limit == 0.0:
            break
        counting = now
    return np.asarray(solution)


def _seat_rotation(linear: Array, poses: _Poses) -> Array:
    """The rotation nearest to a matrix. Raises PoseStartError for a reflection."""
    singular = np.linalg.svd(linear, compute_uv=False)
    if np.linalg.det(linear) < 0.0 and singular[2] > 0.5 * singular[0]:
        files = ", ".join(dict.fromkeys(g.file for g in poses.groups))
        raise PoseStartError(
            f"{files}: the measured points fit the robot only as a mirror image. Is the frame "
            "left-handed, or are two of its axes exchanged? Change the sign or the order of the "
            "value columns; or the sign of a joint column, of joint 1 above all."
        )
    return nearest_rotation(linear)


def _target_rotation(poses: _Poses, seats: dict[str, Placement]) -> Array:
    """(3, 3) of the target on the flange: the median, as rotation vectors about a first guess."""
    measured = Rotation.from_rotvec(poses.values[:, 3:].copy()).as_matrix()
    seat = np.stack([seats[name].rotation for name in poses.names])[poses.seat]
    each = np.einsum("nki,nkl,nlj->nij", poses.rotation, seat, measured)
    middle = Rotation.from_matrix(each).mean()
    rest = (middle.inv() * Rotation.from_matrix(each)).as_rotvec()
    return np.asarray((middle * Rotation.from_rotvec(np.median(rest, axis=0))).as_matrix())


def placed_by(geometry: Geometry, table: PoseTable) -> PlacedPoses:
    """Poses with seats, targets and clocks fitted to a robot that is held, wrong poses left out.

    geometry : of the robot, whatever its last row holds. Raises as `start_of_poses`.
    """
    fit = placed_fit(geometry, table)
    layout = fit.model.unknowns
    return PlacedPoses(
        retimed(fit),
        seats={name: layout.seat(fit.x, name) for name in layout.seats},
        targets={name: layout.target(fit.x, name) for name in layout.targets},
        robust=fit.linear.robust[fit.still],
    )


def retimed(fit: Fit) -> PoseTable:
    """The table of a fit, poses of a robot that moved by the clocks that were found."""
    layout, table = fit.model.unknowns, fit.model.poses
    groups = (
        g if g.motion is None else g.by(layout.instrument_clock(fit.x, g.motion.name))
        for g in table.groups
    )
    return replace(table, groups=tuple(groups))


def placed_fit(geometry: Geometry, table: PoseTable) -> Fit:
    """The fit of seats, targets and clocks to a robot that is held; arguments of `placed_by`."""
    last, flange = bare_flange(table.robot)
    values = geometry.values.copy()
    values[last] = flange
    bare = geometry.with_values(values)
    start = start_of_poses(table, bare.robot)
    layout = still_unknowns(bare, start, ()).held()
    model = still_model(table, layout, (), rounding_noise(table.q))
    errors = [
        np.linalg.norm(point.closure.error[:3], axis=0) for point in model.at_rest(layout.mean)
    ]
    error = np.concatenate(errors)
    far = np.flatnonzero(error > _GROSS * np.median(error))
    return fit_robustly(model, layout.mean.copy(), left_out=far)

"""Characteristics of measured poses: repeated still poses in the robot's base frame.

The seat of the instrument, and a target that the result does not know, are fitted to the identified
robot over all poses of a group: six or nine of their coordinates, so that its errors at few poses
come out small. The nominal robot has the same tool, and the base frame that fits the identified
robot's best over the workspace, so its errors are those that are predicted.

Repetitions are poses of equal commanded angles. What is attained is the same under each model; a
correction moves poses and not their spread.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ballbar.cell.arrays import Array
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup
from ballbar.cell.rigid_fit import kabsch, nearest_rotation
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from ballbar.ident.performance import iso_9283 as iso
from ballbar.ident.performance.characteristics import Characteristic, Statement, not_stated
from ballbar.ident.performance.cube import TestCube
from ballbar.ident.performance.predicted import RobotPair, length_moments

ROUNDS = 30  # of Gauss-Newton from a seat by points to seat and target
SAME = 1e-3  # [rad] of every axis within which two poses are of one command
AS_FAR = 0.01  # of a distance by which others may be longer
LEAST_CYCLES = 3  # from which a spread is stated
LEAST_POSES = 5  # different ones from which an accuracy is stated: those of the test cube
NOT_CORRECTED = not_stated("measured at targets that were not corrected")

Rows = NDArray[np.intp]


def noise_remark(group: PoseGroup) -> str:
    """Sentence on the repeatability that the stated noise of the instrument alone would make."""
    mean, deviation = length_moments(np.diag((group.sigma[:, :3] ** 2).mean(axis=0)))
    size = (mean + 3.0 * deviation) * 1e3
    return f"{size:.2g} mm would follow from the instrument's stated noise alone"


@dataclass(frozen=True, eq=False)
class Attained:
    """N measured poses of a group in the robot's base frame, and where a model commands them."""

    commanded: Array  # (N, 3) [m]
    points: Array  # (N, 3) [m]
    turns: Array | None  # (N, 3) [rad] of the target from the commanded orientation; None: not seen


def attained(
    robots: RobotPair, group: PoseGroup, known: Placement | None
) -> tuple[Attained, Attained]:
    """The poses of a group by the nominal and by the identified robot.

    known : the target in the frame of the identified robot's last row.
    """
    values, (turn, shift) = group.values, robots.alignment
    nominal, identified = (
        model.ends(group.q) for model in (robots.nominal.identified, robots.robot)
    )
    seat, origin, target = _seat_and_target(identified, values[:, :3], known)
    seen = own = None
    if group.kind.target_turns:
        seen = seat @ matrix_from_rotvec(values[:, 3:].T).transpose(2, 0, 1)
        own = nearest_rotation((identified[:, :3, :3].transpose(0, 2, 1) @ seen).sum(axis=0))
    points = values[:, :3] @ seat.T + origin
    there = None if seen is None else turn @ seen
    before = _attained(nominal, target, points @ turn.T + shift, there, own)
    return before, _attained(identified, target, points, seen, own)


def _attained(
    ends: Array, target: Array, points: Array, seen: Array | None, own: Array | None
) -> Attained:
    """Poses by a model with ends (N, 4, 4), its target (3,) [m] of orientation `own` (3, 3), and
    what was seen of them in its base frame: points (N, 3) [m], orientations (N, 3, 3).
    """
    turns = None
    if seen is not None and own is not None:
        turned = np.einsum("nij,nkl,lj->ikn", seen, ends[:, :3, :3], own)
        turns = rotvec_from_matrix(turned).T
    return Attained(ends[:, :3, 3] + ends[:, :3, :3] @ target, points, turns)


def _seat_and_target(
    ends: Array, values: Array, known: Placement | None
) -> tuple[Array, Array, Array]:
    """Rotation (3, 3) and origin (3,) [m] of the seat, and the target (3,) [m] in the last row's
    frame, with the least squares of points; of poses that leave some of them open the nearest.
    """
    target = np.zeros(3) if known is None else known.origin
    commanded = ends[:, :3, 3] + ends[:, :3, :3] @ target
    mean = values.mean(axis=0)
    turn = kabsch(values - mean, commanded - commanded.mean(axis=0))
    middle = commanded.mean(axis=0)
    columns = np.zeros((len(values), 3, 9))
    for _ in range(ROUNDS):
        arms = (values - mean) @ turn.T
        left = ends[:, :3, 3] + ends[:, :3, :3] @ target - middle - arms
        columns[:, :, :3] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
        columns[:, :, 3:6] = np.eye(3)
        columns[:, :, 6:] = 0.0 if known is not None else -ends[:, :3, :3]
        step = np.linalg.lstsq(columns.reshape(-1, 9), left.ravel(), rcond=1e-7)[0]
        turn = matrix_from_rotvec(step[:3, None])[:, :, 0] @ turn
        middle, target = middle + step[3:6], target + step[6:]
        if np.abs(step).max() < 1e-12:
            break
    return turn, middle - turn @ mean, target


def repetitions(q: Array) -> list[Rows]:
    """Rows of each command that occurs LEAST_CYCLES times or more, in the order of q (N, J) [rad].

    A pose belongs to the first command whose first angles are within SAME of its own.
    """
    close = cKDTree(q).query_ball_point(q, SAME, p=np.inf, return_length=True)
    left, rows = np.flatnonzero(np.asarray(close) > 1), list[Rows]()
    while left.size:
        same = (np.abs(q[left] - q[left[0]]) <= SAME).all(axis=1)
        rows.append(left[same])
        left = left[~same]
    return [own for own in rows if own.size >= LEAST_CYCLES]


def repeated(
    group: PoseGroup, seen: Sequence[Attained], cube: TestCube | None
) -> Iterator[Characteristic]:
    """Rows of a group's repeated poses; seen : by the nominal and the identified robot."""
    clusters = repetitions(group.q)
    places = [_place(group.q[rows[0]], k, cube) for k, rows in enumerate(clusters, start=1)]
    for place, rows in zip(places, clusters, strict=True):
        yield from _accuracy(seen, place, rows, len(clusters))
        yield from _repeatability(group, seen[1], place, rows)
        yield from _variation(group, seen[1], clusters, place, rows)
        yield from _drift(group, seen, place, rows)
    if len(clusters) > 1:
        yield from _distance(group, seen, places, clusters)


def _place(q: Array, number: int, cube: TestCube | None) -> str:
    """Name of a repeated pose q (J,) [rad]; one of the test cube has its own."""
    away = np.full(1, np.inf) if cube is None else np.abs(cube.q - q).max(axis=1)
    return f"P{away.argmin() + 1}" if away.min() <= SAME else f"pose {number}"


def _accuracy(
    seen: Sequence[Attained], place: str, rows: Rows, count: int
) -> Iterator[Characteristic]:
    """AP of one pose of `count` that were repeated."""
    if count < LEAST_POSES:
        few = not_stated(f"{count} repeated poses, and the seat follows them; 5 are needed")
        yield Characteristic("AP_p", place, (few,) * 3, rows.size)
        return
    stated, remarks = [], ("", f"the seat is fitted to these {count} poses")
    for each, remark in zip(seen, remarks, strict=True):
        own, commanded = each.points[rows], each.commanded[rows].mean(axis=0)
        value, width = iso.pose_accuracy(own, commanded), iso.accuracy_half_width(own, commanded)
        stated.append(Statement("measured", value, max(0.0, value - width), value + width, remark))
    yield Characteristic("AP_p", place, (*stated, NOT_CORRECTED), rows.size)
    turns = [each.turns[rows] for each in seen if each.turns is not None]
    means = [iso.orientation_accuracy(own, np.zeros(3)) for own in turns]
    for k, index in enumerate("abc" if turns else ""):
        pairs = zip(means, turns, strict=True)
        stated = [_about(float(mean[k]), iso.mean_half_width(own[:, k])) for mean, own in pairs]
        yield Characteristic(f"AP_{index}", place, (*stated, NOT_CORRECTED), rows.size)


def _repeatability(
    group: PoseGroup, seen: Attained, place: str, rows: Rows
) -> Iterator[Characteristic]:
    """RP of one pose."""
    sizes = {"RP_l": float(iso.pose_repeatability(group.values[rows, :3]))}
    if seen.turns is not None:
        turns = iso.orientation_repeatability(seen.turns[rows])
        sizes |= zip(("RP_a", "RP_b", "RP_c"), turns, strict=True)
    for symbol, value in sizes.items():
        remark = noise_remark(group) if symbol == "RP_l" else ""
        stated = _spread(float(value), rows.size, remark)
        yield Characteristic(symbol, place, (stated,) * 3, rows.size)


def _variation(
    group: PoseGroup, seen: Attained, clusters: Sequence[Rows], place: str, rows: Rows
) -> Iterator[Characteristic]:
    """vAP of one pose; the pose before a repetition is the direction that it came from."""
    numbers = np.full(group.size, -1)
    for k, own in enumerate(clusters):
        numbers[own] = k
    before = numbers[np.maximum(rows - 1, 0)]
    ways = [own for k in np.unique(before) if (own := rows[before == k]).size > 1]
    if len(ways) < 2:
        return
    remark = "" if len(ways) > 2 else "of two directions; the standard asks for three"
    means = np.stack([group.values[way, :3].mean(axis=0) for way in ways])
    sizes = {"vAP_p": iso.pose_accuracy_variation(means)}
    if seen.turns is not None:
        means = np.stack([seen.turns[way].mean(axis=0) for way in ways])
        sizes |= zip(
            ("vAP_a", "vAP_b", "vAP_c"), iso.orientation_accuracy_variation(means), strict=True
        )
    for symbol, value in sizes.items():
        stated = Statement("measured", float(value), reason=remark)
        yield Characteristic(symbol, place, (stated,) * 3, rows.size)


def _drift(
    group: PoseGroup, seen: Sequence[Attained], place: str, rows: Rows
) -> Iterator[Characteristic]:
    """Changes from the first cycles to the last ones, at most as many as the standard has."""
    count = min(iso.PATH_CYCLES, rows.size // 2)
    if group.time is None or count < LEAST_CYCLES:
        return
    ordered = rows[np.argsort(group.time[rows])]
    parts = ordered[:count], ordered[-count:]
    hours = float(np.ptp(group.time[rows])) / 3600.0
    remark = f"over {hours:.2g} h, {count} cycles at each end"

    def change(values: Sequence[float]) -> Statement:
        return Statement("measured", float(iso.drift(np.array(values))), reason=remark)

    accuracy = [
        change([iso.pose_accuracy(s.points[p], s.commanded[rows].mean(axis=0)) for p in parts])
        for s in seen
    ]
    spread = change([float(iso.pose_repeatability(group.values[p, :3])) for p in parts])
    yield Characteristic("dAP_p", place, (*accuracy, NOT_CORRECTED), rows.size)
    yield Characteristic("dRP_l", place, (spread,) * 3, rows.size)


def _distance(
    group: PoseGroup, seen: Sequence[Attained], places: Sequence[str], clusters: Sequence[Rows]
) -> Iterator[Characteristic]:
    """AD and RD of the first two poses that are as far apart as any, cycle by cycle."""
    middle = np.stack([group.values[rows, :3].mean(axis=0) for rows in clusters])
    apart = np.linalg.norm(middle[:, None] - middle, axis=2)
    pair = np.argwhere(apart > (1.0 - AS_FAR) * apart.max())[0]  # of the test cube P2 and P4
    count = min(clusters[k].size for k in pair)
    rows = [clusters[k][:count] for k in pair]
    first, second = (group.values[own, :3] for own in rows)
    width = iso.mean_half_width(np.linalg.norm(first - second, axis=1))
    stated = []
    for each in seen:
        commanded = np.stack([each.commanded[own].mean(axis=0) for own in rows])
        stated.append(_about(iso.distance_accuracy(first, second, commanded), width))
    place = "-".join(places[k] for k in pair)
    yield Characteristic("AD_p", place, (*stated, NOT_CORRECTED), count)
    spread = _spread(iso.distance_repeatability(first, second), count)
    yield Characteristic("RD", place, (spread,) * 3, count)


def _about(value: float, width: float) -> Statement:
    """A measured value with an interval of a half width about it."""
    return Statement("measured", value, value - width, value + width)


def _spread(value: float, count: int, remark: str = "") -> Statement:
    """A measured repeatability of so many cycles."""
    low, high = iso.deviation_interval(count)
    return Statement("measured", value, low * value, high * value, remark)

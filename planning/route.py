"""The order of poses and the moves between them: short, and clear of everything.

Poses are visited station by station, since a person moves the instrument or the reflector between
them. Within a station the order begins with nearest neighbours and is improved by 2-opt (Croes
1958); the length of a move is its time at the axes' top speeds. Moves are linear in the axis
angles. One that comes too close is avoided in the order, or led over two intermediate poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from planning.capsules import smallest_distance
from planning.feasible_poses import Candidates
from planning.stations import PoseSetup, station_frames

STEP = np.radians(5.0)  # [rad] of the fastest axis between the poses of a move that are checked
UNKNOWN_SPEED = 1.0  # [rad/s] of an axis whose file states none; only compares moves
BLOCKED = 100.0  # [s] added to a move that comes too close, so that the order avoids it
ROUNDS = 12  # of checking the moves of an order and avoiding those that come too close
PASSED = 600  # random poses that are tried as intermediate ones
PAIRED = 40  # of them at either end of a move, each with each


@dataclass(frozen=True, eq=False)
class Route:
    """Poses in the order of their measurement."""

    poses: Candidates
    passing: dict[int, Array]  # (2, J) [rad] intermediate poses before the pose of that number
    blocked: tuple[int, ...]  # poses, from 0, whose approach comes closer than the clearance
    released: tuple[int, ...]  # poses on whose approach the target leaves the instrument's stroke
    seconds: float  # of all moves at the axes' top speeds


@dataclass(frozen=True, eq=False)
class _Moves:
    """Which moves of one station are clear, as far as they were checked."""

    setup: PoseSetup
    station: int
    axes: Array  # (n, J) [rad]
    time: Array  # (n, n) [s], blocked ones with their penalty

    def check(self, order: NDArray[np.intp]) -> bool:
        """Check the moves of an order; whether one more is blocked. Changes the times in place."""
        pairs = [(int(a), int(b)) for a, b in pairwise(order)]
        pairs = [(a, b) for a, b in pairs if self.time[a, b] < BLOCKED]
        if not pairs:
            return False
        clear = clear_moves(
            self.setup,
            self.station,
            self.axes[[a for a, _ in pairs]],
            self.axes[[b for _, b in pairs]],
        )
        for (a, b), good in zip(pairs, clear, strict=True):
            if not good:
                self.time[a, b] = self.time[b, a] = self.time[a, b] + BLOCKED
        return not clear.all()


def route_of(setup: PoseSetup, poses: Candidates, rng: np.random.Generator) -> Route:
    """The poses in a short order; rng : draws intermediate poses."""
    order = _order(setup, poses)
    ordered = poses.part(order)
    axes, station = ordered.axes, ordered.station
    passing: dict[int, Array] = {}
    blocked: list[int] = []
    released: list[int] = []
    for k in range(1, poses.size):
        if station[k] != station[k - 1]:
            continue  # a person moves the instrument, and the robot to where it begins
        if not in_stroke(setup, int(station[k]), axes[k - 1], axes[k]):
            released.append(k)
        if clear_moves(setup, int(station[k]), axes[k - 1 : k], axes[k : k + 1])[0]:
            continue
        middle = _intermediate(setup, int(station[k]), axes[k - 1], axes[k], rng)
        if middle is None:
            blocked.append(k)
        else:
            passing[k] = middle
    seconds = 0.0
    for k in range(1, poses.size):
        middle = passing.get(k)
        stops = axes[k - 1 : k + 1] if middle is None else np.vstack((axes[k - 1], middle, axes[k]))
        seconds += float(_times(setup, stops[:-1], stops[1:]).sum())
    return Route(ordered, passing, tuple(blocked), tuple(released), seconds)


def clear_moves(setup: PoseSetup, station: int, begin: Array, end: Array) -> NDArray[np.bool_]:
    """(M,) whether moves from begin to end (M, J) [rad] keep the clearance.

    A rod is on the target where the move does not leave its stroke; beams may be interrupted.
    """
    place = setup.stations[station]
    counts = np.ceil(np.abs(end - begin).max(axis=1) / STEP).astype(int) + 1
    owner = np.repeat(np.arange(len(begin)), counts)
    share = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])[:, None]
    axes = begin[owner] + share * (end - begin)[owner]
    frames = station_frames(setup, place, axes)
    apart = smallest_distance(setup, place, frames, line=False)
    if setup.instrument.measured == "length":
        length = np.linalg.norm(frames.tip - place.origin[:, None], axis=0)
        outside = (length < setup.instrument.lower) | (length > setup.instrument.upper)
        left = np.bincount(owner, outside, len(begin)) > 0
        rod = smallest_distance(setup, place, frames, line=True)
        apart = np.where(left[owner], apart, rod)
    close = apart < setup.request.limits.clearance_m
    return np.asarray(np.bincount(owner, close, len(begin)) == 0)


def in_stroke(setup: PoseSetup, station: int, begin: Array, end: Array) -> bool:
    """Whether a length instrument may stay on the target during a move (J,) [rad] to (J,)."""
    if setup.instrument.measured != "length":
        return True
    place = setup.stations[station]
    count = int(np.ceil(np.abs(end - begin).max() / STEP)) + 1
    axes = begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin)
    tip = station_frames(setup, place, axes).tip
    length = np.linalg.norm(tip - place.origin[:, None], axis=0)
    return bool(((length >= setup.instrument.lower) & (length <= setup.instrument.upper)).all())


def two_opt(time: Array, order: NDArray[np.intp]) -> NDArray[np.intp]:
    """An open order of n poses that no reversal of a part shortens.

    time : (n, n) [s] of the move between two poses, symmetric.
    """
    order, n = order.copy(), order.size
    improved = True
    while improved:
        improved = False
        for i in range(n - 1):
            before = time[order[i - 1], order[i]] if i else 0.0
            last = np.arange(i + 1, n)
            after = np.zeros(last.size)
            after[:-1] = time[order[last[:-1]], order[last[:-1] + 1]]
            new_before = time[order[i - 1], order[last]] if i else np.zeros(last.size)
            new_after = np.zeros(last.size)
            new_after[:-1] = time[order[i], order[last[:-1] + 1]]
            gain = before + after - new_before - new_after
            best = int(gain.argmax())
            if gain[best] > 1e-9:
                j = int(last[best])
                order[i : j + 1] = order[i : j + 1][::-1]
                improved = True
    return order


def nearest_neighbours(time: Array, first: int) -> NDArray[np.intp]:
    """(n,) an order that goes on to the nearest pose each time; time : (n, n) [s]."""
    order, rest = [first], set(range(len(time))) - {first}
    while rest:
        order.append(min(rest, key=lambda k: time[order[-1], k]))
        rest.remove(order[-1])
    return np.array(order, dtype=np.intp)


def _order(setup: PoseSetup, poses: Candidates) -> NDArray[np.intp]:
    """Station by station, each order avoiding moves that come too close."""
    out = []
    middle = 0.5 * (setup.lower + setup.upper)
    for station in np.unique(poses.station):
        own = np.flatnonzero(poses.station == station)
        axes = poses.axes[own]
        time = _times(setup, axes[:, None], axes[None])
        moves = _Moves(setup, int(station), axes, time)
        order = nearest_neighbours(time, int(_times(setup, axes, middle).argmin()))
        for _ in range(ROUNDS):
            order = two_opt(time, order)
            if not moves.check(order):
                break
        out.append(own[order])
    return np.concatenate(out)


def _intermediate(
    setup: PoseSetup, station: int, begin: Array, end: Array, rng: np.random.Generator
) -> Array | None:
    """(2, J) [rad] poses over which a move is clear and short; None without any."""
    free = rng.uniform(setup.lower, setup.upper, (PASSED, setup.robot.joints))
    free = free[clear_moves(setup, station, free, free)]
    after = free[clear_moves(setup, station, np.broadcast_to(begin, free.shape), free)]
    before = free[clear_moves(setup, station, free, np.broadcast_to(end, free.shape))]
    after = after[np.argsort(_times(setup, begin, after))][:PAIRED]
    before = before[np.argsort(_times(setup, before, end))][:PAIRED]
    first, second = np.repeat(after, len(before), axis=0), np.tile(before, (len(after), 1))
    if not len(first):
        return None
    clear = clear_moves(setup, station, first, second)
    time = _times(setup, begin, first) + _times(setup, first, second) + _times(setup, second, end)
    if not clear.any():
        return None
    best = int(np.where(clear, time, np.inf).argmin())
    return np.stack((first[best], second[best]))


def _times(setup: PoseSetup, begin: Array, end: Array) -> Array:
    """(...) [s] of moves between axis angles (..., J) [rad] at top speed."""
    speed = setup.robot.axis_speed_max
    speed = np.where(np.isfinite(speed), speed, UNKNOWN_SPEED)
    return np.asarray((np.abs(end - begin) / speed).max(axis=-1))

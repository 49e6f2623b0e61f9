"""The order of poses and the moves between them: short, and clear of everything.

Poses are visited station by station, since a person moves the instrument or the reflector between
them. Within a station the order begins with nearest neighbours and is improved by 2-opt (Croes
1958); the length of a move is its time at the axes' top speeds. Moves are linear in the axis
angles. One that comes too close is avoided in the order, or led over two intermediate poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.planning.capsules import smallest_distance
from ballbar.planning.feasible_poses import Candidates
from ballbar.planning.stations import PoseSetup, Station, station_frames

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


def route_of(setup: PoseSetup, poses: Candidates, rng: np.random.Generator) -> Route:
    """The poses in a short order; rng : draws intermediate poses."""
    ordered = poses.part(_order(setup, poses))
    axes, station = ordered.axes, ordered.station
    passing: dict[int, Array] = {}
    blocked: list[int] = []
    released: list[int] = []
    seconds = 0.0
    for k in range(1, poses.size):
        stops = axes[k - 1 : k + 1]
        if station[k] == station[k - 1]:  # else a person moves instrument and robot
            place = setup.stations[int(station[k])]
            if setup.instrument.measured == "length":
                _, frames = _along(setup, place, stops[:1], stops[1:])
                if _outside(setup, place, frames).any():  # the instrument cannot stay on it
                    released.append(k)
            if not clear_moves(setup, int(station[k]), stops[:1], stops[1:])[0]:
                middle = _intermediate(setup, int(station[k]), stops[0], stops[1], rng)
                if middle is None:
                    blocked.append(k)
                else:
                    passing[k] = middle
                    stops = np.vstack((stops[0], middle, stops[1]))
        seconds += float(_times(setup, stops[:-1], stops[1:]).sum())
    return Route(ordered, passing, tuple(blocked), tuple(released), seconds)


def clear_moves(setup: PoseSetup, station: int, begin: Array, end: Array) -> NDArray[np.bool_]:
    """(M,) whether moves from begin to end (M, J) [rad] keep the clearance.

    A rod is on the target where the move does not leave its stroke; beams may be interrupted.
    """
    place = setup.stations[station]
    owner, frames = _along(setup, place, begin, end)
    apart = smallest_distance(setup, place, frames, line=False)
    if setup.instrument.measured == "length":
        leaving = np.bincount(owner, _outside(setup, place, frames), len(begin)) > 0
        rod = smallest_distance(setup, place, frames, line=True)
        apart = np.where(leaving[owner], apart, rod)
    close = apart < setup.request.limits.clearance_m
    return np.asarray(np.bincount(owner, close, len(begin)) == 0)


def _along(
    setup: PoseSetup, station: Station, begin: Array, end: Array
) -> tuple[NDArray[np.intp], Frames]:
    """Frames (N) along M moves between axis angles (M, J) [rad], and the move (N,) of each."""
    counts = np.ceil(np.abs(end - begin).max(axis=1) / STEP).astype(int) + 1
    owner = np.repeat(np.arange(len(begin)), counts)
    share = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])[:, None]
    return owner, station_frames(setup, station, begin[owner] + share * (end - begin)[owner])


def _outside(setup: PoseSetup, station: Station, frames: Frames) -> NDArray[np.bool_]:
    """(N,) whether the target is out of the instrument's stroke."""
    length = np.linalg.norm(frames.tip - station.origin[:, None], axis=0)
    return np.asarray((length < setup.instrument.lower) | (length > setup.instrument.upper))


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
    order, remaining = [first], set(range(len(time))) - {first}
    while remaining:
        order.append(min(remaining, key=lambda k: time[order[-1], k]))
        remaining.remove(order[-1])
    return np.array(order, dtype=np.intp)


def _order(setup: PoseSetup, poses: Candidates) -> NDArray[np.intp]:
    """Station by station, each order avoiding moves that come too close."""
    orders = []
    middle = 0.5 * (setup.lower + setup.upper)
    for station in np.unique(poses.station):
        of_station = np.flatnonzero(poses.station == station)
        axes = poses.axes[of_station]
        time = _times(setup, axes[:, None], axes[None])  # (n, n), blocked moves with their penalty
        order = nearest_neighbours(time, int(_times(setup, axes, middle).argmin()))
        for _ in range(ROUNDS):
            order = two_opt(time, order)
            begin, end = order[:-1], order[1:]
            open_ = time[begin, end] < BLOCKED
            begin, end = begin[open_], end[open_]
            if not begin.size:
                break
            clear = clear_moves(setup, int(station), axes[begin], axes[end])
            if clear.all():
                break
            begin, end = begin[~clear], end[~clear]
            time[begin, end] += BLOCKED
            time[end, begin] = time[begin, end]
        orders.append(of_station[order])
    return np.concatenate(orders)


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

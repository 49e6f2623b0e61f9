"""Characteristics of a path that was passed while an instrument followed: laps and circles.

A path that is passed several times has path accuracy and repeatability; one on a circle is a
circular test, by positions or by the length of a telescoping ball-bar about its seat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseGroup
from ballbar.ident.performance import iso_9283 as iso
from ballbar.ident.performance.attained import NOT_CORRECTED, Attained
from ballbar.ident.performance.characteristics import CIRCULAR, Listing, Statement, not_stated
from ballbar.ident.performance.iso_230_4 import (
    CircularTest,
    bidirectional_deviation,
    circular_deviation,
    circular_test,
    circular_test_of_lengths,
    least_squares_circle,
    plane_of,
)

LEAST_CYCLES = 3  # from which a spread is stated
POINTS = 100  # of a path at which its normal planes stand
UNIFORM = 6000  # instants of a log in which laps are sought
REPEATED = 1e-3  # mean square difference of laps over that of unlike parts of the path
MOVING = 0.05  # of the largest speed from which the path has begun
BEYOND = 0.03  # of a lap, before and behind it, in which planes may be passed as well
CIRCLE_ROWS = 36  # from which a commanded path may be a circle
ROUND = 0.01  # of its radius by which a commanded circle may be off


def lap_of(time: Array, q: Array) -> tuple[float, float] | None:
    """Start and period [s] of a path that is passed again and again; None where it is not.

    time : (N,) [s]; q : (N, J) [rad]. The period is the first lag at which the angles agree with
    themselves, by their mean square difference.
    """
    grid = np.linspace(time[0], time[-1], min(UNIFORM, 4 * time.size))
    angles = np.column_stack([np.interp(grid, time, column) for column in q.T])
    speed = np.abs(np.diff(angles, axis=0)).max(axis=1)
    moves = np.flatnonzero(speed > MOVING * speed.max())
    if moves.size < 3:
        return None
    grid, angles = grid[moves[0] : moves[-1] + 2], angles[moves[0] : moves[-1] + 2]
    angles = angles - angles.mean(axis=0)
    n, square = len(angles), (angles**2).sum(axis=1)
    transform = np.fft.rfft(angles, 2 * n, axis=0)
    products = np.fft.irfft((np.abs(transform) ** 2).sum(axis=1))[: n // 2 + 1]
    total = np.concatenate(([0.0], np.cumsum(square)))
    lags = np.arange(n // 2 + 1)
    difference = (total[n - lags] + total[n] - total[lags] - 2.0 * products) / (n - lags)
    unlike = difference > 0.1 * difference.max()
    again = np.flatnonzero((difference < REPEATED * difference.max()) & (unlike.cumsum() > 0))
    if not again.size:
        return None
    ends = np.flatnonzero(np.diff(again) > 1)
    last = again[ends[0]] if ends.size else again[-1]
    lag = int(again[0] + difference[again[0] : last + 1].argmin())
    return float(grid[0]), lag * float(grid[1] - grid[0])


def add_path(listing: Listing, group: PoseGroup, seen: Sequence[Attained]) -> None:
    """AT and RT of a path that was passed several times while an instrument followed."""
    assert group.time is not None  # an instrument that follows has a clock
    lap = lap_of(group.time, group.q)
    cycles = 0 if lap is None else int((group.time[-1] - lap[0]) / lap[1] + BEYOND)
    stated, spread = list[Statement](), not_stated("the path does not repeat: pass it three times")
    if lap is not None and cycles >= LEAST_CYCLES:
        for each in seen:
            paths, commanded = _laps(group.time, each, lap, cycles)
            stated.append(Statement("measured", iso.path_accuracy(paths, commanded)))
            spread = Statement("measured", iso.path_repeatability(paths))
    accuracy = (*stated, NOT_CORRECTED) if stated else (spread,) * 3
    listing.add("AT_p", "path", accuracy, cycles=cycles)
    listing.add("RT_p", "path", (spread,) * 3, cycles=cycles)


def _laps(
    time: Array, seen: Attained, lap: tuple[float, float], cycles: int
) -> tuple[Array, Array]:
    """Attained paths (n, m, 3) [m] in the normal planes of the commanded points (m, 3) [m].

    Points whose plane some lap does not pass, such as at its ends, are left out.
    """
    start, period = lap
    instants = start + period * np.linspace(0.0, 1.0, POINTS, endpoint=False)
    commanded = np.column_stack([np.interp(instants, time, column) for column in seen.commanded.T])
    paths = []
    for k in range(cycles):
        first = start + (k - BEYOND) * period
        rows = (time >= first) & (time <= first + (1.0 + 2.0 * BEYOND) * period)
        paths.append(iso.in_normal_planes(seen.points[rows], commanded))
    passed = np.isfinite(paths).all(axis=(0, 2))
    return np.stack(paths)[:, passed], commanded[passed]


def circle_of(seen: Sequence[Attained]) -> tuple[CircularTest, CircularTest] | None:
    """The circular test of positions, and that of what the identified robot leaves of them.

    seen : by the nominal and the identified robot. None where the commanded path is no full circle.
    """
    nominal, identified = seen
    if (commanded := _commanded_circle(nominal.commanded)) is None:
        return None
    centre, axes, radius = commanded
    left = nominal.commanded + identified.points - identified.commanded
    try:
        actual, rest = (
            circular_test((points - centre) @ axes.T, radius) for points in (nominal.points, left)
        )
    except ValueError:
        return None
    return actual, rest


def circle_of_lengths(
    commanded: Array, group: PoseGroup, radius: float | None
) -> CircularTest | None:
    """The circular test of a telescoping ball-bar; None where the path is no full circle.

    commanded : (N, 3) [m] path of the flange, whose angle about its own centre is that of the bar.
    radius : [m] nominal length of the bar; None: the mean length.
    """
    if (circle := _commanded_circle(commanded)) is None:
        return None
    centre, axes, _ = circle
    across = (commanded - centre) @ axes.T
    angle, length = np.arctan2(across[:, 1], across[:, 0]), group.values[:, 0]
    try:
        return circular_test_of_lengths(angle, length, radius or float(length.mean()))
    except ValueError:
        return None


def _commanded_circle(points: Array) -> tuple[Array, Array, float] | None:
    """Centre (3,) [m], axes (2, 3) and radius [m] of commanded points (N, 3) [m] on a circle."""
    if len(points) < CIRCLE_ROWS:
        return None
    origin, axes = plane_of(points)
    across = (points - origin) @ axes.T
    middle, radius = least_squares_circle(across)
    off = np.linalg.norm(points - origin - across @ axes, axis=1)
    away = np.abs(np.linalg.norm(across - middle, axis=1) - radius)
    if max(off.max(), away.max()) > ROUND * radius:
        return None
    return origin + middle @ axes, axes, radius


def add_circle(
    listing: Listing, place: str, test: CircularTest, left: CircularTest | None, *, cycles: int
) -> None:
    """Add G, F and roundness; left : what the identified robot leaves, None where not known."""
    for symbol in CIRCULAR:
        values = [None if t is None else _circular(t)[symbol] for t in (test, left)]
        if values[0] is None:
            continue
        own = not_stated("a length alone does not place the bar on the identified robot")
        if values[1] is not None:
            own = Statement("measured", values[1], reason="what the identified robot leaves")
        statements = (Statement("measured", values[0]), own, NOT_CORRECTED)
        listing.add(symbol, place, statements, cycles=cycles)


def _circular(test: CircularTest) -> dict[str, float | None]:
    """The characteristics of a circular test by their symbols; None of a direction not passed."""
    most, least = test.radial_deviation
    return {
        "G": circular_deviation(test, counter_clockwise=True),
        "G_cw": circular_deviation(test, counter_clockwise=False),
        "G(b)": bidirectional_deviation(test),
        "F_max": most,
        "F_min": least,
        "RONt": test.roundness,
    }

"""Characteristics of a path that was passed while an instrument followed: laps and circles.

A path that is passed several times has path accuracy and repeatability; one on a circle is a
circular test, by positions or by the length of a telescoping ball-bar about its seat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseGroup
from ballbar.cell.statistics import rms
from ballbar.ident.performance import iso_9283 as iso
from ballbar.ident.performance.attained import NOT_CORRECTED, Attained, noise_remark
from ballbar.ident.performance.characteristics import CIRCULAR, Listing, Statement, not_stated
from ballbar.ident.performance.iso_230_4 import (
    CircularTest,
    bidirectional_deviation,
    circular_deviation,
    circular_test,
    circular_test_of_lengths,
    least_squares_circle,
    mean_path,
    plane_of,
)

LEAST_CYCLES = 3  # from which a spread is stated
POINTS = 100  # of a path at which its normal planes stand
SAME = 0.01  # of the extent of the angles within which two instants are of one point of a path
REGULAR = 0.01  # of a lap by which laps may differ in length
BEYOND = 0.03  # of a lap, before and behind it, in which planes may be passed as well
CIRCLE_ROWS = 36  # from which a commanded path may be a circle
ROUND = 0.01  # of its radius by which a commanded circle may be off


def laps_of(time: Array, q: Array) -> tuple[Array, float]:
    """Starts (n,) [s] and length [s] of the laps of a path; no starts where none is repeated.

    time : (N,) [s]; q : (N, J) [rad]. A lap is from one passage of the fastest point of the first
    half to the next in the same direction, and passes the same angles as the first one.
    """
    speed = np.gradient(q, time, axis=0)
    reference = int(np.linalg.norm(speed[: time.size // 2], axis=1).argmax())
    extent = float(np.ptp(q, axis=0).max())
    away = np.abs(q - q[reference]).max(axis=1)
    rows = np.flatnonzero((away < SAME * extent) & (speed @ speed[reference] > 0.0))
    passages = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    starts = time[[int(own[away[own].argmin()]) for own in passages]]
    if starts.size < 2:
        return starts[:0], 0.0
    length = float(np.median(np.diff(starts)))
    starts = starts[:-1][np.abs(np.diff(starts) - length) < REGULAR * length]
    shares = length * np.linspace(0.0, 1.0, POINTS, endpoint=False)
    paths = np.stack([np.interp(starts[:, None] + shares, time, column) for column in q.T])
    off = np.abs(paths - paths[:, :1]).max(axis=(0, 2), initial=0.0)
    return starts[off < 2.0 * SAME * extent], length


def add_path(listing: Listing, group: PoseGroup, seen: Sequence[Attained]) -> None:
    """AT and RT of a path that was passed several times while an instrument followed."""
    assert group.time is not None  # an instrument that follows has a clock
    starts, length = laps_of(group.time, group.q)
    accuracy = [not_stated("the path does not repeat: pass it three times or more")] * 3
    spread = accuracy[0]
    if starts.size >= LEAST_CYCLES:
        accuracy = []
        for each in seen:
            paths, commanded = _laps(group.time, each, starts, length)
            accuracy.append(Statement("measured", iso.path_accuracy(paths, commanded)))
            spread = Statement(
                "measured", iso.path_repeatability(paths), reason=noise_remark(group)
            )
        accuracy.append(NOT_CORRECTED)
    listing.add("AT_p", "path", accuracy, cycles=starts.size)
    listing.add("RT_p", "path", (spread,) * 3, cycles=starts.size)


def _laps(time: Array, seen: Attained, starts: Array, length: float) -> tuple[Array, Array]:
    """Attained paths (n, m, 3) [m] in the normal planes of the commanded points (m, 3) [m].

    Points whose plane some lap does not pass, such as at its ends, are left out.
    """
    instants = starts[0] + length * np.linspace(0.0, 1.0, POINTS, endpoint=False)
    commanded = np.column_stack([np.interp(instants, time, column) for column in seen.commanded.T])
    paths = []
    for start in starts:
        first, last = start - BEYOND * length, start + (1.0 + BEYOND) * length
        rows = (time >= first) & (time <= last)
        paths.append(iso.in_normal_planes(seen.points[rows], commanded))
    passed = np.isfinite(paths).all(axis=(0, 2))
    return np.stack(paths)[:, passed], commanded[passed]


@dataclass(frozen=True, eq=False)
class MeasuredCircle:
    """Circular test of the mean path of all laps, and what the identified robot leaves of it."""

    test: CircularTest
    left: CircularTest | None  # None: not known
    laps: int
    noise: float  # [m] standard deviation of one point along the radius; 0 where not stated


def circle_of(seen: Sequence[Attained], group: PoseGroup) -> MeasuredCircle | None:
    """The circle of a group's positions; None where the commanded path is no full circle.

    seen : by the nominal and the identified robot.
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
        means = [circular_test(mean_path(test), radius) for test in (actual, rest)]
    except ValueError:
        return None
    noise = float(rms(group.sigma[:, :3])) * float(np.sqrt(means[0].angle.size / actual.angle.size))
    return MeasuredCircle(means[0], means[1], actual.laps, noise)


def circle_of_lengths(
    commanded: Array, group: PoseGroup, radius: float | None
) -> MeasuredCircle | None:
    """The circle of a telescoping ball-bar; None where the path is no full circle.

    commanded : (N, 3) [m] path of the flange, whose angle about its own centre is that of the bar.
    radius : [m] nominal length of the bar; None: the mean length.
    """
    if (circle := _commanded_circle(commanded)) is None:
        return None
    centre, axes, _ = circle
    across = (commanded - centre) @ axes.T
    angle, length = np.arctan2(across[:, 1], across[:, 0]), group.values[:, 0]
    nominal = radius or float(length.mean())
    try:
        test = circular_test_of_lengths(angle, length, nominal)
        mean = circular_test(mean_path(test), nominal)
    except ValueError:
        return None
    noise = float(rms(group.sigma)) * float(np.sqrt(mean.angle.size / test.angle.size))
    return MeasuredCircle(mean, None, test.laps, noise)


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


def add_circle(listing: Listing, place: str, circle: MeasuredCircle) -> None:
    """Add G, F and roundness of a circle."""
    count = circle.test.angle.size
    # expected range of so many normal values (Cramer 1946)
    width = 2.0 * circle.noise * float(np.sqrt(2.0 * np.log(count)))
    remark = f"about {width * 1e3:.2g} mm would follow from the instrument's stated noise alone"
    values, rest = _circular(circle.test), None if circle.left is None else _circular(circle.left)
    for symbol in CIRCULAR:
        if (value := values[symbol]) is None:
            continue
        own = not_stated("a length alone does not place the bar on the identified robot")
        if rest is not None:
            own = Statement("measured", rest[symbol], reason="what the identified robot leaves")
        measured = Statement("measured", value, reason=remark if width > 0.0 else "")
        listing.add(symbol, place, (measured, own, NOT_CORRECTED), cycles=circle.laps)


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

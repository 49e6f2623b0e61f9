"""Characteristics that measurements of a robot show: repeated poses, laps of a path, circles.

A path that is passed several times while an instrument follows has path accuracy and repeatability;
one on a circle is a circular test, by positions or by the length of a telescoping ball-bar about
its seat.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from ballbar.cell.arrays import Array
from ballbar.cell.logs import LengthLog
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.statistics import rms
from ballbar.ident.performance import iso_230_4 as circular
from ballbar.ident.performance import iso_9283 as iso
from ballbar.ident.performance.characteristics import (
    CIRCULAR,
    Characteristic,
    Statement,
    not_stated,
)
from ballbar.ident.performance.cube import TestCube
from ballbar.ident.performance.predicted import NORMAL, RobotPair
from ballbar.ident.performance.repeated_poses import (
    LEAST_CYCLES,
    NOT_CORRECTED,
    Attained,
    attained,
    noise_remark,
    repeated,
)

POINTS = 100  # of a path at which its normal planes stand
SAME = 0.01  # of the extent of the angles within which two instants are of one point of a path
REGULAR = 0.01  # of a lap by which laps may differ in length
BEYOND = 0.03  # of a lap, before and behind it, in which planes may be passed as well
LAG, LAG_STEP, LAG_ROWS = 5.0, 0.1, 1000  # [s], [s] and rows of the search for a clock
HARMONICS = 4  # of the angle, of lengths about a circle
CIRCLE_ROWS = 36  # from which a commanded path may be a circle
HARMONICS_OF_PATH = 30  # of the angle, that noise is taken off by
DRAWS, SEED = 50, 230  # of the noise, the same for everyone
ROUND = 0.01  # of its radius by which a commanded circle may be off

Circle = tuple[str, circular.CircularTest]


def measure(
    robots: RobotPair,
    targets: Mapping[str, Placement],
    table: PoseTable,
    cube: TestCube | None,
    *,
    radius: float | None = None,
) -> tuple[list[Characteristic], list[Circle]]:
    """Rows of a table's groups, and its circles, each with its place.

    targets : those that the result knows. radius : [m] nominal length of a telescoping ball-bar.
    """
    rows, circles = list[Characteristic](), list[Circle]()
    for group in table.groups:
        circle = None
        if group.kind.directions == 3:
            seen = attained(robots, group, targets.get(group.target))
            moved = group.motion is not None
            rows += path_rows(group, seen) if moved else repeated(group, seen, cube)
            circle = circle_of(seen, group)
        elif group.kind.names == ("length",):
            ends = robots.nominal.identified.ends(group.q)
            circle = circle_of_lengths(ends[:, :3, 3], group, radius)
        if circle is not None:
            place = "circle" if len(table.groups) == 1 else f"circle about {group.seat}"
            rows += circle_rows(place, circle)
            circles.append((place, circle.test))
    return rows, circles


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


def path_rows(group: PoseGroup, seen: Sequence[Attained]) -> Iterator[Characteristic]:
    """AT and RT of a path that was passed several times while an instrument followed.

    seen : by the nominal and the identified robot.
    """
    assert group.time is not None  # an instrument that follows has a clock
    starts, length = laps_of(group.time, group.q)
    if starts.size < LEAST_CYCLES:
        return
    laps = [_laps(group.time, each, starts, length) for each in seen]
    accuracy = {"AT_p": [iso.path_accuracy(attained[..., :3], way) for attained, way in laps]}
    spread = {"RT_p": iso.path_repeatability(laps[1][0][..., :3])}
    if (turns := laps[1][0][..., 3:]).size:
        own = [
            iso.orientation_path_accuracy(attained[..., 3:], 0.0 * way) for attained, way in laps
        ]
        accuracy |= {f"AT_{c}": v for c, *v in zip("abc", *own, strict=True)}
        spread |= zip(
            ("RT_a", "RT_b", "RT_c"), iso.orientation_path_repeatability(turns), strict=True
        )
    for symbol, values in accuracy.items():
        stated = tuple(Statement("measured", float(value)) for value in values)
        yield Characteristic(symbol, "path", (*stated, NOT_CORRECTED), starts.size)
    for symbol, value in spread.items():
        same = Statement("measured", float(value), reason=noise_remark(group) * (symbol == "RT_p"))
        yield Characteristic(symbol, "path", (same,) * 3, starts.size)


def _laps(time: Array, seen: Attained, starts: Array, length: float) -> tuple[Array, Array]:
    """Attained paths (n, m, 3) [m] in the normal planes of the commanded points (m, 3) [m], with
    turns [rad] from the commanded orientation (n, m, 6) where they were seen.

    Points whose plane some lap does not pass, such as at its ends, are left out.
    """
    instants = starts[0] + length * np.linspace(0.0, 1.0, POINTS, endpoint=False)
    commanded = np.column_stack([np.interp(instants, time, column) for column in seen.commanded.T])
    points = seen.points if seen.turns is None else np.hstack((seen.points, seen.turns))
    paths = []
    for start in starts:
        first, last = start - BEYOND * length, start + (1.0 + BEYOND) * length
        rows = (time >= first) & (time <= last)
        paths.append(iso.in_normal_planes(points[rows], commanded))
    passed = np.isfinite(paths).all(axis=(0, 2))
    return np.stack(paths)[:, passed], commanded[passed]


@dataclass(frozen=True, eq=False)
class MeasuredCircle:
    """Circular test of the mean path of all laps, and what the identified robot leaves of it."""

    test: circular.CircularTest
    left: circular.CircularTest | None  # None: not known
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
    paths = [(points - centre) @ axes.T for points in (nominal.points, left)]
    return _measured_circle(paths, radius, group)


def circle_of_lengths(
    commanded: Array, group: PoseGroup, radius: float | None
) -> MeasuredCircle | None:
    """The circle of a telescoping ball-bar; None where the path is no full circle.

    commanded : (N, 3) [m] path of the flange, whose angle about its own centre is that of the bar.
    radius : [m] nominal length of the bar; None: the mean length.
    """
    if (circle := _commanded_circle(commanded)) is None:
        return None
    across = (commanded - circle[0]) @ circle[1].T
    along = across / np.linalg.norm(across, axis=1)[:, None]
    return _measured_circle([group.values * along], radius or float(group.values.mean()), group)


def lengths_beside(commanded: Array, robot_time: Array, log: LengthLog) -> float:
    """[s] robot time of the first row of a ball-bar that logged on a clock of its own.

    commanded : (N, 3) [m] circle of the flange at robot times (N,) [s]. Lengths of either direction
    are one function of the angle, HARMONICS of it, only by the right clock; of one direction any
    lag turns the plot alone.
    """
    if (circle := _commanded_circle(commanded)) is None:
        return 0.0
    across = (commanded - circle[0]) @ circle[1].T
    angle = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    some = slice(None, None, max(1, log.t.size // LAG_ROWS))

    def left(lag: float) -> float:
        turns = np.outer(np.interp(log.t[some] + lag, robot_time, angle), np.arange(HARMONICS + 1))
        columns = np.hstack((np.cos(turns), np.sin(turns[:, 1:])))
        solution = np.linalg.lstsq(columns, log.length[some], rcond=None)[0]
        return rms(log.length[some] - columns @ solution)

    longer = float(np.ptp(robot_time) - np.ptp(log.t))
    lags = np.arange(min(0.0, longer) - LAG, max(0.0, longer) + LAG, LAG_STEP)
    best = float(lags[int(np.argmin([left(lag) for lag in lags]))])
    return float(minimize_scalar(left, bounds=(best - LAG_STEP, best + LAG_STEP)).x)


def _measured_circle(
    paths: Sequence[Array], radius: float, group: PoseGroup
) -> MeasuredCircle | None:
    """The circle of one or two paths (N, 2) [m]; None where they are no full circle."""
    try:
        tests = [circular.circular_test(path, radius) for path in paths]
        means = [circular.circular_test(circular.mean_path(test), radius) for test in tests]
    except ValueError:
        return None
    noise = rms(group.sigma[:, :3]) * float(np.sqrt(means[0].angle.size / tests[0].angle.size))
    return MeasuredCircle(means[0], means[1] if means[1:] else None, tests[0].laps, noise)


def _commanded_circle(points: Array) -> tuple[Array, Array, float] | None:
    """Centre (3,) [m], axes (2, 3) and radius [m] of commanded points (N, 3) [m] on a circle."""
    if len(points) < CIRCLE_ROWS:
        return None
    origin, axes = circular.plane_of(points)
    across = (points - origin) @ axes.T
    middle, radius = circular.least_squares_circle(across)
    off = np.linalg.norm(points - origin - across @ axes, axis=1)
    away = np.abs(np.linalg.norm(across - middle, axis=1) - radius)
    if max(off.max(), away.max()) > ROUND * radius:
        return None
    return origin + middle @ axes, axes, radius


def circle_rows(place: str, circle: MeasuredCircle) -> Iterator[Characteristic]:
    """G, F and roundness of a circle."""
    own = dict.fromkeys(CIRCULAR, not_stated("a length alone does not place the bar on the robot"))
    if circle.left is not None:
        own = _circle_statements(circle.left, circle.noise, "what the identified robot leaves")
    for symbol, measured in _circle_statements(circle.test, circle.noise).items():
        yield Characteristic(symbol, place, (measured, own[symbol], NOT_CORRECTED), circle.laps)


def _circle_statements(
    test: circular.CircularTest, noise: float, remark: str = ""
) -> dict[str, Statement]:
    """Each characteristic that was measured, with its 95 % interval by draws of the noise [m].

    Noise widens ranges of radii: the interval reaches as far below a range as draws about the
    smoothed path exceed that of the path itself, on the average, and what they vary by.
    """
    values = {symbol: v for symbol, v in _circular(test).items() if v is not None}
    if not noise:
        return {symbol: Statement("measured", v, reason=remark) for symbol, v in values.items()}
    smooth, rng, out = circular.smoothed(test, HARMONICS_OF_PATH), np.random.default_rng(SEED), {}
    noises = noise * rng.standard_normal((DRAWS, test.angle.size))
    draws = [_circular(replace(test, deviation=smooth + each)) for each in noises]
    exact = _circular(replace(test, deviation=smooth))
    for symbol, value in values.items():
        off = np.array([draw[symbol] for draw in draws], dtype=float) - (exact[symbol] or 0.0)
        bias, width = float(off.mean()), NORMAL * float(off.std(ddof=1))
        ends = value - max(bias, 0.0) - width, value - min(bias, 0.0) + width
        noted = f"noise of the instrument, as stated, adds about {bias * 1e3:.2g} mm"
        out[symbol] = Statement("measured", value, *ends, "; ".join(filter(None, (remark, noted))))
    return out


def _circular(test: circular.CircularTest) -> dict[str, float | None]:
    """The characteristics of a circular test by their symbols; None of a direction not passed."""
    most, least = test.radial_deviation
    return {
        "G": circular.circular_deviation(test, counter_clockwise=True),
        "G_cw": circular.circular_deviation(test, counter_clockwise=False),
        "G(b)": circular.bidirectional_deviation(test),
        "F_max": most,
        "F_min": least,
        "RONt": test.roundness,
    }

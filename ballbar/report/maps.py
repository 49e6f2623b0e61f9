"""Maps of the report: errors in cells of the workspace and of the sphere, and correlations.

The sphere is drawn in Lambert's equal-area projection seen from above: the upper pole in the
middle, the equator as a dashed circle, so that equal areas on the page are equal areas of the
sphere (Snyder 1987, Map Projections, USGS PP 1395, ch. 24).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import robot_frames
from ballbar.cell.statistics import rms
from ballbar.figure_style import AFTER, BEFORE, INK
from ballbar.ident.result import NamedCovariance, Residuals
from ballbar.report.drawing import (
    BOTTOM,
    INCH,
    RIGHT,
    ROW,
    SCALE_HEIGHT,
    TEXT,
    TOP,
    WIDTH,
    Axis,
    Colours,
    circle,
    colour_scale,
    figure,
    frame,
    line,
    polygon,
    shade,
    words,
)
from ballbar.report.motion import logged_joints
from ballbar.report.numbers import length_scale, significant
from ballbar.result.run_data import FittedRecording
from ballbar.units import UM, URAD

BEFORE_SCALE = ("#fbe3c6", "#f2a65a", BEFORE, "#7f3b08")
AFTER_SCALE = ("#d6e6f4", "#7fb2dc", AFTER, "#08306b")
CORRELATION_SCALE = (BEFORE, "#fbe3c6", "#ffffff", "#d6e6f4", AFTER)
EQUATOR = float(np.sqrt(2.0))  # of the projection of a unit sphere
SCALE_TOP = 0.98  # share of the cells inside the colour scale; a single far pose would pale them
_ACROSS = 15  # cells across a map of the workspace, about 0.13 m each for the IRB 2400
_ON_SPHERE = 22  # cells across the projection of the sphere
_MARKS = 4  # between the ends of an axis of the workspace, about
_LABELLED = 40  # names that stay readable on an axis of half a page
_NAMES = 250.0  # [pt] height of all names together, 8 pt each at most


@dataclass(frozen=True, eq=False)
class Sphere:
    """The sphere on which the tool was measured, robot base frame."""

    centre: Array  # (3,) [m] base of the ball-bar
    radius: float  # [m]


@dataclass(frozen=True, eq=False)
class Cells:
    """Hexagonal cells of a plane, each with one value of the points in it."""

    centres: Array  # (K, 2)
    width: float  # between opposite sides
    values: Array  # (K,)

    @property
    def top(self) -> float:
        """Upper end of a colour scale for the values."""
        return float(np.quantile(self.values, SCALE_TOP))

    def drawn(self, x: Axis, y: Axis, colours: Colours, top: float, unit: str) -> Iterator[str]:
        """The cells in the colours of a scale from 0 to `top`, their values at the cursor."""
        turn = np.radians(np.arange(30.0, 360.0, 60.0))
        corners = self.width / np.sqrt(3.0) * np.stack((np.cos(turn), np.sin(turn)), axis=1)
        yield '<g stroke="#fff" stroke-width="0.4">'
        shades = shade(colours, self.values / top)
        for centre, value, colour in zip(self.centres, self.values, shades, strict=True):
            at = centre + corners
            page = np.stack((x.at(at[:, 0]), y.at(at[:, 1])), axis=1)
            yield polygon(page, colour, title=f"{significant(float(value))} {unit}")
        yield "</g>"


def cells_of(
    points: Array, values: Array, width: float, reduce: Callable[[Array], float] = np.mean
) -> Cells:
    """Points (N, 2) with values (N,) gathered in hexagons: rows of them, every other one shifted.

    The nearer centre of two rectangular lattices is that of the hexagon (Carr et al. 1987).
    """
    steps = np.array([width, width * np.sqrt(3.0)])
    even = np.round(points / steps) * steps
    odd = (np.floor(points / steps) + 0.5) * steps
    nearer = np.linalg.norm(points - odd, axis=1) < np.linalg.norm(points - even, axis=1)
    keys = np.round(np.where(nearer[:, None], odd, even) / (0.5 * steps)).astype(int)
    distinct, cell = np.unique(keys, axis=0, return_inverse=True)
    members = np.split(values[np.argsort(cell, kind="stable")], np.cumsum(np.bincount(cell))[:-1])
    return Cells(0.5 * steps * distinct, width, np.array([reduce(m) for m in members]))


def workspace_map(
    position: Array, error: Array, spheres: Sequence[Sphere], *, label: str, colours: Colours
) -> Markup:
    """Mean error in cells of the workspace, from the side (x, z) and from above (x, y).

    position : (G, 3) [m] tool positions, robot base frame. error : (G,) [m].
    """
    factor, unit = length_scale(float(error.max()))
    low, high = position.min(axis=0), position.max(axis=0)
    width = float(high[0] - low[0]) / _ACROSS or 1.0
    views = {"from the side": 2, "from above": 1}
    maps = [cells_of(position[:, [0, c]], error * factor, width) for c in views.values()]
    top = max(1e-12, float(np.quantile(np.concatenate([m.values for m in maps]), SCALE_TOP)))
    left, across = 0.62 * INCH, 0.5 * (WIDTH - RIGHT) - 0.62 * INCH
    scale = across / float(high[0] - low[0] + 1.5 * width)  # [pt / m]
    ends = np.stack((low - 0.75 * width, high + 0.75 * width))
    bottom = SCALE_HEIGHT + 1.5 * ROW + scale * float(np.diff(ends[:, 1:], axis=0).max())
    bar = Axis(0.0, top, left, WIDTH - RIGHT - 0.07 * INCH)
    parts = list(colour_scale(bar, colours, f"{label} [{unit}]", extended=True))
    for k, ((title, column), cells) in enumerate(zip(views.items(), maps, strict=True)):
        begin = left + k * (across + left)
        (x_low, x_high), (y_low, y_high) = ends[:, 0].tolist(), ends[:, column].tolist()
        x = Axis(x_low, x_high, begin, begin + across)
        y = Axis(y_low, y_high, bottom, bottom - scale * (y_high - y_low))
        parts += frame(x, y, x.ticks(_MARKS), y.ticks(_MARKS))
        parts += cells.drawn(x, y, colours, top, unit)
        for sphere in spheres:
            centre = x.at(sphere.centre[0]).item(), y.at(sphere.centre[column]).item()
            parts.append(circle(centre, scale * sphere.radius, "#fff", width=2.0))
            parts.append(circle(centre, scale * sphere.radius, width=1.0, dashed=True))
            for a, b in ((4.0, 0.0), (0.0, 4.0)):
                ahead, behind = (centre[0] - a, centre[1] - b), (centre[0] + a, centre[1] + b)
                parts.append(line(ahead, behind, INK, width=1.0))
            parts.append(_base(x, y))
        middle = begin + 0.5 * across
        parts.append(words((middle, y.end - 5.0), title, "middle"))
        parts.append(words((middle, bottom + BOTTOM - 4.0), "x [m]", "middle"))
        place = begin - left + 10.0, 0.5 * (y.begin + y.end)
        parts.append(words(place, f"{'xyz'[column]} [m]", "middle", turned=True))
    return figure(parts, bottom + BOTTOM)


def _base(x: Axis, y: Axis) -> str:
    """The robot's base as a square."""
    a, b = x.at(np.zeros(1)).item(), y.at(np.zeros(1)).item()
    return polygon([(a - 3, b - 3), (a + 3, b - 3), (a + 3, b + 3), (a - 3, b + 3)], INK)


def tool_directions(fitted: FittedRecording) -> Array:
    """(N, 3) unit vectors from the ball-bar's base to the identified tool, robot base frame.

    At the instants of the fit.
    """
    geometry = fitted.estimate.geometry
    q = logged_joints(fitted, fitted.estimate.after.t)
    arm = robot_frames(geometry, q).tip.T - geometry.origin
    return np.asarray(arm / np.linalg.norm(arm, axis=1, keepdims=True))


def equal_area(directions: Array) -> Array:
    """(N, 2) positions on the map of unit vectors (N, 3).

    x to the right, y upwards, distance from the middle sqrt(2 - 2 z).
    """
    planar = np.hypot(directions[:, 0], directions[:, 1])
    reach = np.sqrt(np.maximum(0.0, 2.0 - 2.0 * directions[:, 2]))
    return np.asarray(directions[:, :2] * (reach / np.where(planar > 0.0, planar, 1.0))[:, None])


def sphere_map(
    directions: Array, residuals: Residuals, colours: Colours, *, angles: bool = True
) -> Markup:
    """Root mean square of position and angle residual in the cells of the sphere.

    directions : (N, 3) unit vectors. Each map has a colour scale of its own. angles : whether there
        are any; a sensed length has none.
    """
    places, parts = equal_area(directions), list[str]()
    panels = [("position", "µm", residuals.position * UM)]
    panels += [("angle", "µrad", residuals.angle * URAD)] * angles
    across = 0.5 * (WIDTH - RIGHT) - 0.1 * INCH
    bottom = SCALE_HEIGHT + across
    for k, (name, unit, vectors) in enumerate(panels):
        begin = 0.1 * INCH + k * (across + 0.1 * INCH)
        x, y = Axis(-2.05, 2.05, begin, begin + across), Axis(-2.05, 2.05, bottom, SCALE_HEIGHT)
        cells = cells_of(places, np.linalg.norm(vectors, axis=1), 4.0 / _ON_SPHERE, rms)
        top = cells.top or 1.0
        bar = Axis(0.0, top, begin + 4.0, begin + across - 0.15 * INCH)
        parts += colour_scale(bar, colours, f"{name} [{unit}]", extended=True)
        parts += cells.drawn(x, y, colours, top, unit)
        centre, unit_circle = (x.at(np.zeros(1)).item(), y.at(np.zeros(1)).item()), across / 4.1
        parts.append(circle(centre, 2.0 * unit_circle))
        parts.append(circle(centre, EQUATOR * unit_circle, dashed=True))
        for name_of_axis, (a, b) in {"x": (1.72, 0.0), "y": (0.0, 1.72)}.items():
            place = centre[0] + a * unit_circle, centre[1] - b * unit_circle + 0.35 * TEXT
            parts.append(words(place, name_of_axis, "middle"))
    return figure(parts, bottom + 4.0)


def sphere_maps(fitted: FittedRecording) -> tuple[Markup, Markup]:
    """Residuals of a recording on the sphere, before and after the fit."""
    directions, angles = tool_directions(fitted), fitted.recording.length_log is None
    before, after = fitted.estimate.before, fitted.estimate.after
    return (
        sphere_map(directions, before, BEFORE_SCALE, angles=angles),
        sphere_map(directions, after, AFTER_SCALE, angles=angles),
    )


def correlation_map(covariance: NamedCovariance, groups: Sequence[Sequence[str]]) -> Markup:
    """Correlations among the members of the groups, group by group.

    Empty text where there are more than can be read.
    """
    members = [name for group in groups for name in group]
    if not 1 < len(members) <= _LABELLED:
        return Markup()
    indices = [covariance.names.index(name) for name in members]
    block = covariance.values[np.ix_(indices, indices)]
    deviation = np.sqrt(np.diag(block))
    correlation = block / np.outer(deviation, deviation)
    size = min(8.0, _NAMES / len(members))  # [pt]
    left = 0.15 * INCH + 0.6 * size * max(map(len, members))
    side = min(30.0, (WIDTH - RIGHT - left) / len(members))
    right = max(left + side * len(members), left + 2.0 * INCH)
    parts = list(colour_scale(Axis(-1.0, 1.0, left, right), CORRELATION_SCALE, "correlation [1]"))
    parts.append('<g stroke="#fff">')
    for row, name in enumerate(members):
        y = SCALE_HEIGHT + TOP + row * side
        for column, colour in enumerate(shade(CORRELATION_SCALE, 0.5 + 0.5 * correlation[row])):
            x = left + column * side
            corners = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]
            title = f"{name}, {members[column]}: {correlation[row, column]:.2f}"
            parts.append(polygon(corners, colour, title=title))
    parts.append("</g>")
    for row, name in enumerate(members):
        y = SCALE_HEIGHT + TOP + (row + 0.5) * side + 0.35 * size
        parts.append(words((left - 4.0, y), name, "end", size=size))
    return figure(parts, SCALE_HEIGHT + 2.0 * TOP + side * len(members))

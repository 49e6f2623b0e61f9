"""Polar plot of a circular test (ISO 230-4): deviations from a circle, magnified."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.figure_style import BLUE, FAINT, GRID, INK, ORANGE, QUIET
from ballbar.ident.performance.iso_230_4 import CircularTest
from ballbar.report.drawing import INCH, ROW, TEXT, WIDTH, circle, figure, line, linear_ticks, words
from ballbar.report.numbers import length_scale

RADIUS = 1.35 * INCH  # [pt] of the least-squares circle
SHARE = 0.3  # of it that the largest deviation takes
DIVISIONS = 3  # on either side, about
MOST = 1500  # points of a drawn path
Point = tuple[float, float]  # [pt]


def polar_plot(test: CircularTest) -> Markup:
    """The figure of one circular test."""
    largest = float(np.abs(test.deviation).max()) or 1e-9
    magnification = SHARE * RADIUS / largest
    centre = (0.5 * WIDTH, ROW + 0.2 * INCH + (1.0 + SHARE) * RADIUS)
    height = centre[1] + (1.0 + SHARE) * RADIUS + 4.0 * ROW
    parts = [
        *_rings(centre, largest, magnification),
        *_axes(centre),
        *_path(test, test.counter_clockwise, centre, magnification, BLUE),
        *_path(test, ~test.counter_clockwise, centre, magnification, ORANGE),
        *_words(test, height, largest),
    ]
    return figure(parts, height)


def _rings(centre: Point, largest: float, magnification: float) -> Iterator[str]:
    """Circles of round deviations, that of none darker."""
    for value in linear_ticks(-largest, largest, 2 * DIVISIONS):
        colour = QUIET if value == 0.0 else GRID
        yield circle(centre, RADIUS + magnification * value, colour, width=0.7)


def _axes(centre: Point) -> Iterator[str]:
    """Directions every 90 degrees."""
    reach = (1.0 + SHARE) * RADIUS
    for turn in range(4):
        x, y = np.cos(turn * np.pi / 2.0), -np.sin(turn * np.pi / 2.0)
        yield line(centre, (centre[0] + reach * x, centre[1] + reach * y), FAINT)
        anchor = ("start", "middle", "end", "middle")[turn]
        place = (centre[0] + (reach + 4.0) * x, centre[1] + (reach + 0.7 * TEXT) * y + 0.35 * TEXT)
        yield words(place, f"{90 * turn}°", anchor, QUIET)


def _path(
    test: CircularTest, rows: NDArray[np.bool_], centre: Point, magnification: float, colour: str
) -> Iterator[str]:
    """The path of one direction, in stretches."""
    at = np.flatnonzero(rows)
    for part in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
        if part.size < 2:
            continue
        chosen = part[:: max(1, at.size // MOST)]
        radius: Array = RADIUS + magnification * test.deviation[chosen]
        angle = test.angle[chosen]
        x, y = centre[0] + radius * np.cos(angle), centre[1] - radius * np.sin(angle)
        path = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
        yield f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="1.2"/>'


def _words(test: CircularTest, height: float, largest: float) -> Iterator[str]:
    """Size of a division, magnification, radius, and the colours of the directions."""
    factor, unit = length_scale(largest)
    ticks = list(linear_ticks(-largest, largest, 2 * DIVISIONS))
    division = (ticks[1] - ticks[0]) * factor
    times = SHARE * test.radius / largest
    yield words(
        (0.5 * WIDTH, height - 1.6 * ROW),
        f"a division is {division:g} {unit}, magnified {times:.0f} times",
        "middle",
        INK,
    )
    ways = (
        ("counter-clockwise", test.counter_clockwise, BLUE),
        ("clockwise", ~test.counter_clockwise, ORANGE),
    )
    shown = [(name, colour) for name, rows, colour in ways if rows.any()]
    for k, (name, colour) in enumerate(shown):
        x = 0.5 * WIDTH + (k - 0.5 * len(shown) + 0.5) * 1.6 * INCH
        yield words((x, height - 0.4 * ROW), name, "middle", colour)

"""Plots of curves as SVG elements, and the figures that consist of them.

Each plot states its axes in data attributes, by which the page's script (templates/hover.js) shows
the values at the cursor; printed, or without the script, it is a still picture. A curve has two
points for each half point of width, its least and largest value there, so that no peak is lost.
Before is orange, after is blue, everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.figure_style import AFTER, BEFORE, QUIET
from ballbar.report import drawing
from ballbar.units import MM

COLUMN = 0.5  # [pt] of width of which a curve keeps its least and largest value
_X_TICKS, _TICK_HEIGHT = 6, 26.0  # ticks along x, at most; [pt] between those along y, at least


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of a plot."""

    x: Array  # (N,)
    y: Array  # (N,); NaN leaves a gap
    colour: str
    name: str = ""
    width: float = 1.1  # [pt]
    filled: bool = False  # down to the lower end of the axis
    bars: bool = False  # an upright line from the lower end of the axis to each value
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Plot:
    """Curves on common axes."""

    curves: Sequence[Curve]
    label: str  # of the y axis; two lines where it has a line break
    y: tuple[float, float] | None = None  # ends of the axis; by default those of the curves
    log: bool = False
    upright: bool = False  # whether the label is a letter before the axis
    zero: bool = False  # whether a line is drawn at 0
    names: dict[float, str] | None = None  # ticks of the y axis that are words
    legend: bool = False  # above this plot, in small letters
    spans: Sequence[tuple[float, float, str, float]] = ()  # shaded: from, to, colour, opacity
    lines: Sequence[float] = ()  # dashed upright lines
    note: str = ""  # in the upper right corner


@dataclass(frozen=True, eq=False)
class Distribution:
    """Sizes of one kind of error over many poses."""

    name: str
    values: Array  # (G,) [m]
    colour: str
    dashed: bool = False


def draw(
    plots: Sequence[Plot],
    x_label: str,
    *,
    height: float,
    width: float = drawing.WIDTH,
    x: tuple[float, float] | None = None,
    x_log: bool = False,
    legend: bool = False,
    title: str = "",
) -> Markup:
    """Plots above each other on one x axis, or each on its own where `x` is None.

    height, width : [pt] of the figure. legend : above all, of the first plot. title : above all.
    """
    rows = drawing.legend_rows(plots[0].curves, drawing.TEXT, 2.0) if legend else []
    small = [
        drawing.legend_rows(plot.curves, drawing.SMALL, drawing.LEFT) if plot.legend else []
        for plot in plots
    ]
    above = drawing.TOP + drawing.ROW * (len(rows) + bool(title) + len(small[0]))
    gap = drawing.GAP + drawing.ROW * max(map(len, small)) + drawing.ROW * (x is None)
    tall = (height - above - drawing.BOTTOM - gap * (len(plots) - 1)) / len(plots)
    parts = list(drawing.legend_lines(rows, 8.0, drawing.TEXT, 2.0))
    if title:
        parts.append(drawing.words((drawing.LEFT, drawing.TEXT), title))
    for k, plot in enumerate(plots):
        top = above + k * (tall + gap)
        x_ends = x or drawing.ends_of([curve.x for curve in plot.curves], log=x_log)
        y_ends = plot.y or drawing.ends_of([curve.y for curve in plot.curves], log=plot.log)
        across = drawing.Axis(*x_ends, drawing.LEFT, width - drawing.RIGHT, log=x_log)
        upwards = drawing.Axis(*y_ends, top + tall, top, log=plot.log)
        parts += _plot(plot, across, upwards, numbered=k == len(plots) - 1 or x is None)
        parts += drawing.legend_lines(
            small[k], top - 6.0 - drawing.ROW * (len(small[k]) - 1), drawing.SMALL, drawing.LEFT
        )
    parts.append(
        drawing.words(
            (0.5 * (drawing.LEFT + width - drawing.RIGHT), height - 4.0), x_label, "middle"
        )
    )
    return drawing.figure(parts, height, width)


def cumulative(distributions: Sequence[Distribution], *, label: str) -> Markup:
    """Share of the poses with at most so much of the quantity `label`, logarithmic axis in mm."""
    curves = []
    for d in distributions:
        ordered = np.sort(d.values) * MM
        share = np.arange(ordered.size + 1) / ordered.size * 100.0
        steps = np.repeat(ordered, 2), np.repeat(share, 2)[1:-1]  # it rises at each value
        curves.append(Curve(*steps, d.colour, d.name, width=1.6, dashed=d.dashed))
    plot = Plot(curves, "share of poses [%]", y=(0.0, 101.0))
    return draw([plot], f"{label} [mm]", height=3.5 * drawing.INCH, x_log=True, legend=True)


def order_spectra(before: Array, after: Array) -> Markup:
    """Score (J, K) of the first K orders of every joint, before the search for them and after."""
    orders = np.arange(1.0, before.shape[1] + 1.0)
    plots = [
        Plot(
            [
                Curve(orders - 0.13, first, BEFORE, "before", width=2.4, bars=True),
                Curve(orders + 0.13, last, AFTER, "after", width=2.4, bars=True),
            ],
            f"joint {joint}",
            y=(0.0, 1.05 * max(float(first.max()), float(last.max()), 1e-9)),
        )
        for joint, (first, last) in enumerate(zip(before, after, strict=True), start=1)
    ]
    return draw(
        plots,
        "order [cycles a turn]",
        height=1.25 * drawing.INCH * len(plots),
        width=2.0 * drawing.WIDTH,
        x=(0.0, orders[-1] + 1.0),
        legend=True,
    )


def _plot(plot: Plot, x: drawing.Axis, y: drawing.Axis, *, numbered: bool) -> Iterator[str]:
    yield (
        f'<g class="plot" data-x="{x.low:.9g} {x.high:.9g}" data-y="{y.low:.9g} '
        f'{y.high:.9g}" data-log="{int(x.log)} {int(y.log)}" data-box="{x.begin:.2f} '
        f'{y.end:.2f} {x.end - x.begin:.2f} {y.begin - y.end:.2f}">'
    )
    y_ticks = plot.names or y.ticks(max(2, int((y.begin - y.end) / _TICK_HEIGHT)))
    yield from drawing.frame(x, y, x.ticks(_X_TICKS), y_ticks, numbered=numbered)
    if plot.zero and y.low < 0.0 < y.high:
        (place,) = y.at(np.zeros(1))
        yield drawing.line((x.begin, place), (x.end, place), QUIET)
    for begin, end, colour, opacity in plot.spans:
        a, b = np.clip(x.at(np.array([begin, end])), x.begin, x.end)
        if b > a:
            yield (
                f'<rect x="{a:.2f}" y="{y.end:.2f}" width="{b - a:.2f}" '
                f'height="{y.begin - y.end:.2f}" fill="{colour}" opacity="{opacity:g}"/>'
            )
    for curve in plot.curves:
        yield _curve(x, y, curve)
    for place in x.at(np.array(plot.lines)):
        yield drawing.line((place, y.end), (place, y.begin), AFTER, width=1.0, dashed=True)
    if plot.note:
        yield drawing.words((x.end, y.end + drawing.TEXT), plot.note, "end", QUIET)
    middle = 0.5 * (y.begin + y.end)
    for k, text in enumerate(plot.label.split("\n")):
        at = 10.0 + k * 1.15 * drawing.TEXT
        if plot.upright:
            yield drawing.words((at, middle + 0.35 * drawing.TEXT), text)
        else:
            yield drawing.words((at, middle), text, "middle", turned=True)
    yield "</g>"


def _curve(x_axis: drawing.Axis, y_axis: drawing.Axis, curve: Curve) -> str:
    x, y = x_axis.at(curve.x), y_axis.at(curve.y)
    left, right, top, bottom = x_axis.begin, x_axis.end, y_axis.end, y_axis.begin
    visible = np.flatnonzero((x[1:] >= left) & (x[:-1] <= right))  # with the ends beyond the plot
    rows = slice(visible[0], visible[-1] + 2) if visible.size else slice(0)
    x, y = np.clip(x[rows], left, right), np.clip(y[rows], top, bottom)
    style = f'fill="none" stroke="{curve.colour}" stroke-width="{curve.width:g}"'
    if curve.dashed:
        style += ' stroke-dasharray="5 3"'
    if curve.bars:
        path = "".join(f"M{a:.1f} {b:.2f}V{bottom:.1f}" for a, b in zip(x, y, strict=True))
    else:
        extremes = _extremes(x, y)
        path = "".join(_pieces(x[extremes], y[extremes]))
    if curve.filled and path:
        path += f"V{bottom:.1f}H{x[0]:.1f}Z"
        style = f'fill="{curve.colour}"'
    return f'<path data-name="{escape(curve.name)}" d="{path}" {style}/>'


def _extremes(x: Array, y: Array) -> NDArray[np.intp]:
    """Indices of the least and the largest y of each column, in order; all of a short curve."""
    if x.size < 2 or x.size <= 2.0 * (x[-1] - x[0]) / COLUMN or (np.diff(x) < 0.0).any():
        return np.arange(x.size)
    begins = np.diff(np.floor(x / COLUMN), prepend=-1.0) != 0.0
    starts, column = np.flatnonzero(begins), np.cumsum(begins)

    def least(values: Array) -> NDArray[np.intp]:
        return np.lexsort((np.where(np.isnan(values), np.inf, values), column))[starts]

    return np.unique(np.concatenate((least(y), least(-y))))


def _pieces(x: Array, y: Array) -> Iterator[str]:
    """Path commands, with a gap at each NaN."""
    command = "M"
    for a, b, gap in zip(x.tolist(), y.tolist(), np.isnan(y).tolist(), strict=True):
        if gap:
            command = "M"
            continue
        yield f"{command}{a:.1f} {b:.2f}"
        command = "L"

"""Plots of curves as SVG elements, drawn directly: two hundred times as fast as Matplotlib.

The style is that of the other figures (ballbar.figure_style). Each plot states its axes in data
attributes, by which the page's script (templates/hover.js) shows the values at the cursor; printed,
or without the script, it is a still picture. A curve has two points for each half point of width,
its least and largest value there, so that no peak is lost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from ballbar.figure_style import AFTER, GRID, INK, QUIET
from cell.arrays import Array

INCH = 72.0  # [pt]
WIDTH = 4.6 * INCH  # [pt] 442 px: two figures side by side on a page of 1000 px
LEFT, RIGHT, BOTTOM, TOP, GAP = 0.76 * INCH, 0.16 * INCH, 0.46 * INCH, 0.1 * INCH, 0.16 * INCH
ROW = 0.21 * INCH  # [pt] of a legend or a title
TEXT, SMALL = 10.0, 7.5  # [pt]
COLUMN = 0.5  # [pt] width of which a curve keeps its least and largest value
_X_TICKS, _TICK_HEIGHT = 6, 26.0  # ticks along x, at most; [pt] between those along y, at least
_STEPS = (1.0, 2.0, 5.0, 10.0)
_LEAST = 3  # ticks of an axis
_MORE_LABELS = 2.0  # decades below which 2 and 5 of a logarithmic axis are labelled too


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of a plot."""

    x: Array  # (N,)
    y: Array  # (N,); NaN leaves a gap
    colour: str
    name: str = ""
    width: float = 1.1  # [pt]
    filled: bool = False  # down to the lower end of the axis


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


def draw(
    plots: Sequence[Plot],
    x_label: str,
    *,
    height: float,
    x: tuple[float, float] | None = None,
    legend: bool = False,
    title: str = "",
) -> Markup:
    """Plots above each other on one x axis, or each on its own where `x` is None.

    height : [pt] of the figure. legend : above all, of the first plot. title : likewise.
    """
    above = TOP + ROW * (legend or bool(title))
    gap = GAP + ROW * any(plot.legend for plot in plots) + ROW * (x is None)
    above += ROW * plots[0].legend
    tall = (height - above - BOTTOM - gap * (len(plots) - 1)) / len(plots)
    parts = [f'<svg viewBox="0 0 {WIDTH:g} {height:g}" class="plots" font-size="{TEXT:g}">']
    if legend:
        parts += _legend(plots[0].curves, 8.0, TEXT)
    if title:
        parts.append(_text((LEFT, TEXT), title))
    for k, plot in enumerate(plots):
        last = k == len(plots) - 1
        own = x or _ends([curve.x for curve in plot.curves])
        box = _Box(
            left=LEFT,
            top=above + k * (tall + gap),
            wide=WIDTH - LEFT - RIGHT,
            tall=tall,
            x=own,
            y=plot.y or _ends([curve.y for curve in plot.curves], log=plot.log),
            plot=plot,
        )
        parts += _plot(box, numbered=last or x is None)
        if plot.legend:
            parts += _legend(plot.curves, box.top - 6.0, SMALL)
    parts.append(_text((LEFT + 0.5 * (WIDTH - LEFT - RIGHT), height - 4.0), x_label, "middle"))
    return Markup("\n".join([*parts, "</svg>"]))


@dataclass(frozen=True, eq=False)
class _Box:
    """The area of a plot [pt], and the map of values to points of the page."""

    left: float
    top: float
    wide: float
    tall: float
    x: tuple[float, float]  # ends of the axes
    y: tuple[float, float]
    plot: Plot

    @property
    def bottom(self) -> float:
        return self.top + self.tall

    def across(self, x: Array) -> Array:
        """[pt] of values on the x axis."""
        return self.left + (x - self.x[0]) / (self.x[1] - self.x[0]) * self.wide

    def upwards(self, y: Array) -> Array:
        """[pt] of values on the y axis."""
        low, high = self.y
        if self.plot.log:
            y, low, high = np.log10(y), np.log10(low), np.log10(high)
        return np.asarray(self.bottom - (y - low) / (high - low) * self.tall)


def _plot(box: _Box, *, numbered: bool) -> Iterator[str]:
    plot = box.plot
    yield (
        f'<g class="plot" data-x="{box.x[0]:.9g} {box.x[1]:.9g}" data-y="{box.y[0]:.9g} '
        f'{box.y[1]:.9g}" data-log="{int(plot.log)}" data-box="{box.left:.2f} {box.top:.2f} '
        f'{box.wide:.2f} {box.tall:.2f}">'
    )
    yield from _grid(box, numbered=numbered)
    for begin, end, colour, opacity in plot.spans:
        a, b = np.clip(box.across(np.array([begin, end])), box.left, box.left + box.wide)
        if b > a:
            yield (
                f'<rect x="{a:.2f}" y="{box.top:.2f}" width="{b - a:.2f}" '
                f'height="{box.tall:.2f}" fill="{colour}" opacity="{opacity:g}"/>'
            )
    for curve in plot.curves:
        yield _curve(box, curve)
    for at in plot.lines:
        (x,) = box.across(np.array([at]))
        yield _line((x, box.top), (x, box.bottom), AFTER, width=1.0, dashed=True)
    yield _line((box.left, box.top), (box.left, box.bottom), QUIET)
    yield _line((box.left, box.bottom), (box.left + box.wide, box.bottom), QUIET)
    if plot.note:
        yield _text((box.left + box.wide, box.top + TEXT), plot.note, "end", QUIET)
    yield from _label(box)
    yield "</g>"


def _grid(box: _Box, *, numbered: bool) -> Iterator[str]:
    """Grid, ticks and their numbers."""
    right = box.left + box.wide
    ticks = _ticks(*box.x, _X_TICKS)
    for x, text in zip(box.across(np.array(list(ticks))), ticks.values(), strict=True):
        yield _line((x, box.top), (x, box.bottom), GRID)
        yield _line((x, box.bottom), (x, box.bottom + 3.0), QUIET)
        if numbered:
            yield _text((x, box.bottom + 4.0 + TEXT), text, "middle")
    if box.plot.names is not None:
        ticks = box.plot.names
    elif box.plot.log:
        ticks = _log_ticks(*box.y)
    else:
        ticks = _ticks(*box.y, max(2, int(box.tall / _TICK_HEIGHT)))
    for y, text in zip(box.upwards(np.array(list(ticks))), ticks.values(), strict=True):
        yield _line((box.left, y), (right, y), GRID)
        yield _line((box.left - 3.0, y), (box.left, y), QUIET)
        yield _text((box.left - 5.0, y + 0.35 * TEXT), text, "end")
    if box.plot.zero and box.y[0] < 0.0 < box.y[1]:
        (y,) = box.upwards(np.zeros(1))
        yield _line((box.left, y), (right, y), QUIET)


def _label(box: _Box) -> Iterator[str]:
    lines, middle = box.plot.label.split("\n"), box.top + 0.5 * box.tall
    for k, line in enumerate(lines):
        x = 10.0 + k * 1.15 * TEXT
        if box.plot.upright:
            yield _text((x, middle + 0.35 * TEXT), line)
        else:
            turned = f' transform="rotate(-90 {x:.1f} {middle:.1f})"'
            yield _text((x, middle), line, "middle", extra=turned)


def _curve(box: _Box, curve: Curve) -> str:
    x, y = box.across(curve.x), box.upwards(curve.y)
    right = box.left + box.wide
    shown = np.flatnonzero((x[1:] >= box.left) & (x[:-1] <= right))  # with the ends beyond the box
    rows = slice(shown[0], shown[-1] + 2) if shown.size else slice(0)
    x, y = np.clip(x[rows], box.left, right), np.clip(y[rows], box.top, box.bottom)
    extremes = _extremes(x, y)
    path = "".join(_pieces(x[extremes], y[extremes]))
    style = f'fill="none" stroke="{curve.colour}" stroke-width="{curve.width:g}"'
    if curve.filled and path:
        path += f"V{box.bottom:.1f}H{x[0]:.1f}Z"
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


def _legend(curves: Sequence[Curve], y: float, size: float) -> Iterator[str]:
    x = LEFT if size < TEXT else 2.0
    for curve in curves:
        if curve.name:
            yield _line((x, y), (x + 1.6 * size, y), curve.colour, width=1.5)
            yield _text((x + 2.0 * size, y + 0.35 * size), curve.name, size=size)
            x += (3.2 + 0.6 * len(curve.name)) * size


def _ends(values: Sequence[Array], *, log: bool = False) -> tuple[float, float]:
    """Ends of an axis around values, a twentieth beyond them."""
    every = np.concatenate([v.ravel() for v in values])
    every = every[np.isfinite(every) & ((every > 0.0) | (not log))]
    if not every.size:
        return (0.1, 1.0) if log else (0.0, 1.0)
    low, high = float(every.min()), float(every.max())
    if log:
        margin = max((high / low) ** 0.05, 1.05)
        return low / margin, high * margin
    margin = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def _ticks(low: float, high: float, most: int) -> dict[float, str]:
    """Round values between two ends, and their text."""
    raw = (high - low) / max(1, most)
    size = 10.0 ** np.floor(np.log10(raw))
    step = float(size * min(s for s in _STEPS if s * size >= raw * (1.0 - 1e-9)))
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    values = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0)
    if values.size < _LEAST:
        return _ticks(low, high, most + 1)
    return {float(v): f"{v + 0.0:.{decimals}f}".replace("-", "\u2212") for v in values}


def _log_ticks(low: float, high: float) -> dict[float, str]:
    factors = (1.0, 2.0, 5.0) if np.log10(high / low) < _MORE_LABELS else (1.0,)
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    values = [f * 10.0**d for d in decades for f in factors]
    return {v: f"{v:g}" for v in values if low <= v <= high}


def _line(
    begin: tuple[float, float],
    end: tuple[float, float],
    colour: str,
    *,
    width: float = 0.7,
    dashed: bool = False,
) -> str:
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    (x, y), (to_x, to_y) = begin, end
    return (
        f'<line x1="{x:.2f}" y1="{y:.2f}" x2="{to_x:.2f}" y2="{to_y:.2f}" stroke="{colour}" '
        f'stroke-width="{width:g}"{dash}/>'
    )


def _text(
    at: tuple[float, float],
    text: str,
    anchor: str = "start",
    colour: str = INK,
    *,
    size: float = TEXT,
    extra: str = "",
) -> str:
    x, y = at
    return (
        f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" fill="{colour}" '
        f'font-size="{size:g}"{extra}>{escape(text)}</text>'
    )

"""Elements of the report's figures as SVG text: axes, lines, words, legends, colour scales.

Text stays text, so that the page's own font is used; nothing depends on the hour or on a random
number. A page needs no library to draw, and a figure takes a millisecond.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from markupsafe import Markup, escape

from ballbar.cell.arrays import Array
from ballbar.figure_style import GRID, INK, QUIET, rgb

INCH = 72.0  # [pt]
WIDTH = 4.6 * INCH  # [pt] 442 px: two figures side by side on a page of 1000 px
LEFT, RIGHT, BOTTOM, TOP, GAP = 0.76 * INCH, 0.16 * INCH, 0.46 * INCH, 0.1 * INCH, 0.16 * INCH
ROW = 0.21 * INCH  # [pt] of a legend or a title
TEXT, SMALL = 10.0, 7.5  # [pt]
SCALE_HEIGHT = 0.52 * INCH  # [pt] room of a colour scale
_STEPS = (1.0, 2.0, 5.0, 10.0)
_LEAST = 3  # ticks of an axis
_MORE_LABELS = 2.0  # decades below which 2 and 5 of a logarithmic axis are labelled too
_PATCHES = 48  # of a colour scale
_SCALE_TICKS = 5  # intervals between the numbers of a colour scale, at most

Colours = Sequence[str]  # at even steps from the least value to the largest


@dataclass(frozen=True)
class Axis:
    """Values between two ends, and where the ends lie on the page."""

    low: float
    high: float
    begin: float  # [pt] of `low`
    end: float  # [pt] of `high`
    log: bool = False

    def at(self, values: Array) -> Array:
        """[pt] of values."""
        low, high = self.low, self.high
        if self.log:
            values, low, high = np.log10(values), np.log10(low), np.log10(high)
        return np.asarray(self.begin + (values - low) / (high - low) * (self.end - self.begin))

    def ticks(self, most: int) -> dict[float, str]:
        """Round values and their text, about `most` of them on a linear axis."""
        if not self.log:
            return linear_ticks(self.low, self.high, most)
        decades = np.log10(self.high / self.low)
        factors = (1.0, 2.0, 5.0) if decades < _MORE_LABELS else (1.0,)
        first, last = (int(np.floor(np.log10(end))) for end in (self.low, self.high))
        values = [f * 10.0**d for d in range(first, last + 2) for f in factors]
        return {v: f"{v:g}" for v in values if self.low <= v <= self.high}


class Named(Protocol):
    """A curve as a legend shows it."""

    @property
    def name(self) -> str: ...
    @property
    def colour(self) -> str: ...
    @property
    def dashed(self) -> bool: ...


def figure(parts: Sequence[str], height: float, width: float = WIDTH) -> Markup:
    """The element of a figure of a width and a height [pt]."""
    head = f'<svg viewBox="0 0 {width:g} {height:g}" class="plots" font-size="{TEXT:g}">'
    return Markup("\n".join([head, *parts, "</svg>"]))


def ends_of(values: Sequence[Array], *, log: bool = False) -> tuple[float, float]:
    """Ends of an axis around values, a twentieth beyond them."""
    together = np.concatenate([v.ravel() for v in values])
    together = together[np.isfinite(together) & ((together > 0.0) | (not log))]
    if not together.size:
        return (0.1, 1.0) if log else (0.0, 1.0)
    low, high = float(together.min()), float(together.max())
    if log:
        margin = max((high / low) ** 0.05, 1.05)
        return low / margin, high * margin
    margin = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def linear_ticks(low: float, high: float, most: int) -> dict[float, str]:
    """Round values between two ends, and their text."""
    raw = (high - low) / max(1, most)
    size = 10.0 ** np.floor(np.log10(raw))
    step = float(size * min(s for s in _STEPS if s * size >= raw * (1.0 - 1e-9)))
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    values = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0)
    if values.size < _LEAST:
        return linear_ticks(low, high, most + 1)
    return {float(v): f"{v + 0.0:.{decimals}f}".replace("-", "\u2212") for v in values}


def frame(
    x: Axis, y: Axis, x_ticks: dict[float, str], y_ticks: dict[float, str], *, numbered: bool = True
) -> Iterator[str]:
    """Grid, ticks and their numbers; numbered : whether the x axis shows them."""
    for place, text in zip(x.at(np.array(list(x_ticks))), x_ticks.values(), strict=True):
        yield line((place, y.end), (place, y.begin), GRID)
        yield line((place, y.begin), (place, y.begin + 3.0), QUIET)
        if numbered:
            yield words((place, y.begin + 4.0 + TEXT), text, "middle")
    for place, text in zip(y.at(np.array(list(y_ticks))), y_ticks.values(), strict=True):
        yield line((x.begin, place), (x.end, place), GRID)
        yield line((x.begin - 3.0, place), (x.begin, place), QUIET)
        yield words((x.begin - 5.0, place + 0.35 * TEXT), text, "end")
    yield line((x.begin, y.end), (x.begin, y.begin), QUIET)
    yield line((x.begin, y.begin), (x.end, y.begin), QUIET)


def legend_rows(curves: Sequence[Named], size: float, left: float) -> list[list[Named]]:
    """The named curves of a legend row by row; size : [pt] of letters, left : [pt] of its edge."""
    rows: list[list[Named]] = []
    x = WIDTH
    for curve in curves:
        if not curve.name:
            continue
        if x + _legend_width(curve, size) > WIDTH:
            rows.append([])
            x = left
        rows[-1].append(curve)
        x += _legend_width(curve, size)
    return rows


def legend_lines(
    rows: Sequence[Sequence[Named]], y: float, size: float, left: float
) -> Iterator[str]:
    """Lines and names of `legend_rows`, the first row about y [pt]."""
    for row in rows:
        x = left
        for curve in row:
            begin, end = (x, y), (x + 1.6 * size, y)
            yield line(begin, end, curve.colour, width=1.5, dashed=curve.dashed)
            yield words((x + 2.0 * size, y + 0.35 * size), curve.name, size=size)
            x += _legend_width(curve, size)
        y += ROW


def _legend_width(curve: Named, size: float) -> float:
    return (3.2 + 0.6 * len(curve.name)) * size


def shade(colours: Colours, shares: Array) -> list[str]:
    """Colours of shares (N,) of a scale, from 0 to 1; what lies beyond has that of the end."""
    steps, channels = np.linspace(0.0, 1.0, len(colours)), np.array([rgb(c) for c in colours])
    mixed = np.stack([np.interp(shares, steps, channel) for channel in channels.T], axis=-1)
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.round(mixed).astype(int).tolist()]


def colour_scale(
    axis: Axis, colours: Colours, label: str, *, extended: bool = False
) -> Iterator[str]:
    """A colour scale at the top of a figure; extended : values beyond its upper end are drawn."""
    top, tall = 2.0 * ROW, 0.09 * INCH
    yield words((0.5 * (axis.begin + axis.end), TEXT), label, "middle")
    wide = (axis.end - axis.begin) / _PATCHES
    for k, colour in enumerate(shade(colours, (np.arange(_PATCHES) + 0.5) / _PATCHES)):
        x = axis.begin + k * wide
        yield (
            f'<rect x="{x:.2f}" y="{top:.2f}" width="{wide + 0.3:.2f}" height="{tall:.2f}" '
            f'fill="{colour}"/>'
        )
    if extended:
        corners = [(0.0, 0.0), (0.07 * INCH, 0.5 * tall), (0.0, tall)]
        yield polygon([(axis.end + x, top + y) for x, y in corners], colours[-1])
    ticks = axis.ticks(_SCALE_TICKS)
    for x, text in zip(axis.at(np.array(list(ticks))), ticks.values(), strict=True):
        yield line((x, top - 3.0), (x, top), QUIET)
        yield words((x, top - 5.0), text, "middle")


def line(
    begin: tuple[float, float],
    end: tuple[float, float],
    colour: str,
    *,
    width: float = 0.7,
    dashed: bool = False,
) -> str:
    """A straight line between two points [pt]."""
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    (x, y), (to_x, to_y) = begin, end
    return (
        f'<line x1="{x:.2f}" y1="{y:.2f}" x2="{to_x:.2f}" y2="{to_y:.2f}" stroke="{colour}" '
        f'stroke-width="{width:g}"{dash}/>'
    )


def polygon(corners: Iterable[Iterable[float]], fill: str, *, title: str = "") -> str:
    """A filled polygon; title : what the browser shows at the cursor."""
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in corners)
    if title:
        return f'<path d="M{path}Z" fill="{fill}"><title>{escape(title)}</title></path>'
    return f'<path d="M{path}Z" fill="{fill}"/>'


def circle(
    centre: tuple[float, float],
    radius: float,
    colour: str = INK,
    *,
    width: float = 0.8,
    dashed: bool = False,
) -> str:
    """The outline of a circle."""
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    return (
        f'<circle cx="{centre[0]:.2f}" cy="{centre[1]:.2f}" r="{radius:.2f}" fill="none" '
        f'stroke="{colour}" stroke-width="{width:g}"{dash}/>'
    )


def words(
    place: tuple[float, float],
    text: str,
    anchor: str = "start",
    colour: str = INK,
    *,
    size: float = TEXT,
    turned: bool = False,
) -> str:
    """Text whose base line begins, has its middle or ends at a place [pt].

    turned : whether it runs upwards.
    """
    x, y = place
    rotated = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    return (
        f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" fill="{colour}" '
        f'font-size="{size:g}"{rotated}>{escape(text)}</text>'
    )

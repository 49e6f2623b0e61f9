"""Figures of the report, each as one SVG element of half a page's width.

Before is orange, after is blue, everywhere (distinct in every kind of colour vision: ends of
ColorBrewer's PuOr and RdBu). Text stays text, so that the page's own font is used; nothing depends
on the hour or on a random number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.rcsetup import cycler
from matplotlib.ticker import MaxNLocator, MultipleLocator
from matplotlib.transforms import blended_transform_factory

from ballbar.figure_style import AFTER, BEFORE, DASHED, FRAME, INK, LINES, svg_text
from ballbar.report.numbers import length_scale
from ballbar.units import MM
from cell.arrays import Array

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

BEFORE_SCALE = LinearSegmentedColormap.from_list(
    "before", ["#fbe3c6", "#f2a65a", BEFORE, "#7f3b08"]
)
AFTER_SCALE = LinearSegmentedColormap.from_list("after", ["#d6e6f4", "#7fb2dc", AFTER, "#08306b"])
CORRELATION_SCALE = LinearSegmentedColormap.from_list(
    "correlation", [BEFORE, "#fbe3c6", "#ffffff", "#d6e6f4", AFTER]
)
WIDTH = 4.6  # [in] 442 px: two figures side by side on a page of 1000 px, one on a phone
LEFT, RIGHT, BOTTOM, TOP, GAP = 0.76, 0.16, 0.46, 0.1, 0.16  # [in] around plots; between rows
LEGEND_ROW = 0.21  # [in]
BAR_TOP = 0.66  # [in] room of a colour scale above plots
_LABEL = 0.02, 0.17  # [in] left edge and upper edge of the labels of an axis, from the room's end
_BAR_TICKS = 5  # intervals between the numbers of a colour scale, at most
SCALE_TOP = 0.98  # share of the cells inside the colour scale; a single far pose would pale them
_CELLS = 14  # across a map, about 0.13 m each for the IRB 2400
STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    "svg.hashsalt": "ballbar-report",
    "font.size": 10.0,
    "axes.labelsize": 10.0,
    "axes.titlesize": 10.0,
    "axes.unicode_minus": True,
    "axes.prop_cycle": cycler(color=LINES),
    "grid.linewidth": 0.7,
    "text.color": INK,
    "legend.fontsize": 10.0,
    "lines.linewidth": 1.1,
    "path.simplify_threshold": 0.2,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a cumulative figure."""

    label: str
    values: Array  # (G,) [m]
    colour: str
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Sphere:
    """The sphere on which the tool was measured, robot base frame."""

    centre: Array  # (3,) [m] base of the ball-bar
    radius: float  # [m]


def cumulative(curves: Sequence[Curve], *, label: str) -> Markup:
    """Share of the poses with at most so much of the quantity `label`, logarithmic axis in mm."""
    with matplotlib.rc_context(STYLE):
        figure, axes = one_panel(3.5, top=TOP + LEGEND_ROW * len(curves))
        for curve in curves:
            ordered = np.sort(curve.values) * MM
            share = np.arange(1, ordered.size + 1) / ordered.size * 100.0
            axes.step(
                ordered,
                share,
                where="post",
                color=curve.colour,
                linestyle="--" if curve.dashed else "-",
                label=curve.label,
                linewidth=1.6,
            )
        axes.set(
            xscale="log", ylim=(0.0, 101.0), xlabel=f"{label} [mm]", ylabel="share of poses [%]"
        )
        axes.xaxis.set_major_formatter("{x:g}")
        legend_above(figure, columns=1)
        return as_svg(figure)


def workspace_map(
    position: Array,
    error: Array,
    spheres: Sequence[Sphere],
    *,
    label: str,
    colours: LinearSegmentedColormap,
) -> Markup:
    """Mean error in hexagonal cells of the workspace, from the side (x, z) and from above (x, y).

    position : (G, 3) [m] tool positions, robot base frame. error : (G,) [m].
    """
    factor, unit = length_scale(float(error.max()))
    views = ((2, "from the side"), (1, "from above"))
    with matplotlib.rc_context(STYLE):
        figure, panels = plots(3.6, columns=2, left=0.62, top=BAR_TOP + LEGEND_ROW, sharex=True)
        maps = []
        for axes, (column, title) in zip(panels, views, strict=True):
            maps.append(_map(axes, position[:, [0, column]], error * factor, colours))
            axes.set(xlabel="x [m]", ylabel=f"{'xyz'[column]} [m]", title=title)
            for sphere in spheres:
                _mark(axes, sphere, column)
        means = np.concatenate([cells.get_array().compressed() for cells in maps])
        for cells in maps:
            cells.set_clim(0.0, float(np.quantile(means, SCALE_TOP)))
        colour_bar(maps[0], panels, f"{label} [{unit}]", extend="max")
        return as_svg(figure)


def order_spectra(before: Array, after: Array) -> Markup:
    """Score (J, K) of the first K orders of every joint, before the search for them and after."""
    orders = np.arange(1, before.shape[1] + 1)
    with matplotlib.rc_context(STYLE):
        figure, panels = plots(1.25 * len(before), rows=len(before), width=2.0 * WIDTH, sharex=True)
        for joint, (axes, first, last) in enumerate(zip(panels, before, after, strict=True)):
            axes.vlines(orders - 0.13, 0.0, first, color=BEFORE, linewidth=2.4, label="before")
            axes.vlines(orders + 0.13, 0.0, last, color=AFTER, linewidth=2.4, label="after")
            axes.set(ylabel=f"joint {joint + 1}", xlim=(0.0, orders[-1] + 1))
            axes.set_ylim(bottom=0.0)
        panels[0].legend(ncols=2, loc="upper right")
        panels[-1].set_xlabel("order [cycles a turn]")
        return as_svg(figure)


def one_panel(height: float, *, top: float = TOP) -> tuple[Figure, Axes]:
    """A figure of a height [in] with one plot; top : [in] room above it."""
    figure, (axes,) = plots(height, top=top)
    return figure, axes


def plots(
    height: float,
    *,
    rows: int = 1,
    columns: int = 1,
    width: float = WIDTH,
    left: float = LEFT,
    bottom: float = BOTTOM,
    top: float = TOP,
    gap: float = GAP,
    sharex: bool = False,
    sharey: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure of a height [in] with equal plots, row after row.

    left : [in] room of labels left of every plot. bottom, top : [in] room at the ends of the
        figure. gap : [in] between rows. A layout that measures the texts would double the time.
    """
    figure = Figure(figsize=(width, height))
    grid = {
        "left": left / width,
        "right": 1.0 - RIGHT / width,
        "bottom": bottom / height,
        "top": 1.0 - top / height,
        "wspace": left / ((width - RIGHT) / columns - left),
        "hspace": gap / ((height - bottom - top + gap) / rows - gap),
    }
    panels = figure.subplots(
        rows, columns, sharex=sharex, sharey=sharey, squeeze=False, gridspec_kw=grid
    )
    inches = figure.dpi_scale_trans
    for axes in panels.flat:
        x, y = axes.get_position().x0 * width - left + _LABEL[0], _LABEL[1]
        axes.xaxis.set_label_coords(0.5, y, blended_transform_factory(axes.transAxes, inches))
        axes.yaxis.set_label_coords(x, 0.5, blended_transform_factory(inches, axes.transAxes))
        axes.yaxis.label.set_va("top")  # a second line goes towards the plot
    return figure, panels.ravel().tolist()


def legend_above(figure: Figure, *, columns: int = 2) -> None:
    """The legend above the plots."""
    figure.legend(loc="upper left", ncols=columns, handlelength=1.6, borderaxespad=0.0)


def colour_bar(cells: Any, panels: Sequence[Axes], label: str, *, extend: Any = "neither") -> None:
    """The colour scale of `cells` at the top of the figure, above their plots."""
    figure, first, last = cells.figure, panels[0].get_position(), panels[-1].get_position()
    height = figure.get_figheight()
    axes = figure.add_axes((first.x0, 1.0 - 0.5 / height, last.x1 - first.x0, 0.09 / height))
    bar = figure.colorbar(
        cells,
        cax=axes,
        orientation="horizontal",
        ticklocation="top",
        ticks=MaxNLocator(_BAR_TICKS, steps=[1, 2, 5, 10]),
        extend=extend,
    )
    bar.outline.set_visible(False)
    figure.text(0.5 * (first.x0 + last.x1), 0.995, label, ha="center", va="top")


def _map(axes: Axes, position: Array, error: Array, colours: LinearSegmentedColormap) -> Any:
    """Cells of one view; position : (G, 2) [m], error : (G,)."""
    axes.set_aspect("equal", anchor="S")
    axes.xaxis.set_major_locator(MultipleLocator(0.5))
    axes.yaxis.set_major_locator(MultipleLocator(0.5))
    x, y = position.T
    return axes.hexbin(
        x, y, C=error, gridsize=_CELLS, linewidths=0.4, edgecolors="white", cmap=colours
    )


def _mark(axes: Axes, sphere: Sphere, column: int) -> None:
    """Robot base, ball-bar base and sphere; column : of the positions that points upwards."""
    centre = float(sphere.centre[0]), float(sphere.centre[column])
    halo: dict[str, Any] = {"edgecolor": "white", "linewidth": 2.0}
    line: dict[str, Any] = {"edgecolor": INK, "linewidth": 1.0, "linestyle": DASHED}
    for style in (halo, line):
        axes.add_patch(Circle(centre, sphere.radius, fill=False, **style))
    axes.plot(*centre, marker="+", color=INK, markersize=8, linestyle="none")
    axes.plot(0.0, 0.0, marker="s", color=INK, markersize=6, linestyle="none")


def as_svg(figure: Figure) -> Markup:
    """The bare element, safe to put into a page: no text from files is in it.

    Without XML header, metadata, namespaces (HTML knows them) and names that would clash in a page.
    """
    text = svg_text(figure)
    text = text[text.index("<svg") :]
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", text)
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.DOTALL)
    return Markup(re.sub(r"\n\s*", "\n", text).strip())

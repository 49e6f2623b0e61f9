"""Figures of the report, each as one SVG element of half a page's width.

Before is orange, after is blue, everywhere (told apart by every kind of colour vision: ColorBrewer PuOr and RdBu ends).
Text stays text, so that the page's own font is used; nothing depends on the hour or on a random number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MultipleLocator

from ballbar.figure_style import FRAME, INK, QUIET, svg_text
from ballbar.report.numbers import length_scale
from cell.arrays import Array

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

BEFORE, AFTER = "#d9740b", "#1f66ad"
BEFORE_SCALE = LinearSegmentedColormap.from_list(
    "before", ["#fbe3c6", "#f2a65a", "#d9740b", "#7f3b08"]
)
AFTER_SCALE = LinearSegmentedColormap.from_list(
    "after", ["#d6e6f4", "#7fb2dc", "#1f66ad", "#08306b"]
)
WIDTH = 4.6  # [in] 442 px: two figures side by side on a page of 1000 px, one on a phone
_SCALE_TOP = (
    0.98  # share of the cells inside the colour scale; a single far pose would pale all others
)
_CELLS = 14  # across a map, about 0.13 m each for the IRB 2400
_HISTOGRAM_HALF_WIDTH = 5.0  # standard deviations; wider where the residuals are
STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    "svg.hashsalt": "ballbar-report",
    "font.size": 10.0,
    "axes.labelsize": 10.0,
    "axes.titlesize": 10.0,
    "axes.unicode_minus": True,
    "grid.linewidth": 0.7,
    "text.color": INK,
    "legend.fontsize": 10.0,
    "lines.linewidth": 1.1,
    "path.simplify_threshold": 0.2,
    "figure.constrained_layout.use": True,
}


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a cumulative figure."""

    label: str
    values: Array  # (G,) [m]
    colour: str
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Landmarks:
    """What helps to find one's way on a map of the cell, robot base frame."""

    origin: Array  # (3,) [m] centre of the ball-bar's sphere
    radius: float  # [m]


def cumulative(curves: Sequence[Curve], *, label: str) -> str:
    """Share of the grid's poses with at most so much of what `label` says, over a logarithmic axis in mm."""
    with matplotlib.rc_context(STYLE):
        figure, axes = _one_panel(3.5)
        for curve in curves:
            ordered = np.sort(curve.values) * 1e3
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
        figure.legend(loc="outside upper left", ncols=1, handlelength=1.6)
        return as_svg(figure)


def workspace_map(
    position: Array, error: Array, landmarks: Landmarks, *, label: str, before: bool
) -> str:
    """Mean error over the workspace in hexagonal cells, seen from the side (x, z) and from above (x, y).

    position : (G, 3) [m] tool positions, robot base frame. error : (G,) [m].
    """
    factor, unit = length_scale(float(error.max()))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 3.95))
        panels = figure.subplots(1, 2, sharex=True)
        colours = BEFORE_SCALE if before else AFTER_SCALE
        cells = [
            _view(axes, position, error * factor, column, colours)
            for axes, column in zip(panels, (2, 1), strict=True)
        ]
        top = float(
            np.quantile(np.concatenate([one.get_array().compressed() for one in cells]), _SCALE_TOP)
        )
        for axes, one, column, title in zip(
            panels, cells, (2, 1), ("from the side", "from above"), strict=True
        ):
            one.set_clim(0.0, top)
            axes.set_title(title)
            _mark(axes, landmarks, column)
        bar = figure.colorbar(
            cells[0],
            ax=panels,
            location="top",
            aspect=38,
            pad=0.02,
            extend="max",
            label=f"{label} [{unit}]",
        )
        bar.outline.set_visible(False)
        return as_svg(figure)


def norms_over_time(t: Array, before: Array, after: Array, *, label: str, clock: str) -> str:
    """Norms of (N, 3) residuals on one logarithmic axis; `before` and `after` already in the unit of `label`."""
    with matplotlib.rc_context(STYLE):
        figure, axes = _one_panel(2.9)
        for values, colour, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
            norm = np.linalg.norm(values, axis=1)
            axes.plot(t, np.where(norm > 0.0, norm, np.nan), color=colour, label=name)
        axes.set(
            yscale="log", xlabel=f"time on the {clock} clock [s]", ylabel=label, xlim=(t[0], t[-1])
        )
        axes.set_ylim(bottom=_floor(after))
        axes.yaxis.set_major_formatter("{x:g}")
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        return as_svg(figure)


def components_over_time(t: Array, values: Array, *, label: str, clock: str) -> str:
    """Three residual components (N, 3) after the fit, in the unit of `label`, on one scale."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 3.5))
        panels = figure.subplots(3, 1, sharex=True, sharey=True)
        for axes, column, name in zip(panels, values.T, "xyz", strict=True):
            axes.axhline(0.0, color=QUIET, linewidth=0.6)
            axes.plot(t, column, color=AFTER, linewidth=0.8)
            axes.set(ylabel=name, xlim=(t[0], t[-1]))
            axes.yaxis.label.set(rotation=0, va="center")
        panels[2].set_xlabel(f"time on the {clock} clock [s]")
        panels[0].set_title(label, loc="left")
        return as_svg(figure)


def tension_over_time(t: Array, tension: Array, *, clock: str) -> str:
    """Force in the rod [N], pulling positive."""
    with matplotlib.rc_context(STYLE):
        figure, axes = _one_panel(2.4)
        axes.axhline(0.0, color=QUIET, linewidth=0.6)
        axes.plot(t, tension, color=AFTER)
        axes.set(
            xlabel=f"time on the {clock} clock [s]",
            ylabel="force in the rod [N]",
            xlim=(t[0], t[-1]),
        )
        return as_svg(figure)


def whitened_histogram(whitened: Array) -> str:
    """Residuals in units of their standard deviation, with the unit normal curve that they should follow."""
    values = whitened.ravel()
    half = max(_HISTOGRAM_HALF_WIDTH, float(np.ceil(np.quantile(np.abs(values), 0.999))))
    x = np.linspace(-half, half, 201)
    outside = int((np.abs(values) > half).sum())
    with matplotlib.rc_context(STYLE):
        figure, axes = _one_panel(2.9)
        axes.hist(
            values,
            bins=np.linspace(-half, half, 51).tolist(),
            density=True,
            color="#8fb4d9",
            label="residuals after",
        )
        axes.plot(
            x,
            np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi),
            color=INK,
            linewidth=1.4,
            label="unit normal",
        )
        axes.set(
            xlabel="whitened residual [standard deviations]", ylabel="density", xlim=(-half, half)
        )
        axes.annotate(
            f"{outside} of {values.size} beyond ±{half:g}",
            (1.0, 0.97),
            xycoords="axes fraction",
            ha="right",
            va="top",
            color=QUIET,
        )
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        return as_svg(figure)


def _one_panel(height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDTH, height))
    return figure, figure.subplots()


def _view(
    axes: Axes, position: Array, error: Array, column: int, colours: LinearSegmentedColormap
) -> Any:
    """Cells of one view: x to the right, `column` of the positions upwards."""
    axes.set(aspect="equal", xlabel="x [m]", ylabel=f"{'xyz'[column]} [m]")
    axes.xaxis.set_major_locator(MultipleLocator(0.5))
    axes.yaxis.set_major_locator(MultipleLocator(0.5))
    return axes.hexbin(
        position[:, 0],
        position[:, column],
        C=error,
        gridsize=_CELLS,
        linewidths=0.4,
        edgecolors="white",
        cmap=colours,
    )


def _mark(axes: Axes, landmarks: Landmarks, column: int) -> None:
    """Robot base, ball-bar base and the sphere on which the tool was measured."""
    centre = (float(landmarks.origin[0]), float(landmarks.origin[column]))
    axes.add_patch(Circle(centre, landmarks.radius, fill=False, edgecolor="white", linewidth=2.0))
    axes.add_patch(
        Circle(
            centre,
            landmarks.radius,
            fill=False,
            edgecolor=INK,
            linewidth=1.0,
            linestyle=(0, (4, 3)),
        )
    )
    axes.plot(*centre, marker="+", color=INK, markersize=8, linestyle="none")
    axes.plot(0.0, 0.0, marker="s", color=INK, markersize=6, linestyle="none")


def _floor(after: Array) -> float | None:
    """Where the logarithmic axis ends: a norm that passes through zero would stretch it without end."""
    norm = np.linalg.norm(after, axis=1)
    positive = norm[norm > 0.0]
    return float(np.quantile(positive, 0.02)) / 2.0 if positive.size else None


def as_svg(figure: Figure) -> str:
    """The bare element: no XML header, no metadata, no namespaces (HTML knows them), no names that would clash in one page."""
    text = svg_text(figure, transparent=True)
    text = text[text.index("<svg") :]
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", text)
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.DOTALL)
    return re.sub(r"\n\s*", "\n", text).strip()

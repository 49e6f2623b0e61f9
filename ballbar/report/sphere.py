"""Residuals where they arose: maps on the ball-bar's sphere, and the correlations of what is told apart badly.

The sphere is drawn in Lambert's equal-area projection seen from above: the upper pole in the middle, the equator as a dashed
circle, so that equal areas on the page are equal areas of the sphere (Snyder 1987, Map Projections, USGS PP 1395, ch. 24).
"""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ballbar.figure_style import INK
from ballbar.report.figures import AFTER_SCALE, BEFORE_SCALE, STYLE, WIDTH, as_svg
from ballbar.result.run_data import Joined
from cell.arrays import Array
from cell.geometry import robot_frames
from ident.identify import Residuals

EQUATOR = float(np.sqrt(2.0))  # of the projection of a unit sphere
_CELLS = 22
_SCALE_TOP = 0.98  # share of the cells inside the colour scale
_CORRELATION_SCALE = LinearSegmentedColormap.from_list(
    "correlation", ["#d9740b", "#fbe3c6", "#ffffff", "#d6e6f4", "#1f66ad"]
)
_LABELLED = 40  # names that stay readable on an axis of half a page
_NAMES = 250.0  # [pt] height of all names together, 8 pt each at most


def tool_directions(one: Joined) -> Array:
    """(N, 3) unit vectors from the ball-bar's base to the identified tool at the instants of the fit, robot base frame."""
    result, log = one.identification, one.recording.robot_log
    t = result.after.t if result.clock is None else result.clock.robot_time(result.after.t)
    q = np.stack([np.interp(t, log.t, column) for column in log.q.T], axis=1)
    arm = robot_frames(result.geometry, q).tip.T - result.geometry.origin
    return np.asarray(arm / np.linalg.norm(arm, axis=1, keepdims=True))


def equal_area(directions: Array) -> Array:
    """(N, 2) place on the map of unit vectors (N, 3): x to the right, y upwards, distance from the middle sqrt(2 - 2 z)."""
    planar = np.hypot(directions[:, 0], directions[:, 1])
    reach = np.sqrt(np.maximum(0.0, 2.0 - 2.0 * directions[:, 2]))
    return np.asarray(directions[:, :2] * (reach / np.where(planar > 0.0, planar, 1.0))[:, None])


def sphere_map(directions: Array, residuals: Residuals, *, before: bool) -> str:
    """Root mean square of position and angle residual in the cells of the sphere, each with a colour scale of its own."""
    place = equal_area(directions)
    panels = (("position [µm]", residuals.position), ("angle [µrad]", residuals.angle))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 2.95))
        for axes, (title, vectors) in zip(figure.subplots(1, 2), panels, strict=True):
            _panel(
                figure,
                axes,
                place,
                np.linalg.norm(vectors, axis=1) * 1e6,
                title,
                BEFORE_SCALE if before else AFTER_SCALE,
            )
        return as_svg(figure)


def correlation_map(
    covariance: Array, names: tuple[str, ...], groups: list[tuple[str, ...]]
) -> str:
    """Correlations among the members of the groups, group by group; empty text where there are more than can be read."""
    members = [name for group in groups for name in group]
    if not 1 < len(members) <= _LABELLED:
        return ""
    index = [names.index(name) for name in members]
    some = covariance[np.ix_(index, index)]
    deviation = np.sqrt(np.diag(some))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 4.2))
        axes = figure.subplots()
        axes.grid(visible=False)
        shown = axes.pcolormesh(
            some / np.outer(deviation, deviation),
            cmap=_CORRELATION_SCALE,
            vmin=-1.0,
            vmax=1.0,
            edgecolors="white",
        )
        size = min(8.0, _NAMES / len(members))
        ticks = np.arange(len(members)) + 0.5
        axes.set_xticks([])  # in the same order
        axes.set_yticks(ticks, members, fontsize=size)
        axes.invert_yaxis()
        axes.set_aspect("equal")
        figure.colorbar(
            shown, ax=axes, location="top", label="correlation [1]", aspect=38, pad=0.02
        ).outline.set_visible(False)
        return as_svg(figure)


def _panel(
    figure: Figure,
    axes: Axes,
    place: Array,
    norm: Array,
    title: str,
    colours: LinearSegmentedColormap,
) -> None:
    axes.set(aspect="equal", xlim=(-2.05, 2.05), ylim=(-2.05, 2.05))
    axes.axis("off")
    for radius, dash in ((2.0, (0, ())), (EQUATOR, (0, (4, 3)))):
        axes.add_patch(
            Circle((0.0, 0.0), radius, fill=False, edgecolor=INK, linewidth=0.8, linestyle=dash)
        )
    for x, y, name in ((1.0, 0.0, "x"), (0.0, 1.0, "y")):
        axes.annotate(name, (x * 1.72, y * 1.72), ha="center", va="center", color=INK)
    cells: Any = axes.hexbin(
        place[:, 0],
        place[:, 1],
        C=norm,
        reduce_C_function=_rms,
        gridsize=_CELLS,
        extent=(-2, 2, -2, 2),
        linewidths=0.2,
        cmap=colours,
    )
    top = float(np.quantile(cells.get_array().compressed(), _SCALE_TOP))
    cells.set_clim(0.0, top if top > 0.0 else 1.0)
    figure.colorbar(
        cells, ax=axes, location="top", aspect=22, pad=0.02, extend="max", label=title
    ).outline.set_visible(False)


def _rms(values: Array | list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

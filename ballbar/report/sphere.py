"""Residuals where they arise: maps on the ball-bar's sphere, and correlations of the unknowns.

The sphere is drawn in Lambert's equal-area projection seen from above: the upper pole in the
middle, the equator as a dashed circle, so that equal areas on the page are equal areas of the
sphere (Snyder 1987, Map Projections, USGS PP 1395, ch. 24).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Circle

from ballbar.figure_style import DASHED, INK
from ballbar.replay.motion import logged_joints
from ballbar.report.figures import (
    BAR_TOP,
    CORRELATION_SCALE,
    SCALE_TOP,
    STYLE,
    TOP,
    as_svg,
    colour_bar,
    plots,
)
from ballbar.result.run_data import FittedRecording
from ballbar.units import UM, URAD
from cell.arrays import Array
from cell.geometry import robot_frames
from cell.statistics import rms
from ident.result import NamedCovariance, Residuals

EQUATOR = float(np.sqrt(2.0))  # of the projection of a unit sphere
_CELLS = 22
_LABELLED = 40  # names that stay readable on an axis of half a page
_POINTS = 72.0  # an inch
_NAMES = 250.0  # [pt] height of all names together, 8 pt each at most


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
    directions: Array,
    residuals: Residuals,
    colours: LinearSegmentedColormap,
    *,
    angles: bool = True,
) -> Markup:
    """Root mean square of position and angle residual in the cells of the sphere.

    directions : (N, 3) unit vectors. Each map has a colour scale of its own. angles : whether there
        are any; a sensed length has none.
    """
    x, y = equal_area(directions).T
    panels = [("position [µm]", residuals.position * UM)]
    panels += [("angle [µrad]", residuals.angle * URAD)] * angles
    with matplotlib.rc_context(STYLE):
        figure, grid = plots(2.95, columns=2, left=0.1, bottom=0.02, top=BAR_TOP)
        for axes in grid[len(panels) :]:
            axes.remove()
        for axes, (title, vectors) in zip(grid, panels, strict=False):
            _draw_sphere(axes)
            cells: Any = axes.hexbin(
                x,
                y,
                C=np.linalg.norm(vectors, axis=1),
                reduce_C_function=rms,
                gridsize=_CELLS,
                extent=(-2, 2, -2, 2),
                linewidths=0.2,
                cmap=colours,
            )
            top = float(np.quantile(cells.get_array().compressed(), SCALE_TOP))
            cells.set_clim(0.0, top if top > 0.0 else 1.0)
            colour_bar(cells, [axes], title, extend="max")
        return as_svg(figure)


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
    size = min(8.0, _NAMES / len(members))  # [pt]
    left = 0.15 + 0.6 * size * max(map(len, members)) / _POINTS
    with matplotlib.rc_context(STYLE):
        figure, (axes,) = plots(4.2, left=left, bottom=TOP, top=BAR_TOP)
        axes.grid(visible=False)
        cells = axes.pcolormesh(
            block / np.outer(deviation, deviation),
            cmap=CORRELATION_SCALE,
            vmin=-1.0,
            vmax=1.0,
            edgecolors="white",
        )
        axes.set_xticks([])  # in the same order
        axes.set_yticks(np.arange(len(members)) + 0.5, members, fontsize=size)
        axes.invert_yaxis()
        axes.set_aspect("equal")
        colour_bar(cells, [axes], "correlation [1]")
        return as_svg(figure)


def _draw_sphere(axes: Axes) -> None:
    """Lower pole and equator as circles, and the robot's axes."""
    axes.set(aspect="equal", xlim=(-2.05, 2.05), ylim=(-2.05, 2.05))
    axes.axis("off")
    for radius, dash in ((2.0, "-"), (EQUATOR, DASHED)):
        circle = Circle(
            (0.0, 0.0), radius, fill=False, edgecolor=INK, linewidth=0.8, linestyle=dash
        )
        axes.add_patch(circle)
    for x, y, name in ((1.72, 0.0, "x"), (0.0, 1.72, "y")):
        axes.annotate(name, (x, y), ha="center", va="center", color=INK)

"""Plots of the claims' page as SVG: curves with their spread over the seeds, and rankings.

A ranking shows how often each parameter is among the largest errors of a run.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from ballbar.claims.file import PlatePlot, Plot, Ranking
from ballbar.claims.table import Evidence, places, selected
from ballbar.figure_style import (
    BLUE,
    BROWN,
    DASHED,
    FRAME,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    QUIET,
    RED,
    TEAL,
    svg_text,
    to_hundredths,
)
from ballbar.plan.plate_figure import draw_deflection
from cell.geometry import table_of_names
from ident.thesis.tables import THESIS_COSTS

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

# of a cost, the same in every plot
_COLOURS = {"C_l": BLUE, "C_P": ORANGE, "C_Ptheta": GREEN, "C_T": PURPLE, "ml": "#222222"}
_OTHERS = (RED, TEAL, BROWN, GREY)
_WIDTH, _HEIGHT = 560, 300  # [px]
_MAX_TICKS = 8  # varied values up to which each of them is a tick
_STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    "svg.hashsalt": "claims",
    "font.size": 9.0,
    "axes.prop_cycle": cycler(color=_OTHERS),
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
}


def plot_svg(plot: Plot | Ranking | PlatePlot, evidence: Evidence) -> bytes:
    """A plot as an SVG file.

    Raises InputError where the plot names runs or columns that do not exist.
    """
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH / 96.0, _HEIGHT / 96.0), layout="constrained")
        axes = figure.add_subplot()
        axes.set_title(plot.title, fontsize=9.0, loc="left", color=INK)
        if isinstance(plot, PlatePlot):
            draw_deflection(axes)
        elif isinstance(plot, Plot):
            _curves(axes, plot, selected(evidence.table, plot.rows))
        else:
            _ranking(axes, plot, selected(evidence.table, plot.rows))
        if axes.get_legend_handles_labels()[0]:
            below = isinstance(plot, Ranking)  # many names on the x axis, few lines
            figure.legend(
                loc="outside lower center" if below else "outside right upper",
                ncols=4 if below else 1,
                borderpad=0.0,
            )
        return to_hundredths(svg_text(figure)).encode()


def line_label(value: object) -> str:
    """Label of a line: C_T for `transform`; other values as they are."""
    return THESIS_COSTS.get(str(value), str(value))


def _curves(axes: Axes, plot: Plot, table: pd.DataFrame) -> None:
    for value in dict.fromkeys(table[plot.lines]):
        rows = selected(table, {plot.lines: value})
        groups = rows[plot.y].abs().groupby(rows[plot.x], sort=True)
        median, label = groups.median(), line_label(value)
        x = plot.x_factor * median.index.to_numpy(dtype=float)
        y = median.to_numpy(dtype=float)
        (line,) = axes.plot(x, y, "o-", label=label, color=_COLOURS.get(label))
        colour = line.get_color()
        axes.fill_between(x, groups.min(), groups.max(), color=colour, alpha=0.15, linewidth=0.0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    values = sorted(set(plot.x_factor * table[plot.x].dropna()))
    if len(values) <= _MAX_TICKS:
        axes.set_xticks(values, [f"{x:g}" for x in values])
        axes.minorticks_off()
    if plot.limit is not None:
        axes.axhline(plot.limit, color=QUIET, linewidth=0.8, linestyle=DASHED)
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(plot.y_label)


def _ranking(axes: Axes, plot: Ranking, table: pd.DataFrame) -> None:
    shares: dict[str, dict[str, float]] = {}  # line -> parameter -> share of runs
    if plot.thesis:
        shares["thesis"] = {name: n / plot.thesis_runs for name, n in plot.thesis.items()}
    for value in dict.fromkeys(table[plot.lines]):
        runs = places(selected(table, {plot.lines: value}), plot.places)
        counts = Counter(name for run in runs for name in run)
        shares[line_label(value)] = {name: count / len(runs) for name, count in counts.items()}
    ranked = set().union(*shares.values())
    names = [name for name in table_of_names(ranked).names if name in ranked]
    width = 0.8 / len(shares)
    for k, (label, share) in enumerate(shares.items()):
        x = [i + (k - 0.5 * (len(shares) - 1)) * width for i in range(len(names))]
        heights = [share.get(name, 0.0) for name in names]
        axes.bar(x, heights, width=width, label=label, color=_COLOURS.get(label))
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(f"share of runs, among the {plot.places} largest")

"""Plots of the claims' page as SVG: curves with their spread over the seeds, and rankings.

A ranking shows how often each parameter is among the largest errors of a run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from ballbar import figure_style
from ballbar.cell.geometry import table_of_names
from ballbar.claims.file import (
    AnyPlot,
    CurvesPlot,
    GroupedBars,
    IdentifiedPlot,
    PlatePlot,
    Ranking,
    RunsPlot,
)
from ballbar.claims.kinds import DISTANCE, LARGEST
from ballbar.claims.table import IDENTIFIED, ClaimEvidence, places, selected
from ballbar.ident.thesis.names import ParameterSet
from ballbar.ident.thesis.tables import THESIS_COSTS
from ballbar.plan.plate_figure import draw_deflection

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

# of a cost, the same in every plot
_COLOURS = {
    "C_l": figure_style.BLUE,
    "C_P": figure_style.ORANGE,
    "C_Ptheta": figure_style.GREEN,
    "C_T": figure_style.PURPLE,
    "ml": "#222222",
}
_OTHERS = (figure_style.RED, figure_style.TEAL, figure_style.BROWN, figure_style.GREY)
_WIDTH, _HEIGHT = 560, 300  # [px]
PANELS = {DISTANCE: "distance [mm|mrad]", LARGEST: "largest error [mm|mrad]"}  # thesis sec. 3.4
_MAX_TICKS = 8  # varied values up to which each of them is a tick
_STYLE: dict[RcKeyType, Any] = {
    **figure_style.FRAME,
    "svg.hashsalt": "claims",
    "font.size": 9.0,
    "axes.prop_cycle": cycler(color=_OTHERS),
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
}


def plot_svg(plot: AnyPlot, evidence: Mapping[ParameterSet, ClaimEvidence]) -> bytes:
    """A plot as an SVG file.

    Raises InputError where the plot names runs or columns that do not exist.
    """
    results = PANELS if isinstance(plot, CurvesPlot) and plot.y == DISTANCE else {"": ""}
    with matplotlib.rc_context(_STYLE):
        size = (len(results) * _WIDTH / 96.0, _HEIGHT / 96.0)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(1, len(results), squeeze=False)[0]
        panels[0].set_title(plot.title, fontsize=9.0, loc="left", color=figure_style.INK)
        for axes, (column, label) in zip(panels, results.items(), strict=True):
            if isinstance(plot, PlatePlot):
                draw_deflection(axes)
            elif isinstance(plot, CurvesPlot):
                _curves(axes, plot, evidence, column or plot.y, label or plot.y_label)
            elif isinstance(plot, IdentifiedPlot):
                _identified(axes, plot, evidence["core"])
            elif isinstance(plot, GroupedBars):
                _groups(axes, plot, evidence["core"])
            else:
                _ranking(axes, plot, evidence)
        if panels[-1].get_legend_handles_labels()[0]:
            below = not isinstance(plot, CurvesPlot)  # many names on the x axis, few lines
            figure.legend(
                *panels[-1].get_legend_handles_labels(),
                loc="outside lower center" if below else "outside right upper",
                ncols=4 if below else 1,
                borderpad=0.0,
            )
        return figure_style.to_hundredths(figure_style.svg_text(figure)).encode()


def line_label(value: object) -> str:
    """Label of a line: C_T for `transform`; other values as they are."""
    return THESIS_COSTS.get(str(value), str(value))


def _curves(
    axes: Axes,
    plot: CurvesPlot,
    evidence: Mapping[ParameterSet, ClaimEvidence],
    y: str,
    y_label: str,
) -> None:
    values: set[float] = set()
    for parameters, own in evidence.items():
        for k, (value, rows) in enumerate(_lines(plot, own)):
            values |= set(plot.x_factor * rows[plot.x].dropna())
            groups = rows[y].abs().groupby(rows[plot.x], sort=True)
            label = line_label(value)
            x = plot.x_factor * groups.median().index.to_numpy(dtype=float)
            median = groups.median().to_numpy(dtype=float)
            colour = _COLOURS.get(label, _OTHERS[k % len(_OTHERS)])
            if parameters == "core":
                axes.plot(x, median, "o-", label=label, color=colour)
                low, high = groups.min(), groups.max()
                axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0.0)
            else:
                axes.plot(x, median, linestyle=figure_style.DASHED, color=colour)
    figure_style.logarithmic(axes, "x", "y")
    ticks = sorted(values)
    if len(ticks) <= _MAX_TICKS:
        axes.set_xticks(ticks, [f"{x:g}" for x in ticks])
        axes.minorticks_off()
    if plot.limit is not None and y == plot.y:
        axes.axhline(plot.limit, color=figure_style.QUIET, linewidth=0.8, linestyle=":")
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(y_label)


def _ranking(axes: Axes, plot: Ranking, evidence: Mapping[ParameterSet, ClaimEvidence]) -> None:
    shares: dict[str, dict[str, float]] = {}  # line -> parameter -> share of runs
    if plot.thesis:
        shares["thesis"] = {name: n / plot.thesis_runs for name, n in plot.thesis.items()}
    for parameters, own in evidence.items():
        for value, rows in _lines(plot, own):
            runs = places(rows, plot.places)
            counts = Counter(name for run in runs for name in run)
            label = line_label(value) + ("" if parameters == "core" else ", all parameters")
            shares[label] = {name: count / len(runs) for name, count in counts.items()}
    _bars(axes, _parameters(shares), shares, f"share of runs, among the {plot.places} largest")


def _identified(axes: Axes, plot: IdentifiedPlot, evidence: ClaimEvidence) -> None:
    heights: dict[str, dict[str, float]] = {}  # line -> parameter -> mm | mrad
    for value, rows in _lines(plot, evidence):
        first = rows.sort_values("seed").iloc[0]
        errors = first[[name for name in rows.columns if name.startswith(IDENTIFIED)]].dropna()
        heights[line_label(value)] = {
            str(name).removeprefix(IDENTIFIED): float(error) for name, error in errors.items()
        }
    _bars(axes, _parameters(heights), heights, "identified - nominal [mm|mrad]")


def _groups(axes: Axes, plot: GroupedBars, evidence: ClaimEvidence) -> None:
    heights = {
        line_label(value): {
            str(name): float(group[plot.y].median()) for name, group in rows.groupby(plot.groups)
        }
        for value, rows in _lines(plot, evidence)
    }
    names = list(dict.fromkeys(selected(evidence.table, plot.rows)[plot.groups]))
    _bars(axes, names, heights, plot.y_label)
    axes.tick_params(axis="x", labelrotation=0)
    figure_style.logarithmic(axes, "y")
    if plot.limit is not None:
        axes.axhline(plot.limit, color=figure_style.QUIET, linewidth=0.8, linestyle=":")


def _lines(plot: RunsPlot, evidence: ClaimEvidence) -> Iterator[tuple[object, pd.DataFrame]]:
    """The value of each line of a plot, and its runs."""
    table = selected(evidence.table, plot.rows)
    for value in dict.fromkeys(table[plot.lines]):
        yield value, selected(table, {plot.lines: value})


def _parameters(heights: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Names of all parameters that have a height, in the order of the table."""
    shown = set().union(*heights.values())
    return [name for name in table_of_names(shown).names if name in shown]


def _bars(
    axes: Axes, names: Sequence[str], heights: Mapping[str, Mapping[str, float]], y_label: str
) -> None:
    """Bars beside one another at each name, a colour for each label; no bar where it has none."""
    width = 0.8 / len(heights)
    for k, (label, own) in enumerate(heights.items()):
        x = [i + (k - 0.5 * (len(heights) - 1)) * width for i in range(len(names))]
        bars = [own.get(name, 0.0) for name in names]
        axes.bar(x, bars, width=width, label=label, color=_COLOURS.get(label))
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(y_label)

"""The figures of the claims' page, as SVG: curves with their spread over the seeds, and how often a parameter is among the worst."""

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
from ballbar.figure_style import FRAME, INK, QUIET, svg_text, to_hundredths
from ballbar.plan.plate_figure import draw_deflection
from cell.geometry import NAMES
from ident.thesis.tables import THESIS_COSTS

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

_COLOURS = {
    "C_l": "#1f66ad",
    "C_P": "#d9740b",
    "C_Ptheta": "#2a8f5b",
    "C_T": "#8a4fa0",
    "ml": "#222222",
}  # the same in every figure
_OTHERS = ("#b03030", "#1a8a9a", "#8a6d1e", "#8a949c")
_WIDTH, _HEIGHT = 560, 300  # [px]
_TICKS_OF_VALUES = 8  # so many varied values are ticks themselves
_STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    "svg.hashsalt": "claims",
    "font.size": 9.0,
    "axes.prop_cycle": cycler(color=_OTHERS),
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
}


def drawn(plot: Plot | Ranking | PlatePlot, evidence: Evidence) -> bytes:
    """A figure as an SVG file. Raises InputError where the plot names runs or columns that are not there."""
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
            below = isinstance(plot, Ranking)  # many names across, few lines
            figure.legend(
                loc="outside lower center" if below else "outside right upper",
                ncols=4 if below else 1,
                borderpad=0.0,
            )
        return to_hundredths(svg_text(figure)).encode()


def line_label(value: object) -> str:
    """C_T for `transform`; other values as they are."""
    return THESIS_COSTS.get(str(value), str(value))


def _curves(axes: Axes, plot: Plot, table: pd.DataFrame) -> None:
    for value in dict.fromkeys(table[plot.lines]):
        rows = selected(table, {plot.lines: value})
        groups = rows[plot.y].abs().groupby(rows[plot.x], sort=True)
        x, middle = (
            plot.x_factor * groups.median().index.to_numpy(dtype=float),
            groups.median().to_numpy(dtype=float),
        )
        label = line_label(value)
        (line,) = axes.plot(x, middle, "o-", label=label, color=_COLOURS.get(label))
        axes.fill_between(
            x, groups.min(), groups.max(), color=line.get_color(), alpha=0.15, linewidth=0.0
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    shown = sorted(set(plot.x_factor * table[plot.x].dropna()))
    if len(shown) <= _TICKS_OF_VALUES:
        axes.set_xticks(shown, [f"{x:g}" for x in shown])
        axes.minorticks_off()
    if plot.limit is not None:
        axes.axhline(plot.limit, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(plot.y_label)


def _ranking(axes: Axes, plot: Ranking, table: pd.DataFrame) -> None:
    groups = {
        line_label(v): selected(table, {plot.lines: v}) for v in dict.fromkeys(table[plot.lines])
    }
    counts = {
        label: Counter(name for run in places(rows, plot.places) for name in run)
        for label, rows in groups.items()
    }
    shares = {
        label: {name: count[name] / len(groups[label]) for name in count}
        for label, count in counts.items()
    }
    if plot.thesis:
        shares = {
            "thesis": {name: n / plot.thesis_runs for name, n in plot.thesis.items()},
            **shares,
        }
    names = [name for name in NAMES if any(name in share for share in shares.values())]
    width = 0.8 / len(shares)
    for k, (label, share) in enumerate(shares.items()):
        at = [i + (k - 0.5 * (len(shares) - 1)) * width for i in range(len(names))]
        axes.bar(
            at,
            [share.get(name, 0.0) for name in names],
            width=width,
            label=label,
            color=_COLOURS.get(label),
        )
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(f"share of runs, among the {plot.places} largest")

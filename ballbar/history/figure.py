"""Figure of a history: for each axis what the results state over time, and what is fitted to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from ballbar.cell.arrays import Array
from ballbar.figure_style import FRAME, LINES, RED, svg_text
from ballbar.history.events import SeriesFit
from ballbar.history.history import History
from ballbar.units import MRAD, URAD

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import RcKeyType

_STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    **{"svg.hashsalt": "history", "font.size": 8.0, "axes.titlesize": 8.5, "lines.linewidth": 1.1},
    **{"legend.frameon": True, "legend.framealpha": 0.7, "legend.edgecolor": "none"},
    **{"legend.fontsize": 6, "legend.handlelength": 1.0, "axes.prop_cycle": cycler(color=LINES)},
}
# Columns of the figure: kinds, title, unit and factor
_COLUMNS = (
    (("zero", "twist"), "zero and angle to the next axis, change", "mrad", MRAD),
    (("backlash",), "backlash, half width", "mrad", MRAD),
    (("compliance",), "compliance", "urad/(N m)", URAD),
    (("ripple",), "ripple, amplitude", "mrad", MRAD),
)


def history_figure(history: History) -> Figure:
    """A row of panels for each axis, a column for each kind of quantity."""
    axes = sorted({fit.series.axis for fit in history.fits})
    present = {fit.series.kind for fit in history.fits}
    columns = [column for column in _COLUMNS if present & set(column[0])]
    size = (max(6.0, 2.9 * len(columns)), 0.6 + 1.5 * max(1, len(axes)))
    figure = Figure(figsize=size, layout="constrained")
    days = np.array([r.day for r in history.results], dtype="datetime64[D]")
    margin = 1 + (days[-1] - days[0]) // 30
    panels = figure.subplots(len(axes), len(columns), squeeze=False) if axes else np.zeros((0, 0))
    for column, (kinds, title, unit, factor) in zip(panels.T, columns, strict=True):
        column[0].set_title(title, loc="left")
        for panel, axis in zip(column, axes, strict=True):
            fits = [f for f in history.fits if f.series.axis == axis and f.series.kind in kinds]
            panel.set(ylabel=f"axis {axis} [{unit}]", xlim=(days[0] - margin, days[-1] + margin))
            if fits:
                _draw(panel, fits, days, factor)
            else:
                panel.set_axis_off()
    return figure


def _draw(panel: Axes, fits: Sequence[SeriesFit], days: Array, factor: float) -> None:
    """The series of one axis and of one column."""
    names = sorted(dict.fromkeys(map(_name, fits)), key=lambda name: name == "angle")
    for colour, name in zip(LINES, names, strict=False):
        members = [fit for fit in fits if _name(fit) == name]
        value, sigma, line, band = (factor * part for part in _drawn(members))
        at = days[members[0].series.dates]
        steps = sorted({e.at for fit in members for e in fit.events if not e.drift})
        for part in np.split(np.arange(at.size), steps):
            own, spread = line[part], 2.0 * band[part]
            panel.fill_between(at[part], own - spread, own + spread, color=colour, alpha=0.2, lw=0)
            panel.plot(at[part], own, color=colour)
        panel.errorbar(at, value, 2.0 * sigma, fmt="o", ms=2.2, lw=0.6, color=colour, label=name)
        for step in steps:
            panel.axvspan(at[step - 1], at[step], color=RED, alpha=0.15, lw=0)
    if fits[0].series.kind in ("zero", "twist", "ripple"):
        panel.legend(ncols=3, columnspacing=0.8)
    locator = AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
    panel.xaxis.set_major_locator(locator)
    panel.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def _name(fit: SeriesFit) -> str:
    """Name of a line, which sine and cosine of a ripple share."""
    if fit.series.kind == "ripple":
        return f"{fit.series.name.split('_')[1]} a turn"
    return "angle" if fit.series.kind == "twist" else fit.series.kind


def _drawn(members: Sequence[SeriesFit]) -> tuple[Array, Array, Array, Array]:
    """Values, deviations, line and its deviations; the amplitude of sine and cosine."""
    first, kind = members[0], members[0].series.kind
    if kind != "ripple":
        start = first.fitted[0] if kind in ("zero", "twist") else 0.0
        return first.series.value - start, first.sigma, first.fitted - start, first.fitted_sigma
    value = np.linalg.norm([m.series.value for m in members], axis=0)
    line = np.linalg.norm([m.fitted for m in members], axis=0)
    return value, first.sigma, line, first.fitted_sigma


def history_svg(history: History) -> str:
    """The figure as SVG."""
    with matplotlib.rc_context(_STYLE):
        return svg_text(history_figure(history))

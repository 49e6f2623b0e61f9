"""Figure of a history: by how much each axis moved the tool since the first result."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ballbar.cell.arrays import Array
from ballbar.figure_style import BLUE, BROWN, FRAME, GREEN, ORANGE, PURPLE, RED, svg_text
from ballbar.history.events import SeriesFit
from ballbar.history.history import History
from ballbar.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import RcKeyType

_STYLE: dict[RcKeyType, Any] = {**FRAME, "svg.hashsalt": "history", "font.size": 8.0}
KINDS = {  # name and colour
    "zero": ("zero", BLUE),
    "twist": ("angle to the next axis", ORANGE),
    "backlash": ("backlash", GREEN),
    "compliance": ("compliance, of a newton metre", PURPLE),
    "ripple": ("ripple", BROWN),
}


def history_figure(history: History, title: str = "") -> Figure:
    """A panel for each axis, all of one scale; quantities with an event are drawn strong."""
    axes = sorted({fit.series.axis for fit in history.fits})
    days = np.array([r.day for r in history.results], dtype="datetime64[D]")
    figure = Figure(figsize=(8.0, 1.2 + 1.1 * len(axes)), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=8.5)
    if not axes:
        return figure
    grid = figure.subplots(len(axes), sharex=True, sharey=True, squeeze=False)[:, 0]
    for panel, axis in zip(grid, axes, strict=True):
        panel.set_ylabel(f"axis {axis} [um]")
        own = [fit for fit in history.fits if fit.series.axis == axis]
        for fit in sorted(own, key=lambda fit: (bool(fit.events), fit.series.kind == "zero")):
            _draw(panel, fit, days)
    locator = AutoDateLocator(minticks=3)  # type: ignore[no-untyped-call]
    formatter = ConciseDateFormatter(locator)  # type: ignore[no-untyped-call]
    grid[-1].xaxis.set(major_locator=locator, major_formatter=formatter)
    present = {fit.series.kind for fit in history.fits}
    shown = [Line2D([], [], color=c, label=n) for k, (n, c) in KINDS.items() if k in present]
    figure.legend(handles=shown, loc="outside lower center", ncols=5)
    return figure


def _draw(panel: Axes, fit: SeriesFit, days: Array) -> None:
    """A series, in micrometres of the tool."""
    series, factor, strong = fit.series, UM * fit.series.effect, bool(fit.events)
    at, (_, colour) = days[series.dates], KINDS[series.kind]
    value, line = (factor * (part - fit.fitted[0]) for part in (series.value, fit.fitted))
    style: dict[str, Any] = {
        "color": colour,
        "lw": 1.4 if strong else 0.6,
        "alpha": 1.0 if strong else 0.4,
    }
    steps = sorted(event.at for event in fit.events if not event.drift)
    panel.errorbar(at, value, 2.0 * factor * fit.sigma, fmt="o", ms=3 if strong else 1.5, **style)
    for part in np.split(np.arange(at.size), steps):
        panel.plot(at[part], line[part], **style)
    for step in steps:
        panel.axvspan(at[step - 1], at[step], color=RED, alpha=0.12, lw=0)


def history_image(history: History, sentences: Sequence[str], kind: str) -> bytes:
    """The figure as a file; kind : its ending, .svg or .png."""
    with matplotlib.rc_context(_STYLE):
        figure = history_figure(history, "\n".join(sentences))
        if kind == ".svg":
            return svg_text(figure).encode()
        image = BytesIO()
        figure.savefig(image, format="png", dpi=200)
        return image.getvalue()

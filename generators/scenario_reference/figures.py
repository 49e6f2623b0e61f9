"""Draws the small plots, and measures how large the effects in them are."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.figure import Figure

from ballbar.cell.arrays import Array
from ballbar.figure_style import FRAME, svg_text, to_hundredths
from generators.scenario_reference.plots import POINTS, Plot, Source
from generators.scenario_reference.runs import ROOT, Changes, View, run
from generators.scenario_reference.sources import SOURCES

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

PLOTS = ROOT / "docs" / "images" / "effects"
SIZES = PLOTS / "sizes.csv"  # the largest change of the logs that each source makes, as plotted
WIDTH, HEIGHT = 320, 180  # [px]
BLUE, ORANGE, GREY = "#1f66ad", "#d9740b", "#8a949c"
_STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    "svg.hashsalt": "effects",
    "font.size": 8.0,
    "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREY]),
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.handlelength": 1.2,
    "lines.linewidth": 1.0,
    "lines.solid_capstyle": "round",
}


def draw(source: Source) -> None:
    """Writes the plot of one source."""
    plot = source.plot
    with matplotlib.rc_context({**_STYLE, "path.simplify": not plot.marks}):
        figure = Figure(figsize=(WIDTH / 96.0, HEIGHT / 96.0), layout="constrained")
        axes = figure.add_subplot()
        labelled = False
        for label, x, y in _lines(plot):
            axes.plot(
                *(_dots(x, y) if plot.marks else (x, y)),
                label=label,
                linewidth=1.8 if plot.marks else None,
            )
            labelled |= bool(label)
        axes.set_xlabel(plot.axes[0])
        axes.set_ylabel(plot.axes[1])
        axes.margins(x=0.02)
        low, high = axes.get_ylim()
        if high - low < 1e-6 * abs(high):  # a constant
            axes.set_ylim(0.0, 1.3 * high)
        if labelled:
            figure.legend(loc="outside upper right", ncols=3, borderpad=0.0)
        text = to_hundredths(svg_text(figure))
    (PLOTS / f"{source.key}.svg").write_text(text, encoding="utf-8")


def _dots(x: Array, y: Array) -> tuple[Array, Array]:
    """Lines of no length with round ends: a third of the bytes of markers."""
    gap = np.full_like(x, np.nan)
    return np.stack((x, x, gap), axis=1).ravel(), np.stack((y, y, gap), axis=1).ravel()


def _lines(plot: Plot) -> Iterator[tuple[str, Array, Array]]:
    """Label, x and y of every line."""
    t = np.linspace(*plot.window, plot.points)
    off = run(plot.off)
    known = off.simulation.motion.geometry
    without = View(off, t, known, plot.counted)
    for label, changes in plot.on.items():
        view = View(run(changes), t, known, plot.counted)
        x, y = plot.x(view), plot.y(view)
        y = y - plot.y(without) if plot.minus_off else y
        for name, column in zip(plot.columns or (label,), np.atleast_2d(y.T), strict=True):
            yield (name, *_thinned(x, column, plot))
    if plot.show_off:
        yield (plot.show_off, *_thinned(plot.x(without), plot.y(without), plot))


def _thinned(x: Array, y: Array, plot: Plot) -> tuple[Array, Array]:
    """Rows of a log inside the window; of each of POINTS / 2 stretches the two extreme values."""
    if not plot.rows:
        return x, y
    inside = (x >= plot.window[0]) & (x <= plot.window[1])
    x, y = x[inside], y[inside]
    if x.size <= POINTS:
        return x, y
    extremes: set[int] = set()
    for part in np.array_split(np.arange(x.size), POINTS // 2):
        extremes |= {int(part[y[part].argmin()]), int(part[y[part].argmax()])}
    order = sorted(extremes)
    return x[order], y[order]


def measured_sizes() -> list[dict[str, str]]:
    """Largest changes of the logs by every source that changes angles, largest residual first."""
    rows = [
        {"source": source.key, "variant": label, **_sizes(changes, source.plot)}
        for source in SOURCES
        if source.key.startswith(("errors.", "plant.")) or source.key == "encoders.noise_sigma_rad"
        for label, changes in source.plot.on.items()
    ]
    return sorted(rows, key=lambda row: (-float(row["tool_um"]), -float(row["q_urad"])))


def _sizes(changes: Changes, plot: Plot) -> dict[str, str]:
    off, on = run(plot.off), run(changes)
    known, end = off.simulation.motion.geometry, off.settings.path.duration_s
    t = np.arange(1.0, end - 1.0, 0.01)
    a, b = (View(each, t, known, plot.counted) for each in (on, off))
    residual = np.linalg.norm(a.residual - b.residual, axis=1)
    with_forces = on.settings.plant.kind != "kinematic"
    return {
        "tool_um": _largest(residual, 1e6),
        "q_urad": _largest(a.q - b.q, 1e6),
        "b_urad": _largest(a.b - b.b, 1e6),
        "rod_N": _largest(a.rod_force - b.rod_force, 1.0) if with_forces else "-",
    }


def _largest(change: Array, scale: float) -> str:
    """The largest, to two digits."""
    return f"{float(f'{np.abs(change).max() * scale:.2g}'):g}"


def read_sizes() -> list[dict[str, str]]:
    """Rows of the committed sizes.csv."""
    with SIZES.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_sizes(rows: list[dict[str, str]]) -> None:
    """Writes sizes.csv."""
    with SIZES.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)

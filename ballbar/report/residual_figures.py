"""Residuals and forces of a recording over time, and the histogram of whitened residuals."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ballbar.figure_style import AFTER, BEFORE, INK
from ballbar.report.drawing import INCH
from ballbar.report.line_plot import Curve, Plot, draw
from cell.arrays import Array

_HISTOGRAM_HALF_WIDTH = 5.0  # standard deviations; wider where the residuals are
_BINS = 50
_RESIDUALS = "#8fb4d9"


def norms_over_time(t: Array, before: Array, after: Array, *, label: str, clock: str) -> Markup:
    """Norms of residuals before and after (N, 3), in the unit of `label`, on a logarithmic axis.

    t : (N,) [s] on the clock named `clock`.
    """
    curves = []
    for values, colour, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
        norm = np.linalg.norm(values, axis=1)
        curves.append(Curve(t, np.where(norm > 0.0, norm, np.nan), colour, name))
    plot = Plot(curves, label, y=_log_ends(curves), log=True)
    return draw([plot], _time(clock), height=2.9 * INCH, x=_span(t), legend=True)


def components_over_time(t: Array, values: Array, *, label: str, clock: str) -> Markup:
    """Three residual components (N, 3) after the fit, in the unit of `label`, on one scale.

    t : (N,) [s] on the clock named `clock`.
    """
    largest = 1.05 * float(np.abs(values).max()) or 1.0
    plots = [
        Plot(
            [Curve(t, column, AFTER, name, width=0.8)],
            name,
            y=(-largest, largest),
            upright=True,
            zero=True,
        )
        for column, name in zip(values.T, "xyz", strict=True)
    ]
    return draw(plots, _time(clock), height=3.5 * INCH, x=_span(t), title=label)


def tension_over_time(t: Array, tension: Array, *, clock: str) -> Markup:
    """Force in the rod (N,) [N], tension positive, at t (N,) [s] on the clock named `clock`."""
    plot = Plot([Curve(t, tension, AFTER)], "force in the rod [N]", zero=True)
    return draw([plot], _time(clock), height=2.4 * INCH, x=_span(t))


def whitened_histogram(whitened: Array) -> Markup:
    """Whitened residuals (E, N), with the unit normal curve that they should follow."""
    values = whitened.ravel()
    half = max(_HISTOGRAM_HALF_WIDTH, float(np.ceil(np.quantile(np.abs(values), 0.999))))
    density, edges = np.histogram(values, np.linspace(-half, half, _BINS + 1), density=True)
    x = np.linspace(-half, half, 201)
    normal = np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi)
    curves = [
        Curve(
            np.repeat(edges, 2)[1:-1],
            np.repeat(density, 2),
            _RESIDUALS,
            "residuals after",
            filled=True,
        ),
        Curve(x, normal, INK, "unit normal", width=1.4),
    ]
    top = 1.08 * max(float(density.max()), float(normal.max()))
    outside = f"{int((np.abs(values) > half).sum())} of {values.size} beyond ±{half:g}"
    plot = Plot(curves, "density", y=(0.0, top), note=outside)
    label = "whitened residual [standard deviations]"
    return draw([plot], label, height=2.9 * INCH, x=(-half, half), legend=True)


def _time(clock: str) -> str:
    return f"time on the {clock} clock [s]"


def _span(t: Array) -> tuple[float, float]:
    return float(t[0]), float(t[-1])


def _log_ends(curves: list[Curve]) -> tuple[float, float] | None:
    """Ends of the logarithmic axis: a norm that passes through zero would stretch it."""
    after = curves[-1].y[np.isfinite(curves[-1].y)]
    largest = max(float(np.nanmax(c.y, initial=0.0)) for c in curves)
    if not after.size or largest <= 0.0:
        return None
    return float(np.quantile(after, 0.02)) / 2.0, 1.3 * largest

"""Polar plot of a circular test (ISO 230-4): deviations from a circle, magnified."""

from __future__ import annotations

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from ballbar.figure_style import BLUE, FRAME, INK, ORANGE, svg_text
from ballbar.ident.performance.iso_230_4 import CircularTest
from ballbar.report.drawing import linear_ticks
from ballbar.report.numbers import length_scale

SHARE = 0.3  # of the circle's radius that the largest deviation takes
DIVISIONS = 6  # about


def polar_plot(test: CircularTest) -> Markup:
    """The figure of one circular test."""
    factor, unit = length_scale(float(np.ptp(test.deviation)))
    largest = float(np.abs(test.deviation).max()) * factor or 1.0
    ticks = linear_ticks(-largest, largest, DIVISIONS)
    with matplotlib.rc_context({**FRAME, "font.size": 9.0}):
        figure = Figure(figsize=(4.6, 5.0))
        axes = figure.add_axes((0.11, 0.17, 0.78, 0.72), projection="polar")
        axes.set_ylim(-largest / SHARE, 1.1 * largest)
        axes.set_yticks(list(ticks), labels=[""] * len(ticks))
        circle = np.linspace(0.0, 2.0 * np.pi, 361)
        axes.plot(circle, 0.0 * circle, color=INK, linewidth=0.7)
        ways = ((True, BLUE, "counter-clockwise"), (False, ORANGE, "clockwise"))
        for way, colour, name in ways:
            rows = test.counter_clockwise == way
            if rows.any():
                values = factor * test.deviation[rows]
                axes.plot(test.angle[rows], values, color=colour, linewidth=1.1, label=name)
        division = float(np.diff(list(ticks))[0])
        times = SHARE * test.radius * factor / largest
        axes.set_xlabel(f"a division is {division:g} {unit}, magnified {times:.0f} times")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
        return Markup(svg_text(figure))

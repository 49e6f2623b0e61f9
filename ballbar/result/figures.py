"""Figures of a calibration on axes of Matplotlib."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib import pyplot
from matplotlib.axes import Axes

from ballbar.figure_style import AFTER, BEFORE
from ballbar.units import MM


def parameters(frame: pd.DataFrame, axes: Axes | None) -> Axes:
    """Axes with the deviation of each identified parameter of robot and ball-bar from the
    catalogue, in mm and mrad, and two standard deviations. Where the instrument stood has none.
    """
    axes = axes or pyplot.subplots(layout="constrained")[1]
    shared = frame.loc[""]
    identified = shared[shared["identified"]]
    size = (identified["value"] - identified["nominal"]).to_numpy() * 1e3
    places = np.arange(len(identified))
    sigma = 2e3 * identified["sigma"].to_numpy()
    axes.errorbar(places, size, sigma, fmt="o", color=AFTER, markersize=3, capsize=2)
    axes.axhline(0.0, color=BEFORE, linewidth=0.8)
    axes.set_xticks(places, identified.index, rotation=90, fontsize="small")
    axes.set_ylabel("deviation from the catalogue [mm, mrad]")
    return axes


def residuals(frame: pd.DataFrame, axes: Axes | None) -> Axes:
    """Axes with the share of residuals of a frame below a length [mm], of both robots."""
    axes = axes or pyplot.subplots(layout="constrained")[1]
    for robot, colour in (("nominal", BEFORE), ("identified", AFTER)):
        norms = frame.xs(robot, level="robot")["norm"].to_numpy() * MM
        axes.ecdf(norms, color=colour, label=f"{robot} robot")
    axes.set_xscale("log")
    axes.set_xlabel("residual [mm]")
    axes.set_ylabel("share of samples and poses")
    axes.legend()
    return axes

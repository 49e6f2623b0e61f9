"""Thesis Fig. 4.4: how far the offset plate sinks, over its thickness, of aluminium and of steel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes

from ballbar.figure_style import QUIET
from ballbar.plan.beam import OFFSET_PLATE, PLATE_ALLOWED, PLATE_FORCE, STEEL_PLATE, tip_deflection

MATERIALS = {"aluminium": OFFSET_PLATE, "steel": STEEL_PLATE}
THICKNESS = np.linspace(0.020, 0.070, 60)  # [m] of the plates drawn


def draw_deflection(axes: Axes) -> None:
    """A curve for each material, in the colours of the axes' cycle, and what is allowed."""
    for label, material in MATERIALS.items():
        deflection = [
            1e6 * tip_deflection(replace(material, thickness=float(h)), PLATE_FORCE)
            for h in THICKNESS
        ]
        axes.plot(1e3 * THICKNESS, deflection, label=label)
    axes.set_yscale("log")
    axes.axhline(1e6 * PLATE_ALLOWED, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set_xlabel("thickness [mm]")
    axes.set_ylabel("deflection [um]")

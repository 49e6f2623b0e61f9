"""Thesis Fig. 4.4: tip deflection of the offset plate over its thickness, aluminium and steel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes

from ballbar.figure_style import DASHED, QUIET, logarithmic
from ballbar.plan.beam import OFFSET_PLATE, PLATE_ALLOWED, PLATE_FORCE, STEEL_PLATE, tip_deflection
from ballbar.units import MM, UM

MATERIALS = {"aluminium": OFFSET_PLATE, "steel": STEEL_PLATE}
THICKNESS = np.linspace(0.020, 0.070, 60)  # [m] of the plates drawn


def draw_deflection(axes: Axes) -> None:
    """Draws a curve for each material, in the colours of the axes' cycle, and the limit."""
    for label, material in MATERIALS.items():
        plates = [replace(material, thickness=float(h)) for h in THICKNESS]
        deflection = [UM * tip_deflection(plate, PLATE_FORCE) for plate in plates]
        axes.plot(MM * THICKNESS, deflection, label=label)
    logarithmic(axes, "y")
    axes.axhline(UM * PLATE_ALLOWED, color=QUIET, linewidth=0.8, linestyle=DASHED)
    axes.set_xlabel("thickness [mm]")
    axes.set_ylabel("deflection [um]")

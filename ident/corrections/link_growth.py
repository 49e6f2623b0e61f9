"""Long links grow as they warm up while a recording is made.

Each recording has a line and a parabola in time of its own, and the later ones start with a length
of their own: an exponential, also of a robot that was warm already, is near to that.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import nominal_geometry, parameter_table
from ballbar.ident.corrections.base import Coefficient, Correction, State

SPREAD = 4e-5  # [m] of each coefficient: 0.7 m of aluminium that warms by 2.5 K
LONG = 0.3  # [m] a link from which its growth counts
UNIT = 100.0  # [s] of time in the coefficients


def link_growth(cell: Cell, recordings: int) -> Correction:
    """Growth [m] of the long links, per `UNIT` of time and its square; later recordings' starts."""
    nominal, table = nominal_geometry(cell, np.zeros(3)), parameter_table(cell.robot)
    free = (p for p in table.parameters if p.side == "robot" and p.is_length)
    known = (*table.gauge, table.plate)
    links = [p for p in free if p.name not in known and abs(nominal[p.name]) > LONG]

    def regressors(state: State) -> list[Array]:
        time, out = state.t / UNIT, []
        for k in range(recordings):
            own = np.full_like(time, float(state.recording == k))
            out += [own] if k else []
            out += [own * time, own * time * time]
        return out * len(links)

    coefficients = tuple(
        Coefficient(f"growth_{link.name}_{term}@{k + 1}", "m", 0.0, SPREAD, link)
        for link in links
        for k in range(recordings)
        for term in (("start", "line", "square") if k else ("line", "square"))
    )
    return Correction("link_growth", "growth of the links", coefficients, regressors)

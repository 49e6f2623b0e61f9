"""Bearings of the first joints tilt under the moment across their axes.

A bearing yields about x and y of the frame in which its joint turns, each by a compliance of its
own: one for both hides a bearing that is not symmetric (notes/identification sec. 7). Where an
axis is parallel to the joint before, that joint's gear compliance holds the tilt too, and none is
fitted.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Parameter
from ballbar.ident.corrections.base import Coefficient, Correction, State
from ballbar.ident.loads.gear_loads import BEARINGS

# [rad/(N m)] moment rigidity of 1e7 N m/rad, a cross-roller bearing of 0.3 m (catalogues of such
# bearings and of gears with one: 3e6 to 3e7), with the housing twice as soft
SPREAD = 2e-7
PARALLEL = 0.9  # sine of a twist from which y of a joint's frame counts as parallel to axis before
AXES = (("x", "alpha"), ("y", "beta"))


def bearing_tilt(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Compliances [rad/(N m)] about x and y of the first joints."""
    axes = [
        (joint, k)
        for joint in range(BEARINGS)
        for k in range(len(AXES))
        if not (k == 1 and joint and abs(np.sin(cell.robot.alpha[joint - 1])) > PARALLEL)
    ]

    def tilts(moments: Array) -> list[Array]:
        return [-moments[joint, k] for joint, k in axes]

    def regressors(state: State) -> list[Array]:
        return tilts(state.loads.bearings(state.tension))

    def slopes(state: State) -> list[Array]:
        return tilts(state.loads.bearing_per_newton * np.ones_like(state.tension))

    coefficients = tuple(_coefficient(joint, *AXES[k]) for joint, k in axes)
    return Correction("bearing_tilt", "tilting bearings", coefficients, regressors, slopes)


def _coefficient(joint: int, axis: str, kind: str) -> Coefficient:
    """Compliance about x or y of the frame that the row before ends with."""
    channel = Parameter(f"r{kind}{joint}", "robot", kind, joint - 1)
    return Coefficient(f"tilt{joint + 1}{axis}", "rad/(N m)", 0.0, SPREAD, channel)

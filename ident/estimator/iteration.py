"""Figures that a minimisation reports to a callback after each iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cell.arrays import Array
from cell.clock import Clock
from cell.geometry import Geometry


@dataclass(frozen=True, eq=False)
class Iteration:
    """One value of the unknowns, seen from the first recording of the fit."""

    geometry: Geometry
    clock: Clock
    times: Array  # (N,) [s] of the samples, on the ball-bar's clock (the robot's if it has none)
    error: Array  # (6, N) [m, rad] loop-closure error, robot base frame
    chi2_per_sample: float  # cost per whitened residual, under the weights of that iteration


IterationCallback = Callable[[Iteration], None]

"""Where a minimisation stands: what the solvers report, iteration by iteration, to whoever watches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cell.chain import Array
from cell.geometry import Geometry
from ident.estimator.problem import Clock


@dataclass(frozen=True, eq=False)
class Iteration:
    """One value of the unknowns, seen from the first recording of the fit."""

    geometry: Geometry
    clock: Clock
    times: Array  # (N,) [s] of the samples, on the ball-bar's clock (the robot's without encoders)
    error: Array  # (6, N) [m, rad] mismatch of the loop, robot base frame
    chi2_per_sample: float  # cost for each whitened residual, under the weights of that iteration


IterationCallback = Callable[[Iteration], None]

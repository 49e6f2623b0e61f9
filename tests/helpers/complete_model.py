"""A model, where its unknowns stand, and the normal equations there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.model import Model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import NormalEquations, jacobian, normal_equations

EXCESS = ExcessNoise(3e-6, 3e-6, 5e-6, 1e-6)


@dataclass(frozen=True, eq=False)
class CompleteModel:
    """A model, unknowns off its prior, and the ball-bar's angles."""

    model: Model
    x: Array  # (P,)
    ballbar: Array  # (N, 5) [rad]

    def equations(self) -> NormalEquations:
        return normal_equations(self.model, self.x, [self.ballbar], EXCESS, keep_blocks=True)

    def columns(self, equations: NormalEquations) -> Array:
        """(P, E, N) all columns; those of the tension's knots are the slope times a spline."""
        (samples,), own = self.model.recordings, self.model.unknowns.own[0]
        out = np.zeros((self.model.unknowns.count, *equations.residuals[0].shape))
        for block in jacobian(self.model, equations, 0):
            out[block.index, :, block.samples] = block.values
            if block.slope is not None:
                splines = samples.splines[:, block.samples].toarray()
                out[own.knots, :, block.samples] = splines[:, None] * block.slope
        return out

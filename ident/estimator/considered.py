"""What uncertain masses, which a fit takes as given, add to its uncertainty.

Consider parameters (Schmidt 1966; Tapley, Schutz & Born 2004, sec. 6.4): with the residual's change
`r_m` for one standard deviation of a direction of the masses, the estimate moves by

    x_m = -C J' W r_m

and its covariance grows by the sum of `x_m x_m'` over the directions. The tool of the unloaded
robot moves with the masses directly and through x; since heavier links under the same deflection
mean stiffer gears, the two nearly cancel, so the x_m are kept, not their squares alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cell.arrays import Array
from ident.estimator.fit import Fit
from ident.estimator.normal_equations import gradient_of, jacobian, normal_equations
from ident.loads.gear_loads import mass_model
from ident.loads.mass_uncertainty import UncertainMasses

SAMPLES = 300  # of each recording: four a second of a motion of 120 s, whose loads vary slowly


def considered_shifts(fit: Fit, masses: UncertainMasses) -> Array:
    """(P, K) shifts x_m of the estimate for one standard deviation of each direction."""
    count, directions = fit.model.unknowns.count, masses.deviated()
    if fit.model.masses is None:
        return np.zeros((count, len(directions)))
    steps = [max(1, r.times.size // SAMPLES) for r in fit.model.recordings]
    recordings = [r.thinned(n) for r, n in zip(fit.model.recordings, steps, strict=True)]
    model = replace(fit.model, recordings=tuple(recordings))
    ballbars = [b[::n] for b, n in zip(fit.ballbars, steps, strict=True)]
    equations = normal_equations(model, fit.x, ballbars, fit.excess)
    changed = [replace(model, masses=mass_model(cell)) for cell in directions]
    gradient = np.zeros((count, len(changed)))
    for k, (point, weights, n) in enumerate(
        zip(equations.evaluations, equations.weights, steps, strict=True)
    ):
        blocks = list(jacobian(model, equations, k))
        for column, other in zip(gradient.T, changed, strict=True):
            moved = other.evaluate(fit.x, k, point.ballbar)
            change = weights(moved.closure.error - point.closure.error)
            for block in blocks:
                column += n * gradient_of(model, k, block, change[:, block.samples])
    return np.asarray(-fit.covariance @ gradient)

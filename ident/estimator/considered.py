"""Uncertainty from quantities that a fit takes as given: masses, lengths, instrument angles.

Consider parameters (Schmidt 1966; Tapley, Schutz & Born 2004, sec. 6.4): with the residual's change
`r_m` for one standard deviation of a direction of the masses, the estimate moves by

    x_m = -C J' W r_m

and its covariance grows by the sum of `x_m x_m'` over the directions. A parameter of the geometry
that was held is a direction like them. The tool of the unloaded
robot moves with the masses directly and through x; since heavier links under the same deflection
mean stiffer gears, the two nearly cancel, so the x_m are kept, not their squares alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.descriptions import Cell
from ident.estimator.fit import Fit
from ident.estimator.normal_equations import gradient_of, jacobian, normal_equations
from ident.loads.gear_loads import mass_model

SAMPLES = 300  # of each recording: four a second of a motion of 120 s, whose loads vary slowly


def considered_shifts(fit: Fit, deviated: Sequence[Cell]) -> Array:
    """(P, K) shifts x_m of the estimate.

    deviated : K cells whose masses deviate by one standard deviation, in independent directions
    (ident.loads.mass_uncertainty).
    """
    shape = (fit.model.unknowns.count, len(deviated))
    if fit.model.masses is None or not deviated:
        return np.zeros(shape)
    steps = [max(1, r.times.size // SAMPLES) for r in fit.model.recordings]
    recordings = [r.thinned(n) for r, n in zip(fit.model.recordings, steps, strict=True)]
    model = replace(fit.model, recordings=tuple(recordings), table=None)
    ballbars = [b[::n] for b, n in zip(fit.ballbars, steps, strict=False)]
    equations = normal_equations(model, fit.x, ballbars, fit.excess)
    blocks = [list(jacobian(model, equations, k)) for k in range(len(steps))]
    gradient = np.zeros(shape)
    for m, cell in enumerate(deviated):
        other = replace(model, masses=mass_model(cell))
        for k, n in enumerate(steps):
            point, weights = equations.evaluations[k], equations.weights[k]
            with_own_loads = replace(point, loads_at=None)
            moved = other.evaluate(fit.x, k, point.ballbar, with_own_loads)
            change = weights(moved.closure.error - point.closure.error)
            for block in blocks[k]:
                own = gradient_of(model, k, block, change[:, block.samples])
                gradient[:, m] += n * own
    return np.asarray(-fit.covariance @ gradient)


def held_shifts(fit: Fit, held: NDArray[np.intp], sigma: Array) -> tuple[Array, Array]:
    """Errors of parameters that a fit held at their nominal values, and the shifts they cause.

    Once freed under their priors, they would have the covariance D and go by the step h. Their
    error in the fit has the mean square D + h h', so what the data say of them counts.

    held : (H,) indices into the table, in its order. sigma : (H,) [m, rad] of their priors.
    Returns (H, H) the errors' independent directions, one a column, and (P, H) the shifts of the
    estimate for each of them.
    """
    model = fit.model
    layout, x = model.unknowns.with_shared(held, fit.x)
    linear = normal_equations(replace(model, unknowns=layout), x, fit.ballbars, fit.excess)
    freed = np.flatnonzero(np.isin(layout.shared, held))
    mixed = np.delete(linear.normal[:, freed], freed, axis=0)
    shift = -fit.covariance @ mixed  # of the estimate, per unit of each
    gradient = linear.gradient[freed] + shift.T @ np.delete(linear.gradient, freed)
    reduced = linear.normal[np.ix_(freed, freed)] + mixed.T @ shift
    scaled = np.outer(sigma, sigma) * reduced + np.eye(held.size)  # of order one and above
    covariance = np.linalg.inv(scaled)
    step = covariance @ (sigma * gradient)
    values, vectors = np.linalg.eigh(covariance + np.outer(step, step))
    root = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root, shift @ root

"""Physical bounds: forces, unknowns and slips of a fit that no machine has.

A fit explains a damaged log with whatever its model offers. Each prior is of physical size, so an
unknown far beyond it, a force that no seat of a ball holds, and as many steps as are looked for at
most are signs of something else, however small the residual.
"""

from __future__ import annotations

import numpy as np

from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.step_faults import MAX_FOUND
from ballbar.ident.model_choice import coefficients_of, lasting

FORCE = 2000.0  # [N] of the rod: four times what any scenario reaches; magnetic seats hold less
FAR = 10.0  # standard deviations of a prior
SHOWN = 3  # unknowns that are named


def impossible(fit: Fit) -> tuple[str, ...]:
    """Phrases on what is beyond physical size in a fit; none for the fit of a sound recording."""
    layout, out = fit.model.unknowns, []
    forces = [np.abs(fit.model.tension(fit.x, k)).max() for k in range(len(fit.model.recordings))]
    if forces and max(forces) > FORCE:
        out.append(f"the rod would bear {max(forces) * 1e-3:.1f} kN")
    places = [coefficients_of(fit, correction) for correction in lasting(fit)]
    own = np.concatenate([np.arange(p.start, p.stop) for p in [slice(0, 0), *places]])
    off = np.abs(fit.x[own] - layout.mean[own]) / layout.sigma[own]
    worst = [(own[k], off[k]) for k in np.argsort(-off)[:SHOWN] if off[k] > FAR]
    out += [f"{layout.names[i]} would be {times:.0f} prior deviations off" for i, times in worst]
    steps = sum(fault.removed == 0.0 for fault in fit.step_faults)
    if steps >= MAX_FOUND:
        out.append(f"{steps} steps of encoders and clock would be in it")
    return tuple(out)

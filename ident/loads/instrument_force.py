"""Force along a telescoping rod or a wire: a constant, the spring of its sensor, its friction.

    F = F_0 + F_1 extension / range + F_2 sign(extension rate)

takes the place of the tension's spline. Friction has the sign of the speed at which the length
changes, so without it the arm's deflection passes for a clock offset: 1.4 ms for 0.3 N on the IRB
2400 and 0.3 mm/s.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ident.estimator.samples import Samples

FORCE_PRIOR = 5.0  # [N] of each part; a wire pulls with 3 to 10 N (recalled), a rod with less
SLIDING = 3e-5  # [m/s] of the length, over which the friction changes its sign


def instrument_forces(samples: Samples, stroke: tuple[float, float]) -> csr_array:
    """(3, N) force [N] at the samples of a sensed length for 1 N of each part.

    stroke : [m] shortest and longest length.
    """
    half = 0.5 * (stroke[1] - stroke[0])
    rate = samples.extension_rate
    return csr_array(
        np.stack((np.ones_like(rate), samples.extension / half, rate / np.hypot(rate, SLIDING)))
    )

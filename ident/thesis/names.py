"""Names of the cost functions, and the ball-bar joints whose encoders each of them needs."""

from __future__ import annotations

from typing import Literal

CostName = Literal["length", "position", "position_angles", "transform"]  # thesis eqs. 2.1 to 2.4

ENCODERS_NEEDED: dict[CostName, tuple[int, ...]] = {
    "length": (),
    "position": (1, 2),
    "position_angles": (1, 2, 4, 5),
    "transform": (1, 2, 3, 4, 5),
}
# not one of the thesis: the whole residual, weighed by its noise (ident.estimator.whitening)
ML = "ml"
COSTS = (ML, *ENCODERS_NEEDED)

"""CMA-ES (Hansen, arXiv:1604.00772; library `cma`) with the settings of both searches."""

from __future__ import annotations

import warnings
from typing import Any

from cell.arrays import Array

SPREAD = 0.08  # first step size, relative to the range of each number


def evolution(start: Array, *, seed: int) -> Any:
    """A `cma.CMAEvolutionStrategy` that begins at `start` (K,) [-] and prints nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cma looks for plotting when it is imported
        # imported here, since loading it takes long and only a search needs it
        from cma import CMAEvolutionStrategy  # noqa: PLC0415
    return CMAEvolutionStrategy(start, SPREAD, {"seed": seed + 1, "verbose": -9, "verb_log": 0})

"""CMA-ES (Hansen, arXiv:1604.00772; library `cma`) as both searches use it."""

from __future__ import annotations

import warnings
from typing import Any

from cell.arrays import Array

SPREAD = 0.08  # first step, of each number's range


def evolution(start: Array, *, seed: int) -> Any:
    """A `cma.CMAEvolutionStrategy` that begins at `start` and prints and writes nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cma looks for plotting when it is imported
        from cma import CMAEvolutionStrategy  # noqa: PLC0415  and loads it: only who searches waits for that
    return CMAEvolutionStrategy(start, SPREAD, {"seed": seed + 1, "verbose": -9, "verb_log": 0})

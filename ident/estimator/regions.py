"""Contiguous regions of joint space, for cross-validation that does not flatter.

A pose left out at random has neighbours that were fitted; a region left out has none. So what is
judged is how the model continues, and errors that neighbours share do not pass for evidence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array

REGIONS = 8  # 16 take twice the time and are hardly better (docs/real_robots)


def joint_regions(q: Array, count: int = REGIONS) -> NDArray[np.intp]:
    """(N,) number from 0 of the region of each of the angles q (N, J) [rad].

    count : a power of two. Regions come from halving at the median along the main direction.
    """
    out = np.zeros(len(q), dtype=np.intp)
    while out.max(initial=0) + 1 < count:
        out *= 2
        for region in range(0, out.max(initial=0) + 1, 2):
            own = np.flatnonzero(out == region)
            centred = q[own] - q[own].mean(axis=0)
            main = np.linalg.svd(centred, full_matrices=False)[2][0]
            order = np.argsort(centred @ main, kind="stable")
            out[own[order[len(own) // 2 :]]] += 1
        if len(q) < 2 * count:
            break
    return out

"""Scrambled Sobol sequence of few dimensions, the points of scipy.stats.qmc.Sobol.

scipy.stats is slow to import. Direction numbers: Joe & Kuo 2008 (new-joe-kuo-6); scrambling by
lower triangular matrices and a shift: Matousek 1998.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array

BITS = 30
# Degree, coefficients and first direction numbers of the primitive polynomial of each dimension;
# the first is the van der Corput sequence.
_POLYNOMIALS: tuple[tuple[int, int, tuple[int, ...]], ...] = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
)
MOST = len(_POLYNOMIALS) + 1  # dimensions


def sobol(count: int, dimensions: int, rng: np.random.Generator) -> Array:
    """(count, dimensions) points in [0, 1). Raises ValueError beyond `MOST` dimensions."""
    if dimensions > MOST:
        raise ValueError(f"Sobol points have at most {MOST} dimensions here, not {dimensions}")
    size, (own,) = (dimensions, BITS), rng.spawn(1)  # as SciPy does
    powers = 2 ** np.arange(BITS, dtype=np.uint32)
    shift = own.integers(2, size=size, dtype=np.uint32) @ powers
    lower = np.tril(own.integers(2, size=(*size, BITS), dtype=np.uint32))
    lower[:, np.arange(BITS), np.arange(BITS)] = 1
    directions = np.stack([_directions(d) for d in range(dimensions)])
    bits = directions[:, None, :] >> np.arange(BITS - 1, -1, -1, dtype=np.uint32)[:, None] & 1
    scrambled = (powers[::-1, None] * ((lower @ bits) % 2)).sum(axis=1, dtype=np.uint32)
    index = np.arange(count, dtype=np.uint32)
    gray, points = index ^ index >> 1, np.broadcast_to(shift, (count, dimensions)).copy()
    for k in range(int(count - 1).bit_length()):
        points ^= (gray >> np.uint32(k) & 1)[:, None] * scrambled[:, k]
    return np.asarray(points / 2.0**BITS)


def _directions(dimension: int) -> np.ndarray:
    """(BITS,) direction numbers of a dimension, from 0."""
    degree, coefficients, numbers = (0, 0, ()) if dimension == 0 else _POLYNOMIALS[dimension - 1]
    m = list(numbers)
    for i in range(len(m), BITS):
        if dimension == 0:
            m.append(1)
            continue
        new = m[i - degree] ^ m[i - degree] << degree
        for k in range(1, degree):
            if coefficients >> (degree - 1 - k) & 1:
                new ^= m[i - k] << k
        m.append(new)
    return np.array([m[i] << (BITS - 1 - i) for i in range(BITS)], dtype=np.uint32)

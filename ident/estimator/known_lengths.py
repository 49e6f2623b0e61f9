"""Do the lengths that are known beforehand agree? Rod, plate and axis offsets give the scale.

No log tells one of them from the other, only their sum: what the data take from the prior of each
is less than all. With priors of covariance D and a posterior of C, the posterior mean is off the
prior's by a normal deviate of covariance D - C, and what the inflation adds to C, where everything
stated is true. Where it is off by more, the stated deviations are widened by as much (Birge 1932,
as for constants that disagree).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.geometry import parameter_named
from ident.estimator.unknowns import Unknowns

KNOWN = 5e-5  # [m] standard deviation up to which a length is known beforehand
ALONE = 0.9  # of its prior variance taken away by the data: they tell this length by itself
SEEN = 0.1  # the same for a combination: without the data nothing contradicts it


@dataclass(frozen=True, eq=False)
class KnownLengths:
    """The known lengths that share the scale, and how far they contradict each other."""

    unknowns: NDArray[np.intp]  # indices
    apart: float  # standard deviations
    off: float = 0.0  # [m] sum of what these lengths would have to change by, to agree

    @property
    def widening(self) -> float:
        """Factor on their standard deviations, at least 1."""
        return max(1.0, self.apart)


def known_lengths(layout: Unknowns, x: Array, covariance: Array, added: Array) -> KnownLengths:
    """The known lengths of a fit with estimate x (P,) and white covariance (P, P).

    added : (P, P) to the covariance, by the inflation of what the data contribute.
    """
    sigma, left = layout.sigma, np.diag(covariance) / layout.sigma**2
    known = np.array(
        [
            i
            for i in range(layout.shared.size)
            if parameter_named(layout.names[i]).is_length
            and sigma[i] < KNOWN
            and left[i] > 1.0 - ALONE
        ],
        dtype=np.intp,
    )
    scale = sigma[known]
    off = (x - layout.mean)[known] / scale
    units = np.outer(scale, scale)
    moved = np.eye(known.size) - covariance[np.ix_(known, known)] / units
    size, directions = np.linalg.eigh(moved)
    seen = directions[:, size > SEEN]
    if not seen.size:
        return KnownLengths(known, 0.0)
    expected = seen.T @ (moved + added[np.ix_(known, known)] / units) @ seen
    along = seen.T @ off
    square = float(along @ np.linalg.solve(expected, along))
    needed = float(np.abs(scale * (seen @ along)).sum())
    return KnownLengths(known, float(np.sqrt(square / along.size)), needed)

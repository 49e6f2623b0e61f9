"""Least sizes of findings: below them an effect may be certain, and means nothing for the result.

Thousands of rows make effects of a micrometre significant. A finding has to exceed chance and the
size from which it matters to the tool's position: here 5 um, a twentieth of what no nominal robot
keeps (ballbar.ident.verdict.ALWAYS_WORTHWHILE) and what an unchanged machine is apart by from one
recording to the next.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array

LITTLE_SHIFT = 5e-6  # [m] of a tool or seat, or of a length: 0.4 m of steel that warms by 1 K
LITTLE_TURN = 2.5e-5  # [rad] of a tool or an axis that is turned: 5 um at 0.2 m from the flange
# [rad], [m] standard deviations of what an unchanged machine is apart by from one recording to the
# next: friction and play leave the zero of an axis 10 urad, and 0.7 K a length of steel 5 um.
WANDER_ZERO, WANDER_LENGTH = 1e-5, 5e-6
LITTLE_RIPPLE = 5e-6  # [rad] amplitude of a periodic joint error: 5 um at a metre from the joint
LITTLE_RATIO = 5e-5  # [1] of a gear: 25 um at half a metre, over a radian
LITTLE_LAG = 1e-3  # [s] the filters of one controller differ by as much
# Chi-square of k values beyond k, in sqrt(2 k), from which they are not 0: what chance gives to one
# value in 500.
SUPPORT = 6.0


def not_by_chance(values: Array, covariance: Array) -> bool:
    """Whether values (K,) of a covariance (K, K) differ from 0 by more than chance explains."""
    chi2 = float(values @ np.linalg.solve(covariance, values))
    return bool(chi2 > values.size + SUPPORT * np.sqrt(2.0 * values.size))

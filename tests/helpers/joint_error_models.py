"""A linearised fit whose residual is white noise beside joint errors."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.regions import joint_regions

POSES, EQUATIONS, JOINTS = 400, 3, 4


def linear_model(angles: Array, errors: Array, seed: int = 0) -> LinearModel:
    """White noise of unit variance beside joint errors (J, N) [rad]; two unknowns are present."""
    rng = np.random.default_rng(seed)
    n = angles.shape[1]
    joints = 1e4 * rng.normal(size=(len(angles), EQUATIONS, n))
    residual = rng.normal(size=(EQUATIONS, n)) + np.einsum("jen,jn->en", joints, errors)
    jacobian = rng.normal(size=(2, EQUATIONS, n))
    return LinearModel(
        jacobian=jacobian,
        residual=residual,
        joints=joints,
        angles=angles,
        prior_gradient=np.zeros(2),
        prior_normal=1e-6 * np.eye(2),
        regions=joint_regions(angles.T),
        groups=np.arange(n),
    )


def uniform_angles(seed: int = 3) -> Array:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (JOINTS, POSES))

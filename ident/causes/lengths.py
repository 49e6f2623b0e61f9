"""Which single length of the cell, or zero of an axis, puts the tool's path on a sphere.

The distance of the tool from a centre is linear in the lengths a and d of the nominal robot, plate
and tool included; the centre, the radius and one parameter at a time are fitted by Gauss-Newton on
`|p - o| - r`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cell.arrays import Array
from cell.geometry import Geometry, parameter_named, robot_frames
from cell.statistics import rms
from ident.start.sphere import sphere_candidates


@dataclass(frozen=True)
class Length:
    """One parameter changed, and how far the tool then is from its sphere."""

    name: str  # as in cell.geometry, such as ra2
    change: float  # [m, rad] to add to the file's
    radius: float  # [m] of the sphere
    rms: float  # [m]


def single_lengths(nominal: Geometry, q: Array) -> list[Length]:
    """The path at joint angles q (N, J) [rad] with each length or joint offset changed, best first.

    Raises ValueError where the tool hardly moves.
    """
    points = robot_frames(nominal, q).poses()[:, :3, 3]
    start = sphere_candidates(points, nominal["bd3"])[0]
    table = nominal.table
    kinds = ("a", "d", "theta")
    names = [n for n in table.robot if parameter_named(n).kind in kinds and n not in table.gauge]
    lengths = [_fitted(nominal, q, name, start.centre, start.radius) for name in names]
    return sorted(lengths, key=lambda length: length.rms)


def _fitted(nominal: Geometry, q: Array, name: str, centre: Array, radius: float) -> Length:
    def residual(x: Array) -> Array:
        """(N,) [m] of the tool's distance; x (5,) centre, radius and change of the parameter."""
        changed = nominal.replaced({name: nominal[name] + x[4]})
        points = robot_frames(changed, q).tip.T
        return np.asarray(np.linalg.norm(points - x[:3], axis=1) - x[3])

    fit = least_squares(residual, [*centre, radius, 0.0], method="lm")
    return Length(name, float(fit.x[4]), float(fit.x[3]), rms(fit.fun))

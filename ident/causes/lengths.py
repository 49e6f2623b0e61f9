"""Which single length of the cell, or zero of an axis, puts the tool's path on a sphere.

The distance of the tool from a centre is linear in the lengths a and d of the nominal robot, plate
and tool included; the centre, the radius and one parameter at a time are fitted by Gauss-Newton on
`|p - o| - r`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import screw
from cell.geometry import Geometry, parameter_named, robot_frames
from ident.start.sphere import sphere_candidates

ITERATIONS = 8


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
    parameter, change, geometry = parameter_named(name), 0.0, nominal
    for last in [False] * ITERATIONS + [True]:
        frames = robot_frames(geometry, q)
        rod = frames.poses()[:, :3, 3] - centre
        distance = np.linalg.norm(rod, axis=1)
        direction, residual = rod / distance[:, None], distance - radius
        if last:
            break
        slope = (direction * screw(frames, parameter.kind, parameter.row)[:3].T).sum(axis=1)
        jacobian = np.column_stack((-direction, -np.ones(len(q)), slope))
        step = np.linalg.lstsq(jacobian, -residual, rcond=1e-6)[0]
        step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-300))
        centre, radius, change = centre + step[:3], radius + step[3], change + step[4]
        geometry = nominal.replaced({name: nominal[name] + change})
    return Length(name, float(change), float(radius), float(np.sqrt((residual**2).mean())))

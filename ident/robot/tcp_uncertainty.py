"""Stated uncertainty of the tool over the workspace, and what it consists of.

The error of the tool at the poses of a grid is linear in the unknowns, e = A x with the base
aligned and x of covariance C. Two figures are stated, never one without the other's name:

- with scale: the root of the diagonal of A C A', the scale's own uncertainty included. The scale is
  what plate, rod or sensor was measured to, and no recording shows it;
- without scale: the same after the best common factor on all positions is removed too, as
  `TcpError.error_without_scale` does with an error.

The difference of their squares is the part along the scale. What remains is split into the
principal directions of its covariance (Karhunen-Loeve expansion; Jolliffe 2002), so that the mean
squares of all parts add up to that of the stated uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import nominal_geometry, robot_frames
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.priors import scale_sigma
from ballbar.ident.robot.accuracy import TcpError, accuracy_grid, aligned_columns

SCALE = "scale"  # name of the direction
MASSES = "masses"  # name of directions of masses that a fit took as given
LISTED = 0.5  # correlation from which an unknown is said to move along a direction
_KEPT = 1e-3  # share of the mean square that the directions left out have together, at most


@dataclass(frozen=True)
class TcpDirection:
    """A direction in which the unknowns are uncertain together.

    Its part of the tool's error is orthogonal to that of the others over the poses.
    """

    name: str  # SCALE, MASSES, or empty
    rms: float  # [m] of the tool over the poses, for one standard deviation
    # unknowns with their correlation to it, the strongest first
    members: tuple[tuple[str, float], ...]


@dataclass(frozen=True, eq=False)
class TcpUncertainty:
    """Stated uncertainty (1 sigma) of the unloaded robot's tool, base aligned."""

    sigma: Array  # (G,) [m] with the scale
    without_scale: Array  # (G,) [m]
    directions: tuple[TcpDirection, ...]  # the largest first; small ones are left out

    def share(self, direction: TcpDirection) -> float:
        """Share of a direction in the mean square of `sigma`."""
        return (direction.rms / rms(self.sigma)) ** 2

    def with_doubt(self, doubt: TcpError, share: float) -> TcpUncertainty:
        """With an error of its own, of which one standard deviation is this share."""
        part = TcpDirection(MASSES, share * rms(doubt.error), ())
        directions = sorted((*self.directions, part), key=lambda d: -d.rms)
        return replace(
            self,
            sigma=np.hypot(self.sigma, share * doubt.error),
            without_scale=np.hypot(self.without_scale, share * doubt.error_without_scale),
            directions=tuple(directions),
        )


def tcp_uncertainty(
    positions: Array, moves: Array, covariance: Array, names: Sequence[str]
) -> TcpUncertainty:
    """Stated uncertainty of tool positions (G, 3) [m], robot base frame.

    moves : (P, 3, G) change of the tool per unit of each unknown. covariance : (P, P) [SI] of the
    unknowns `names`.
    """
    # In units of deviations: otherwise what is small beside a mass would be lost in rounding.
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    # x = root @ z with z of unit covariance
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    fields = aligned_columns(positions, moves) @ root  # (3G, P)
    scale = scale_direction(positions)
    along = scale @ fields
    rest = fields - np.outer(scale, along)
    return TcpUncertainty(
        sigma=_norms(fields),
        without_scale=_norms(rest),
        directions=_directions(along, rest, root, names),
    )


def parts_without_scale(positions: Array, moves: Array, *parts: Array) -> list[float]:
    """[m] root mean square of `without_scale` that each part (P, P) of the covariance makes up.

    positions, moves : as `tcp_uncertainty`. The squares of parts add up to that of the whole.
    """
    fields = aligned_columns(positions, moves)
    scale = scale_direction(positions)
    rest = fields - np.outer(scale, scale @ fields)
    squares = (float(((rest @ part) * rest).sum()) for part in parts)
    return [float(np.sqrt(max(0.0, square) / len(positions))) for square in squares]


def scale_direction(positions: Array) -> Array:
    """(3G,) unit vector of the motion of points (G, 3) [m] under a common factor, base aligned."""
    centred = (positions - positions.mean(axis=0)).ravel()  # orthogonal to every rigid motion
    return np.asarray(centred / np.linalg.norm(centred))


def _norms(fields: Array) -> Array:
    """(G,) [m] standard deviation of each point from columns (3G, P) of independent errors."""
    return np.asarray(np.sqrt((fields**2).sum(axis=1).reshape(-1, 3).sum(axis=1)))


def _directions(
    along: Array, rest: Array, root: Array, names: Sequence[str]
) -> tuple[TcpDirection, ...]:
    """Scale and principal directions, the largest first."""
    points = len(rest) // 3
    values, vectors = np.linalg.eigh(rest.T @ rest)
    size = float(np.linalg.norm(along))
    parts = [(size, along / size, SCALE)] if size > 0.0 else []
    parts += [
        (float(np.sqrt(value)), vector, "")
        for value, vector in zip(values, vectors.T, strict=True)
        if value > 0.0
    ]
    parts.sort(key=lambda part: -part[0])
    squares = np.cumsum([part[0] ** 2 for part in parts])
    count = int((squares < (1.0 - _KEPT) * squares[-1]).sum()) + 1 if parts else 0
    spread = np.sqrt((root**2).sum(axis=1))
    return tuple(
        _direction(size / np.sqrt(points), root @ unit, spread, name, names)
        for size, unit, name in parts[:count]
    )


def _direction(
    size: float, change: Array, spread: Array, name: str, names: Sequence[str]
) -> TcpDirection:
    """change : (P,) of the unknowns for one standard deviation. spread : (P,) their sigmas."""
    correlation = change / np.where(spread > 0.0, spread, 1.0)
    correlation *= np.sign(correlation[np.abs(correlation).argmax()]) or 1.0
    order = [i for i in np.argsort(-np.abs(correlation)) if abs(correlation[i]) >= LISTED]
    members = tuple((names[i], float(correlation[i])) for i in order)
    masses = not name and bool(members) and members[0][0].startswith(MASSES)
    return TcpDirection(MASSES if masses else name, float(size), members)


def scale_error(cell: Cell, grid: Array | None = None) -> float:
    """[m] root mean square TCP error of one standard deviation of the scale, which no data show.

    grid : (G, J) [rad] joint angles of the poses; default the accuracy grid.
    """
    q = accuracy_grid(cell.robot) if grid is None else grid
    positions = robot_frames(nominal_geometry(cell, np.zeros(3)), q).tip
    centred = positions - positions.mean(axis=1, keepdims=True)
    return float(np.sqrt((centred**2).sum(axis=0).mean())) * scale_sigma(cell)

"""TCP error: distance of the tool from its predicted position over a grid of the workspace.

Parameter errors depend on which parameters were held fixed (gauge); the TCP error after aligning
the base frame does not, so it is what compares robots, paths and methods. Alignment: Kabsch 1976,
Umeyama 1991 (with scale).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, reduce
from operator import xor

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array, read_only
from ballbar.cell.chain import screw
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.robot_angles import controller_to_joints

GRID_POSES = 800
_GRID_SEED = 2400  # the grid is part of the metric: the same poses for everyone
_BITS = 30  # of a coordinate
# Primitive polynomial, its bits from the highest power down, and first direction numbers of each
# dimension (Joe & Kuo 2008, table new-joe-kuo-6).
_JOE_KUO = (
    *((1, *(1,) * 10), (0b11, 1), (0b111, 1, 3), (0b1011, 1, 3, 1), (0b1101, 1, 1, 1)),
    *((0b10011, 1, 1, 3, 3), (0b11001, 1, 3, 5, 13), (0b100101, 1, 1, 5, 5, 17)),
)


@dataclass(frozen=True, eq=False)
class TcpError:
    """Position error of the tool over the grid, base frames aligned."""

    position: Array  # (G, 3) [m] nominal tool position of each pose, robot base frame
    error: Array  # (G,) [m] distance
    error_without_scale: Array  # (G,) [m] after removing one common scale factor too

    @property
    def mean(self) -> float:
        return float(self.error.mean())

    @property
    def maximum(self) -> float:
        return float(self.error.max())


def accuracy_grid(robot: Robot) -> Array:
    """(G, J) [rad] held-out joint angles: a Sobol sequence over the robot's box of axis angles."""
    span = robot.accuracy_upper - robot.accuracy_lower
    return controller_to_joints(robot, robot.accuracy_lower + _grid_points(robot.joints) * span)


@cache
def _grid_points(joints: int) -> Array:
    """(G, J) points of the unit cube: a Sobol sequence, scrambled (Matousek 1998, LMS and shift).

    They are those of scipy.stats.qmc.Sobol, whose import takes as long as a fit.
    """
    (rng,) = np.random.default_rng(_GRID_SEED).spawn(1)  # as SciPy does
    places = np.arange(_BITS)
    shift = rng.integers(2, size=(joints, _BITS, 1), dtype=np.uint32)[:, ::-1]
    scramble = np.tril(rng.integers(2, size=(joints, _BITS, _BITS), dtype=np.uint32), -1)
    count = (GRID_POSES - 1).bit_length()
    directions = np.zeros((joints, _BITS, count), dtype=np.uint32)  # bits, the highest first
    for direction, (polynomial, *m) in zip(directions, _JOE_KUO[:joints], strict=True):
        degree = polynomial.bit_length() - 1
        for k in range(count):
            if k >= len(m):
                terms = (
                    m[k - i] << i for i in range(1, degree + 1) if polynomial >> degree - i & 1
                )
                m.append(reduce(xor, terms, m[k - degree]))
            direction[: k + 1, k] = m[k] >> places[k::-1] & 1
    number = np.arange(GRID_POSES)
    gray = (number ^ number >> 1) >> places[:count, None] & 1  # (count, G)
    bits = ((scramble + np.eye(_BITS, dtype=np.uint32)) @ directions @ gray + shift) % 2
    return read_only(np.einsum("b,jbg->gj", 0.5 ** (1.0 + places), bits))


def tcp_error(model: Geometry, truth: Geometry, grid: Array) -> TcpError:
    """Kinematic error of `model` against `truth` at angles grid (G, J) [rad], base aligned."""
    return position_error(robot_frames(model, grid).tip.T, robot_frames(truth, grid).tip.T)


def position_error(predicted: Array, actual: Array) -> TcpError:
    """Error of predicted tool positions (G, 3) [m] against actual ones, base aligned."""
    rigid = np.linalg.norm(aligned(predicted, actual, scale=False) - actual, axis=1)
    scaled = np.linalg.norm(aligned(predicted, actual, scale=True) - actual, axis=1)
    return TcpError(predicted, rigid, scaled)


def aligned(points: Array, target: Array, *, scale: bool) -> Array:
    """(G, 3) [m] points (G, 3) after the best rigid motion onto a target, or with a factor too."""
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    factor = float((s * np.diag(turn)).sum() / (a * a).sum()) if scale else 1.0
    return np.asarray(factor * a @ (u @ turn @ vt).T + target.mean(axis=0))


def tcp_sigma(
    geometry: Geometry, grid: Array, parameters: NDArray[np.intp], covariance: Array
) -> Array:
    """(G,) [m] standard deviation of the tool position that a parameter covariance implies.

    grid : (G, J) [rad]. parameters : (P,) indices into the table of the first rows of the
    covariance (P or more, same) [m, rad]; those off the robot do not move the unloaded tool. The
    base is aligned.
    """
    chosen = [geometry.table.parameters[i] for i in parameters]
    on_robot = np.array([p.side == "robot" for p in chosen], dtype=bool)
    frames = robot_frames(geometry, grid)
    moves = np.stack([screw(frames, p.kind, p.row)[:3] for p in chosen if p.side == "robot"])
    rows = np.flatnonzero(on_robot)
    return position_sigma(frames.tip.T, moves, covariance[np.ix_(rows, rows)])


def position_sigma(positions: Array, moves: Array, covariance: Array) -> Array:
    """(G,) [m] standard deviation of tool positions (G, 3), base aligned.

    moves : (P, 3, G) change of the tool per unit of each unknown; covariance : (P, P).
    """
    columns = aligned_columns(positions, moves)
    variance = ((columns @ covariance) * columns).sum(axis=1).reshape(-1, 3).sum(axis=1)
    return np.asarray(np.sqrt(variance))


def aligned_columns(positions: Array, moves: Array) -> Array:
    """(3G, P) changes of tool positions (G, 3) [m] per unit of each unknown, base aligned.

    moves : (P, 3, G) the changes as they are.
    """
    columns = moves.transpose(2, 1, 0).reshape(positions.size, len(moves))
    basis = rigid_basis(positions)
    return np.asarray(columns - basis @ (basis.T @ columns))


def rigid_basis(points: Array) -> Array:
    """(3G, 6) orthonormal basis of the small rigid motions of points (G, 3) [m]."""
    centred = points - points.mean(axis=0)
    motions = np.zeros((points.shape[0], 3, 6))
    motions[:, :, :3] = np.eye(3)
    for k in range(3):
        motions[:, :, 3 + k] = np.cross(np.eye(3)[k], centred)
    return np.linalg.qr(motions.reshape(-1, 6))[0]

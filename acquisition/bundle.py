"""Pictures of a flat board by one camera as poses of the board, with what their errors share.

A picture of M corners is one pose with the covariance that its corners leave, for what the robot
does wrong is common to all of them. The corners tell of lens and board besides: what is left of
them when each picture has its best pose. All of that is one bundle adjustment (Zhang 2000)
without the robot: lens, shape of the board and a pose for each picture minimise the corners'
distances, the lens's calibration and the board's tolerances being priors; poses are eliminated
picture by picture (Schur complement). What it leaves uncertain of lens and board displaces every
pose in a known way, and becomes a few unknowns of the fit (`ballbar.cell.poses.CommonErrors`).
To second order in that uncertainty the fit of the poses is that of all corners.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ballbar.cell.arrays import Array
from ballbar.cell.board import SHAPE, Board
from ballbar.cell.camera import NAMES, Camera, Lens
from ballbar.cell.rotation import matrix_from_rotvec

FEWEST = 6  # corners of a picture that is used
FAR = 5.0  # robust standard deviations beyond which a corner is left out
_SHARE = (
    0.6  # of the corners that a picture is used for: else they are not where the board has them
)
_MEDIAN = 0.6745  # of the magnitude of a normal number
_STEPS = 60  # of an adjustment
_SETTLED = 1e-6  # relative decrease of the squares that ends it
DAMPING, _MOST_DAMPING = 1e-3, 1e9  # of Marquardt, on the diagonal
_ROUNDS = 8  # of leaving corners out
_STEADY = 0.01  # relative change of the noise that ends the rounds
_LEAST_NOISE = 1e-3  # [px]

_SHARED = 10.0  # degrees of freedom of the noise of all pictures in that of each


@dataclass(frozen=True, eq=False)
class Pictures:
    """N pictures of one board by one camera."""

    camera: Camera
    board: Board
    pixels: Array  # (N, C, 2) [px]; NaN where a corner was not seen
    flange: Array  # (N, 3, 3) orientation of the nominal robot's flange

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(N, C) whether a corner was seen."""
        return np.asarray(np.isfinite(self.pixels).all(axis=2))


@dataclass(frozen=True, eq=False)
class Bundle:
    """A lens, a board and the poses of a board in N pictures."""

    pictures: Pictures
    lens: Array  # (L,)
    shape: Array  # (5,)
    rotation: Array  # (N, 3, 3) of the board in the camera's frame
    origin: Array  # (N, 3) [m]
    counting: NDArray[np.bool_]  # (N, C) corners that count
    sigma: float  # [px] of each coordinate of a corner

    @property
    def values(self) -> Array:
        """(U,) of lens, then board."""
        return np.concatenate((self.lens, self.shape))

    @cached_property
    def _imaged(self) -> tuple[Array, Array, Array]:
        """Pixels of the corners and their derivatives, as `Lens.image`."""
        points, _ = self.pictures.board.bent(self.shape)
        points = points @ self.rotation.transpose(0, 2, 1) + self.origin[:, None]
        return Lens(self.pictures.camera.lens.model, self.lens).image(points)

    @cached_property
    def residual(self) -> Array:
        """(N, C, 2) [px] measured minus predicted; 0 where a corner was not seen."""
        rest = self.pictures.pixels - self._imaged[0]
        return np.where(self.pictures.seen[..., None], rest, 0.0)

    @property
    def used(self) -> NDArray[np.bool_]:
        """(N,) whether a picture counts."""
        return np.asarray(self.counting.any(axis=1))

    @property
    def square(self) -> Array:
        """(N,) [px^2] sum of squares of the corners that count."""
        return np.asarray((self.residual**2 * self.counting[..., None]).sum(axis=(1, 2)))

    @property
    def picture_noise(self) -> Array:
        """(N,) [px] of each picture's corners, which near and sharp ones have less of.

        Its own root mean square, as far as its corners tell it, and that of all.
        """
        free = np.maximum(2.0 * self.counting.sum(axis=1) - 6.0, 0.0)
        variance = (self.square + _SHARED * self.sigma**2) / (free + _SHARED)
        return np.asarray(np.sqrt(variance))

    @property
    def cost(self) -> float:
        """Sum of squares in standard deviations, priors included."""
        mean, prior = prior_of(self.pictures)
        off = self.values - mean
        return float(self.square.sum() / self.sigma**2 + off @ prior @ off)

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Change of the prediction (N, C, 2, 6) by shift [m] and turn [rad] of the board, about its
        origin in the camera's axes, and (N, C, 2, U) by lens and shape; 0 where none counts.
        """
        _, by_point, by_lens = self._imaged
        points, by_shape = self.pictures.board.bent(self.shape)
        arm = points @ self.rotation.transpose(0, 2, 1)
        turning = np.zeros((*arm.shape, 3))  # of each point by a turn: -[arm]x
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            turning[..., i, j], turning[..., i, k] = arm[..., k], -arm[..., j]
        by_pose = np.concatenate((by_point, by_point @ turning), axis=-1)
        moved = self.rotation[:, None] @ by_shape
        by_values = np.concatenate((by_lens, by_point @ moved), axis=-1)
        counting = self.counting[..., None, None]
        return by_pose * counting, by_values * counting

    def moved(self, poses: Array, values: Array | float = 0.0) -> Bundle:
        """The bundle after shifts and turns (N, 6) of the board, and a step (U,) of the values."""
        turn = matrix_from_rotvec(poses[:, 3:].T).transpose(2, 0, 1)
        changed = self.values + values
        return replace(
            self,
            lens=changed[: self.lens.size],
            shape=changed[self.lens.size :],
            rotation=turn @ self.rotation,
            origin=self.origin + poses[:, :3],
        )

    @cached_property
    def reduced(self) -> tuple[Array, Array, Array, Array]:
        """Normal matrices [1/px^2 as weights]: of the poses (N, 6, 6), of poses with values (N, 6,
        U), and gradients of the poses (N, 6) and of the values (U,), both of half the squares.
        """
        by_pose, by_values = self.slopes
        n = len(by_pose)
        a, b = by_pose.reshape(n, -1, 6), by_values.reshape(n, -1, self.values.size)
        rest = self.residual.reshape(n, -1)
        own, mixed = a.transpose(0, 2, 1) @ a, a.transpose(0, 2, 1) @ b
        own[~self.used] = np.eye(6)
        return own, mixed, np.einsum("nmi,nm->ni", a, rest), np.einsum("nmi,nm->i", b, rest)

    @cached_property
    def information(self) -> Array:
        """(U, U) of lens and board in the corners, poses eliminated; without priors."""
        own, mixed, _, _ = self.reduced
        b = self.slopes[1].reshape(-1, self.values.size)
        whole = b.T @ b
        whole -= np.einsum("niu,niv->uv", mixed, np.linalg.solve(own, mixed))
        return np.asarray(whole / self.sigma**2)

    @cached_property
    def covariance(self) -> Array:
        """(U, U) of lens and board by corners and priors."""
        return np.asarray(np.linalg.inv(self.information + prior_of(self.pictures)[1]))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the corners: coordinates less poses, and what they tell besides."""
        determined = self.values.size - float(
            np.trace(self.covariance @ prior_of(self.pictures)[1])
        )
        return 2.0 * float(self.counting.sum()) - 6.0 * float(self.used.sum()) - determined


def counted(start: Bundle) -> Bundle:
    """The adjusted bundle, with noise as it shows and corners that are far off left out."""
    fitted = _nearer(start)
    for _ in range(_ROUNDS):
        fitted = adjusted(fitted)
        noise = np.sqrt(fitted.square.sum() / max(fitted.freedom, 1.0))
        closest = _nearer(fitted)
        same = bool((closest.counting == fitted.counting).all())
        steady = abs(noise - fitted.sigma) < _STEADY * fitted.sigma
        fitted = replace(closest, sigma=max(float(noise), _LEAST_NOISE))
        if same and steady:
            break
    return fitted


def _nearer(fitted: Bundle) -> Bundle:
    """The bundle with all corners but those that are far off, and pictures with too few left."""
    length, seen = np.linalg.norm(fitted.residual, axis=2), fitted.pictures.seen
    scale = float(np.median(np.abs(fitted.residual[seen]))) / _MEDIAN
    counting = seen & (length < FAR * max(scale, _LEAST_NOISE))
    enough = counting.sum(axis=1) >= np.maximum(FEWEST, _SHARE * seen.sum(axis=1))
    return replace(fitted, counting=counting & enough[:, None])


def adjusted(start: Bundle) -> Bundle:
    """The bundle at its least squares, from where it is, by Marquardt's method."""
    damping, current = DAMPING, start
    mean, prior = prior_of(start.pictures)
    for _ in range(_STEPS):
        own, mixed, of_poses, of_values = current.reduced
        weight = current.sigma**2
        damped = own + damping * own * np.eye(6)
        sides = np.concatenate((mixed, of_poses[..., None]), axis=2)
        solved: Array = np.linalg.solve(damped, sides).astype(np.float64)
        b = current.slopes[1].reshape(-1, mean.size)
        whole = b.T @ b + weight * prior
        whole += damping * np.diag(np.diag(whole))
        whole -= np.einsum("niu,niv->uv", mixed, solved[..., :-1])
        right = of_values + weight * prior @ (mean - current.values)
        right -= np.einsum("niu,ni->u", mixed, solved[..., -1])
        step: Array = np.linalg.solve(whole, right).astype(np.float64)
        tried = current.moved(solved[..., -1] - solved[..., :-1] @ step, step)
        gained = current.cost - tried.cost
        if gained > 0.0:
            current, damping = tried, damping * 0.1
        else:
            damping = max(DAMPING, damping * 10.0)
        if 0.0 <= gained < _SETTLED * current.cost or damping > _MOST_DAMPING:
            break
    return current


def prior_of(pictures: Pictures) -> tuple[Array, Array]:
    """(U,) mean and (U, U) information of the priors of lens and board."""
    lens, board = pictures.camera.lens.values, pictures.board
    sigma = np.array([board.scale_sigma] * 2 + [board.flat] * 3)
    inverse = np.linalg.inv(pictures.camera.covariance)
    return np.concatenate((lens, np.zeros(sigma.size))), block_diag(inverse, np.diag(sigma**-2.0))


def names_of(pictures: Pictures) -> tuple[str, ...]:
    """(U) names of the values of lens and board."""
    return (*NAMES[pictures.camera.lens.model], *SHAPE)

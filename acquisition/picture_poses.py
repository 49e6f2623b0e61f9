"""Pictures of a flat board by one camera as poses of the board, with what their errors share.

A picture of M corners is one pose with the covariance that its corners leave, for what the robot
does wrong is common to all of them. The corners tell of lens and board besides: what is left of
them when each picture has its best pose. All of that is one bundle adjustment (Triggs et al. 2000)
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
from ballbar.cell.rigid_fit import nearest_rotation
from ballbar.cell.rotation import matrix_from_rotvec

FEWEST = 6  # corners of a picture that is used
FAR = 5.0  # robust standard deviations beyond which a corner is left out
_MEDIAN = 0.6745  # of the magnitude of a normal number
_STEPS = 60  # of a bundle adjustment
_POSE_STEPS = 25  # of a pose with lens and board given
_SETTLED = 1e-6  # relative decrease of the squares that ends a search
_STEADY = 0.01  # relative change of the noise that ends the rounds
_DAMPING, _MOST_DAMPING = 1e-3, 1e9  # of Marquardt, on the diagonal
_ROUNDS = 8  # of leaving corners out
_DOUBTFUL = 4.0  # ratio of squares up to which the robot tells which of two poses a picture shows
_LEAST_NOISE = 1e-3  # [px]
_SAMPLES = 30  # of a homography
_SHARE = (
    0.6  # of the corners that a picture is used for: else they are not where the board has them
)


@dataclass(frozen=True, eq=False)
class Pictures:
    """N pictures of one board by one camera."""

    camera: Camera
    board: Board
    pixels: Array  # (N, C, 2) [px]; NaN where a corner was not seen
    flange: Array  # (N, 3, 3) orientation of the nominal robot's flange

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(N, C) whether a corner was found."""
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
        told = self.values.size - float(np.trace(self.covariance @ prior_of(self.pictures)[1]))
        return 2.0 * float(self.counting.sum()) - 6.0 * float(self.used.sum()) - told


def bundle(pictures: Pictures) -> Bundle:
    """The bundle of pictures with FEWEST corners or more each, single wrong corners left out."""
    n, camera = len(pictures.pixels), pictures.camera
    start = Bundle(
        pictures,
        camera.lens.values,
        np.zeros(len(SHAPE)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3)),
        pictures.seen,
        camera.sigma,
    )
    plane = _started(start)
    starts = [_chosen(each, robust=True) for each in (plane, _started(_focused(plane)))]
    found = min(starts, key=lambda each: float(np.median(each.square)))
    for _ in range(2):  # the second time with the lens that the first one found
        found = _counted(found)
        chosen = _chosen(found, robust=False)
        if np.allclose(chosen.rotation, found.rotation, atol=0.05):
            break
        found = chosen
    return found


def _counted(start: Bundle) -> Bundle:
    """The adjusted bundle, with noise as found and corners that are far off left out."""
    found = _nearer(start)
    for _ in range(_ROUNDS):
        found = _adjusted(found)
        noise = np.sqrt(found.square.sum() / max(found.freedom, 1.0))
        nearer = _nearer(found)
        same = bool((nearer.counting == found.counting).all())
        steady = abs(noise - found.sigma) < _STEADY * found.sigma
        found = replace(nearer, sigma=max(float(noise), _LEAST_NOISE))
        if same and steady:
            break
    return found


def _nearer(found: Bundle) -> Bundle:
    """The bundle with all corners but those that are far off, and pictures with too few left."""
    length, seen = np.linalg.norm(found.residual, axis=2), found.pictures.seen
    scale = float(np.median(np.abs(found.residual[seen]))) / _MEDIAN
    counting = seen & (length < FAR * max(scale, _LEAST_NOISE))
    enough = counting.sum(axis=1) >= np.maximum(FEWEST, _SHARE * seen.sum(axis=1))
    return replace(found, counting=counting & enough[:, None])


def _adjusted(start: Bundle) -> Bundle:
    """The bundle at its least squares, from where it is, by Marquardt's method."""
    damping, current = _DAMPING, start
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
            damping = max(_DAMPING, damping * 10.0)
        if 0.0 <= gained < _SETTLED * current.cost or damping > _MOST_DAMPING:
            break
    return current


def _posed(start: Bundle, *, robust: bool) -> Bundle:
    """The bundle with each picture's pose at its least squares, lens and board as they are.

    robust : whether corners far off count less (Geman & McClure 1987).
    """
    current = start
    damping = np.full(len(start.origin), _DAMPING)
    for _ in range(_POSE_STEPS):
        weight = _weights(current) if robust else np.ones(current.counting.shape)
        root = np.sqrt(weight)
        a = (current.slopes[0] * root[..., None, None]).reshape(len(root), -1, 6)
        own = a.transpose(0, 2, 1) @ a
        own[~current.used] = np.eye(6)
        rest = (current.residual * root[..., None]).reshape(len(root), -1, 1)
        right = (a.transpose(0, 2, 1) @ rest)[..., 0]
        own += damping[:, None, None] * own * np.eye(6)
        tried = current.moved(np.asarray(np.linalg.solve(own, right[..., None])[..., 0]))
        before, after = (
            (b.residual**2 * (weight * b.counting)[..., None]).sum(axis=(1, 2))
            for b in (current, tried)
        )
        better = after < before
        damping = np.where(better, 0.1 * damping, 10.0 * np.maximum(damping, _DAMPING))
        if not better.any():
            break
        current = _mixed(current, tried, better)
    return current


def _weights(current: Bundle) -> Array:
    """(N, C) of corners by their distances from the prediction, each picture's own scale."""
    length = np.linalg.norm(current.residual, axis=2)
    masked = np.where(current.counting, length, np.nan)
    scale = np.maximum(np.nanmedian(masked, axis=1), current.sigma)
    return np.asarray(1.0 / (1.0 + (length / (3.0 * scale[:, None])) ** 2) ** 2)


def _mixed(first: Bundle, second: Bundle, chosen: NDArray[np.bool_]) -> Bundle:
    """The first bundle with the chosen pictures' poses of the second."""
    return replace(
        first,
        rotation=np.where(chosen[:, None, None], second.rotation, first.rotation),
        origin=np.where(chosen[:, None], second.origin, first.origin),
    )


def _chosen(start: Bundle, *, robust: bool) -> Bundle:
    """The bundle with the better of the two poses that the picture of a flat board allows.

    Turned about its line of sight by half a turn a small board looks nearly the same (Schweighofer
    & Pinz 2006). Where the corners leave it open the robot tells: the angle between two pictures'
    orientations is that between the flange's.
    """
    first = _posed(start, robust=robust)
    middle = start.pictures.board.points.mean(axis=0)
    centre = first.rotation[..., :2] @ middle + first.origin
    along = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    half_turn = 2.0 * along[:, :, None] * along[:, None] - np.eye(3)
    rotation = half_turn @ first.rotation * np.array([-1.0, -1.0, 1.0])
    other = replace(first, rotation=rotation, origin=centre - rotation[..., :2] @ middle)
    second = _posed(other, robust=robust)
    ratio = (second.square + 1e-12) / (first.square + 1e-12)
    best = _mixed(first, second, ratio < 1.0)
    doubtful = (ratio < _DOUBTFUL) & (ratio > 1.0 / _DOUBTFUL)
    flange = start.pictures.flange
    off = [_disagreement(b.rotation, best.rotation, flange) for b in (first, second)]
    return _mixed(best, _mixed(first, second, off[1] < off[0]), doubtful)


def _disagreement(rotation: Array, others: Array, flange: Array) -> Array:
    """(N,) [rad] median difference of the angles between orientations, pictures and flange."""
    off = np.abs(_angles(rotation, others) - _angles(flange, flange))
    return np.asarray(np.median(off, axis=1))


def _angles(first: Array, second: Array) -> Array:
    """(N, K) [rad] angles between orientations (N, 3, 3) and (K, 3, 3)."""
    cosine = 0.5 * (np.einsum("nij,kij->nk", first, second) - 1.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _started(start: Bundle) -> Bundle:
    """The bundle with the poses of each picture's homography."""
    points = start.pictures.board.points
    rotation, origin = start.rotation.copy(), start.origin.copy()
    for n, (matrix, seen) in enumerate(zip(_planes(start), start.pictures.seen, strict=True)):
        size = 0.5 * (np.linalg.norm(matrix[:, 0]) + np.linalg.norm(matrix[:, 1]))
        middle = matrix @ np.array([*points[seen].mean(axis=0), 1.0])
        x, y, shift = (matrix / (size if middle[2] > 0.0 else -size)).T
        rotation[n] = nearest_rotation(np.column_stack((x, y, np.cross(x, y))))
        origin[n] = shift
    return replace(start, rotation=rotation, origin=origin)


def _planes(start: Bundle) -> Array:
    """(N, 3, 3) maps of board coordinates [m] to tangents of the lines of sight."""
    pictures, points = start.pictures, start.pictures.board.points
    lens, scale = Lens(pictures.camera.lens.model, start.lens), np.abs(points).max()
    out = []
    for pixels, seen in zip(pictures.pixels, pictures.seen, strict=True):
        matrix = homography(points[seen] / scale, lens.tangents(pixels[seen]))
        out.append(matrix / np.array([scale, scale, 1.0]))
    return np.stack(out)


def _focused(start: Bundle) -> Bundle:
    """The bundle with the focal lengths that the pictures' homographies show, within the prior.

    Images of the board's axes are at right angles and equally long (Zhang 2000, sec. 3.1), the
    principal point and the ratio of the focal lengths as declared.
    """
    planes = _planes(start)
    x, y = planes[..., 0], planes[..., 1]
    size = (x * x).sum(axis=1) + (y * y).sum(axis=1)
    product, difference = x * y / size[:, None], (x * x - y * y) / size[:, None]
    rows = np.concatenate((product, difference))
    flat, deep = rows[:, :2].sum(axis=1), rows[:, 2]
    square = -float(flat @ flat) / min(float(flat @ deep), -np.finfo(float).tiny)
    wide = 3.0 * np.sqrt(start.pictures.camera.covariance[0, 0]) / start.lens[0]
    share = np.clip(np.sqrt(square), max(0.2, 1.0 - wide), 1.0 + wide)
    lens = start.lens.copy()
    lens[:2] *= share
    return replace(start, lens=lens)


def homography(points: Array, images: Array) -> Array:
    """(3, 3) projective map of points (M, 2) to images (M, 2); a few may be wrong.

    Direct linear transformation (Hartley & Zisserman 2004, sec. 4.1) of the points near the best of
    some random samples (least median of squares, Rousseeuw 1984).
    """
    known = np.column_stack((points, np.ones(len(points))))
    zero = np.zeros_like(known)
    u, v = images.T[..., None]
    rows = np.stack((np.hstack((known, zero, -u * known)), np.hstack((zero, known, -v * known))), 1)
    rng = np.random.default_rng(0)
    few = np.argsort(rng.random((_SAMPLES, len(points))), axis=1)[:, :FEWEST]
    matrices = np.linalg.svd(rows[few].reshape(_SAMPLES, -1, 9))[2][:, -1].reshape(-1, 3, 3)
    off = np.stack([_off(matrix, known, images) for matrix in matrices])
    off = off[np.median(off, axis=1).argmin()]
    for _ in range(3):
        near = off <= max(FAR * float(np.median(off)), np.sort(off)[FEWEST - 1])
        matrix = np.linalg.svd(rows[near].reshape(-1, 9), full_matrices=False)[2][-1].reshape(3, 3)
        off = _off(matrix, known, images)
    return np.asarray(matrix)


def _off(matrix: Array, known: Array, images: Array) -> Array:
    """(M,) distances of mapped points (M, 3) from their images (M, 2)."""
    image = known @ matrix.T
    depth = np.where(np.abs(image[:, 2]) < 1e-9, 1e-9, image[:, 2])
    return np.asarray(np.linalg.norm(image[:, :2] / depth[:, None] - images, axis=1))


def prior_of(pictures: Pictures) -> tuple[Array, Array]:
    """(U,) mean and (U, U) information of the priors of lens and board."""
    lens, board = pictures.camera.lens.values, pictures.board
    sigma = np.array([board.scale_sigma] * 2 + [board.flat] * 3)
    inverse = np.linalg.inv(pictures.camera.covariance)
    return np.concatenate((lens, np.zeros(sigma.size))), block_diag(inverse, np.diag(sigma**-2.0))


def names_of(pictures: Pictures) -> tuple[str, ...]:
    """(U) names of the values of lens and board."""
    return (*NAMES[pictures.camera.lens.model], *SHAPE)

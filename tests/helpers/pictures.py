"""Pictures of a board, made without the project's kinematics, lens or rotations.

A UR5e by its Denavit-Hartenberg rows with errors of the size of thesis Table 3.1, a lens by the
formulas of Brown 1966, and corners with white noise. The camera stands in the cell, with the board
on the flange, or the other way round.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array

A = np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0])
D = np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
ALPHA = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
LENGTHS, ANGLES = 1.1e-3, 0.7e-3  # [m], [rad] root mean squares of thesis Table 3.1
LENS = dict(
    zip(
        ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
        (1050.0, 1048.0, 655.0, 352.0, -0.12, 0.06, 6e-4, -4e-4, 0.01),
        strict=True,
    )
)
SIZE = np.array([1280, 720])  # [px]
COLUMNS, ROWS = 9, 7  # squares of the board
DRAWS = 20000  # of postures at a time
AT_ONCE = 200  # of them whose pictures are worked out together

Image = Callable[[Array], Array]


def turn(vector: Array) -> Array:
    """(3, 3) rotation by a rotation vector (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew)


def inverse(poses: Array) -> Array:
    """(..., 4, 4) inverses of poses."""
    out, back = np.zeros_like(poses), poses[..., :3, :3].swapaxes(-1, -2)
    out[..., :3, :3], out[..., 3, 3] = back, 1.0
    out[..., :3, 3] = -(back @ poses[..., :3, 3:])[..., 0]
    return out


@dataclass(frozen=True, eq=False)
class Arm:
    """Rows of an arm: lengths [m], and angles [rad] off those of the joints."""

    a: Array
    d: Array
    alpha: Array
    theta: Array
    beta: Array  # about y behind each row

    def flange(self, q: Array) -> Array:
        """(N, 4, 4) poses of the flange at joint angles q (N, 6) [rad]."""
        out = np.tile(np.eye(4), (len(q), 1, 1))
        for j in range(6):
            c, s = np.cos(q[:, j] + self.theta[j]), np.sin(q[:, j] + self.theta[j])
            ca, sa, zero = np.cos(self.alpha[j]), np.sin(self.alpha[j]), np.zeros(len(q))
            row = np.zeros((len(q), 4, 4))
            row[:, 0] = np.stack((c, -s * ca, s * sa, self.a[j] * c), axis=1)
            row[:, 1] = np.stack((s, c * ca, -c * sa, self.a[j] * s), axis=1)
            row[:, 2] = np.stack((zero, zero + sa, zero + ca, zero + self.d[j]), axis=1)
            row[:, 3, 3] = 1.0
            tilt = np.eye(4)
            tilt[:3, :3] = turn(np.array([0.0, self.beta[j], 0.0]))
            out = out @ row @ tilt
        return out


NOMINAL = Arm(A, D, ALPHA, np.zeros(6), np.zeros(6))


def arm(rng: np.random.Generator, size: float = 1.0, zeros: float = 0.0) -> Arm:
    """A UR5e with errors of `size` times Table 3.1, and zeros [rad] of its axes lost."""
    draw = rng.standard_normal
    beta = np.zeros(6)
    beta[1:3] = ANGLES * size * draw(2)
    lost = zeros * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    return Arm(
        A + LENGTHS * size * draw(6),
        D + LENGTHS * size * draw(6),
        ALPHA + ANGLES * size * draw(6),
        ANGLES * size * draw(6) + lost,
        beta,
    )


def brown(points: Array, lens: Mapping[str, float] = LENS) -> Array:
    """(..., 2) [px] of points (..., 3) in the camera's frame."""
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    r2 = x * x + y * y
    radial = 1.0 + lens["k1"] * r2 + lens["k2"] * r2**2 + lens["k3"] * r2**3
    p1, p2 = lens["p1"], lens["p2"]
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack((lens["fx"] * u + lens["cx"], lens["fy"] * v + lens["cy"]), axis=-1)


def corners(square: float) -> Array:
    """(C, 3) [m] row by row."""
    return square * np.array([[x, y, 0.0] for y in range(1, ROWS) for x in range(1, COLUMNS)])


def shaped(points: Array, stretch: float = 0.0, sag: float = 0.0) -> Array:
    """Points (C, 3) [m] of a board that is longer along x by a share, and bent [m] along x about
    its middle plane.
    """
    x = points[:, 0] - points[:, 0].mean()
    square = (x / np.abs(x).max()) ** 2
    moved = np.column_stack(
        (stretch * points[:, 0], np.zeros(len(points)), sag * (square - square.mean()))
    )
    return points + moved


@dataclass(frozen=True, eq=False)
class Drawn:
    """N pictures and how they came about."""

    q: Array  # (N, 6) [rad]
    pixels: Array  # (N, C, 2); NaN where a corner is outside the picture
    arm: Arm
    seat: Array  # (4, 4) of what stands in the cell, robot base frame
    target: Array  # (4, 4) of what is on the flange
    board: Array  # (C, 3) [m] as it is meant to be
    carried: bool  # whether the camera is on the flange

    def tcp(self, q: Array) -> Array:
        """(N, 3) [m] true positions of the target."""
        return np.asarray((self.arm.flange(q) @ self.target)[:, :3, 3])


def draw(
    seed: int,
    count: int = 60,
    *,
    carried: bool = False,
    noise: float = 0.15,
    size: float = 1.0,
    zeros: float = 0.0,
    square: float = 0.025,
    cut: float = 0.1,
    board: Callable[[Array], Array] = lambda points: points,
    image: Image = brown,
) -> Drawn:
    """Pictures at random postures that see the whole board, but a share `cut` of them a part.

    noise : [px] of each corner. size, zeros : as of `arm`. board : the points as they truly are.
    """
    rng = np.random.default_rng(seed)
    robot, points = arm(rng, size, zeros), corners(square)
    middle = points.mean(axis=0)
    seat, target = _stands(rng, middle, carried=carried)
    true = np.column_stack((board(points), np.ones(len(points))))
    q, pixels = list[Array](), list[Array]()
    while len(q) < count:
        trial = rng.uniform(-np.pi, np.pi, (DRAWS, 6))
        trial[:, 1] = rng.uniform(-2.6, -0.3, DRAWS)
        trial[:, 2] = rng.uniform(0.2, 2.6, DRAWS)
        sights = _facing(robot, trial, seat, target, middle, carried=carried)
        for angles, to_camera in islice(sights, count - len(q)):
            seen = image((true @ to_camera.T)[:, :3])
            seen = seen + noise * rng.standard_normal(seen.shape)
            inside = ((seen > 2.0) & (seen < SIZE - 3.0)).all(axis=1)
            if inside.sum() >= (12 if rng.random() < cut else len(points)):
                q.append(angles)
                pixels.append(np.where(inside[:, None], seen, np.nan))
    return Drawn(np.array(q), np.array(pixels), robot, seat, target, points, carried)


def _facing(
    robot: Arm, trial: Array, seat: Array, target: Array, middle: Array, *, carried: bool
) -> Iterator[tuple[Array, Array]]:
    """Joint angles (6,) [rad] of rows of `trial` where the camera may see the board, whose middle
    is a point (3,) [m] of it, and the board's pose (4, 4) before the camera; worked out a few rows
    ahead of those that are taken.
    """
    for rows in np.split(trial, range(AT_ONCE, len(trial), AT_ONCE)):
        flange = robot.flange(rows)
        to_camera = inverse(flange @ target) @ seat if carried else inverse(seat) @ flange @ target
        seen = to_camera[:, :3, :3] @ middle + to_camera[:, :3, 3]
        away = np.linalg.norm(seen, axis=1)
        facing = (to_camera[:, :3, 2] * seen).sum(axis=1) / away
        good = (seen[:, 2] > 0.35) & (away < 1.1) & (facing > 0.5) & (flange[:, 2, 3] > 0.05)
        yield from zip(rows[good], to_camera[good], strict=True)


def _stands(rng: np.random.Generator, middle: Array, *, carried: bool) -> tuple[Array, Array]:
    """Poses of camera and board: in the cell, and on the flange."""
    seat, target = np.eye(4), np.eye(4)
    target[:3, :3] = turn(rng.uniform(-0.1, 0.1, 3))
    if carried:
        target[:3, 3] = [0.04, 0.06, 0.03]
        seat[:3, :3] = turn(np.array([0.0, 0.0, 0.4])) @ turn(np.array([np.pi, 0.0, 0.0]))
        seat[:3, 3] = np.array([-0.55, 0.1, 0.0]) - seat[:3, :3] @ middle
        return seat, target
    target[:3, 3] = np.array([0.0, 0.0, 0.05]) - target[:3, :3] @ middle
    seat[:3, 3] = [-1.0, 0.45, 0.45]
    along = np.array([-0.35, 0.0, 0.35]) - seat[:3, 3]
    along /= np.linalg.norm(along)
    right = np.cross(along, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    looking = np.stack((right, np.cross(along, right), along), axis=1)
    seat[:3, :3] = looking @ turn(rng.uniform(-0.05, 0.05, 3))
    return seat, target


def write(
    drawn: Drawn,
    folder: Path,
    *,
    square: float | None = None,
    sigma: float = 2e-5,
    instrument: str = "webcam_720p",
) -> Path:
    """The files of the pictures, as a user has them; square, sigma : [m] of the board's file."""
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"image_{n:03d}.png" for n in range(len(drawn.q))]
    axes = [f"J{j}" for j in range(1, 7)]
    with (folder / "joints.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["image", *axes])
        for name, q in zip(names, np.rad2deg(drawn.q), strict=True):
            rows.writerow([name, *(f"{angle:.7f}" for angle in q)])
    with (folder / "corners.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["image", "corner", "u", "v"])
        for name, seen in zip(names, drawn.pixels, strict=True):
            for corner in np.flatnonzero(np.isfinite(seen[:, 0])):
                rows.writerow([name, corner, *(f"{x:.4f}" for x in seen[corner])])
    stated = square or drawn.board[1, 0] - drawn.board[0, 0]
    (folder / "board.yaml").write_text(
        f"schema: ballbar-board/1\nkind: checkerboard\nsquares_x: {COLUMNS}\nsquares_y: {ROWS}\n"
        f"square_m: {stated:.6f}\nsigma_m: {sigma:.1e}\n"
    )
    seat, target, place = (
        ("board", "camera", "flange") if drawn.carried else ("camera", "board", "cell")
    )
    (folder / "poses.yaml").write_text(
        f"schema: ballbar-poses/1\nkind: simulated\nrobot: ur5e\ninstrument: {instrument}\n"
        "tables:\n- files: [joints.csv]\n"
        f"  joints: {{columns: [{', '.join(axes)}], unit: deg, angles: joints}}\n"
        f"  pictures: {{corners: corners.csv, board: board.yaml, camera: {place}}}\n"
        f"  seat: {seat}\n  target: {target}\n"
    )
    return folder


def position_errors(predicted: Array, true: Array) -> Array:
    """(N,) [m] distances of points (N, 3) from true ones, moved onto them as a rigid body."""
    a, b = predicted - predicted.mean(axis=0), true - true.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return np.asarray(np.linalg.norm(a @ rotation - b, axis=1))


def workspace(drawn: Drawn, count: int = 400) -> Array:
    """(N, 6) [rad] postures within the ranges of those of the pictures."""
    rng = np.random.default_rng(0)
    return rng.uniform(drawn.q.min(axis=0), drawn.q.max(axis=0), (count, 6))

"""A robot from pictures of a board: error against its bound, and against poses of each picture.

    python -m benchmarks.camera --seeds 30          # five minutes of one core
    python -m benchmarks.camera --seeds 18 --exact-board [--pictures 30] [--first 100]

Pictures are those of tests/helpers/pictures.py, which shares no code with the project: a UR5e with
errors of the size of thesis Table 3.1, 1280 x 720, corners to 0.15 px, boards as long as their
files say and glued to a plate. Writes docs/studies/camera.csv, a row for each stand and seed: root
mean squares of the tool's error over the fitted ranges, base aligned, of the nominal robot, of the
identified one, and of the Bayesian Cramer-Rao bound of all corners; what is stated; the same error
from poses of each picture alone (with OpenCV, where it is installed: its calibration and its
poses, through the instrument `pose`); the share of poses whose tool lies in its stated 95 % region,
and of lens and board within their 95 % intervals; and seconds of one core. The two lengths of the
board are most of error and bound: with --exact-board they are known. That, other seeds and fewer
pictures write nothing.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseTable
from ballbar.cell.rigid_fit import kabsch
from ballbar.ident.table_fit import fit_table
from benchmarks.study import STUDIES, in_words, study_parser, write_table
from tests.helpers.pictures import (
    ANGLES,
    LENGTHS,
    LENS,
    NOMINAL,
    SIZE,
    Arm,
    Drawn,
    brown,
    draw,
    inverse,
    position_errors,
    turn,
    workspace,
    write,
)

NOISE, SQUARE = 0.15, 0.025  # [px], [m]
SCALE, SAG = 2e-5 / SQUARE, 5e-4  # relative, [m]: standard deviations that the board's file states
FLAT = 1e-4  # [m] the same of the boards drawn, glued to a plate: OpenCV takes them as flat
# Of rows of the arm, places of camera and board, lens, and board, in the order of `_pixels`.
PRIOR = np.array(
    [LENGTHS] * 12 + [ANGLES] * 14 + [1.0] * 12
    + [200.0, 200.0, 40.0, 40.0, 0.3, 0.5, 0.01, 0.01, 0.5]
    + [SCALE] * 2 + [SAG] * 3
)  # fmt: skip
STEPS = np.array([1e-6] * 38 + [1e-2] * 4 + [1e-5] * 5 + [1e-6] * 5)


def board(shape: Array, points: Array) -> Array:
    """Points (C, 3) [m] of a board stretched and bent; shape : (5,) as in ballbar.cell.board."""
    middle, half = points[:, :2].mean(axis=0), 0.5 * np.ptp(points[:, :2], axis=0).max()
    x, y = ((points[:, :2] - middle) / half).T
    sag = shape[2] * (x * x - (x * x).mean()) + shape[3] * x * y
    sag = sag + shape[4] * (y * y - (y * y).mean())
    return points * np.array([1.0 + shape[0], 1.0 + shape[1], 1.0]) + np.outer(sag, [0, 0, 1.0])


def _arm(drawn: Drawn, change: Array) -> Arm:
    """The arm with its 26 errors changed."""
    arm, beta = drawn.arm, drawn.arm.beta.copy()
    beta[1:3] += change[24:26]
    parts = (arm.a, arm.d, arm.alpha, arm.theta)
    a, d, alpha, theta = (p + change[6 * k : 6 * k + 6] for k, p in enumerate(parts))
    return Arm(a, d, alpha, theta, beta)


def _moved(pose: Array, change: Array) -> Array:
    out = pose.copy()
    out[:3, :3] = turn(change[3:]) @ pose[:3, :3]
    out[:3, 3] += change[:3]
    return out


def _pixels(drawn: Drawn, change: Array) -> Array:
    """(N, C, 2) [px] without noise at errors changed (52,) from the true ones."""
    seat, target = _moved(drawn.seat, change[26:32]), _moved(drawn.target, change[32:38])
    flange = _arm(drawn, change).flange(drawn.q) @ target
    to_camera = inverse(flange) @ seat if drawn.carried else inverse(seat) @ flange
    points = board(change[47:], drawn.board)
    seen = points @ to_camera[:, :3, :3].transpose(0, 2, 1) + to_camera[:, None, :3, 3]
    lens = {name: value + change[38 + k] for k, (name, value) in enumerate(LENS.items())}
    return brown(seen, lens)


def bound(drawn: Drawn, prior: Array = PRIOR) -> float:
    """[m] root mean square of the tool's error by the Bayesian Cramer-Rao bound."""
    seen, q = np.isfinite(drawn.pixels[..., 0]), workspace(drawn)

    def tool(change: Array) -> Array:
        target = _moved(drawn.target, change[32:38])
        return np.asarray((_arm(drawn, change).flange(q) @ target)[:, :3, 3])

    pixels, moves = [], []
    for step in np.diag(STEPS):
        size = 2.0 * step.max()
        pixels.append(((_pixels(drawn, step) - _pixels(drawn, -step))[seen] / size).ravel())
        moves.append(((tool(step) - tool(-step)) / size).ravel())
    jacobian, columns = np.stack(pixels, axis=1), np.stack(moves, axis=1)
    arm = tool(np.zeros(STEPS.size)) - tool(np.zeros(STEPS.size)).mean(axis=0)
    rigid = np.zeros((len(q), 3, 6))
    rigid[:, :, :3] = np.eye(3)
    for k in range(3):
        rigid[:, :, 3 + k] = np.cross(np.eye(3)[k], arm)
    basis = np.linalg.qr(rigid.reshape(-1, 6))[0]
    columns = (columns - basis @ (basis.T @ columns)) * prior
    information = (jacobian * prior).T @ (jacobian * prior) / NOISE**2 + np.eye(prior.size)
    solved = np.linalg.solve(information, columns.T)
    return float(np.sqrt((columns.T * solved).sum() / len(q)))


def by_single_pictures(drawn: Drawn, table: PoseTable) -> PoseTable:
    """The table with the pose that OpenCV finds in each picture, its lens calibrated by all."""
    import cv2  # noqa: PLC0415

    seen = [np.isfinite(p[:, 0]) for p in drawn.pixels]
    points = [drawn.board[s].astype(np.float32) for s in seen]
    pixels = [p[s].astype(np.float32) for p, s in zip(drawn.pixels, seen, strict=True)]
    size = (int(SIZE[0]), int(SIZE[1]))
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(points, pixels, size, None, None)
    poses = np.tile(np.eye(4), (len(seen), 1, 1))
    for pose, rotation, shift in zip(poses, turns, shifts, strict=True):
        pose[:3, :3], pose[:3, 3] = (
            Rotation.from_rotvec(rotation.ravel()).as_matrix(),
            shift.ravel(),
        )
    del matrix, distortion
    poses = inverse(poses) if drawn.carried else poses
    (group,) = table.groups
    values = np.hstack((poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()))
    sigma = np.tile(np.median(group.sigma, axis=0), (len(seen), 1))
    sigma = np.repeat([np.sqrt((part**2).mean()) for part in (sigma[:, :3], sigma[:, 3:])], 3)
    single = replace(
        group,
        values=values[group.rows - 2],
        sigma=np.tile(sigma, (group.size, 1)),
        factor=None,
        common=None,
        by_common=None,
    )
    return replace(table, groups=(single,))


def aligned(predicted: Array, true: Array) -> Array:
    """(N, 3) [m] errors of points (N, 3), the true ones moved onto them as a rigid body."""
    a, b = predicted - predicted.mean(axis=0), true - true.mean(axis=0)
    return np.asarray(a - b @ kabsch(b, a).T)


def row(seed: int, count: int, *, carried: bool, scale: float) -> dict[str, object]:
    """One robot and so many pictures; scale : relative deviation of the board's lengths."""
    rng = np.random.default_rng(1000 + seed)
    shape = np.array([scale, scale, FLAT, FLAT, FLAT]) * rng.standard_normal(5)
    drawn = draw(seed, count, carried=carried, noise=NOISE, board=partial(board, shape))
    with tempfile.TemporaryDirectory() as folder:
        begun = time.process_time()
        table = read_poses(write(drawn, Path(folder), sigma=scale * SQUARE))
        estimate = fit_table(table)
        seconds = time.process_time() - begun
    q = workspace(drawn)
    robot, true = estimate.identified_robot(), drawn.tcp(q)
    inside = robot.covered(q)

    def rms(values: Array) -> float:
        return float(np.sqrt((values**2).mean()))

    error = position_errors(robot.tool(q), true)
    nominal = position_errors((NOMINAL.flange(q) @ drawn.target)[:, :3, 3], true)
    (camera,) = estimate.cameras.values()
    off = (camera.values - np.concatenate((list(LENS.values()), shape))) / camera.sigma
    out: dict[str, object] = {
        "camera": "on the flange" if carried else "in the cell",
        "seed": seed,
        "nominal_mm": rms(nominal) * 1e3,
        "error_mm": rms(error) * 1e3,
        "bound_mm": bound(drawn, np.array([*PRIOR[:47], scale, scale, *PRIOR[49:]])) * 1e3,
        "stated_mm": rms(robot.sigma(q[inside])) * 1e3,
        "inside": float(robot.within(q, aligned(robot.tool(q), true))[inside].mean()),
        "intervals": float((np.abs(off) < 1.96).mean()),
        "noise_px": camera.errors.noise,
        "seconds": seconds,
    }
    try:
        single = fit_table(by_single_pictures(drawn, table)).identified_robot()
    except ImportError:
        return out
    return out | {"single_pictures_mm": rms(position_errors(single.tool(q), true)) * 1e3}


def main() -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pictures", type=int, default=60)
    parser.add_argument("--exact-board", action="store_true")
    options = parser.parse_args()
    scale = SCALE * 1e-3 if options.exact_board else SCALE
    rows = []
    for seed in range(options.first, options.first + options.seeds):
        for carried in (False, True):
            rows.append(row(seed, options.pictures, carried=carried, scale=scale))
            print(in_words(rows[-1]), flush=True)
    if not (options.exact_board or options.first or options.pictures != 60):
        write_table(STUDIES / "camera.csv", rows, ".4g")
    for camera in ("in the cell", "on the flange"):
        own = [r for r in rows if r["camera"] == camera]
        means = {
            key: float(np.sqrt(np.mean(np.square([float(str(r[key])) for r in own]))))
            for key in own[0]
            if key not in ("camera", "seed")
        }
        print(
            camera,
            in_words(dict(means)),
            f"error/bound {means['error_mm'] / means['bound_mm']:.3f}",
        )


if __name__ == "__main__":
    main()

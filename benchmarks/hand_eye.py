"""Hand-eye transforms: of an identification, and by OpenCV's methods from the same pictures.

    python -m benchmarks.hand_eye --seeds 6

Pictures as in benchmarks.camera, lengths of the boards included. OpenCV's lens and poses of single
pictures (`calibrateCamera`) and the nominal robot's flange go to `calibrateHandEye` and
`calibrateRobotWorldHandEye`, which OpenCV 4 has and OpenCV 5 has not: install
`opencv-python-headless<5` beside the project to run it. Camera on the flange: its pose there;
camera in the cell: that of the board. Writes docs/studies/hand_eye.csv, a row for each stand, seed
and method: errors of position and orientation against the truth, in the frame of the true flange.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.arrays import Array
from ballbar.ident.table_fit import fit_table
from benchmarks.camera import FLAT, NOISE, SCALE, SQUARE, board
from benchmarks.study import STUDIES, in_words, study_parser, write_table
from tests.helpers.pictures import NOMINAL, SIZE, Drawn, draw, inverse, write

HAND_EYE = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
WORLD = ("SHAH", "LI")


def pose(rotation: Array, shift: Array) -> Array:
    """(4, 4) [m] of a rotation, matrix or vector, and a shift."""
    out = np.eye(4)
    out[:3, :3] = rotation if np.size(rotation) == 9 else cv2.Rodrigues(rotation)[0]
    out[:3, 3] = np.ravel(shift)
    return out


def single_pictures(drawn: Drawn) -> Array:
    """(N, 4, 4) [m] of the other in the frame of what is on the flange, by OpenCV alone."""
    seen = [np.isfinite(p[:, 0]) for p in drawn.pixels]
    points = [drawn.board[s].astype(np.float32) for s in seen]
    pixels = [p[s].astype(np.float32) for p, s in zip(drawn.pixels, seen, strict=True)]
    size = (int(SIZE[0]), int(SIZE[1]))
    _, _, _, turns, shifts = cv2.calibrateCamera(points, pixels, size, None, None)
    poses = np.stack([pose(*each) for each in zip(turns, shifts, strict=True)])
    return poses if drawn.carried else inverse(poses)


def by_opencv(drawn: Drawn) -> Iterator[tuple[str, Array]]:
    """Names of methods, and poses (4, 4) [m] on the flange."""
    flange, sights = NOMINAL.flange(drawn.q), single_pictures(drawn)
    own = [list(part) for part in (flange[:, :3, :3], flange[:, :3, 3])]
    other = [list(part) for part in (sights[:, :3, :3], sights[:, :3, 3])]
    for name in HAND_EYE:
        method = getattr(cv2, f"CALIB_HAND_EYE_{name}")
        yield name, pose(*cv2.calibrateHandEye(*own, *other, method=method))
    back = inverse(flange)
    base = [list(part) for part in (back[:, :3, :3], back[:, :3, 3])]
    for name in WORLD:
        method = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
        found = cv2.calibrateRobotWorldHandEye(*other, *base, method=method)
        yield name, inverse(pose(found[2], found[3])[None])[0]


def rows(seed: int, *, carried: bool) -> Iterator[dict[str, object]]:
    """Errors of each method on one robot's pictures."""
    rng = np.random.default_rng(1000 + seed)
    shape = np.array([SCALE, SCALE, FLAT, FLAT, FLAT]) * rng.standard_normal(5)
    drawn = draw(seed, 60, carried=carried, noise=NOISE, board=partial(board, shape))
    with tempfile.TemporaryDirectory() as folder:
        fit = fit_table(read_poses(write(drawn, Path(folder), sigma=SCALE * SQUARE))).fit
    (name,) = fit.model.unknowns.targets
    target = fit.model.unknowns.target(fit.x, name)
    for method, found in (("own", pose(target.rotation, target.origin)), *by_opencv(drawn)):
        turn = cv2.Rodrigues(found[:3, :3].T @ drawn.target[:3, :3])[0]
        yield {
            "camera": "on the flange" if carried else "in the cell",
            "seed": seed,
            "method": method,
            "position_mm": 1e3 * float(np.linalg.norm(found[:3, 3] - drawn.target[:3, 3])),
            "orientation_mrad": 1e3 * float(np.linalg.norm(turn)),
        }


def main() -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=6)
    options = parser.parse_args()
    stands = [(seed, carried) for carried in (False, True) for seed in range(options.seeds)]
    every = [row for seed, carried in stands for row in rows(seed, carried=carried)]
    write_table(STUDIES / "hand_eye.csv", every, ".4g")
    for camera, method in dict.fromkeys((r["camera"], r["method"]) for r in every):
        own = [r for r in every if (r["camera"], r["method"]) == (camera, method)]
        errors = np.array([[r["position_mm"], r["orientation_mrad"]] for r in own], dtype=float)
        position, turn = np.sqrt((errors**2).mean(axis=0))
        print(camera, method, in_words({"position_mm": position, "orientation_mrad": turn}))


if __name__ == "__main__":
    main()

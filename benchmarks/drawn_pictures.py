"""Drawn pictures from the corners that OpenCV finds to the robot: `ballbar camera detect` on.

Robots of tests.helpers.pictures, which shares no code with the fit, before a camera.
Every picture is drawn with blur and noise, a tenth of them with the board cut off; five more cannot
be used: no board, mirrored, of another size, a repetition, and one without joint angles. A row a
robot: the error of the tool against truth, what the result states, and the error from corners with
white noise as large as that of the found ones (`white_corners_mm`), their own bound.

    python -m benchmarks.drawn_pictures --robots 6 --out docs/studies/drawn_pictures.csv
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from ballbar.acquisition.pose_tables import import_poses
from ballbar.camera.corner_files import BOARD, CORNERS, write_corners
from ballbar.cell.arrays import Array
from ballbar.cell.board import load_board
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.camera import Lens
from ballbar.cell.files import write_whole
from ballbar.cell.placement import Placement
from ballbar.ident.table_fit import fit_table
from benchmarks.study import in_words, study_parser, write_table
from tests.helpers import pictures as robots
from tests.helpers.drawn_boards import Exposure, draw

SQUARE = 0.025  # [m]
UNUSABLE = ("blank.png", "mirrored.png", "small.png", "twice.png", "unnamed.png")


def drawn_robot(folder: Path, seed: int, count: int, blur: float) -> robots.Drawn:
    """Writes the pictures of a robot, joints.csv and board.yaml."""
    drawn = robots.draw(seed, count, square=SQUARE)
    robots.write(drawn, folder, sigma=2e-8)  # the scale is exact
    text = (folder / BOARD).read_text().replace("checkerboard", "charuco")
    (folder / BOARD).write_text(f"{text}marker_m: {0.72 * SQUARE}\ndictionary: DICT_4X4_50\n")
    pattern, lens = Pattern(load_board(folder / BOARD).file), Lens("brown", lens_values())
    to_camera = robots.inverse(drawn.seat) @ drawn.arm.flange(drawn.q) @ drawn.target
    rng, exposure = np.random.default_rng([seed, 1]), Exposure(blur=blur, noise=3.0)
    width, height = robots.SIZE.tolist()
    images = [
        draw(pattern, lens, (width, height), Placement(pose[:3, :3], pose[:3, 3]), exposure, rng)
        for pose in to_camera
    ]
    (folder / "pictures").mkdir()
    for n, image in enumerate(images):
        cv2.imwrite(str(folder / "pictures" / f"image_{n:03d}.png"), image)
    blank = np.asarray(rng.normal(120.0, 3.0, (height, width)), dtype=np.uint8)
    other = cv2.resize(images[3], (width // 2, height // 2))
    odd = (blank, images[1][:, ::-1], other, images[2], np.roll(images[4], 1, axis=1))
    for name, image in zip(UNUSABLE, odd, strict=True):
        cv2.imwrite(str(folder / "pictures" / name), image)
    with (folder / "joints.csv").open("a") as file:
        for name, k in zip(UNUSABLE[:4], range(4), strict=True):
            angles = ",".join(f"{angle:.7f}" for angle in np.rad2deg(drawn.q[k]))
            file.write(f"{name},{angles}\n")
    return drawn


def lens_values() -> Array:
    """(9,) of the lens that images."""
    return np.array(list(robots.LENS.values()))


def study(seed: int, count: int, blur: float) -> dict[str, object]:
    """One robot's row."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawn = drawn_robot(folder, seed, count, blur)
        started = time.perf_counter()
        found = write_corners(
            folder / "found", [folder / "pictures"], folder / BOARD, folder / "joints.csv"
        )
        seconds = time.perf_counter() - started
        write_whole(folder / CORNERS, (folder / "found" / CORNERS).read_bytes())
        error, stated, noise = identified(drawn, folder)
        white = robots.draw(seed, count, square=SQUARE, noise=noise)
        robots.write(white, folder / "white")
        (folder / "white" / BOARD).write_bytes((folder / BOARD).read_bytes())
        bound, _, _ = identified(white, folder / "white")
    q = robots.workspace(drawn)
    nominal = replace(drawn, arm=robots.NOMINAL)
    named = {p.name for p in found if not p.used}
    return {
        "robot": seed,
        "pictures": sum(p.used for p in found),
        "unusable_named": f"{len(named & set(UNUSABLE))} of {len(UNUSABLE)}",
        "corners": sum(len(p.numbers) for p in found if p.used),
        "detect_s": seconds,
        "corner_noise_px": noise,
        "before_mm": 1e3 * rms(robots.position_errors(nominal.tcp(q), drawn.tcp(q))),
        "after_mm": 1e3 * error,
        "stated_mm": 1e3 * stated,
        "white_corners_mm": 1e3 * bound,
    }


def identified(drawn: robots.Drawn, folder: Path) -> tuple[float, float, float]:
    """[m] error of the tool and what is stated of it, and [px] noise of the corners."""
    table = import_poses(folder).table
    group = table.groups[0]
    assert group.common is not None
    robot = fit_table(table).identified_robot()
    q = robots.workspace(replace(drawn, q=group.q))
    error = robots.position_errors(robot.tool(q), drawn.tcp(q))
    return rms(error), rms(robot.sigma(q)), group.common.noise


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """Prints and writes a row a robot."""
    parser = study_parser(__doc__)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--pictures", type=int, default=60)
    parser.add_argument("--blur", type=float, default=1.0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    lines = []
    for seed in range(given.first, given.first + given.robots):
        lines.append(study(seed, given.pictures, given.blur))
        print(in_words(lines[-1]), flush=True)
    if given.out:
        write_table(given.out, lines, ".4g")


if __name__ == "__main__":
    main()

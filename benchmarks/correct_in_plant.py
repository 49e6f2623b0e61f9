"""Do corrected targets reach the nominal pose? Drawn robots, identified, then held in the plant.

    python -m benchmarks.correct_in_plant            # 6 IRB 2400, about five minutes on one core
    python -m benchmarks.correct_in_plant --rehearsed runs/irb2400_full-rehearsal

Each robot: every error source on (tests/helpers/drawn_robots.py, geometry drawn with 1 mm and 1
mrad), two recordings of 120 s through device files, identified with motor torque. Then targets over
the accuracy box are held by the unloaded robot in MuJoCo, first as planned with the nominal robot,
then corrected, and the tool is measured against the wanted pose. The truth drives the plant, and
the columns `known`: corrected by the plant's own numbers, the floor that backlash without load
leaves. Writes docs/studies/correct_in_plant.csv, a row for each robot.

--rehearsed : prints the same of the targets of a day that `ballbar rehearse` has left.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbar.cell.geometry import robot_frames
from ballbar.compensation.targets_file import read_targets
from ballbar.export.result import load_result
from ballbar.ident.robot.accuracy import position_error
from ballbar.ident.robot.inverse_calibration import corrected_targets
from ballbar.rehearsal.day import RESULT, SIMULATED
from ballbar.rehearsal.targets import CORRECTED, GIVEN
from ballbar.scenario import load_scenario
from ballbar.sim.plant.held import hold_machine, pose_distance
from ballbar.sim.true_robot import true_machine
from benchmarks.study import STUDIES, in_words, study_parser, write_table
from tests.helpers.plant_robot import known_robot, robot_row

OUT = STUDIES / "correct_in_plant.csv"
COLUMNS = (
    "robot", "seed", "poses", "refused", "before_mean_mm", "before_max_mm", "after_mean_mm",
    "after_max_mm", "before_mean_mrad", "after_mean_mrad", "after_aligned_mean_mm",
    "after_scale_known_mean_mm", "known_mean_mm", "known_max_mm",
    "predicted_before_mean_mm", "readings_miss_urad",
)  # fmt: skip


def say_rehearsed(day: Path) -> None:
    """Prints how far corrected targets of a rehearsal are off, and where that comes from."""
    file = day / SIMULATED / "path1.scenario.yaml"
    plant = true_machine(load_scenario(file), relative_to=file.parent)
    robot = load_result(day / RESULT).robot
    q, corrected = (read_targets(day / name, robot).q for name in (GIVEN, CORRECTED))
    wanted = robot_frames(plant.nominal, q)
    by_truth = corrected_targets(known_robot(plant), plant.nominal.robot, q).q
    for words, targets in (("by the result", corrected), ("known", by_truth)):
        held = hold_machine(plant, targets)
        aligned = position_error(wanted.tip.T, held.tool[:, :3, 3])
        print(
            f"corrected {words}: "
            + "; ".join(
                f"{what} {1e3 * error.mean():.4f} mean, {1e3 * error.max():.4f} mm largest"
                for what, error in (
                    ("as held", pose_distance(wanted, held)[0]),
                    ("base aligned", aligned.error),
                    ("scale known too", aligned.error_without_scale),
                )
            )
        )


def main() -> None:
    """Draws, identifies, corrects, holds, writes the rows and prints them."""
    parser = study_parser(__doc__)
    parser.add_argument("--robot", default="irb2400")
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--rehearsed", type=Path, metavar="DIR")
    options = parser.parse_args()
    if options.rehearsed is not None:
        say_rehearsed(options.rehearsed)
        return
    rows = []
    for seed in range(1, options.robots + 1):
        rows.append(robot_row(options.robot, seed, options.duration))
        print(in_words(rows[-1]), flush=True)
    write_table(OUT, rows, ".5g", COLUMNS)
    after, known = (
        np.array([r[f"after_{kind}mean_mm"] for r in rows], dtype=float)
        for kind in ("", "scale_known_")
    )
    print(
        f"pose error after correction: mean over robots {after.mean():.4f} mm, "
        f"worst robot {after.max():.4f} mm (target 0.05); base aligned and scale known: "
        f"{known.mean():.4f}, {known.max():.4f} mm"
    )


if __name__ == "__main__":
    main()

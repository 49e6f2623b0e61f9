"""How often the automatic start finds the solution, over random draws of everything unknown.

    python -m benchmarks.automatic_start --draws 200 --out docs/studies/automatic_start.csv

Drawn are encoder offsets and directions, configuration, position, clock, robot and encoder set.
Each draw is a kinematic recording written as device files, read and identified by the same code as
a real one. In half of them the ball-bar log lacks up to 40 % of the run at one end. A draw counts
as solved when the clock offset is within 1 ms and the mean TCP error below 0.1 mm (1.5 mm without
encoders, where one path on a sphere says little).
"""

from __future__ import annotations

import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd

from ballbar.acquisition.recording import Recording, read_recording
from ballbar.cell.errors import InputError
from ballbar.cell.inverse import UnreachableError
from ballbar.cell.logs import BallBarLog
from ballbar.ident.start.automatic import StartError
from ballbar.sim.recording_files import write_recording
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.simulate import Simulation, simulate
from ballbar.truth.compare import identification_against_truth
from benchmarks.study import kinematic_settings, study_parser
from tests.helpers.one_recording import identify

FITTED = ((1, 2, 3, 4, 5), (1, 2, 4, 5), (1, 2), ())
BASE = np.array([0.70, 0.0, 0.54])  # [m] ball-bar position of scenarios/irb2400.yaml
PATH = """schema: ballbar-path/1
centre_deg: [{centre}, {b2}, 20.8, {b4}, 138.0]
amplitude_deg: [75.9, {a2}, 31.0, {a4}, 87.4]
cycles: [3, 1, 4, 2, 5]
phase_deg: [18.0, 49.7, 251.0, 277.2, 357.4]
"""


def settings_of(draw: int, rng: np.random.Generator, folder: Path) -> SimulationSettings:
    """One draw, in any of the four configurations.

    The path turns with the ball-bar about the robot's first axis.
    """
    turn = float(rng.uniform(-1.2, 1.2))
    place = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    ) @ (BASE + rng.uniform(-0.05, 0.05, 3))
    flip2, flip4 = rng.choice(
        [-1, 1], 2
    )  # negative angles, zeros of their neighbours half a turn on: same motion, other configuration
    centre = -23.2 + np.degrees(turn) + (180.0 if flip2 < 0 else 0.0)
    path = PATH.format(
        centre=centre, b2=-54.3 * flip2, b4=-129.6 * flip4, a2=-19.6 * flip2, a4=-18.2 * flip4
    )
    if flip2 < 0:
        path = path.replace(", 20.8,", ", 200.8,")
    if flip4 < 0:
        path = (
            path.replace(", 20.8,", ", 200.8,").replace(" 138.0]", " 318.0]")
            if flip2 > 0
            else path.replace(", 200.8,", ", 20.8,").replace(" 138.0]", " 318.0]")
        )
    (folder / "path.yaml").write_text(path)
    encoders = {"fitted": FITTED[draw % 4], "noise_sigma_rad": 1e-5, "directions": "unknown"}
    offset, skew = float(rng.uniform(-60, 60)), float(rng.uniform(-2e-4, 2e-4))
    return kinematic_settings(
        {"file": "path.yaml", "duration_s": 120.0, "dwell_s": 4.0, "stops": 2},
        cell={"ballbar_position_m": [float(c) for c in place]},
        errors={"static": {"sigma_m": 1e-3, "sigma_rad": 1e-3}, "joint_noise": {"sigma_rad": 1e-5}},
        encoders=encoders,
        clocks={"offset_s": offset, "skew": skew, "overrun_probability": 0.005},
        seed=draw,
    )


def feasible(draw: int, folder: Path) -> tuple[SimulationSettings, Simulation, np.random.Generator]:
    """The first draw of this seed that the robot can run."""
    rng = np.random.default_rng([2016, draw])
    while True:
        settings = settings_of(draw, rng, folder)
        try:
            return settings, simulate(settings, relative_to=folder), rng
        except (InputError, UnreachableError):
            continue


def cut(recording: Recording, rng: np.random.Generator) -> tuple[BallBarLog | None, float]:
    """Ball-bar log less up to 40 % of the run at one end, and the time lost at the start [s]."""
    log = recording.ballbar_log
    if log is None or rng.random() < 0.5:
        return log, 0.0
    rows = int(rng.uniform(0.0, 48.0) / 0.01)
    if rng.random() < 0.5:
        return BallBarLog(
            log.t[: -rows or None].copy(), log.angles[: -rows or None].copy(), log.joints
        ), 0.0
    lost = float(log.t[rows])
    return BallBarLog(log.t[rows:] - lost, log.angles[rows:].copy(), log.joints), lost


def one(draw: int) -> dict[str, object]:
    """The outcome of one draw."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings, simulation, rng = feasible(draw, folder)
        write_recording(simulation, settings, folder / "recording")
        recording = read_recording(folder / "recording")
    log, lost = cut(recording, rng)
    offset = settings.clocks.offset_s + (1.0 + settings.clocks.skew) * lost
    row: dict[str, object] = {
        "draw": draw,
        "encoders": "".join(map(str, settings.encoders.fitted)) or "none",
        "offset_s": offset,
    }
    begin = time.perf_counter()
    try:
        result = identify(simulation.cell, recording.robot_log, log)
    except StartError as error:
        return row | {"solved": False, "status": f"failed: {error}"}
    comparison = identification_against_truth(result, simulation.truth)
    (found,) = result.recordings
    late = abs(found.clock.offset - offset) if found.clock else 0.0
    limit = 1e-4 if log is not None else 1.5e-3
    return row | {
        "solved": bool(late < 1e-3 and comparison.tcp.mean < limit),
        "status": result.verdict.status,
        "iterations": result.fit.iterations,
        "tried": found.start.tried,
        "offset_error_us": late * 1e6,
        "tcp_mean_mm": comparison.tcp.mean * 1e3,
        "tcp_before_mm": comparison.tcp_nominal.mean * 1e3,
        "seconds": time.perf_counter() - begin,
    }


def main() -> None:
    """Runs the draws on two processes and prints a summary."""
    parser = study_parser(__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--out", type=Path, help="CSV file of all draws")
    arguments = parser.parse_args()
    with ProcessPoolExecutor(2) as pool:
        table = pd.DataFrame(pool.map(one, range(arguments.draws)))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(arguments.out, index=False, float_format="%.6g")
    print(f"solved {int(table.solved.sum())} of {len(table)}")
    print(table[~table.solved].to_string() if not table.solved.all() else "")
    figures = table.groupby("encoders")[["iterations", "offset_error_us", "tcp_mean_mm", "seconds"]]
    print(figures.describe(percentiles=[0.5, 0.95]).T.to_string())


if __name__ == "__main__":
    main()

"""How well two clocks are aligned before the geometry is known: 200 draws, from files to offset.

    python -m benchmarks.coarse_alignment [DRAWS]

Motions of the kinematic plant on two shipped paths. Each draw: both logs begin and end at other
times of the run, the clocks are up to a day apart, of different epochs and forms, up to 200 ppm
apart in rate; both logs are written to files, read as a recording and aligned. The offset counts
from the first row of each log, as everywhere. Allowed: 100 ms.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from ballbar.acquisition.alignment import coarse_alignment
from ballbar.acquisition.recording import read_recording
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import joints_to_motors
from ballbar.sim.motion import Motion
from ballbar.sim.simulate import simulate
from benchmarks.study import COUNTS_PER_RAD, SCENARIOS, describe, kinematic_settings

DRAWS = 200
ALLOWED = 0.1  # [s]
NOISE = 1e-5  # [rad]
PATHS = ("paths/irb2400_a.yaml", "paths/irb2400_b.yaml")
DAY = 86_400.0  # [s]
BEGIN_1970 = 1_780_000_000  # [s] a day of 2026
FORMS = ("dc", "filetime", "unix-ns", "unix-us", "date", "ns")


def motion_of(path: str) -> Motion:
    """A run of 150 s with three stops."""
    settings = kinematic_settings(
        {"file": path, "duration_s": 150.0, "dwell_s": 3.0, "stops": 3},
        errors={},
        encoders={"fitted": [1, 2, 4, 5], "noise_sigma_rad": 0.0},
        clocks={"offset_s": 0.0, "skew": 0.0, "overrun_probability": 0.0},
        seed=1,
    )
    return simulate(settings, relative_to=SCENARIOS).motion


def stamp(form: str, seconds: np.ndarray, clock: float) -> list[str]:
    """Stamps of a form; seconds since the log began, on a clock that is `clock` [s] off."""
    ns = np.rint(seconds * 1e9).astype(np.int64) + round(clock * 1e9)
    unix = ns + BEGIN_1970 * 10**9
    match form:
        case "dc":
            return [str(n - 946_684_800 * 10**9) for n in unix.tolist()]
        case "filetime":
            return [str(n // 100 + 116_444_736_000_000_000) for n in unix.tolist()]
        case "unix-us":
            return [str(n // 1000) for n in unix.tolist()]
        case "date":
            return [str(np.datetime64(n, "ns")).replace("T", "-") for n in unix.tolist()]
        case "unix-ns":
            return [str(n) for n in unix.tolist()]
        case _:
            return [str(n + 2 * 10**14) for n in ns.tolist()]


def draw(folder: Path, motion: Motion, rng: np.random.Generator) -> float:
    """[s] error of one draw."""
    robot = load_robot("irb2400")
    end = float(motion.t[-1])
    start_r, start_b = rng.uniform(0.0, 25.0, 2)
    stop_r, stop_b = end - rng.uniform(0.0, 25.0, 2)
    t_robot = np.arange(start_r, stop_r, 0.004032)
    cycles = np.cumsum(rng.choice([2, 3], int((stop_b - start_b) / 0.010) + 1, p=[0.99, 0.01])) - 2
    t_bar = start_b + 0.005 * cycles
    t_bar = t_bar[t_bar < stop_b]
    q, b = motion.shown_at(t_robot), motion.bar_at(t_bar)[:, [0, 1, 3, 4]]
    motors = joints_to_motors(robot, q + rng.normal(0, NOISE, q.shape))
    angles = (b + rng.normal(0, NOISE, b.shape)) * COUNTS_PER_RAD + rng.integers(0, 2**32, 4)
    counts = np.rint(angles).astype(np.int64) % 2**32
    skew, form = rng.uniform(-2e-4, 2e-4), str(rng.choice(FORMS))
    stamps = stamp(form, (t_bar - t_bar[0]) / (1.0 + skew), rng.uniform(-DAY, DAY))
    up_time = rng.uniform(0.0, DAY)
    rows = np.column_stack((up_time + t_robot - t_robot[0], motors))
    lines = [
        "time,m1,m2,m3,m4,m5,m6",
        *(",".join(["%.6f"] + ["%.9f"] * 6) % tuple(row) for row in rows.tolist()),
    ]
    (folder / "robot.csv").write_text("\n".join(lines) + "\n")
    lines = [
        "time;b1;b2;b4;b5",
        *(f"{s};{';'.join(map(str, row))}" for s, row in zip(stamps, counts.tolist(), strict=True)),
    ]
    (folder / "ballbar.csv").write_text("\r\n".join(lines) + "\r\n", newline="")
    describe(folder, "", (1, 2, 4, 5), **({"time": "ns"} if form == "ns" else {}))
    read = read_recording(folder)
    assert read.ballbar_log is not None
    return coarse_alignment(read.robot_log, read.ballbar_log).offset_s - float(
        t_bar[0] - t_robot[0]
    )


def main() -> None:
    """Prints how many of the draws are within what is allowed."""
    draws, rng = int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS, np.random.default_rng(11)
    motions = [motion_of(path) for path in PATHS]
    with tempfile.TemporaryDirectory() as work:
        errors = np.array([draw(Path(work), motions[k % len(motions)], rng) for k in range(draws)])
    within, rms, largest = (
        int((np.abs(errors) < ALLOWED).sum()),
        np.sqrt((errors**2).mean()),
        np.abs(errors).max(),
    )
    print(
        f"{within} of {draws} within {ALLOWED * 1e3:.0f} ms; "
        f"rms {rms * 1e3:.1f} ms, largest {largest * 1e3:.1f} ms"
    )


if __name__ == "__main__":
    main()

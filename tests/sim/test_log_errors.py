"""Every error between the true motion and the device files is in the files as the scenario states.

The files are read here by plain text and numpy, not by acquisition, and compared with the motion of
the kinematic plant, which is known exactly. Times are on the clock of the path.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline

from ballbar import sim
from ballbar.acquisition.recording import Recording, read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.errors import DescriptionError
from ballbar.cell.geometry import Geometry, bar_frames, nominal_geometry, robot_frames
from ballbar.cell.inverse import pose_error
from ballbar.cell.load import load_cell
from ballbar.cell.logs import segment_starts
from ballbar.cell.robot_angles import joints_to_motors, motors_to_joints
from ballbar.cell.strict_yaml import load_model
from ballbar.sim.errors.static_errors import (
    AXIS_ANGLES,
    AXIS_OFFSETS,
    BASE_TILT,
    THESIS_3_1,
    true_geometry,
)
from ballbar.sim.logging.clocks import chosen
from ballbar.sim.motion import Motion
from ballbar.sim.recording_files import truth_path
from ballbar.sim.settings import ErrorSettings, SimulationSettings
from ballbar.sim.truth import Truth, load_truth
from tests.helpers.simulated_recordings import Recorded, lissajous, record, settings
from tests.helpers.six_axes import NAMES

PERIOD = 0.004032  # [s] of the robot's rows
WITHIN = 0.01  # of what was asked for
CLOCK = {"offset_s": 0.137, "skew": 5e-5}
# without them every row falls on an even cycle and the toggle stands still
OVERRUNS = {**CLOCK, "overrun_probability": 0.05}
NOISE = {"joint_noise": {"sigma_rad": 1e-5}}
CELL = load_cell("irb2400", "lund_600", "plate_250")
NOMINAL = nominal_geometry(CELL, np.array([0.70, 0.0, 0.54]))
COUNT = 2.0 * np.pi / (3600 << 12)  # [rad]


@dataclass(frozen=True, eq=False)
class Run:
    """One recording: its files as they are, the logged motion, and the truth."""

    folder: Path
    motion: Motion
    truth: Truth

    @cached_property
    def description(self) -> dict[str, Any]:
        return dict(yaml.safe_load((self.folder / "recording.yaml").read_text()))

    @cached_property
    def bar_table(self) -> dict[str, np.ndarray]:
        """(M,) integers of each column of the ball-bar's files."""
        header = (
            (self.folder / self.description["sources"]["ballbar"]["files"][0])
            .read_text()
            .splitlines()[0]
        )
        rows = np.loadtxt(self.lines("ballbar"), delimiter=";", dtype=np.int64)
        return dict(zip(header.split(";"), rows.T, strict=True))

    def lines(self, side: str) -> list[str]:
        """The lines of all files of one side, without headers."""
        return [
            line
            for name in self.description["sources"][side]["files"]
            for line in (self.folder / name).read_text().splitlines()[1:]
        ]

    def robot(self) -> tuple[Array, Array]:
        """(N,) [s] stamps from the first row, (N, 6) [rad] motor angles."""
        table = np.loadtxt(self.lines("robot"), delimiter=",")
        return table[:, 0] - table[0, 0], table[:, 1:]

    def ballbar(self, name: str = "time") -> np.ndarray:
        """(M,) one column of the ball-bar's files, as integers; time in ns from the first row."""
        values = self.bar_table[name]
        return values - values[0] if name == "time" else values

    def encoder(self, joint: int) -> Array:
        """(M,) [rad] unwrapped angle from the first row, positive along the joint's angle."""
        encoder = self.description["encoders"][f"b{joint}"]
        step = (np.diff(self.ballbar(f"b{joint}")) + 2**31) % 2**32 - 2**31
        return np.concatenate(([0.0], np.cumsum(step))) * (
            encoder["sign"] * 2.0 * np.pi / (encoder["lines"] << encoder["bits"])
        )

    def bar_time(self) -> Array:
        """(M,) [s] run time of the ball-bar's rows, if its clock did what CLOCK says."""
        return 0.5 + (1.0 + CLOCK["skew"]) * self.ballbar() * 1e-9

    def error(self, joint: int) -> tuple[Array, Array]:
        """(M,) [rad] true angle of a joint at the rows, and its encoder's error without offset."""
        true = self.motion.bar_at(self.bar_time())[:, joint - 1]
        return true, self.encoder(joint) - (true - true[0])


def simulated(folder: Path, *, duration: float = 30.0, **changes: Any) -> Run:
    """A run of the kinematic plant without any error but those that `changes` switch on."""
    base: dict[str, Any] = {
        "errors": {},
        "encoders": {},
        "clocks": CLOCK,
        "plant": {"kind": "kinematic"},
    }
    path = lissajous("paths/irb2400_a.yaml", duration)
    done: Recorded = record(folder / "recording", **(base | {"path": path} | changes))
    return Run(done.folder, done.simulation.motion, load_truth(truth_path(done.folder)))


def amplitude(angle: Array, error: Array, orders: tuple[int, ...]) -> Array:
    """(K,) [rad] amplitude of each harmonic of an error, by least squares with a constant.

    Where the angle rests, the same rounding comes again and again: those rows are left out.
    """
    moving = np.abs(np.gradient(angle)) > 2.0 * COUNT
    angle, error = angle[moving], error[moving]
    waves = [wave(order * angle) for order in orders for wave in (np.sin, np.cos)]
    fit = np.linalg.lstsq(np.stack([*waves, np.ones_like(angle)], axis=1), error, rcond=None)[0]
    return np.hypot(fit[0:-1:2], fit[1:-1:2])


def taken_at(run: Run) -> tuple[np.ndarray, Array]:
    """Rows of the ball-bar's log in motion, and times (K,) [s] at which the motion has their
    angles.
    """
    t = run.bar_time()
    angles = np.stack([run.encoder(j) for j in range(1, 6)], axis=1) + run.motion.bar_at(
        np.zeros(1)
    )
    moving = (t > 3.0) & (t < run.motion.t[-1] - 3.0)
    found = t[moving]
    for _ in range(12):
        here, after = run.motion.bar_at(found), run.motion.bar_at(found + 1e-4)
        speed = (after - here) / 1e-4
        found = found + ((angles[moving] - here) * speed).sum(axis=1) / (speed**2).sum(axis=1)
    return np.flatnonzero(moving), found


# --- ball-bar encoders


@pytest.mark.parametrize(
    ("source", "joints", "orders", "sizes"),
    [
        # joints 1 and 5 turn far enough to tell three harmonics apart
        ("encoder_eccentricity", (1, 5), (1, 2, 3), [6.0e-5, 2.5e-5, 8.0e-6]),
        ("mounting_eccentricity", range(1, 6), (1,), [3.0e-4]),
        ("subdivisional_error", range(1, 6), (3600,), [1.2e-5]),
    ],
)
def test_each_harmonic_of_an_encoder_comes_out_of_its_counts(
    source: str, joints: Iterable[int], orders: tuple[int, ...], sizes: list[float], tmp_path: Path
) -> None:
    run = simulated(tmp_path, errors={source: {}})
    for joint in joints:
        assert amplitude(*run.error(joint), orders) == pytest.approx(sizes, rel=WITHIN)


def test_the_error_within_a_period_follows_the_signal_and_not_the_joint(tmp_path: Path) -> None:
    run = simulated(
        tmp_path,
        errors={"subdivisional_error": {}, "mounting_eccentricity": {"amplitude_rad": 2e-3}},
    )
    true, error = run.error(5)
    mounting = run.truth.logs.encoders["b5"].mounting[0].at(true)
    assert amplitude(true + mounting, error - mounting, (3600,)) == pytest.approx(
        [1.2e-5], rel=WITHIN
    )
    assert amplitude(true, error - mounting, (3600,))[0] < 0.7 * 1.2e-5


@pytest.mark.parametrize("bits", [8, 9, 10, 11, 12, 13])
def test_a_turn_has_as_many_counts_as_lines_and_bits_say(bits: int, tmp_path: Path) -> None:
    run = simulated(tmp_path, encoders={"bits": bits})
    count = 2.0 * np.pi / (3600 * 2**bits)
    rounding = []
    for joint in range(1, 6):
        true, error = run.error(joint)
        # at rest the same rounding comes again and again
        moving = np.abs(np.gradient(true)) > 2 * count
        rounding.append(error[moving] - error[moving].mean())
        assert np.ptp(run.encoder(joint)) == pytest.approx(np.ptp(true), abs=1.01 * count)
    assert np.std(np.concatenate(rounding)) == pytest.approx(count / np.sqrt(12.0), rel=WITHIN)


def test_white_noise_has_the_asked_size(tmp_path: Path) -> None:
    run = simulated(tmp_path, duration=60.0, encoders={"noise_sigma_rad": 1e-5})
    errors = [run.error(joint)[1] for joint in range(1, 6)]
    assert np.concatenate([e - e.mean() for e in errors]).std() == pytest.approx(1e-5, rel=WITHIN)


def test_low_bits_freeze_at_the_asked_speed_and_one_more_an_octave_above(tmp_path: Path) -> None:
    free, run = (
        simulated(tmp_path / n, errors=e)
        for n, e in (("free", {}), ("frozen", {"frozen_bits": {"onset_factor": 0.5}}))
    )
    t = run.bar_time()
    for joint in (1, 5):
        speed = (
            np.abs(run.motion.bar_at(t + 1e-4) - run.motion.bar_at(t - 1e-4))[:, joint - 1] / 2e-4
        )
        stuck = free.ballbar(f"b{joint}") ^ run.ballbar(f"b{joint}")
        onset = 0.5 * 750.0 * 2.0 * np.pi / 3600.0  # [rad/s] EL5021 at 12 bits
        assert speed[(stuck & 1) > 0].min() == pytest.approx(onset, rel=WITHIN)
        if joint == 5:  # the other one does not reach an octave above
            assert speed[(stuck & 2) > 0].min() == pytest.approx(2.0 * onset, rel=WITHIN)
        assert stuck.max() < 4
        fast = np.flatnonzero(speed > 1.02 * onset)
        fast = fast[1:][np.diff(fast) == 1]
        low = run.ballbar(f"b{joint}") & 1
        assert (low[fast] == low[fast - 1]).all()  # frozen, not cleared or random


def test_a_weak_signal_is_reported_for_its_encoder_in_its_interval_only(tmp_path: Path) -> None:
    faults = [{"encoder": 2, "start_s": 10.0, "end_s": 13.0}]
    run = simulated(tmp_path, errors={"amplitude_errors": faults}, clocks=OVERRUNS)
    t, word = run.bar_time(), run.ballbar("s2")
    weak = word & ~(1 << 15) == (1 << 4 | 1 << 14)
    assert t[weak].min() == pytest.approx(10.0, abs=0.016)
    assert np.ptp(t[weak]) == pytest.approx(3.0, rel=WITHIN)
    assert (word[~weak] & ~(1 << 15) == 0).all()
    assert (run.ballbar("s1") & ~(1 << 15) == 0).all()
    # the toggle goes on, cycle by cycle
    assert (word >> 15 == run.ballbar() // 5_000_000 & 1).all()
    assert set(word[weak] >> 15) == {0, 1}


def test_rows_with_a_weak_signal_are_left_out_by_the_reader(tmp_path: Path) -> None:
    run = simulated(
        tmp_path, errors={"amplitude_errors": [{"encoder": 2, "start_s": 10.0, "end_s": 13.0}]}
    )
    read = read_recording(run.folder)
    assert {f.kind: f.count for f in read.report.findings}["amplitude error"] == 300
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == run.ballbar().size - 300


def test_a_slipped_period_is_a_step_of_2_to_the_bits(tmp_path: Path) -> None:
    slips = [{"encoder": 3, "at_s": 12.0, "periods": -2}, {"encoder": 3, "at_s": 20.0}]
    run = simulated(tmp_path, encoders={"bits": 10}, errors={"slipped_periods": slips})
    t, sign = run.bar_time(), run.description["encoders"]["b3"]["sign"]
    counts = sign * run.error(3)[1] / (2.0 * np.pi / (3600 << 10))
    level = [counts[(t > a) & (t < b)].mean() for a, b in ((0.0, 12.0), (12.0, 20.0), (20.0, 30.0))]
    assert np.diff(level) == pytest.approx([-2048.0, 1024.0], abs=0.5)
    assert np.abs(run.error(2)[1]).max() < 1.1 * COUNT * 4


def test_a_coupling_slips_by_the_stated_angle_along_that_of_the_joint(tmp_path: Path) -> None:
    run = simulated(
        tmp_path, errors={"coupling_slips": [{"encoder": 4, "at_s": 12.0, "angle_rad": -7e-4}]}
    )
    t, error = run.bar_time(), run.error(4)[1]
    assert error[t >= 12.0].mean() - error[t < 12.0].mean() == pytest.approx(-7e-4, rel=WITHIN)
    assert np.abs(np.diff(error)).argmax() == np.searchsorted(t, 12.0) - 1


# --- resolvers


def test_resolvers_err_once_and_twice_a_motor_turn(tmp_path: Path) -> None:
    run = simulated(tmp_path, errors={"resolver_error": {"quantum_rad": 0.0}})
    for motor, error in motor_errors(run):
        assert amplitude(motor, error, (1, 2)) == pytest.approx([1.5e-3, 1.5e-3], rel=WITHIN)


def test_the_resolvers_converter_has_65536_steps_a_turn(tmp_path: Path) -> None:
    run = simulated(tmp_path, errors={"resolver_error": {"amplitude_rad": [0.0, 0.0]}})
    quantum = 2.0 * np.pi / 65536.0
    steps = run.robot()[1] / quantum
    assert np.abs(steps - np.rint(steps)).max() < 1e-4  # the file has nine decimals
    assert np.concatenate([e for _, e in motor_errors(run)]).std() == pytest.approx(
        quantum / np.sqrt(12.0), rel=WITHIN
    )


def motor_errors(run: Run) -> Iterator[tuple[Array, Array]]:
    """True angle of each motor where it moves, and what its resolver adds."""
    t, motors = run.robot()
    at = run.truth.logs.first_rows.robot_s + t
    true = joints_to_motors(CELL.robot, run.motion.shown_at(at))
    moving = (at > 3.0) & (at < 27.0)
    for m, read in zip(true[moving].T, motors[moving].T, strict=True):
        yield m, read - m


# --- clocks


def test_offset_and_skew_are_the_line_through_both_clocks(tmp_path: Path) -> None:
    run = simulated(tmp_path)
    rows, found = taken_at(run)
    skew, bar_start = np.polyfit(run.ballbar()[rows] * 1e-9, found - run.ballbar()[rows] * 1e-9, 1)
    assert skew == pytest.approx(5e-5, rel=WITHIN)
    _, motors = run.robot()
    row = motors.shape[0] // 2
    times = run.truth.logs.first_rows.robot_s + row * PERIOD + np.linspace(-1e-3, 1e-3, 2001)
    miss = np.abs(joints_to_motors(CELL.robot, run.motion.shown_at(times)) - motors[row]).sum(
        axis=1
    )
    assert bar_start - (times[miss.argmin()] - row * PERIOD) == pytest.approx(0.137, rel=1e-4)
    assert (run.truth.clock.offset_s, run.truth.clock.skew) == (0.137, 5e-5)


def test_a_wandering_clock_takes_its_rows_where_the_truth_says(tmp_path: Path) -> None:
    run = simulated(tmp_path, clocks={**CLOCK, "wander": {"rate_rms_ppm": 20.0}})
    curve = run.truth.logs.clock_wander
    assert curve is not None
    rate = np.diff(curve.deviation_s) / np.diff(curve.t_clock_s)
    assert rate.std() == pytest.approx(20e-6, rel=1e-6)
    # no line in it: that is offset and skew
    assert np.polyfit(curve.t_clock_s, curve.deviation_s, 1) == pytest.approx([0.0, 0.0], abs=1e-15)
    rows, found = taken_at(run)
    t_bar = run.ballbar()[rows] * 1e-9
    basis = np.stack(
        [np.interp(t_bar, curve.t_clock_s, curve.deviation_s), np.ones_like(t_bar), t_bar], axis=1
    )
    (size, constant, slope), *_ = np.linalg.lstsq(basis, found - run.bar_time()[rows], rcond=None)
    assert size == pytest.approx(1.0, rel=WITHIN)
    assert abs(constant) < 1e-6
    assert abs(slope) < 1e-7


def test_a_clock_that_warms_up_runs_off_exponentially(tmp_path: Path) -> None:
    run = simulated(
        tmp_path,
        clocks={
            **CLOCK,
            "wander": {"rate_rms_ppm": 0.0, "warm_up_ppm": 50.0, "warm_up_time_s": 12.0},
        },
    )
    rows, found = taken_at(run)
    t_bar = run.ballbar()[rows] * 1e-9
    basis = np.stack([-12.0 * np.exp(-t_bar / 12.0), np.ones_like(t_bar), t_bar], axis=1)
    assert np.linalg.lstsq(basis, found - run.bar_time()[rows], rcond=None)[0][0] == pytest.approx(
        50e-6, rel=WITHIN
    )


@pytest.mark.parametrize("step", [0.128, -0.05])
def test_a_clock_that_is_set_shifts_its_later_stamps(step: float, tmp_path: Path) -> None:
    run = simulated(tmp_path, clocks={**CLOCK, "step": {"at_s": 15.0, "step_s": step}})
    rows, found = taken_at(run)
    late = run.bar_time()[rows] - found
    assert late[found >= 15.001].mean() - late[found < 14.999].mean() == pytest.approx(
        step * (1 + 5e-5), rel=WITHIN
    )
    assert np.abs(late[found < 14.999]).max() < 5e-6
    if step < 0.0:
        read = read_recording(run.folder)
        assert "clock set back" in [one.kind for one in read.report.findings]
        assert read.ballbar_log is not None
        # [s] what was added to the stamps behind
        put_together = read.ballbar_log.t - run.ballbar() * 1e-9
        # as though no row were late
        assert put_together[found_row(read) :] == pytest.approx(-step, abs=0.0051)


def found_row(read: Recording) -> int:
    """Where the second segment of the ball-bar's log begins."""
    assert read.ballbar_log is not None
    (row,) = segment_starts(read.ballbar_log.segment)
    return row


def test_robot_stamps_in_whole_milliseconds_are_the_nearest(tmp_path: Path) -> None:
    run = simulated(tmp_path, clocks={**CLOCK, "quantum": {}})
    stamps, _ = run.robot()
    assert np.abs(stamps * 1e3 - np.rint(stamps * 1e3)).max() < 1e-3
    late = stamps - PERIOD * np.arange(stamps.size)
    assert np.sqrt(np.mean(late**2)) == pytest.approx(1e-3 / np.sqrt(12.0), rel=WITHIN)
    # a 5 ms task does not show whole milliseconds
    assert (np.diff(run.ballbar()) == 10_000_000).all()


def test_ballbar_stamps_are_rounded_to_their_quantum(tmp_path: Path) -> None:
    run = simulated(tmp_path, clocks={**CLOCK, "quantum": {"robot_s": 0.0, "ballbar_s": 3e-3}})
    stamps = run.ballbar()
    assert np.gcd.reduce(stamps) == 3_000_000
    assert np.abs(stamps - 10_000_000 * np.arange(stamps.size)).max() == 1_000_000
    assert np.diff(run.robot()[0]) == pytest.approx(PERIOD, abs=1.1e-6)


# --- loggers


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> Run:
    clocks = {
        **CLOCK,
        "dropped_rows": {"robot_probability": 0.4, "ballbar_probability": 0.45},
        "duplicated_rows": {"robot_probability": 0.45, "ballbar_probability": 0.4},
    }
    return simulated(tmp_path_factory.mktemp("lossy"), duration=60.0, clocks=clocks)


def test_another_recording_is_of_the_same_machine_with_noise_of_its_own(tmp_path: Path) -> None:
    """Regression: two paths of one machine had the same noise, row by row."""
    drawn = {
        "static": {"sigma_m": 1e-3, "sigma_rad": 1e-3},
        "transmission_error": {},
        "mounting_eccentricity": {},
    }
    clocks = {**OVERRUNS, "wander": {}, "jitter": {}, "dropped_rows": {}, "duplicated_rows": {}}
    common: dict[str, Any] = {"clocks": clocks, "encoders": {"noise_sigma_rad": 1e-4}}
    first, again, second = (
        simulated(tmp_path / name, errors=drawn | NOISE, **common, **more)
        for name, more in (("first", {}), ("again", {"recording": 1}), ("second", {"recording": 2}))
    )
    for file in ("robot.csv", "ballbar.csv"):
        raw = (run.folder / "raw" / file for run in (first, again, second))
        one, same, other = (path.read_bytes() for path in raw)
        assert one == same
        assert one != other
    assert np.array_equal(first.truth.geometry.values, second.truth.geometry.values)
    assert first.truth.plant == second.truth.plant
    assert first.truth.logs.encoders == second.truth.logs.encoders
    assert first.truth.logs.clock_wander != second.truth.logs.clock_wander
    assert first.truth.logs.rows != second.truth.logs.rows
    rows = slice(0, 400)  # of the first dwell
    noise = [run.robot()[1][rows] - run.robot()[1][rows].mean(axis=0) for run in (first, second)]
    shared = (noise[0] * noise[1]).mean(axis=0) / noise[0].std(axis=0) / noise[1].std(axis=0)
    assert np.abs(shared).max() < 0.2  # 1 when both drew the same


def test_the_first_row_from_which_time_counts_is_always_written_once() -> None:
    hit = np.stack([chosen(3, 0.49, np.random.default_rng(seed)) for seed in range(100)])
    assert hit.any(axis=0).tolist() == [False, True, True]


def test_the_truth_counts_the_rows_that_are_lost_and_doubled(lossy: Run) -> None:
    robot, bar = np.rint(lossy.robot()[0] / PERIOD).astype(int), lossy.ballbar() // 10_000_000
    for side, place in (("robot", robot), ("ballbar", bar)):
        different, stated = np.unique(place), lossy.truth.logs.rows[side]
        assert stated.taken > place[-1]  # the last ones may be lost
        assert stated.taken - stated.dropped == different.size
        assert stated.duplicated == place.size - different.size


def test_the_reader_keeps_the_first_of_two_rows_and_reports_the_gaps(lossy: Run) -> None:
    read = read_recording(lossy.folder)
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == np.unique(lossy.ballbar()).size
    assert {"duplicate stamp", "overrun"} <= {f.kind for f in read.report.findings}


def test_a_restarted_logger_leaves_two_files_and_a_gap_while_counters_and_toggle_run_on(
    tmp_path: Path,
) -> None:
    run = simulated(tmp_path, clocks={**OVERRUNS, "restart": {"at_s": 14.0, "gap_s": 3.0}})
    assert run.description["sources"]["ballbar"]["files"] == [
        "raw/ballbarOld.csv",
        "raw/ballbar.csv",
    ]
    headers = {
        (run.folder / name).read_text().splitlines()[0]
        for name in run.description["sources"]["ballbar"]["files"]
    }
    assert headers == {"time;b1;b2;b3;b4;b5;s1;s2;s3;s4;s5"}
    t = run.bar_time()
    assert np.diff(t).max() == pytest.approx(3.0, rel=WITHIN)
    assert t[np.diff(t).argmax()] == pytest.approx(14.0, abs=0.016)
    for joint in range(1, 6):
        assert np.abs(run.error(joint)[1]).max() < 1.1 * COUNT
    assert (run.ballbar("s1") >> 15 == run.ballbar() // 5_000_000 & 1).all()
    log = read_recording(run.folder).ballbar_log
    assert log is not None
    assert log.angles[:, 4] - log.angles[0, 4] == pytest.approx(run.encoder(5), abs=1e-12)


# --- static errors


STATIC: dict[str, dict[str, Any]] = {
    "static": {"sigma_m": 1e-3, "sigma_rad": 1e-3, "parameters": "all"},
    "ballbar_axes": {"parameters": "all"},
    "base_tilt": {},
    "plate_length": {"sigma_m": 1e-4},
}


def drawn(errors: dict[str, Any], seed: int) -> Array:
    """(P,) [m, rad] deviations from nominal."""
    asked = ErrorSettings.model_validate(errors)
    return true_geometry(NOMINAL, asked, CELL, seed=seed).values - NOMINAL.values


AXES = AXIS_OFFSETS + AXIS_ANGLES


@pytest.mark.parametrize(
    ("source", "parameters", "names"),
    [
        ("static", "thesis", tuple(THESIS_3_1)),
        ("static", "robot", (*THESIS_3_1, "ralpha6", "rbeta2", "rbeta6")),
        ("static", "all", tuple(n for n in NAMES if n != "ra6")),
        ("ballbar_axes", "between", AXES),
        ("ballbar_axes", "all", (*AXES, "ba5", "bd1", "bd5", "balpha5")),
        ("base_tilt", "", BASE_TILT),
        ("plate_length", "", ("ra6",)),
    ],
)
def test_a_static_source_deviates_its_own_parameters_one_by_one(
    source: str, parameters: str, names: tuple[str, ...]
) -> None:
    stated = STATIC[source] | ({"parameters": parameters} if parameters else {})
    values = np.stack([drawn({source: stated}, seed) for seed in range(400)])
    assert {NAMES[i] for i in np.flatnonzero(values.any(axis=0))} == set(names)
    own = values[:, values.any(axis=0)]
    alike = np.atleast_2d(np.corrcoef(own.T)) - np.eye(len(names))
    assert np.abs(alike).max() < 6.0 / np.sqrt(len(values))


@pytest.mark.parametrize(
    ("source", "fewer", "more"),
    [
        ("static", "thesis", "robot"),
        ("static", "thesis", "all"),
        ("ballbar_axes", "between", "all"),
    ],
)
def test_more_parameters_leave_the_draws_of_the_fewer_unchanged(
    source: str, fewer: str, more: str
) -> None:
    size = {"sigma_m": 1e-3, "sigma_rad": 1e-3}
    few, many = (drawn({source: size | {"parameters": which}}, 7) for which in (fewer, more))
    assert few[few != 0.0] == pytest.approx(many[few != 0.0], abs=1e-15)
    assert (many != 0.0).sum() > (few != 0.0).sum()


def test_static_sources_add_up() -> None:
    each = [drawn({name: asked}, 3) for name, asked in STATIC.items()]
    assert drawn(STATIC, 3) == pytest.approx(np.sum(each, axis=0), abs=1e-15)


@pytest.mark.parametrize("source", STATIC)
def test_logs_close_the_loop_only_with_the_deviations_of_each_static_source(
    source: str, tmp_path: Path
) -> None:
    run = simulated(tmp_path, errors=STATIC, encoders={"bits": 13})
    without = run.truth.geometry.with_values(
        run.truth.geometry.values - drawn({source: STATIC[source]}, 1)
    )
    t, motors = run.robot()
    rows = slice(None, None, 5)
    q = CubicSpline(run.truth.logs.first_rows.robot_s + t, motors_to_joints(CELL.robot, motors))(
        run.bar_time()[rows]
    )
    b = np.stack([_angle(run, joint)[rows] for joint in range(1, 6)], axis=1)
    closed, open_ = (_closure(geometry, q, b) for geometry in (run.truth.geometry, without))
    # of the source, with 1 for what the truth states
    size = np.sum(open_ * (open_ - closed)) / np.sum((open_ - closed) ** 2)
    assert size == pytest.approx(1.0, rel=WITHIN)
    assert np.abs(closed).max() < 2e-6
    assert np.abs(open_).max() > 5e-6


def _closure(geometry: Geometry, q: Array, b: Array) -> Array:
    """(6, K) [m, rad] loop-closure error at joint angles (K, 6) and encoder angles (K, 5) [rad]."""
    bar = bar_frames(geometry, b)
    return pose_error(bar.rotation(), bar.tip, robot_frames(geometry, q))


def _angle(run: Run, joint: int) -> Array:
    """(M,) [rad] `sign 2 pi counts / (lines 2^bits)`, the first word read as signed."""
    encoder, first = run.description["encoders"][f"b{joint}"], int(run.ballbar(f"b{joint}")[0])
    start = (first + 2**31) % 2**32 - 2**31
    return run.encoder(joint) + encoder["sign"] * start * 2.0 * np.pi / (
        encoder["lines"] << encoder["bits"]
    )


# --- one source leaves all others alone


NOISY: dict[str, dict[str, Any]] = {
    "errors": {"static": {"sigma_m": 1e-3, "sigma_rad": 1e-3}, **NOISE},
    "encoders": {"noise_sigma_rad": 1e-5, "directions": "unknown"},
    "clocks": OVERRUNS,
}
SENSORS: dict[str, Any] = {
    "encoder_eccentricity": {},
    "mounting_eccentricity": {},
    "subdivisional_error": {},
    "frozen_bits": {"onset_factor": 0.2},
    "amplitude_errors": [{"encoder": 2, "start_s": 10.0, "end_s": 13.0}],
    "slipped_periods": [{"encoder": 3, "at_s": 12.0, "periods": 4}],
    "coupling_slips": [{"encoder": 4, "at_s": 12.0}],
}
# the encoder that each of them names
NAMED = {"amplitude_errors": 2, "slipped_periods": 3, "coupling_slips": 4}
GEOMETRY: dict[str, Any] = {
    "ballbar_axes": {"parameters": "all"},
    "base_tilt": {},
    "plate_length": {},
    "static": STATIC["static"],
}
STAMPS: dict[str, Any] = {
    "wander": {"rate_rms_ppm": 20.0},
    "step": {"at_s": 15.0},
    "quantum": {"ballbar_s": 3e-3},
    "jitter": {},
}
ROWS: dict[str, Any] = {
    "dropped_rows": {"robot_probability": 0.1},
    "duplicated_rows": {"ballbar_probability": 0.1},
    "restart": {"at_s": 14.0},
}


def noisy(folder: Path, section: str = "errors", **source: Any) -> Run:
    """The noisy run with one more source switched on."""
    return simulated(folder, **(NOISY | {section: NOISY[section] | source}))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return noisy(tmp_path_factory.mktemp("plain"))


def raw(run: Run, name: str) -> bytes:
    return (run.folder / "raw" / name).read_bytes()


@pytest.mark.parametrize("source", SENSORS)
def test_an_encoder_error_changes_nothing_but_its_own_encoders(
    source: str, plain: Run, tmp_path: Path
) -> None:
    run = noisy(tmp_path, **{source: SENSORS[source]})
    assert raw(run, "robot.csv") == raw(plain, "robot.csv")
    assert raw(run, "ballbar.csv") != raw(plain, "ballbar.csv")
    assert (run.ballbar() == plain.ballbar()).all()
    for joint in range(1, 6):
        concerned = NAMED.get(source, joint) == joint
        same_status = (run.ballbar(f"s{joint}") == plain.ballbar(f"s{joint}")).all()
        assert same_status != (source == "amplitude_errors" and concerned)
        effects = run.truth.logs.encoders.get(f"b{joint}")
        difference = run.encoder(joint) - plain.encoder(joint)
        assert (effects is not None) == concerned
        if effects is None or source == "amplitude_errors":
            assert (difference == 0.0).all()
            continue
        t, true = run.bar_time(), run.error(joint)[0]
        added = run.truth.directions[f"b{joint}"] * (effects.read_angle(true, t) - true)
        sign, most = run.description["encoders"][f"b{joint}"]["sign"], 2.01
        added += sign * effects.periods(t) * 4096 * COUNT
        if source == "frozen_bits":
            most = 64.0
        assert np.abs(difference - (added - added[0])).max() < most * COUNT


def test_resolver_errors_leave_the_noise_of_the_robot_and_the_ballbar_alone(
    plain: Run, tmp_path: Path
) -> None:
    run = noisy(tmp_path, resolver_error={})
    assert raw(run, "ballbar.csv") == raw(plain, "ballbar.csv")
    (t, motors), (t_plain, motors_plain), effects = (
        run.robot(),
        plain.robot(),
        run.truth.logs.resolvers,
    )
    assert (t == t_plain).all()
    assert effects is not None
    for motor, harmonics in enumerate(effects.motors):
        added = sum(
            h.amplitude_rad * np.sin(h.order * motors_plain[:, motor] + h.phase_rad)
            for h in harmonics
        )
        assert (
            np.abs(motors[:, motor] - motors_plain[:, motor] - added).max()
            < 0.51 * effects.quantum_rad
        )


@pytest.mark.parametrize("source", GEOMETRY)
def test_a_static_error_leaves_noise_zeros_and_clocks_alone(
    source: str, plain: Run, tmp_path: Path
) -> None:
    run = noisy(tmp_path, **{source: GEOMETRY[source]})
    assert (run.truth.geometry.values != plain.truth.geometry.values).any()
    # the kinematic plant's ball-bar takes the path's angles
    assert raw(run, "ballbar.csv") == raw(plain, "ballbar.csv")
    (t, motors), (t_plain, motors_plain) = run.robot(), plain.robot()
    assert (t == t_plain).all()
    at = run.truth.logs.first_rows.robot_s + PERIOD * np.arange(t.size)
    noise, noise_plain = (
        m - joints_to_motors(CELL.robot, r.motion.shown_at(at))
        for m, r in ((motors, run), (motors_plain, plain))
    )
    assert noise == pytest.approx(noise_plain, abs=1.1e-9)  # the file has nine decimals
    assert noise.std() > 1e-4


@pytest.mark.parametrize("source", STAMPS)
def test_an_error_of_one_clock_leaves_the_other_log_and_all_noise_alone(
    source: str, plain: Run, tmp_path: Path
) -> None:
    run = noisy(tmp_path, "clocks", **{source: STAMPS[source]})
    if source in ("wander", "step"):
        assert raw(run, "robot.csv") == raw(plain, "robot.csv")
    if source in ("quantum", "jitter"):
        assert (run.robot()[1] == plain.robot()[1]).all()
        assert not (run.robot()[0] == plain.robot()[0]).all()
    if source == "jitter":
        assert raw(run, "ballbar.csv") == raw(plain, "ballbar.csv")
    for name in (f"{kind}{joint}" for kind in "bs" for joint in range(1, 6)):
        assert source == "wander" or (run.ballbar(name) == plain.ballbar(name)).all()


def test_a_wandering_clock_keeps_overruns_and_encoder_noise(plain: Run, tmp_path: Path) -> None:
    run = noisy(tmp_path, "clocks", wander=STAMPS["wander"])
    rows = min(run.ballbar().size, plain.ballbar().size)
    assert (run.ballbar()[:rows] == plain.ballbar()[:rows]).all()
    assert run.truth.logs.clock_wander is not None
    moved = run.truth.logs.clock_wander.at(run.ballbar()[:rows] * 1e-9)
    for joint in range(1, 6):
        direction = run.truth.directions[f"b{joint}"]
        true = run.motion.bar_at(run.bar_time()[:rows] + moved)[:, joint - 1]
        noise = direction * run.encoder(joint)[:rows] - (true - true[0])
        assert noise == pytest.approx(
            direction * plain.encoder(joint)[:rows] - (plain.error(joint)[0][:rows] - true[0]),
            abs=2.01 * COUNT,
        )


@pytest.mark.parametrize("source", ROWS)
def test_lost_and_repeated_rows_leave_the_other_rows_as_they_were(
    source: str, plain: Run, tmp_path: Path
) -> None:
    run = noisy(tmp_path, "clocks", **{source: ROWS[source]})
    for side in ("robot", "ballbar"):
        before, after = plain.lines(side), run.lines(side)
        if (source, side) == ("restart", "robot"):
            assert after == before
            continue
        assert after != before
        assert after[0] == before[0]
        kept = set(after)
        assert list(dict.fromkeys(after)) == [line for line in before if line in kept]
        if source == "duplicated_rows":
            assert kept == set(before)
        else:
            assert len(after) == len(kept)


def test_every_stream_of_random_numbers_has_one_user() -> None:
    sources = "".join(file.read_text() for file in Path(sim.__path__[0]).rglob("*.py"))
    names = re.findall(r"stream\([\w.]+, f?\"([^\"]+)\"\)", sources)
    assert sorted(names) == sorted(set(names))
    assert {
        "clock_wander",
        "stamp_jitter",
        "encoder_noise_b{encoder.joint}",
        "resolver_error",
        "ballbar_axes",
    } <= set(names)


def test_dropping_rows_does_not_change_which_ones_are_doubled(tmp_path: Path) -> None:
    double = noisy(tmp_path / "a", "clocks", duplicated_rows={"robot_probability": 0.2})
    both = noisy(
        tmp_path / "b",
        "clocks",
        duplicated_rows={"robot_probability": 0.2},
        dropped_rows={"robot_probability": 0.2},
    )
    left = set(both.lines("robot"))
    assert both.lines("robot") == [line for line in double.lines("robot") if line in left]


SIZE_ZERO: dict[str, dict[str, Any]] = {
    "errors": {
        "encoder_eccentricity": {"amplitude_rad": [0.0, 0.0, 0.0]},
        "mounting_eccentricity": {"amplitude_rad": 0.0},
        "subdivisional_error": {"amplitude_rad": 0.0},
        "frozen_bits": {"onset_factor": 100.0},
        "slipped_periods": [{"encoder": 1, "at_s": 9.0, "periods": 0}],
        "coupling_slips": [{"encoder": 1, "at_s": 9.0, "angle_rad": 0.0}],
        "resolver_error": {"amplitude_rad": [0.0, 0.0], "quantum_rad": 0.0},
        "outliers": {"size_rad": [0.0, 0.0]},
        "ballbar_axes": {"sigma_m": 0.0, "sigma_rad": 0.0},
        "base_tilt": {"sigma_rad": 0.0},
        "plate_length": {"sigma_m": 0.0},
        "thermal_growth": {"a2_m": 0.0, "d4_m": 0.0},
    },
    "clocks": {
        "wander": {"rate_rms_ppm": 0.0},
        "step": {"at_s": 9.0, "step_s": 0.0},
        "quantum": {"robot_s": 0.0, "ballbar_s": 0.0},
        "jitter": {"sigma_s": 0.0},
        "dropped_rows": {"robot_probability": 0.0, "ballbar_probability": 0.0},
        "duplicated_rows": {"robot_probability": 0.0, "ballbar_probability": 0.0},
    },
}


@pytest.mark.parametrize(
    ("section", "source"), [(section, name) for section in SIZE_ZERO for name in SIZE_ZERO[section]]
)
def test_a_source_of_size_zero_is_as_good_as_absent(
    section: str, source: str, plain: Run, tmp_path: Path
) -> None:
    run = noisy(tmp_path, section, **{source: SIZE_ZERO[section][source]})
    files, files_plain = (
        {p.name: p.read_bytes() for p in each.folder.rglob("*.*")} for each in (run, plain)
    )
    assert files == files_plain
    assert (run.truth.geometry.values == plain.truth.geometry.values).all()


def test_everything_at_once_is_in_the_truth_file_and_the_reader_copes(tmp_path: Path) -> None:
    errors = NOISY["errors"] | SENSORS | GEOMETRY | {"resolver_error": {}}
    step = {"at_s": 20.0, "step_s": 0.2}
    clocks = NOISY["clocks"] | ROWS | {"wander": {}, "step": step, "quantum": {}, "jitter": {}}
    changes = NOISY | {"plant": {"kind": "kinematic"}, "errors": errors, "clocks": clocks}
    done = record(tmp_path / "recording", **changes)
    logs = load_truth(truth_path(done.folder)).logs
    assert logs == done.simulation.truth.logs
    assert [h.amplitude_rad for h in logs.encoders["b1"].own] == [6.0e-5, 2.5e-5, 8.0e-6]
    assert logs.encoders["b3"].slipped_periods[0].periods == 4
    assert logs.clock_step is not None
    assert (logs.clock_step.at_s, logs.clock_step.step_s) == (20.0, 0.2)
    kinds = {f.kind for f in read_recording(done.folder).report.findings}
    assert {"amplitude error", "duplicate stamp", "gap"} <= kinds


def test_without_errors_the_truth_file_says_when_the_logs_began_and_no_more(plain: Run) -> None:
    stated = yaml.safe_load(truth_path(plain.folder).read_text())["logs"]
    assert stated == {"first_rows": {"robot_s": pytest.approx(0.363), "ballbar_s": 0.5}}


# --- settings


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {
                "encoders": {"fitted": [1, 2, 4, 5]},
                "errors": {"slipped_periods": [{"encoder": 3, "at_s": 9.0}]},
            },
            r"errors.slipped_periods\[0\].encoder = 3: joint 3 has no encoder; "
            "encoders.fitted are: 1, 2, 4, 5",
        ),
        (
            {
                "encoders": {"fitted": []},
                "errors": {"amplitude_errors": [{"encoder": 1, "start_s": 9.0, "end_s": 10.0}]},
            },
            "joint 1 has no encoder; encoders.fitted are: none",
        ),
        (
            {"errors": {"coupling_slips": [{"encoder": 3, "at_s": 59.8}]}},
            r"errors.coupling_slips\[0\].at_s = 59.8: t = 59.8 s is not logged; "
            "the logs run from 0.5 to 59.5 s of the path",
        ),
        (
            {"errors": {"amplitude_errors": [{"encoder": 3, "start_s": 9.0, "end_s": 8.0}]}},
            "end_s = 8 must be later than start_s = 9",
        ),
        (
            {"errors": {"static": {"table": "thesis_3_1", "parameters": "all"}}},
            "Table 3.1 has its own; to draw others, give sigma_m and sigma_rad",
        ),
        ({"clocks": {"step": {"at_s": 0.2}}}, "clocks.step.at_s = 0.2: t = 0.2 s is not logged"),
        ({"clocks": {"restart": {"at_s": 58.0}}}, "t = 60 s is not logged"),
    ],
)
def test_a_fault_that_cannot_happen_is_refused_in_words(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        yaml.safe_dump(settings().model_dump(mode="json", exclude_unset=True) | changes)
    )
    with pytest.raises(DescriptionError, match=words):
        load_model(scenario, SimulationSettings)


def test_an_empty_mapping_switches_a_source_on_at_its_documented_size() -> None:
    chosen = settings(errors={"encoder_eccentricity": {}, "resolver_error": {}})
    errors = chosen.errors
    assert errors.encoder_eccentricity is not None
    assert errors.encoder_eccentricity.amplitude_rad == (6.0e-5, 2.5e-5, 8.0e-6)
    assert errors.resolver_error is not None
    assert errors.resolver_error.amplitude_rad == (1.5e-3, 1.5e-3)
    assert errors.resolver_error.quantum_rad == pytest.approx(9.587e-5, rel=1e-4)
    assert settings().errors.encoder_eccentricity is None

"""Dwells and coarse alignment: dwells are found in the noise, and a clock shift is found."""

import numpy as np
import pytest

from ballbar.acquisition.alignment import coarse_alignment, overlap_correlation
from ballbar.acquisition.dwells import find_dwells, noise_sigma, speeds
from ballbar.cell.errors import LogError
from ballbar.cell.logs import BallBarLog, RobotLog

NOISE = 1e-5  # [rad]
RAMP = 0.6  # [s] from motion to rest


class Trajectory:
    """How far along its trajectory a mechanism is: even progress with smooth dwells.

    It is the same for both ends of the loop.
    """

    def __init__(self, duration: float, rests: list[tuple[float, float]]) -> None:
        self.t = np.arange(0.0, duration, 0.002)
        pace = np.ones_like(self.t)
        for start, stop in rests:
            away = np.clip(np.maximum(start - self.t, self.t - stop) / RAMP, 0.0, 1.0)
            pace *= away**2 * (3.0 - 2.0 * away)
        self.progress = np.cumsum(pace) * 0.002

    def angles(self, t: np.ndarray, columns: int, rng: np.random.Generator) -> np.ndarray:
        along = np.interp(t, self.t, self.progress)
        draws = rng.uniform([0.2, 0.01, 0.0], [0.6, 0.1, 6.28], (columns, 2, 3))
        return np.stack(
            [sum(a * np.sin(2 * np.pi * f * along + p) for a, f, p in terms) for terms in draws],
            axis=1,
        )


def draw_trajectory(duration: float, rng: np.random.Generator) -> Trajectory:
    """Rests at both ends, and a few dwells at random."""
    dwells = [
        (start, start + rng.uniform(2.0, 5.0))
        for start in rng.uniform(10.0, duration - 15.0, rng.integers(2, 6))
    ]
    return Trajectory(duration, [(-1.0, 4.0), (duration - 4.0, duration + 1.0), *dwells])


def logs_with_offset(
    offset: float, *, skew: float, seed: int, longer: bool
) -> tuple[RobotLog, BallBarLog, float]:
    """Both logs of one run, and the true offset.

    longer : the log that starts early has the dwell before the trajectory; otherwise the one that
        starts late misses part of it.
    """
    rng = np.random.default_rng(seed)
    duration = rng.uniform(120.0, 240.0)
    trajectory = draw_trajectory(duration, rng)
    sign = -1.0 if longer else 1.0
    late_robot, late_bar = sign * max(0.0, -sign * offset), sign * max(0.0, sign * offset)
    t_robot = np.arange(late_robot, duration, 0.004032)
    t_bar = late_bar + np.cumsum(
        rng.choice([0.010, 0.015], int((duration - late_bar) / 0.0101), p=[0.99, 0.01])
    )
    q = trajectory.angles(t_robot, 6, rng) + rng.normal(0.0, NOISE, (t_robot.size, 6))
    b = trajectory.angles(t_bar, 4, rng) + rng.normal(0.0, NOISE, (t_bar.size, 4))
    stamps = (t_bar - t_bar[0]) / (1.0 + skew)
    return (
        RobotLog(t_robot - t_robot[0], q),
        BallBarLog(stamps, b, (1, 2, 4, 5)),
        float(t_bar[0] - t_robot[0]),
    )


@pytest.mark.parametrize("longer", [True, False])
@pytest.mark.parametrize(
    "offset",
    [
        -31.4,
        0.0,
        7.7,
        *(pytest.param(o, marks=pytest.mark.slow) for o in (-60.0, -0.137, 0.137, 60.0)),
    ],
)
def test_a_shifted_clock_is_found_to_be_shifted(offset: float, longer: bool) -> None:
    for seed in range(3):
        robot, ballbar, truth = logs_with_offset(offset, skew=2e-4, seed=seed, longer=longer)
        alignment = coarse_alignment(robot, ballbar)
        # Grid of 0.05 s, and 2e-4 of skew over 240 s is another 0.05 s; issue 2 asks for 0.3 s.
        assert alignment.offset_s == pytest.approx(truth, abs=0.15)
        assert alignment.score > alignment.runner_up_score
        assert alignment.score <= alignment.overlap_s


def test_an_offset_between_two_steps_of_the_grid_is_found() -> None:
    """Clocks that differ by parts of a grid step of 0.05 s."""
    robot, ballbar, _ = logs_with_offset(10.0, skew=0.0, seed=3, longer=True)
    parts = np.array([0.0, 0.0125, 0.025, 0.0375])
    found = []
    for part in parts:
        begin = int(np.searchsorted(robot.t, 1.0 + part))
        t = robot.t[begin:]
        later = coarse_alignment(RobotLog(t - t[0], robot.q[begin:]), ballbar).offset_s
        found.append(later + t[0])
    # the nearest steps of the grid would differ by 37 ms; a parabola is no exact shape of a peak
    assert np.ptp(found) < 12e-3


def test_the_second_best_offset_is_another_peak() -> None:
    robot, ballbar, _ = logs_with_offset(10.0, skew=0.0, seed=3, longer=True)
    alignment = coarse_alignment(robot, ballbar)
    assert alignment.runner_up_offset_s is not None
    assert abs(alignment.runner_up_offset_s - alignment.offset_s) > 2.0
    assert alignment.runner_up_score > 0.0


def test_the_same_trajectory_driven_twice_gives_a_runner_up_one_round_away() -> None:
    rests = [
        (-1.0, 3.0),
        (17.0, 19.0),
        (41.0, 45.0),
        (59.0, 61.0),
        (83.0, 90.0),
    ]  # rest, motion, dwell, motion, twice
    rng = np.random.default_rng(0)
    trajectory = Trajectory(86.0, rests)
    t = np.arange(0.0, 86.0, 0.01)
    robot = RobotLog(t, trajectory.angles(t, 6, rng))
    part = t[t < 44.0]
    alignment = coarse_alignment(
        robot, BallBarLog(part, trajectory.angles(part, 4, rng), (1, 2, 4, 5))
    )
    offsets = sorted([alignment.offset_s, alignment.runner_up_offset_s])
    assert offsets == pytest.approx([0.0, 42.0], abs=0.3)


def test_rest_against_rest_does_not_win() -> None:
    # 100 s of dwell in each log, 30 s of motion: the longest overlap of equal signals is of dwells.
    rng = np.random.default_rng(1)
    trajectory = Trajectory(130.0, [(-1.0, 100.0), (110.0, 113.0), (126.0, 140.0)])
    t_robot, t_bar = np.arange(0.0, 130.0, 0.004032), np.arange(90.0, 130.0, 0.01)
    robot = RobotLog(
        t_robot, trajectory.angles(t_robot, 6, rng) + rng.normal(0.0, NOISE, (t_robot.size, 6))
    )
    bar = BallBarLog(
        t_bar - 90.0,
        trajectory.angles(t_bar, 4, rng) + rng.normal(0.0, NOISE, (t_bar.size, 4)),
        (1, 2, 4, 5),
    )
    assert coarse_alignment(robot, bar).offset_s == pytest.approx(90.0, abs=0.15)


def test_peaks_within_two_seconds_are_one() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    q = np.stack([0.5 * np.sin(2 * np.pi * t / 3.0)] * 6, axis=1)  # speed repeats every 1.5 s
    alignment = coarse_alignment(RobotLog(t, q), BallBarLog(t.copy(), q[:, :1].copy(), (1,)))
    assert alignment.offset_s == pytest.approx(0.0, abs=0.02)
    assert abs(alignment.runner_up_offset_s) == pytest.approx(3.0, abs=0.02)


def test_correlation_at_every_lag_is_that_of_the_overlapping_samples() -> None:
    rng = np.random.default_rng(9)
    robot, ballbar = np.cumsum(rng.normal(size=50)) + 5.0, np.cumsum(rng.normal(size=35)) - 3.0
    lags = np.arange(-34, 50)
    pairs = [(robot[max(0, lag) : lag + 35], ballbar[max(0, -lag) : 50 - lag]) for lag in lags]
    samples = np.array([len(r) for r, _ in pairs])
    enough = samples >= 5
    expected = [
        max(0.0, np.corrcoef(r, b)[0, 1])
        for (r, b), chosen in zip(pairs, enough, strict=True)
        if chosen
    ]
    correlation = overlap_correlation(robot, ballbar, samples[enough].astype(float), enough)
    np.testing.assert_allclose(correlation, expected, atol=1e-10)


def test_a_signal_constant_in_the_overlap_correlates_with_nothing() -> None:
    step = np.concatenate((np.zeros(30), np.ones(30)))
    samples = np.concatenate((np.arange(1.0, 61.0), np.arange(59.0, 0.0, -1.0)))
    correlation = overlap_correlation(step, step, samples, samples > 0)
    lags = np.arange(-59, 60)
    assert correlation[lags == 0] == pytest.approx(1.0)
    assert not correlation[np.abs(lags) >= 30].any()


def test_logs_without_motion_or_too_short_to_align_are_refused() -> None:
    robot, ballbar, _ = logs_with_offset(0.0, skew=0.0, seed=4, longer=True)
    rng = np.random.default_rng(2)
    standing = BallBarLog(
        ballbar.t.copy(), rng.normal(0.0, NOISE, ballbar.angles.shape), ballbar.joints
    )
    with pytest.raises(LogError, match="nothing moves in the ball-bar log"):
        coarse_alignment(robot, standing)
    short = RobotLog(robot.t[:2000].copy(), robot.q[:2000].copy())
    with pytest.raises(
        LogError, match=r"the robot log lasts 8\.06 s; aligning two clocks needs 10 s"
    ):
        coarse_alignment(short, ballbar)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-4])
@pytest.mark.parametrize("period", [0.004032, 0.01])
def test_the_rests_of_a_noisy_log_are_found_and_nothing_else(noise: float, period: float) -> None:
    rng = np.random.default_rng(5)
    rests = [(-1.0, 4.0), (20.0, 23.0), (40.0, 41.5), (56.0, 61.0)]
    t = np.arange(0.0, 60.0, period)
    angles = Trajectory(60.0, rests).angles(t, 5, rng) + rng.normal(0.0, noise, (t.size, 5))
    dwells = find_dwells(t, angles)
    expected = [(0.0, 4.0), (20.0, 23.0), (40.0, 41.5), (56.0, 60.0)]
    # A speed spans 0.1 s to either side, and a ramp begins too slowly to be seen.
    np.testing.assert_allclose(t[dwells.intervals], expected, atol=0.2)
    np.testing.assert_array_equal(
        np.flatnonzero(np.diff(dwells.standing.astype(int)) == 1), dwells.intervals[1:, 0] - 1
    )
    assert dwells.standing.sum() == np.sum(dwells.intervals[:, 1] - dwells.intervals[:, 0] + 1)


def test_one_moving_channel_is_motion() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    angles = np.zeros((t.size, 5))
    assert find_dwells(t, angles).standing.all()
    angles[:, 3] = 0.005 * np.sin(t)
    assert not find_dwells(t, angles).standing.any()  # reversals are slow for 0.2 s only


def test_a_log_that_never_rests_has_no_rest() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    angles = np.stack(
        [np.sin(0.5 * t + 0.7 * i) for i in range(5)], axis=1
    ) + np.random.default_rng(6).normal(0.0, NOISE, (t.size, 5))
    dwells = find_dwells(t, angles)
    assert not dwells.standing.any()
    assert dwells.intervals.shape == (0, 2)


@pytest.mark.parametrize("sigma", [2e-6, 1e-5, 1e-3])
def test_noise_is_measured_in_motion_and_with_uneven_stamps(sigma: float) -> None:
    rng = np.random.default_rng(7)
    t = np.cumsum(rng.choice([0.010, 0.015, 0.020], 8000, p=[0.9, 0.08, 0.02]))
    angles = np.stack([np.sin(0.5 * t), np.cos(0.3 * t)], axis=1) + rng.normal(
        0.0, sigma, (t.size, 2)
    )
    # 8000 samples: the median is good to about 2 %; jerk of 0.125 rad/s^3 leaves less than 1e-7
    # rad.
    assert noise_sigma(t, angles) == pytest.approx([sigma, sigma], rel=0.08)


def test_speeds_have_no_delay() -> None:
    t = np.cumsum(np.random.default_rng(8).choice([0.010, 0.015], 5000))
    (speed,) = speeds(t, np.sin(t)[:, None])
    error = speed[20:-20] - np.cos(t)[20:-20]
    # Uneven stamps move the middle of a window by some ms to and fro; a delay would always move
    # it the same way.
    assert np.abs(error).max() < 0.02
    delay = np.mean(error * np.sin(t)[20:-20]) / 0.5  # [s] as d cos(t)/dt = -sin(t)
    assert abs(delay) < 5e-4

"""Steps of a log: their rows, sizes and times, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident.signals.steps import (
    CLOSE,
    SMALLEST_JUMP,
    SMALLEST_STEP,
    LogStep,
    StepFault,
    _split,
    continuous_clock,
    find_steps,
    without_steps,
)

PERIOD = 0.01  # [s]
T = PERIOD * np.arange(1200)
SIGMA = 1e-5  # [rad]


def motion(t: Array) -> Array:
    """(N, 2) [rad]"""
    return np.stack([0.6 * np.sin(1.1 * t) + 0.3 * t, 0.5 * np.cos(0.9 * t)], axis=1)


def logged(t: Array = T, seed: int = 3) -> Array:
    return motion(t) + SIGMA * np.random.default_rng(seed).standard_normal((t.size, 2))


@pytest.mark.parametrize("size", [-0.02, 2e-3])
@pytest.mark.parametrize("row", [40, 600, 1150])
def test_a_channel_that_stepped_has_its_row_size_and_time(row: int, size: float) -> None:
    values = logged()
    values[row:, 1] += size
    (step,) = find_steps(T, values)
    assert (step.row, step.channel) == (row, 1)
    assert step.size == pytest.approx(size, abs=6.0 * SIGMA)
    assert step.time == pytest.approx(T[row] - 0.5 * PERIOD)
    _, mended = without_steps(T, values, (step,))
    assert np.abs(mended - motion(T)).max() < 10.0 * SIGMA


def test_a_joint_that_strikes_in_its_backlash_is_no_step() -> None:
    for share, count in ((0.9, 0), (1.1, 1)):
        values = logged()
        values[500:, 0] += share * SMALLEST_JUMP
        assert len(find_steps(T, values)) == count


def test_a_step_must_stand_out_of_the_noise_of_the_rows_beside_it() -> None:
    """Noise of half the step in every row hides what is clear without it."""
    values = logged()
    values[500:, 0] += 2e-3
    assert len(find_steps(T, values)) == 1
    values[:, 0] += 1e-3 * np.random.default_rng(4).standard_normal(T.size)
    assert find_steps(T, values) == ()


def test_steps_of_two_channels_and_of_the_clock_come_in_order_of_time() -> None:
    late = T.copy()
    late[700:] += 0.05
    values = logged()
    values[900:, 0] -= 4e-3
    values[300:, 1] += 5e-3
    steps = find_steps(late, values)
    assert [(s.row, s.channel) for s in steps] == [(300, 1), (700, None), (900, 0)]
    assert steps[1].size == pytest.approx(0.05, abs=2e-4)
    assert steps[2].time == pytest.approx(T[900] - 0.5 * PERIOD, abs=2e-4)  # of the mended clock
    stamps, mended = without_steps(late, values, steps)
    np.testing.assert_allclose(stamps, T, atol=2e-4)
    assert np.abs(mended - motion(T)).max() < 10.0 * SIGMA


@pytest.mark.parametrize(("share", "count"), [(0.8, 0), (1.3, 1), (-0.8, 0), (-1.3, 1)])
def test_a_clock_that_was_set_by_less_than_half_a_row_is_left(share: float, count: int) -> None:
    late = T.copy()
    late[500:] += share * SMALLEST_STEP
    assert [s.channel for s in find_steps(late, logged(), [500])].count(None) == count


@pytest.mark.parametrize(("missing", "size"), [(3, 0.0), (3, 0.2), (0, -0.15)])
def test_rows_that_were_left_out_are_no_step_of_the_clock(missing: int, size: float) -> None:
    keep = np.delete(np.arange(T.size), np.arange(500, 500 + missing))
    late = T[keep].copy()
    late[500:] += size
    steps = find_steps(late, logged()[keep])
    assert [(s.row, s.channel) for s in steps] == ([(500, None)] if size else [])
    if size:
        assert steps[0].size == pytest.approx(size, abs=3e-4)


def test_across_seconds_a_step_of_the_clock_is_believed_where_all_rows_agree() -> None:
    """The clock was set by 3 s, and the motion goes on; once with all channels off by 1 mrad."""
    late = T.copy()
    late[500:] += 3.0
    (step,) = find_steps(late, logged())
    assert step.size == pytest.approx(3.0, abs=3e-4)
    off = logged()
    off[500:] += 3.0 * CLOSE * SIGMA * np.array([1.0, -1.0])
    assert [s.channel for s in find_steps(late, off)] in ([], [None])


def test_rows_of_a_stretch_are_split_where_they_fit_best() -> None:
    """Against trying every place."""
    rng = np.random.default_rng(1)
    for count in range(6):
        before, behind = rng.uniform(size=(2, count))
        costs = [before[:k].sum() + behind[k:].sum() for k in range(count + 1)]
        assert _split(before, behind) == int(np.argmin(costs))


def test_the_clock_without_its_steps_is_set_back_behind_each() -> None:
    stamps = continuous_clock(np.array([0.0, 1.0, 2.5, 3.5]), [(2, 0.5), (3, -1.0)])
    assert stamps.tolist() == [0.0, 1.0, 2.0, 4.0]
    values = np.array([[0.0, 0.0], [1.0, 2.0]])
    steps = (LogStep(1, 0.5, 1, 2.0),)
    assert without_steps(np.array([0.0, 1.0]), values, steps)[1].tolist() == [[0, 0], [1, 0]]
    assert values[1, 1] == 2.0


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (StepFault(0, "clock", 0, 12.345, -0.0123), "clock step of -12.3 ms (ball-bar's against"),
        (StepFault(0, "encoder", 4, 1.0, 1e-3, 1), "encoder b4 slipped +1 signal period at t ="),
        (StepFault(0, "encoder", 4, 1.0, 1e-3, -2), "encoder b4 slipped -2 signal periods at t"),
        (StepFault(0, "encoder", 2, 1.0, -1.5e-3), "encoder b2 jumped by -1.500 mrad at t = 1.00"),
    ],
)  # fmt: skip
def test_a_step_fault_is_said_with_its_size_and_time(fault: StepFault, words: str) -> None:
    assert fault.sentence.startswith(words)

"""Clocks of two recorders of one motion, against those that were planted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.errors import LogError
from ballbar.cell.logs import ChannelLog
from ballbar.ident.log_alignment import AlignmentError, _normalised, align_logs
from tests.helpers.two_recorders import GAINS, ZEROS, two_logs, wandering

SEEDS = 20


@pytest.mark.slow
@pytest.mark.long
def test_the_clock_lies_within_the_stated_95_percent_about_as_often_as_that() -> None:
    off = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        clock = Clock(rng.uniform(-15.0, 15.0), rng.uniform(-2e-4, 2e-4))
        alignment = align_logs(*two_logs(wandering(rng), clock, rng))
        off.append(
            (
                (alignment.clock.offset - clock.offset) / alignment.offset_sigma,
                (alignment.clock.skew - clock.skew) / alignment.skew_sigma,
            )
        )
    inside = (np.abs(off) < 1.96).sum(axis=0)
    # Of 20 at 95 % fewer than 17 come once in a hundred times.
    assert (inside >= 17).all(), off
    # Nor are the sigmas wide: 20 draws scatter by 16 %, the estimate of each sigma by 20 % more.
    assert (np.sqrt((np.square(off)).mean(axis=0)) > 0.5).all(), off


def test_gain_sign_and_zero_of_a_channel_are_read_off_and_leave_the_clock_alone() -> None:
    rng = np.random.default_rng(3)
    motion, clock = wandering(rng), Clock(-4.25, 8e-5)
    alignment = align_logs(*two_logs(motion, clock, rng))
    assert [(pair.a, pair.b) for pair in alignment.pairs] == [("x", "u"), ("y", "v")]
    for pair, gain, zero in zip(alignment.pairs, GAINS, ZEROS, strict=True):
        assert pair.gain == pytest.approx(1.0 / gain, rel=1e-4)
        assert pair.zero == pytest.approx(-zero / gain, abs=1e-4)
        assert pair.correlation[0] == pytest.approx(np.sign(gain), abs=1e-6)
    assert alignment.clock.offset == pytest.approx(clock.offset, abs=2e-5)


def test_a_steady_channel_and_one_of_another_motion_are_left_alone() -> None:
    rng = np.random.default_rng(4)
    a, b = two_logs(wandering(rng), Clock(2.0, 0.0), rng)
    other = np.column_stack((np.arange(a.t.size), a.values, wandering(rng)(a.t)[:, 0]))
    alignment = align_logs(ChannelLog("A", a.t, other, ("row", "x", "y", "other")), b)
    assert [(pair.a, pair.b) for pair in alignment.pairs] == [("x", "u"), ("y", "v")]
    assert alignment.clock.offset == pytest.approx(2.0, abs=2e-5)


def test_channels_of_the_same_name_go_together_and_a_strange_one_is_reported() -> None:
    rng = np.random.default_rng(5)
    motion = wandering(rng)
    a, b = two_logs(motion, Clock(2.0, 0.0), rng, names=("x", "y"))
    strange = np.column_stack((b.values[:, 0], wandering(rng)(b.t)[:, 0]))
    alignment = align_logs(a, replace(b, values=strange))
    assert [pair.a for pair in alignment.pairs] == ["x"]
    assert alignment.remarks[0].startswith("channels y and y were left out: their speeds correlate")


@pytest.mark.long
@pytest.mark.slow
def test_a_drift_of_the_clocks_that_shifts_the_ends_by_a_second_is_followed() -> None:
    rng = np.random.default_rng(6)
    clock = Clock(12.0, 8e-4)
    a, b = two_logs(wandering(rng), clock, rng, duration=1200.0)
    alignment = align_logs(a.part([0]), b.part([0]))
    assert alignment.clock.skew == pytest.approx(clock.skew, abs=5.0 * alignment.skew_sigma)


def test_a_motion_that_repeats_itself_is_refused_unless_it_once_differs() -> None:
    def logs(bump: float) -> tuple[ChannelLog, ChannelLog]:
        def motion(t: np.ndarray) -> np.ndarray:
            angle = 2.0 * np.pi * t / 4.0
            once = bump * np.exp(-0.5 * ((t - 17.0) / 1.0) ** 2)
            return np.stack((np.sin(angle) + once, np.cos(2.0 * angle + 0.3)), axis=1)

        return two_logs(motion, Clock(1.0, 0.0), np.random.default_rng(7))

    with pytest.raises(AlignmentError, match="the motion repeats itself: clock offsets"):
        align_logs(*logs(bump=0.0))
    assert align_logs(*logs(bump=1.0)).clock.offset == pytest.approx(1.0, abs=1e-4)


def test_logs_that_cannot_be_aligned_are_refused_with_the_reason() -> None:
    rng = np.random.default_rng(9)
    a, b = two_logs(wandering(rng), Clock(0.0, 0.0), rng)
    _, other = two_logs(wandering(rng), Clock(0.0, 0.0), rng)
    still = replace(b, values=1e-3 * rng.standard_normal(b.values.shape))
    rows = b.t < 2.0
    short = replace(b, t=b.t[rows], values=b.values[rows])
    late = np.random.default_rng(14)
    for pair in ((a, other), two_logs(wandering(late), Clock(60.0, 0.0), late)):
        with pytest.raises(AlignmentError, match="no clock offset makes the channels of A and B"):
            align_logs(*pair)
    with pytest.raises(LogError, match=r"B: nothing moves in u, v"):
        align_logs(a, still)
    with pytest.raises(LogError, match=r"B: the log lasts 1.99 s; aligning two clocks needs 5 s"):
        align_logs(a, short)
    with pytest.raises(LogError, match=r"B: no channel 'w'; it has u, v"):
        align_logs(a, b, [("x", "w")])
    with pytest.raises(LogError, match=r"A: channel 'x' is named 2 times"):
        align_logs(a, b, [("x", "u"), ("x", "v")])


def test_logs_that_overlap_for_seconds_only_are_aligned_there() -> None:
    rng = np.random.default_rng(13)
    alignment = align_logs(*two_logs(wandering(rng), Clock(25.0, 0.0), rng))
    assert alignment.overlap == pytest.approx(15.0 - 0.6, abs=0.1)
    assert alignment.clock.offset == pytest.approx(25.0, abs=1e-4)


def test_the_offset_at_the_first_row_and_the_skew_are_known_together() -> None:
    """Value and slope at the end of a line through even instants correlate by -sqrt(3)/2."""
    rng = np.random.default_rng(15)
    alignment = align_logs(*two_logs(wandering(rng), Clock(2.0, 0.0), rng))
    assert alignment.correlation == pytest.approx(-np.sqrt(0.75), abs=0.05)


def test_a_step_of_a_clock_is_reported_with_its_size() -> None:
    rng = np.random.default_rng(16)
    a, b = two_logs(wandering(rng), Clock(2.0, 0.0), rng)
    alignment = align_logs(a, replace(b, t=b.t + 0.2 * (b.t > 15.0)))
    (remark,) = alignment.remarks
    assert remark.startswith("B: the clock stepped by +200.0 ms at t = 15.0")


def test_the_rounding_of_a_constant_speed_is_no_motion() -> None:
    """A channel that moves has an rms of 1; one that does not is still, whatever its speed."""
    covered, rng = np.ones(200, dtype=bool), np.random.default_rng(1)
    moving = rng.standard_normal((200, 2))
    assert np.sqrt((_normalised(moving, covered) ** 2).mean()) == pytest.approx(1.0)
    steady = 3e-3 * (1.0 + 1e-13 * moving)
    assert not _normalised(steady, covered).any()

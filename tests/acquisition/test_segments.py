"""Jumps that no motion makes, and stretches of a log between starts, resets and pauses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ballbar.acquisition.faults.jumps import LONGEST, Jumps, find_jumps
from ballbar.acquisition.faults.segments import HELD, MOST, PAUSE, Segments, find_segments
from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.stamps.order import STAMP
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError

PERIOD = 0.01  # [s]
ROWS = 300
T = PERIOD * np.arange(ROWS)
FASTEST = np.array([2.0, 1.0])  # [rad/s]


def motion(t: Array = T) -> Array:
    """(N, 2) [rad], up to 0.6 and 0.5 rad/s."""
    return np.stack([0.6 * np.sin(t), 0.5 * t], axis=1)


def jumps_of(values: Array, t: Array = T) -> Jumps:
    return find_jumps(t, values, FASTEST, lambda later, earlier: later - earlier)


def test_motion_below_the_greatest_speed_has_no_jumps() -> None:
    jumps = jumps_of(motion())
    assert (jumps.fast.size, jumps.lasting.size, jumps.damaged.any()) == (0, 0, False)


@pytest.mark.parametrize("rows", range(1, LONGEST + 1))
@pytest.mark.parametrize("first", [4, 150, ROWS - LONGEST - 4])
def test_what_is_back_within_three_rows_was_damaged(rows: int, first: int) -> None:
    values = motion()
    values[first : first + rows, 1] -= 0.5
    jumps = jumps_of(values)
    assert np.flatnonzero(jumps.damaged).tolist() == list(range(first, first + rows))
    assert jumps.lasting.tolist() == []
    assert jumps.fast.tolist() == [first, first + rows]
    assert jumps.speed[0] == pytest.approx([abs(np.diff(values[:, 0]))[first - 1] / PERIOD, 49.5])


def test_what_does_not_come_back_is_a_lasting_step() -> None:
    values = motion()
    values[150:, 0] += 0.5
    values[200 : 200 + LONGEST + 1, 1] += 0.5  # back too late
    jumps = jumps_of(values)
    assert jumps.lasting.tolist() == [150, 200, 200 + LONGEST + 1]
    assert not jumps.damaged.any()


def test_the_first_and_last_rows_alone_are_damaged_whatever_follows() -> None:
    for cut in (1, LONGEST):
        values = motion()
        values[:cut] += 0.7
        values[ROWS - cut :] += 0.7
        jumps = jumps_of(values)
        expected = [*range(cut), *range(ROWS - cut, ROWS)]
        assert np.flatnonzero(jumps.damaged).tolist() == expected
        assert jumps.lasting.tolist() == []
    values = motion()
    values[: LONGEST + 1] += 0.7
    values[ROWS - LONGEST - 1 :] += 0.7
    assert jumps_of(values).lasting.tolist() == [LONGEST + 1, ROWS - LONGEST - 1]


def test_a_disturbance_must_come_back_half_of_its_way() -> None:
    """To a third of it, within what motion may do in three rows, is another place."""
    values = motion()
    values[150:, 1] += 0.03
    values[150, 1] += 0.01
    assert jumps_of(values).lasting.tolist() == [150]


def test_a_stamp_that_follows_closely_makes_no_speed() -> None:
    late = T.copy()
    late[150] = late[149] + 1e-5
    assert jumps_of(motion(), late).fast.size == 0
    late[150] = late[149] - 5.0  # and one that goes back neither
    assert jumps_of(motion(), late).fast.size == 0


def test_more_than_one_in_a_hundred_is_no_accident() -> None:
    for count, many in ((2 * LONGEST, False), (2 * LONGEST + 2, True)):
        values = motion()
        for row in range(40, 40 + 10 * (count // 2), 10):
            values[row, 0] += 0.5
        jumps = jumps_of(values)
        assert (jumps.fast.size, jumps.many()) == (count, many)
        assert jumps.damaged.any() != many


def test_steps_in_every_block_of_rows_are_found() -> None:
    t = PERIOD * np.arange(9000)
    values = np.zeros((9000, 1))
    for row in (4096, 4097, 8192):
        values[row:] += 1.0
    jumps = find_jumps(t, values, FASTEST[:1], lambda later, earlier: later - earlier)
    assert jumps.fast.tolist() == [4096, 4097, 8192]


def log(stamps: Array, begins: Any = (), bad: Any = ()) -> Table:
    """Rows with stamps (N,) [s]; begins : rows at which the logger started again."""
    ns = np.rint(stamps * 1e9).astype(np.int64)
    count = np.zeros(ns.size, dtype=np.intp)
    table = Table({STAMP: ns}, ("log.csv",), count, count + np.arange(ns.size) + 2)
    table.begins[list(begins)] = True
    table.flags[list(bad)] = int(RowFlag.IMPLAUSIBLE)
    return table


def found(
    stamps: Array, angles: Array | None = None, *, begins: Any = (), bad: Any = (), **events: Any
) -> tuple[Segments, list[str]]:
    table, segments = find_segments(
        log(stamps, begins, bad), motion(stamps) if angles is None else angles, **events
    )
    return segments, [entry.sentence for entry in table.findings]


def test_an_even_log_is_one_segment() -> None:
    segments, sentences = found(T)
    assert sentences == []
    assert segments.used.all()
    assert not segments.segment.any()
    assert (segments.stamps == np.rint(T * 1e9)).all()


def test_a_clock_that_was_set_back_while_the_motion_went_on_is_joined() -> None:
    late = T.copy()
    late[100:] -= 0.731
    segments, (sentence,) = found(late, motion(T))
    assert "the clock was set back by 721 ms while the motion went on; joined on" in sentence
    assert segments.used.all()
    assert segments.segment[[99, 100]].tolist() == [0, 1]
    np.testing.assert_allclose(segments.stamps * 1e-9, T, atol=1e-9)


def test_two_shifts_add_up() -> None:
    late = T.copy()
    late[100:] -= 0.4
    late[200:] -= 0.3
    segments, sentences = found(late, motion(T))
    assert len(sentences) == 2
    np.testing.assert_allclose(segments.stamps * 1e-9, T, atol=1e-9)


def test_a_logger_that_started_again_elsewhere_leaves_the_longest_part() -> None:
    late = np.concatenate([T[:100], T[:200] + 0.05])
    angles = motion(np.concatenate([T[:100], T[:200] + 5.0]))
    segments, sentences = found(late, angles)
    assert "the stamp goes back by 940 ms and the motion does not go on." in sentences[0]
    assert "100 rows over 990 ms are not used: they cannot be joined to the longest" in sentences[1]
    assert "starts at log.csv:102" in sentences[1]
    assert np.flatnonzero(segments.used).tolist() == list(range(100, 300))


@pytest.mark.parametrize(("share", "joined"), [(0.9, True), (1.2, False)])
def test_a_motion_goes_on_within_twice_its_speed(share: float, joined: bool) -> None:
    """Over three periods of a row that may be late, and a start or stop besides."""
    late = T.copy()
    late[100:] -= 0.5
    angles = motion(T)
    angles[100:, 1] += share * (HELD + 2.0 * 0.5 * 3.0 * PERIOD) - 0.5 * PERIOD
    segments, _ = found(late, angles)
    assert segments.used.all() == joined


def test_damaged_rows_do_not_tell_whether_the_motion_goes_on() -> None:
    late = T.copy()
    late[100:] -= 0.4
    angles = motion(T)
    angles[98:101] += 3.0
    angles[100] += 3.0
    segments, _ = found(late, angles, bad=[98, 99, 100])
    assert segments.used.all()


def test_of_an_arm_that_stands_any_time_may_have_passed() -> None:
    still = np.tile([0.3, 0.4], (ROWS, 1))
    for back, begins, joined in ((0.2, (), True), (0.2, (100,), False), (0.7, (), False)):
        late = T.copy()
        late[100:] -= back
        segments, _ = found(late, still, begins=begins)
        assert segments.used.all() == joined, (back, begins)


@pytest.mark.parametrize(("pause", "segments"), [(0.9, 1), (1.1, 2)])
def test_rows_that_are_missing_for_half_a_second_begin_a_segment(
    pause: float, segments: int
) -> None:
    late = T.copy()
    late[100:] += pause * PAUSE - PERIOD
    made, sentences = found(late)
    assert made.segment.max() == segments - 1
    assert made.used.all()
    assert len(sentences) == segments - 1
    assert all("550 ms without rows: a pause, or the clock was set" in text for text in sentences)


def test_counters_that_start_near_zero_after_a_pause_were_switched_off() -> None:
    late = T.copy()
    late[100:] += 2.0
    asked = list[tuple[int | None, int | None]]()

    def powered_up(before: int | None, behind: int | None) -> bool:
        asked.append((before, behind))
        return True

    segments, sentences = found(late, bad=[99, 100], powered_up=powered_up)
    assert asked == [(98, 101)]
    assert "all counters start near zero after 2.01 s without rows" in sentences[0]
    assert np.flatnonzero(segments.used).tolist() == list(range(100, 300))


@pytest.mark.parametrize(("missing", "used"), [(1, 300), (4, 200)])
def test_a_counter_that_was_reset_between_neighbours_is_left_to_the_motion(
    missing: int, used: int
) -> None:
    late = T.copy()
    late[100:] += (missing - 1) * PERIOD
    segments, sentences = found(late, reset=np.array([100]))
    assert segments.used.sum() == used
    assert bool(sentences) == (used < 300)
    assert segments.segment[[99, 100]].tolist() == [0, 1]


def test_a_log_of_more_than_fifty_segments_has_another_fault() -> None:
    for count in (MOST, MOST + 1):
        late = T.copy()
        for k in range(1, count + 1):
            late[5 * k :] += 1.0
        if count == MOST:
            assert found(late)[0].segment.max() == MOST
        else:
            with pytest.raises(LogError, match=r"log\.csv:7: the log falls into 52 segments"):
                found(late)

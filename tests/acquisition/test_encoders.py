"""Encoders: counter words become angles, what the terminal marks as faulty never does."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbar.acquisition.explain import _encoder
from ballbar.acquisition.faults import encoders
from ballbar.acquisition.faults.encoders import (
    counter_words,
    counts_to_rad,
    powered_up,
    refuse_standing,
    unwrap_counter,
    with_jumps_checked,
    with_status_checked,
)
from ballbar.acquisition.flags import RowFlag, usable
from ballbar.acquisition.table.table import Table
from ballbar.cell.dialect import load_dialect
from ballbar.cell.errors import LogError
from ballbar.cell.recording import EncoderFitting

LINES, BITS = 3600, 12
STATUS = {"b1": "s1", "b2": "s2"}


def table_of(**columns: np.ndarray) -> Table:
    count = len(next(iter(columns.values())))
    integers = {name: np.asarray(values, dtype=np.int64) for name, values in columns.items()}
    return Table(
        integers, ("raw/bar.csv",), np.zeros(count, dtype=np.int64), np.arange(2, count + 2)
    )


def turning(*, period: float = 0.01, count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, and counts of two encoders that turn to and fro by 1 rad as a ball-bar does."""
    t = period * np.arange(count)
    per_rad = LINES * 2**BITS / (2 * np.pi)
    return (
        t,
        np.rint(np.sin(t) * per_rad).astype(np.int64),
        np.rint(np.cos(t) * per_rad).astype(np.int64),
    )


def fitted(*names: str) -> dict:
    return {name: EncoderFitting(column=name, lines=LINES, bits=BITS) for name in names}


def encoder_angles(table: Table, t: np.ndarray, names: dict, *, robot_moves: bool) -> np.ndarray:
    """The steps of the reader: words, jumps, angles, standing columns."""
    return checked(table, t, names, robot_moves=robot_moves)[1]


def checked(
    table: Table, t: np.ndarray, names: dict, *, robot_moves: bool
) -> tuple[Table, np.ndarray]:
    """The table with jumps flagged and reported, and the encoder angles."""
    words = counter_words(table, names)
    table = with_jumps_checked(table, t, words, names)
    refuse_standing(table, words, names, robot_moves=robot_moves)
    return table, encoders.encoder_angles(words, usable(table.flags), names)


@given(
    start=st.integers(-(2**31), 2**31 - 1),
    steps=st.lists(st.integers(-(2**31), 2**31 - 1), max_size=50),
    signed=st.booleans(),
)
def test_counts_wrapped_into_words_unwrap_to_the_same_counts(
    start: int, steps: list[int], signed: bool
) -> None:
    counts = start + np.concatenate(([0], np.cumsum(np.array(steps, dtype=np.int64)))).astype(
        np.int64
    )
    words = counts.astype(np.uint32)
    logged = words.view(np.int32).astype(np.int64) if signed else words.astype(np.int64)
    assert unwrap_counter(logged).tolist() == counts.tolist()


def test_the_first_backward_step_from_power_up_is_one_count_back() -> None:
    assert unwrap_counter(np.array([0, 4294967295, 0, 1])).tolist() == [0, -1, 0, 1]


def test_one_turn_is_lines_times_interpolation_and_the_sign_turns_it_round() -> None:
    turn = np.array([LINES * 4096, 1])
    assert counts_to_rad(turn, lines=LINES, bits=12, sign=1) == pytest.approx(
        [2 * np.pi, 0.4261e-6], rel=1e-4
    )  # notes/log_formats sec. A.3
    assert counts_to_rad(turn, lines=LINES, bits=12, sign=-1)[0] == pytest.approx(-2 * np.pi)
    assert counts_to_rad(turn, lines=LINES, bits=13, sign=1)[0] == pytest.approx(np.pi)


def test_a_counter_that_was_reset_is_found_at_its_row_and_its_angle_jumps() -> None:
    t, first, second = turning()
    first[250:] -= first[249] - 4_000_000  # the counter starts again, 1.7 rad away
    table = table_of(b1=first % 2**32, b2=second % 2**32)
    names = fitted("b1", "b2")
    table = with_jumps_checked(table, t, counter_words(table, names), names)
    assert np.flatnonzero(table.flags).tolist() == [250]
    assert table.flags[250] == RowFlag.PRESET
    assert [(entry.kind, entry.severity, entry.lines) for entry in table.findings] == [
        ("counter jumped", "warning", (252,))
    ]


@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("at", [0, 120, -1])
def test_rows_that_are_off_for_a_moment_are_flagged_and_add_no_wrap(rows: int, at: int) -> None:
    t, first, _ = turning()
    words = first.copy()
    damaged = np.arange(400)[at:][:rows] if at >= 0 else np.arange(400)[-rows:]
    words[damaged] = words[120] + 3_000_000_000
    table, angles = checked(table_of(b1=words % 2**32), t, fitted("b1"), robot_moves=True)
    valid = np.delete(np.arange(400), damaged)
    expected = counts_to_rad(first, lines=LINES, bits=BITS, sign=1)
    # At the start the first word is another, and so is the zero.
    assert np.ptp(angles[valid, 0] - expected[valid]) < 1e-12
    assert [(entry.kind, entry.lines) for entry in table.findings] == [
        ("implausible value", tuple((damaged + 2).tolist()))
    ]


def test_an_encoder_that_jumps_all_the_time_is_declared_wrongly() -> None:
    t, first, _ = turning()
    with pytest.raises(
        LogError,
        match=(
            r"raw/bar.csv:\d+: encoder b1 jumps by -?\d.* rad within 0.01 ms .* such rows.*lines "
            r"and bits"
        ),
    ):
        encoder_angles(table_of(b1=first % 2**32), 1e-3 * t, fitted("b1"), robot_moves=True)


def test_counters_that_start_near_zero_after_a_pause_were_switched_off() -> None:
    close, far = 4 * 2**BITS, 400 * 2**BITS
    names = fitted("b1", "b2")
    words = np.array([[far, 3], [close, 2**32 - 5], [far + 9, 2]])
    assert powered_up(words, names, 0, 1)
    assert not powered_up(words, names, 0, 2)  # went on counting
    assert not powered_up(words, names, 1, 1)  # was close zero before
    assert not powered_up(words, names, None, 1)


def test_a_fast_but_possible_motion_is_no_jump() -> None:
    t = 0.01 * np.arange(100)
    words = table_of(b1=np.rint(30.0 * t * LINES * 2**BITS / (2 * np.pi)).astype(np.int64))
    assert np.ptp(encoder_angles(words, t, fitted("b1"), robot_moves=True)) == pytest.approx(
        30.0 * 0.99, abs=1e-6
    )


def test_a_stamp_that_follows_closely_makes_no_jump() -> None:
    t, first, _ = turning()
    # Written late, or early: 0.005 rad of motion within 10 us would be 500 rad/s.
    t[100] = t[99] + 1e-5
    assert len(encoder_angles(table_of(b1=first % 2**32), t, fitted("b1"), robot_moves=True)) == 400


@pytest.mark.parametrize("value", [0, 123456])
def test_a_standing_counter_while_others_move_is_a_column_without_counts(value: int) -> None:
    t, first, _ = turning()
    with pytest.raises(
        LogError,
        match=f"encoder column without counts: column b2 of encoder b2 is {value} in every row",
    ):
        encoder_angles(
            table_of(b1=first % 2**32, b2=np.full(t.size, value)),
            t,
            fitted("b1", "b2"),
            robot_moves=False,
        )


def test_counters_may_all_stand_only_while_the_robot_does() -> None:
    t = 0.01 * np.arange(60)
    words = table_of(b1=np.full(60, 7), b2=np.full(60, 8))
    assert np.ptp(
        encoder_angles(words, t, fitted("b1", "b2"), robot_moves=False), axis=0
    ).tolist() == [0.0, 0.0]
    with pytest.raises(LogError, match="encoder column without counts: column b1"):
        encoder_angles(words, t, fitted("b1", "b2"), robot_moves=True)


@pytest.mark.parametrize(("first", "second"), [(2**32, 0), (-(2**31) - 1, 0), (-1, 2**31)])
def test_a_number_that_is_no_counter_word_is_refused(first: int, second: int) -> None:
    with pytest.raises(
        LogError, match=r"raw/bar.csv:\d: column b1: -?\d+ is no 32-bit counter word"
    ):
        encoder_angles(
            table_of(b1=np.array([first, second])),
            np.array([0.0, 0.01]),
            fitted("b1"),
            robot_moves=True,
        )


FAULTS = [
    (3, "frequency error", RowFlag.FREQUENCY),
    (4, "amplitude error", RowFlag.AMPLITUDE),
    (14, "invalid process data", RowFlag.INVALID),
]


@pytest.mark.parametrize(("bit", "kind", "flag"), FAULTS)
def test_rows_with_a_faulty_encoder_are_flagged_and_counted(
    bit: int, kind: str, flag: RowFlag
) -> None:
    _, first, second = turning()
    toggle = (np.arange(400) % 2) << 15
    status = np.zeros(400, dtype=np.int64)
    faulty = [10, 11, 12, 13, 14, 15, 200]
    status[faulty] = 1 << bit
    logged = table_of(b1=first % 2**32, b2=second % 2**32, s1=status + toggle, s2=toggle)
    table = with_status_checked(logged, STATUS)
    assert np.flatnonzero(table.flags).tolist() == faulty
    assert set(table.flags[faulty]) == {flag}
    assert np.flatnonzero(~usable(table.flags)).tolist() == faulty
    assert not logged.flags.any()
    assert [(e.kind, e.severity, e.lines, e.count) for e in table.findings] == [
        (kind, "repaired", (12, 13, 14, 15, 16), 7)
    ]


@pytest.mark.parametrize(
    ("dialect", "column"),
    [("canonical-ballbar", "b{}_status"), ("twincat-plc", "s{}"), ("twincat-scope", "s{}")],
)
@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_a_faulty_status_word_is_that_of_the_encoder_whose_number_its_column_bears(
    dialect: str, column: str, number: int
) -> None:
    toggle = (np.arange(400) % 2) << 15
    words = {column.format(k): toggle for k in range(1, 6)}
    words[column.format(number)] = toggle + (1 << 4)
    table = with_status_checked(table_of(**words), load_dialect(dialect).status)
    assert [entry.sentence.split(":")[0] for entry in table.findings] == [f"encoder b{number}"]


def test_garbage_words_between_good_ones_add_no_wrap() -> None:
    t, first, _ = turning()
    words = first.copy()
    words[[100, 101]] = words[99] + np.array([1_500_000_000, 3_000_000_000])
    table = table_of(b1=words % 2**32)
    table.flags[[100, 101]] = RowFlag.INVALID
    angles = encoder_angles(table, t, fitted("b1"), robot_moves=True)
    good = np.delete(np.arange(400), [100, 101])
    np.testing.assert_array_equal(
        angles[good, 0], counts_to_rad(first[good], lines=LINES, bits=BITS, sign=1)
    )


def test_sync_errors_are_reported_and_their_rows_kept() -> None:
    _, first, _ = turning()
    status = np.zeros(400, dtype=np.int64)
    status[5] = 1 << 13
    table = with_status_checked(table_of(b1=first % 2**32, s1=status), {"b1": "s1"})
    assert usable(table.flags).all()
    assert table.flags[5] == RowFlag.SYNC
    assert [(entry.kind, entry.severity, entry.lines) for entry in table.findings] == [
        ("sync error", "warning", (7,))
    ]


def test_a_toggle_that_stands_still_tells_of_old_data_only_where_every_cycle_is_logged() -> None:
    _, first, _ = turning()
    toggle = np.arange(400) % 2
    toggle[200:] ^= 1  # row 200 has the data of row 199 again
    for log, stale in (
        (toggle, [200]),
        (np.zeros(400, dtype=np.int64), []),
        (np.arange(400) // 7 % 2, []),
    ):
        table = with_status_checked(table_of(b1=first % 2**32, s1=log << 15), {"b1": "s1"})
        assert np.flatnonzero(table.flags == RowFlag.STALE).tolist() == stale
        assert [entry.kind for entry in table.findings] == ["stale process data"] * len(stale)


def test_a_counter_preset_during_the_log_is_found_and_one_before_it_is_not() -> None:
    _, first, _ = turning()
    status = np.full(400, 1 << 2)
    table = with_status_checked(table_of(b1=first % 2**32, s1=status), {"b1": "s1"})
    assert not table.flags.any()
    status[:50] = 0
    table = with_status_checked(table_of(b1=first % 2**32, s1=status), {"b1": "s1"})
    assert np.flatnonzero(table.flags == RowFlag.PRESET).tolist() == [50]


def test_a_number_that_is_no_status_word_is_refused() -> None:
    with pytest.raises(LogError, match=r"raw/bar.csv:3: column s1: 65536 is no 16-bit status word"):
        with_status_checked(table_of(b1=np.zeros(3), s1=np.array([0, 65536, 0])), {"b1": "s1"})


def test_an_encoder_without_status_column_is_warned_of() -> None:
    _, first, second = turning()
    logged = table_of(b1=first % 2**32, b2=second % 2**32, s1=np.zeros(400))
    table = with_status_checked(logged, STATUS)
    assert [(entry.kind, entry.severity, entry.sentence) for entry in table.findings] == [
        (
            "no status word",
            "warning",
            "encoders b2 have no status column: their faults are not seen.",
        )
    ]


@pytest.mark.parametrize("signed", [False, True])
def test_a_counter_that_was_cut_to_sixteen_bits_is_refused(signed: bool) -> None:
    _, b1, b2 = turning()
    cut = b2 % 2**16
    cut -= 2**16 * (signed & (cut >= 2**15))
    with pytest.raises(LogError, match=r"raw/bar.csv:\d+: column b2: .* lower 16 bits"):
        counter_words(table_of(b1=b1 % 2**32, b2=cut), fitted("b1", "b2"))


def test_a_counter_that_hardly_moves_is_no_cut_one() -> None:
    _, b1, _ = turning()
    small = np.rint(30_000 * np.sin(np.arange(b1.size) / 50.0)).astype(np.int64)
    small[[100, 101]] = 32_000, -32_000  # damaged
    counter_words(table_of(b1=b1 % 2**32, b2=small), fitted("b1", "b2"))
    counter_words(table_of(b2=small % 2**32), fitted("b2"))  # through zero


def test_an_encoder_is_explained_with_its_count_and_direction() -> None:
    """A turn has 3600 lines of 4096 counts: 0.426 urad each."""
    one: Any = SimpleNamespace(column="c1", lines=3600, bits=12, sign=-1)
    words = "encoder b1: counter in column c1, 3600 lines at 12 bits (recording.yaml): 0.426 urad a"
    assert _encoder("b1", one, None) == f"{words} count, against the count"
    one.sign = 1
    status = "; status word s1 where there is such a column"
    assert _encoder("b1", one, "s1") == f"{words} count, as counted{status}"

"""Faults of the field, one by one: repaired and reported, or refused.

The order is that of notes/log_formats sec. H.5.
"""

import bz2
import gzip
import lzma
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.recording import Recording, read_recording
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.logs import segment_starts
from ballbar.cell.robot_angles import joints_to_axes, joints_to_motors
from tests.helpers.device_logs import (
    BAR_T,
    EPOCH,
    PER_RAD,
    ROBOT,
    ROBOT_T,
    bar_lines,
    bar_trajectory,
    change_line,
    joint_trajectory,
    motor_rows,
    put,
    robot_lines,
    stamped,
    summaries,
    write,
)

TORQUES = [f"tau{i}" for i in range(1, 7)]


def kinds(recording: Recording) -> list[str]:
    return [entry[0] for entry in summaries(recording)]


def bar_angles(recording: Recording) -> np.ndarray:
    assert recording.ballbar_log is not None
    return recording.ballbar_log.angles


def sentence(recording: Recording, kind: str) -> str:
    return next(entry.sentence for entry in recording.report.findings if entry.kind == kind)


def assert_rows(recording: Recording, rows: np.ndarray) -> None:
    """The ball-bar's log is that of these rows of the trajectory, half a count off."""
    log = recording.ballbar_log
    assert log is not None
    np.testing.assert_allclose(log.t, BAR_T[rows] - BAR_T[rows[0]], atol=1e-9)
    off = log.angles - bar_trajectory(BAR_T)[rows]
    np.testing.assert_allclose(
        off, np.broadcast_to(np.round(off[0] * PER_RAD) / PER_RAD, off.shape), atol=1.1 / PER_RAD
    )


ALL = np.arange(BAR_T.size)


# --- form of the file


def test_a_header_without_line_end_gives_its_first_row_back(tmp_path: Path) -> None:
    lines = bar_lines()
    recording = read_recording(write(tmp_path, ballbar=[lines[0] + lines[1], *lines[2:]]))
    assert_rows(recording, ALL)
    assert summaries(recording) == [
        ("header without line end", "repaired", "raw/ballbar.csv", (1,), 1)
    ]
    assert recording.ballbar_log.flags[0] == RowFlag.REPAIRED


def test_a_file_without_header_is_read_by_the_names_that_the_recording_gives(
    tmp_path: Path,
) -> None:
    names = ["time", "b1", "b2", "b4", "b5"]
    assert_rows(
        read_recording(
            write(
                tmp_path,
                ballbar=bar_lines()[1:],
                change=put("sources", "ballbar", "columns", value=names),
            )
        ),
        ALL,
    )
    with pytest.raises(
        LogError,
        match=(
            r"raw/ballbar.csv:1: the first line holds numbers, not column names.*name all its "
            r"columns"
        ),
    ):
        read_recording(write(tmp_path, ballbar=bar_lines()[1:]))
    with pytest.raises(
        LogError, match=r"raw/ballbar.csv:1: 5 fields, but recording.yaml names 4 columns"
    ):
        read_recording(
            write(
                tmp_path,
                ballbar=bar_lines()[1:],
                change=put("sources", "ballbar", "columns", value=names[:4]),
            )
        )


def test_a_header_that_stands_again_begins_a_segment(tmp_path: Path) -> None:
    lines = bar_lines()
    recording = read_recording(write(tmp_path, ballbar=[*lines[:100], lines[0], *lines[100:]]))
    assert_rows(recording, ALL)
    assert summaries(recording) == [("header again", "repaired", "raw/ballbar.csv", (101,), 1)]
    assert segment_starts(recording.ballbar_log.segment) == (99,)


def test_preamble_end_mark_quotes_and_separators_at_the_line_end_are_no_data(
    tmp_path: Path,
) -> None:
    rows = [";".join(f'"{cell}"' for cell in line.split(";")) + ";" for line in bar_lines()]
    recording = read_recording(
        write(tmp_path, ballbar=["Project;rig;", "Started;2026;", *rows, "EOF"])
    )
    assert_rows(recording, ALL)
    assert kinds(recording) == ["preamble", "separator at the line end"]
    with pytest.raises(LogError, match=r"raw/ballbar.csv:1: columns time, b1, b2, b4, b5 missing"):
        read_recording(write(tmp_path, ballbar=[*(["key;value"] * 300), *bar_lines()]))


@pytest.mark.parametrize(
    ("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress), (".xz", lzma.compress)]
)
def test_a_packed_file_is_unpacked_and_a_cut_one_gives_what_it_holds(
    tmp_path: Path, ending: str, pack: Callable[[bytes], bytes]
) -> None:
    write(tmp_path, change=put("sources", "ballbar", "files", value=["raw/ballbar.csv" + ending]))
    packed = pack((tmp_path / "raw/ballbar.csv").read_bytes())
    file = tmp_path / f"raw/ballbar.csv{ending}"
    file.write_bytes(packed)
    assert_rows(read_recording(tmp_path), ALL)
    file.write_bytes(b"\x00garbage" + packed[8:])
    with pytest.raises(LogError, match=f"raw/ballbar.csv{ending}: "):
        read_recording(tmp_path)
    if ending == ".gz":
        file.write_bytes(packed[: len(packed) * 3 // 4])
        recording = read_recording(tmp_path)
        assert kinds(recording)[:2] == ["packed file cut off", "unterminated last line"]
        assert_rows(recording, np.arange(recording.ballbar_log.t.size))
        assert 100 < recording.ballbar_log.t.size < 300


def test_files_packed_in_another_way_are_named(tmp_path: Path) -> None:
    write(tmp_path, change=put("sources", "ballbar", "files", value=["raw/ballbar.csv.zst"]))
    (tmp_path / "raw/ballbar.csv.zst").write_bytes(b"(\xb5/\xfd")
    with pytest.raises(
        LogError, match=r"raw/ballbar.csv.zst: packed in a way that is not read here"
    ):
        read_recording(tmp_path)


# --- what the numbers mean


def other_numbers(
    tmp_path: Path, values: np.ndarray, dialect: str, names: str, *, ticks: float = 1.0
) -> Recording:
    """The robot's log with other numbers under the names of a dialect."""
    form = "{:.0f}" if ticks > 1 else "{!r}"
    rows = [
        names,
        *(
            ",".join([form.format(float(t) * ticks), *map(repr, row)])
            for t, row in zip(ROBOT_T, values.tolist(), strict=True)
        ),
    ]
    return read_recording(
        write(tmp_path, robot=rows, change=put("sources", "robot", "dialect", value=dialect))
    )


AXES = joints_to_axes(ROBOT, joint_trajectory(ROBOT_T))
MOTORS = joints_to_motors(ROBOT, joint_trajectory(ROBOT_T))


def test_angles_are_read_as_their_dialect_declares_them(tmp_path: Path) -> None:
    for values, dialect, names, ticks in (
        (np.rad2deg(AXES), "comau-joint", "time,J1,J2,J3,J4,J5,J6", 1e6),
        (
            np.rad2deg(AXES),
            "abb-libegm",
            "TIMESTAMP,R_FB_POS_RJ1,R_FB_POS_RJ2,R_FB_POS_RJ3,R_FB_POS_RJ4,R_FB_POS_RJ5,R_FB_POS_RJ6",
            1e3,
        ),
        (joint_trajectory(ROBOT_T), "joint-rad", "time,q1,q2,q3,q4,q5,q6", 1.0),
        (MOTORS, "canonical-robot", "t_ns,m1,m2,m3,m4,m5,m6", 1e9),
        (
            MOTORS[:, [1, 0, 3, 2, 5, 4]],
            "abb-labcomm",
            "Time [s],"
            + ",".join(f"robot_0:irb2ext.joint[{j}].posRawAbs" for j in (2, 1, 4, 3, 6, 5)),
            1.0,
        ),
    ):
        log = other_numbers(tmp_path, values, dialect, names, ticks=ticks).robot_log
        np.testing.assert_allclose(log.q, joint_trajectory(ROBOT_T), atol=1e-12)
        np.testing.assert_allclose(log.t, ROBOT_T, atol=1e-12 if ticks != 1e3 else 2e-5)


@pytest.mark.parametrize(
    ("values", "dialect", "words"),
    [
        (np.rad2deg(MOTORS), "abb-motor", "Degrees where radians are declared"),
        (AXES, "abb-motor", "xis angles in rad"),
        (AXES, "comau-joint", "Axis angles in rad .* where axis angles in degrees are declared"),
        (
            np.rad2deg(MOTORS),
            "comau-joint",
            "Motor angles in degrees where axis angles in degrees are declared",
        ),
        (MOTORS, "joint-rad", "Or motor angles in rad"),
        (np.rad2deg(joint_trajectory(ROBOT_T)), "joint-rad", "Degrees where radians are declared"),
    ],
)
def test_another_unit_or_side_is_refused_with_what_it_may_be(
    tmp_path: Path, values: np.ndarray, dialect: str, words: str
) -> None:
    names = {
        "abb-motor": "time,m1,m2,m3,m4,m5,m6",
        "comau-joint": "time,J1,J2,J3,J4,J5,J6",
        "joint-rad": "time,q1,q2,q3,q4,q5,q6",
    }
    with pytest.raises(LogError, match=r"raw/robot.csv:\d+: .*" + words):
        other_numbers(
            tmp_path,
            values,
            dialect,
            names[dialect],
            ticks=1e6 if dialect == "comau-joint" else 1.0,
        )


def test_exchanged_columns_and_another_robot_are_asked_for_too(tmp_path: Path) -> None:
    """Motor 4 turns by more than axis 5 may."""
    wide = MOTORS.copy()
    wide[:, 3] = np.linspace(0.0, 1.6 * np.pi, len(wide)) / np.abs(ROBOT.transmission[3, 3])
    names = "time,m1,m2,m3,m4,m5,m6"
    words = r"another robot than irb2400\?.* columns.* motors \d and \d"
    with pytest.raises(LogError, match=words):
        other_numbers(tmp_path, wide[:, [0, 1, 2, 4, 3, 5]], "abb-motor", names, ticks=1.0)


def test_torques_that_no_motor_has_are_refused(tmp_path: Path) -> None:
    at_gears = np.random.default_rng(1).normal(0.0, 400.0, (ROBOT_T.size, 6))
    rows = [
        f"{line},{','.join(map(repr, row))}"
        for line, row in zip(robot_lines()[1:], at_gears.tolist(), strict=True)
    ]
    with pytest.raises(
        LogError,
        match=r"raw/robot.csv:\d+: column tau\d: .* N m at the motor: at the gear's output",
    ):
        read_recording(write(tmp_path, robot=[f"{robot_lines()[0]},{','.join(TORQUES)}", *rows]))


def test_numbers_that_stand_for_none_are_left_out(tmp_path: Path) -> None:
    lines = robot_lines()
    lines[1:4] = [stamped("0,0,0,0,0,0,0", 99.98 + 0.004 * k) for k in range(3)]
    lines[200] = stamped("0,9E9,0,0,0,0,0", lines[200].split(",")[0])
    recording = read_recording(write(tmp_path, robot=lines))
    assert summaries(recording)[:2] == [
        ("sentinel", "repaired", "raw/robot.csv", (201,), 1),
        ("zeros at the start", "repaired", "raw/robot.csv", (2, 3, 4), 3),
    ]
    np.testing.assert_allclose(
        recording.robot_log.q, joint_trajectory(np.delete(ROBOT_T, [0, 1, 2, 199])), atol=1e-12
    )
    assert recording.robot_log.flags is not None
    assert np.flatnonzero(recording.robot_log.flags & np.uint32(RowFlag.SENTINEL)).tolist() == [
        0,
        196,
    ]  # the rows behind
    absent = motor_rows(
        np.where(np.arange(6) == 5, 9e9, joints_to_motors(ROBOT, joint_trajectory(ROBOT_T)))
    )
    with pytest.raises(LogError, match=r"raw/robot.csv:2: column m6: 9E9 in every row"):
        read_recording(write(tmp_path, robot=absent))


# --- clocks


def with_times(cells: list[object], head: str = "time") -> list[str]:
    lines = bar_lines()
    return [
        lines[0].replace("time", head),
        *(stamped(row, cell) for row, cell in zip(lines[1:], cells, strict=True)),
    ]


START_1970 = 1_461_159_910_000_000_000  # [ns] 2016-04-20 13:45:10 UTC
NS = [START_1970 + 10_000_000 * i for i in range(300)]
DATES = [str(np.datetime64(ns, "ns")) for ns in NS]


@pytest.mark.parametrize(
    ("cells", "declared", "form"),
    [
        ([ns - 946_684_800_000_000_000 for ns in NS], None, "ns since 2000"),
        ([ns // 100 + 116_444_736_000_000_000 for ns in NS], None, "FILETIME"),
        (NS, None, "ns since 1970"),
        ([ns // 1000 for ns in NS], None, "us since 1970"),
        ([ns // 1_000_000 for ns in NS], None, "ms since 1970"),
        ([text[:23].replace("T", "-") for text in DATES], None, "dates"),
        ([text.replace("T", "-") for text in DATES], None, "dates"),
        (
            [f"{d[8:10]}.{d[5:7]}.{d[:4]} {d[11:]}" for d in DATES],  # 20.04.2016 13:45:10.000
            None,
            "dates",
        ),
        (["DT#" + text.replace("T", " ") for text in DATES], None, "dates"),
        ([f"T#1h2m{10 * i // 1000}s{10 * i % 1000}ms" for i in range(300)], None, "IEC times"),
        ([(2**32 - 500 + 10 * i) % 2**32 for i in range(300)], "ms-32bit", "ms in 32 bits"),
        ([(2**32 - 500 + 10_000_000 * i) % 2**32 for i in range(300)], "ns-32bit", "ns in 32 bits"),
        ([77 + 100_000 * i for i in range(300)], "100ns", "100 ns"),
        ([f"{ns // 10**9}.{ns % 10**9:09d}" for ns in NS], "unix-s", "s since 1970"),
        ([f"{0.01 * i:.6f}" for i in range(300)], "s", "s"),
    ],
)
def test_every_time_form_of_a_plc_is_read_to_the_nanosecond(
    tmp_path: Path, cells: list[object], declared: str | None, form: str
) -> None:
    change = put("sources", "ballbar", "time", value=declared) if declared else id
    recording = read_recording(write(tmp_path, ballbar=with_times(cells), change=change))
    assert recording.ballbar_log is not None
    np.testing.assert_array_equal(recording.ballbar_log.t, np.rint(BAR_T * 1e9) / 1e9)
    assert form in recording.report.files[1].time
    assert kinds(recording) == []


def test_a_time_in_two_halves_is_put_together(tmp_path: Path) -> None:
    ticks = [ns // 100 + 116_444_736_000_000_000 for ns in NS]
    lines = with_times([f"{tick % 2**32};{tick // 2**32}" for tick in ticks], "time_lo;time_hi")
    recording = read_recording(write(tmp_path, ballbar=lines))
    assert_rows(recording, ALL)
    assert recording.report.files[1].time == "time_lo and time_hi in 100 ns since 1601 (FILETIME)"
    with pytest.raises(
        LogError, match=r"raw/ballbar.csv:2: column time_lo: -5 is no half of a 64-bit time"
    ):
        read_recording(
            write(tmp_path, ballbar=change_line(lines, 2, "-5" + lines[1][lines[1].index(";") :]))
        )


@pytest.mark.parametrize(
    ("cells", "declared", "message"),
    [
        ([10 * i for i in range(300)], None, "the form of the time stamps does not show"),
        (NS, "filetime", "is no time stamp in 100 ns since 1601"),
        ([10 * i for i in range(300)], "dc", "that would be the year 2000"),
        ([10 * i for i in range(300)], "miles", "unknown form of time 'miles'"),
        (["2016-13-20-13:45:10.123"] * 300, None, "is no date of the calendar"),
        (
            [*DATES[:100], "20.04.2016 13:45", *DATES[101:]],
            None,
            "'20.04.2016 13:45' is no date with time of day",
        ),
        ([f"{ns:.3e}" for ns in NS], None, "is in exponent form"),
        (
            [f"{ns // 100 + 116_444_736_000_000_000:.15E}" for ns in NS[:1]] + [""] * 299,
            "filetime",
            "is an empty cell",
        ),
        ([f"DT#{text[:19]}" for text in DATES], None, "The clock is too coarse"),
    ],
)
def test_stamps_that_are_ambiguous_are_refused(
    tmp_path: Path, cells: list[object], declared: str | None, message: str
) -> None:
    change = put("sources", "ballbar", "time", value=declared) if declared else id
    with pytest.raises((LogError, DescriptionError), match=re.escape(message)):
        read_recording(write(tmp_path, ballbar=with_times(cells), change=change))


def test_stamps_that_a_spreadsheet_rounded_to_less_than_a_millisecond_are_read_and_reported(
    tmp_path: Path,
) -> None:
    ticks = [ns // 100 + 116_444_736_000_000_000 for ns in NS]
    recording = read_recording(
        write(tmp_path, ballbar=with_times([f"{tick:.14E}" for tick in ticks]))
    )
    assert recording.ballbar_log is not None
    assert np.abs(recording.ballbar_log.t - BAR_T).max() < 1.1e-4  # 1000 ticks of 100 ns
    assert summaries(recording) == [
        ("rounded stamp", "repaired", "raw/ballbar.csv", (2, 3, 4, 5, 6), 300)
    ]


def test_a_damaged_stamp_is_left_out(tmp_path: Path) -> None:
    for stamp in (EPOCH - 5_000_000_000, EPOCH + 900_000_000_000, 7):
        recording = read_recording(
            write(tmp_path, ballbar=change_line(bar_lines(), 100, stamped(bar_lines()[99], stamp)))
        )
        assert_rows(recording, np.delete(ALL, 98))
        damaged = ("damaged stamp", "repaired", "raw/ballbar.csv", (100,), 1)
        assert summaries(recording)[0] == damaged


def test_rows_out_of_order_are_put_in_order_by_their_sequence_number_only(tmp_path: Path) -> None:
    lines = [line + f";{i}" for i, line in enumerate(bar_lines())]
    lines[0] = bar_lines()[0] + ";seq"
    lines[100:104] = [lines[103], lines[100], lines[102], lines[101]]
    recording = read_recording(write(tmp_path, ballbar=lines))
    assert_rows(recording, ALL)
    assert kinds(recording) == ["rows out of order"]
    assert (recording.ballbar_log.flags[99:103] & RowFlag.REORDERED).any()
    shuffled = bar_lines()
    for k in range(20, 280, 20):
        shuffled[k], shuffled[k + 1] = shuffled[k + 1], shuffled[k]
    with pytest.raises(
        LogError,
        match=(
            r"stands out of the order of its neighbours, and so in 13 of 300 rows.*sequence "
            r"number"
        ),
    ):
        read_recording(write(tmp_path, ballbar=shuffled))


def test_a_message_that_was_read_twice_is_dropped_by_its_sequence_number(tmp_path: Path) -> None:
    lines = [line + f";{i}" for i, line in enumerate(bar_lines())]
    lines[0] = bar_lines()[0] + ";seq"
    lines.insert(51, stamped(lines[50], EPOCH + 494_000_000))
    recording = read_recording(write(tmp_path, ballbar=lines))
    assert_rows(recording, ALL)
    assert summaries(recording) == [("row read twice", "repaired", "raw/ballbar.csv", (52,), 1)]


# --- segments


def test_a_clock_that_was_set_back_while_the_motion_goes_on_is_joined(tmp_path: Path) -> None:
    stamps = [EPOCH + 10_000_000 * i - (40_000_000 if i >= 180 else 0) for i in range(300)]
    recording = read_recording(write(tmp_path, ballbar=with_times(stamps)))
    assert_rows(recording, ALL)
    assert summaries(recording) == [("clock set back", "repaired", "raw/ballbar.csv", (182,), 1)]
    assert "set back by 30 ms while the motion went on" in sentence(recording, "clock set back")
    assert segment_starts(recording.ballbar_log.segment) == (180,)


def test_a_logger_that_started_anew_leaves_the_longer_part_and_says_what_is_not_used(
    tmp_path: Path,
) -> None:
    """Its clock starts at power-up, and the mechanism moved on: the time between is unknown."""
    stamps = [10_000_000 * (i + 500) for i in range(100)] + [10_000_000 * i for i in range(200)]
    lines = with_times(stamps)
    moved = [line.split(";") for line in lines[101:]]
    lines[101:] = [
        ";".join((row[0], *(str((int(cell) + 400_000) % 2**32) for cell in row[1:])))
        for row in moved
    ]
    recording = read_recording(
        write(tmp_path, ballbar=lines, change=put("sources", "ballbar", "time", value="ns"))
    )
    assert_rows(recording, ALL[100:])
    assert summaries(recording) == [
        ("logger restarted", "warning", "raw/ballbar.csv", (102,), 1),
        ("part not used", "repaired", "raw/ballbar.csv", (2,), 100),
    ]
    assert "longest part, which starts at raw/ballbar.csv:102" in sentence(
        recording, "part not used"
    )
    rows = recording.rows["ballbar"]
    assert (rows.used.sum(), rows.segment.max()) == (200, 1)


def test_a_pause_begins_a_segment_and_loses_nothing(tmp_path: Path) -> None:
    t = BAR_T.copy()
    t[150:] += 2.0
    recording = read_recording(write(tmp_path, ballbar=bar_lines(t)))
    assert recording.ballbar_log is not None
    np.testing.assert_allclose(recording.ballbar_log.t, t, atol=1e-9)
    assert kinds(recording) == ["pause or clock jump", "gap"]
    assert segment_starts(recording.ballbar_log.segment) == (150,)
    assert recording.ballbar_log.flags[150] == RowFlag.GAP


def reset_from(lines: list[str], row: int, counts: int) -> list[str]:
    """All counters shifted from a row (from 0) on."""
    rows = [line.split(";") for line in lines[1:]]
    shifted = [
        [row_[0], *(str((int(c) + counts) % 2**32) for c in row_[1:])] if i >= row else row_
        for i, row_ in enumerate(rows)
    ]
    return [lines[0], *(";".join(row_) for row_ in shifted)]


def test_a_counter_that_was_reset_between_two_rows_keeps_both_sides(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path, ballbar=reset_from(bar_lines(), 120, 9_000_000)))
    assert kinds(recording) == ["counter jumped"]
    assert bar_angles(recording).shape == (300, 4)
    assert segment_starts(recording.ballbar_log.segment) == (120,)
    assert recording.ballbar_log.flags[120] == RowFlag.PRESET
    step = np.diff(bar_angles(recording), axis=0)[119] * [1, -1, 1, -1]
    # Left for identification, which measures it.
    np.testing.assert_allclose(step, 9_000_000 / PER_RAD, atol=0.01)


def test_counters_switched_off_and_on_in_a_pause_split_the_log(tmp_path: Path) -> None:
    t = BAR_T.copy()
    t[100:] += 30.0
    far = reset_from(bar_lines(t), 0, 100_000_000)
    at_100 = [int(cell) for cell in far[101].split(";")[1:]]
    rows = [line.split(";") for line in far]
    rows[101:] = [
        [row[0], *(str((int(c) - start) % 2**32) for c, start in zip(row[1:], at_100, strict=True))]
        for row in rows[101:]
    ]
    recording = read_recording(write(tmp_path, ballbar=[";".join(row) for row in rows]))
    assert kinds(recording) == ["counter reset", "part not used"]
    assert bar_angles(recording).shape == (200, 4)


def test_more_segments_than_a_log_has_are_refused(tmp_path: Path) -> None:
    t = BAR_T + 3.0 * (np.arange(300) // 4)
    with pytest.raises(LogError, match=r"raw/ballbar.csv:6: the log falls into 75 segments"):
        read_recording(write(tmp_path, ballbar=bar_lines(t)))


def test_a_wrapping_counter_goes_on_and_signed_logs_are_the_same(tmp_path: Path) -> None:
    offset = reset_from(bar_lines(), 0, 2**31 - 1000)  # wraps where signed words do
    assert_rows(read_recording(write(tmp_path, ballbar=offset)), ALL)
    rows = [line.split(";") for line in offset]
    signed = [
        ";".join((row[0], *(str((int(c) + 2**31) % 2**32 - 2**31) for c in row[1:])))
        for row in rows[1:]
    ]
    assert_rows(read_recording(write(tmp_path, ballbar=[offset[0], *signed])), ALL)


def test_a_stamp_that_goes_far_back_in_a_dwell_shows_nothing_of_the_time_between(
    tmp_path: Path,
) -> None:
    standing = np.where(BAR_T < 1.0, BAR_T, np.maximum(BAR_T - 1.0, 1.0))
    for back, joined in ((0.3, True), (20.0, False)):
        lines = bar_lines(standing)
        stamps = [
            EPOCH + 10**12 + 10_000_000 * i - (round(back * 1e9) if i >= 150 else 0)
            for i in range(300)
        ]
        rows = [
            lines[0],
            *(stamped(row, stamp) for row, stamp in zip(lines[1:], stamps, strict=True)),
        ]
        recording = read_recording(write(tmp_path, ballbar=rows))
        assert kinds(recording) == (
            ["clock set back"] if joined else ["logger restarted", "part not used"]
        )


def test_an_irregular_stamp_in_a_regular_log_is_warned_of(tmp_path: Path) -> None:
    t = BAR_T.copy()
    t[150:] += 0.0007
    recording = read_recording(write(tmp_path, ballbar=bar_lines(t)))
    assert summaries(recording) == [("irregular stamp", "warning", "raw/ballbar.csv", (152,), 1)]

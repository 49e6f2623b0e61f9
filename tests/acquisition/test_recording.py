"""A recording folder: both logs become the recorded angles, and bad input is refused."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ballbar.acquisition import recording as reading
from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.recording import Recording, read_recording, readable
from ballbar.acquisition.report import report_lines
from ballbar.cell.dialect import dialect_names, load_dialect
from ballbar.cell.errors import DescriptionError, InputError, LogError
from ballbar.cell.robot_angles import joints_to_axes, joints_to_motors
from tests.helpers.device_logs import (
    BAR_T,
    PER_RAD,
    ROBOT,
    ROBOT_FILES,
    ROBOT_T,
    bar_lines,
    bar_trajectory,
    change_line,
    flagged,
    joint_trajectory,
    motor_rows,
    put,
    robot_lines,
    stamped,
    summaries,
    write,
)


def test_both_logs_are_read_as_the_angles_that_were_recorded(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path))
    robot, ballbar = recording.robot_log, recording.ballbar_log
    assert ballbar is not None
    # Times: 100 s + t as float64 resolves 1.4e-14 s; nanoseconds from the first row are exact to
    # rounding.
    np.testing.assert_allclose(robot.t, ROBOT_T, atol=1e-13)
    np.testing.assert_array_equal(ballbar.t, np.rint(BAR_T * 1e9) / 1e9)
    np.testing.assert_allclose(robot.q, joint_trajectory(ROBOT_T), atol=1e-13)
    # Half a count.
    np.testing.assert_allclose(ballbar.angles, bar_trajectory(BAR_T), atol=0.51 / PER_RAD)
    assert ballbar.joints == (1, 2, 4, 5)
    assert recording.description.robot == "irb2400"
    assert summaries(recording) == []
    assert [
        (file.file, file.source, file.rows_read, file.rows_kept) for file in recording.report.files
    ] == [("raw/robot.csv", "robot", 800, 800), ("raw/ballbar.csv", "ballbar", 300, 300)]


def test_what_is_no_sound_recording_is_left_to_who_tells_what_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("sound", "torn", "both"):
        (tmp_path / name).mkdir()
    sound, torn = write(tmp_path / "sound"), write(tmp_path / "torn")
    (torn / "raw" / "robot.csv").write_text("torn")
    both = write(tmp_path / "both")
    (both / "poses.yaml").write_text("")
    read, *others = readable([sound, torn, both, tmp_path / "none", sound / "recording.yaml"])
    assert isinstance(read, Recording)
    assert others == [torn, both, tmp_path / "none", sound / "recording.yaml"]
    followed = SimpleNamespace(followed=True)
    with monkeypatch.context() as patch:
        patch.setattr(reading, "load_recording_file", lambda _: followed)
        patch.setattr(reading, "read_recording", lambda _: pytest.fail("read twice"))
        assert readable([sound]) == [sound], "its poses are read in another way"
    monkeypatch.setattr(reading, "LARGE", 1000)
    assert readable([sound]) == [sound], "what is large is read where it is needed"


def test_any_subset_of_encoders_is_read_from_its_declared_columns(tmp_path: Path) -> None:
    lines = [line.split(";") for line in bar_lines()]
    lines[0] = ["time", "left", "b2", "b4", "fork"]
    shuffled = [";".join((row[4], row[0], row[1], row[2], row[3])) for row in lines]

    def two(data: dict) -> None:
        data["encoders"] = {
            "b5": {"column": "fork", "lines": 3600, "bits": 12, "sign": -1},
            "b1": {"column": "left", "lines": 3600, "bits": 12},
        }

    recording = read_recording(write(tmp_path, ballbar=shuffled, change=two))
    assert recording.ballbar_log is not None
    assert recording.ballbar_log.joints == (1, 5)
    np.testing.assert_allclose(
        recording.ballbar_log.angles, bar_trajectory(BAR_T)[:, [0, 3]], atol=0.51 / PER_RAD
    )
    assert summaries(recording) == [("column not used", "warning", "raw/ballbar.csv", (), 2)]


def test_a_bar_without_sensors_has_no_ballbar_log(tmp_path: Path) -> None:
    def sensorless(data: dict) -> None:
        data["encoders"] = {}
        del data["sources"]["ballbar"]

    recording = read_recording(write(tmp_path, change=sensorless))
    assert recording.ballbar_log is None
    assert len(recording.robot_log.t) == 800


def test_files_of_one_source_are_joined_in_order_of_time(tmp_path: Path) -> None:
    lines = bar_lines()

    def two_files(data: dict) -> None:
        data["sources"]["ballbar"]["files"] = ["raw/ballbar.csv", "raw/ballbarOld.csv"]

    write(tmp_path, ballbar=[lines[0], *lines[151:]], change=two_files)
    (tmp_path / "raw/ballbarOld.csv").write_text("\n".join(lines[:151]) + "\n")
    recording = read_recording(tmp_path)
    assert recording.ballbar_log is not None
    np.testing.assert_array_equal(recording.ballbar_log.t, np.rint(BAR_T * 1e9) / 1e9)
    np.testing.assert_allclose(
        recording.ballbar_log.angles, bar_trajectory(BAR_T), atol=0.51 / PER_RAD
    )
    (tmp_path / "raw/ballbarOld.csv").write_text("\n".join(lines[:161]) + "\n")
    with pytest.raises(
        LogError, match=r"raw/ballbar.csv:2: starts 90 ms before raw/ballbarOld.csv ends"
    ):
        read_recording(tmp_path)


def test_a_repeated_stamp_keeps_its_first_row(tmp_path: Path) -> None:
    lines = bar_lines()
    lines.insert(101, lines[100].split(";")[0] + ";1;2;3;4")
    recording = read_recording(write(tmp_path, ballbar=lines))
    assert recording.ballbar_log is not None
    np.testing.assert_allclose(
        recording.ballbar_log.angles, bar_trajectory(BAR_T), atol=0.51 / PER_RAD
    )
    assert summaries(recording) == [("duplicate stamp", "repaired", "raw/ballbar.csv", (102,), 1)]
    assert flagged(recording, RowFlag.DUPLICATE) == [99]


def test_overruns_and_gaps_are_reported_against_the_nominal_period(tmp_path: Path) -> None:
    t = BAR_T.copy()
    t[100:] += 0.005
    t[200:] += 0.2
    recording = read_recording(write(tmp_path, ballbar=bar_lines(t)))
    assert summaries(recording) == [
        ("overrun", "warning", "raw/ballbar.csv", (102,), 1),
        ("gap", "warning", "raw/ballbar.csv", (202,), 1),
    ]
    assert (
        "rows up to 210 ms after the one before; nominal period 10 ms"
        in recording.report.findings[-1].sentence
    )
    assert (flagged(recording, RowFlag.OVERRUN), flagged(recording, RowFlag.GAP)) == ([100], [200])


def with_stamps(stamps: list[int]) -> list[str]:
    return [
        bar_lines()[0],
        *(stamped(row, stamp) for row, stamp in zip(bar_lines()[1:], stamps, strict=True)),
    ]


def test_stamps_a_hundred_times_too_far_apart_are_warned_of(tmp_path: Path) -> None:
    lines = with_stamps([1_000_000_000 * i for i in range(300)])
    recording = read_recording(
        write(tmp_path, ballbar=lines, change=put("sources", "ballbar", "time", value="ns"))
    )
    assert summaries(recording) == [("unusual period", "warning", "raw/ballbar.csv", (), 1)]
    assert (
        "the median period is 1 s; logs of this dialect have 0.2 ms to 100 ms"
        in recording.report.findings[-1].sentence
    )


def test_microseconds_where_nanoseconds_are_declared_make_the_encoders_impossibly_fast(
    tmp_path: Path,
) -> None:
    folder = write(
        tmp_path,
        ballbar=with_stamps([10_000 * i for i in range(300)]),
        change=put("sources", "ballbar", "time", value="ns"),
    )
    with pytest.raises(
        LogError,
        match=r"raw/ballbar.csv:3: encoder b. jumps .*or the time column in another unit\?",
    ):
        read_recording(folder)


def test_damage_at_the_end_of_both_files_is_repaired_and_counted(tmp_path: Path) -> None:
    write(tmp_path)
    robot, ballbar = tmp_path / "raw/robot.csv", tmp_path / "raw/ballbar.csv"
    robot.write_bytes(robot.read_bytes()[:-4])
    ballbar.write_bytes(ballbar.read_bytes()[:-2] + bytes(512))
    recording = read_recording(tmp_path)
    assert recording.ballbar_log is not None
    assert (len(recording.robot_log.t), len(recording.ballbar_log.t)) == (799, 299)
    assert [entry[0:4] for entry in summaries(recording)] == [
        ("unterminated last line", "repaired", "raw/robot.csv", (801,)),
        ("NUL block at the end", "repaired", "raw/ballbar.csv", ()),
        ("unterminated last line", "repaired", "raw/ballbar.csv", (301,)),
    ]


def test_the_report_reads_as_lines_and_goes_through_json(tmp_path: Path) -> None:
    lines = bar_lines()
    lines[150] = "torn"
    report = read_recording(write(tmp_path, ballbar=lines)).report
    plain = report.to_dict()
    assert json.loads(json.dumps(plain)) == plain
    assert plain["findings"][0] == {
        "kind": "torn line",
        "severity": "repaired",
        "file": "raw/ballbar.csv",
        "lines": [151],
        "count": 1,
        "sentence": "expected 5 fields, got 1; treated as torn line and dropped.",
        "remedy": "",
    }
    text = report_lines(report)
    assert text[:3] == [
        "FILES",
        "  raw/robot.csv: 800 of 800 rows used",
        "    robot, dialect abb-motor; utf-8, separator comma, decimal point; time in s",
    ]
    assert text[3] == "  raw/ballbar.csv: 299 of 300 rows used"
    assert (
        "  raw/ballbar.csv:151: torn line: expected 5 fields, got 1; treated as torn line and "
        "dropped." in text
    )
    assert report_lines(replace(report, findings=()))[-2:] == ["REPAIRED: none", "WARNINGS: none"]


def test_degrees_close_to_zero_betray_themselves_by_their_speed(tmp_path: Path) -> None:
    small = np.rad2deg(
        joints_to_motors(ROBOT, 0.007 * np.sin(20.0 * ROBOT_T)[:, None] * np.ones(6))
    )
    with pytest.raises(
        LogError,
        match=r"axis \d of irb2400 would turn at .* rad/s; it reaches .*Degrees where radians",
    ):
        read_recording(write(tmp_path, robot=motor_rows(small)))


def test_a_robot_that_stands_at_zero_is_no_joint_side_log(tmp_path: Path) -> None:
    still = np.random.default_rng(0).normal(0.0, 1e-3, (ROBOT_T.size, 6))
    assert np.ptp(read_recording(write(tmp_path, robot=motor_rows(still))).robot_log.q) < 1e-3


@pytest.mark.parametrize(
    "damage", [10.0, 0.1]
)  # one digit: 0.08 rad at the joint within 4 ms, and 0.8 mrad, which is slow enough
def test_a_damaged_motor_angle_is_left_out_and_named(tmp_path: Path, damage: float) -> None:
    motors = joints_to_motors(ROBOT, joint_trajectory(ROBOT_T))
    motors[400, 2] += damage
    recording = read_recording(write(tmp_path, robot=motor_rows(motors)))
    assert summaries(recording)[0] == ("implausible value", "repaired", "raw/robot.csv", (402,), 1)
    np.testing.assert_allclose(
        recording.robot_log.q, np.delete(joint_trajectory(ROBOT_T), 400, axis=0), atol=1e-13
    )
    rows = recording.rows["robot"]
    assert rows.flags[400] == RowFlag.IMPLAUSIBLE
    assert np.flatnonzero(~rows.used).tolist() == [400]


def test_an_axis_a_little_beyond_its_limits_is_warned_of(tmp_path: Path) -> None:
    q = joint_trajectory(ROBOT_T)
    q[:, 0] += ROBOT.axis_upper[0] - joints_to_axes(ROBOT, q)[:, 0].max() + 0.1
    recording = read_recording(write(tmp_path, robot=motor_rows(joints_to_motors(ROBOT, q))))
    np.testing.assert_allclose(recording.robot_log.q, q, atol=1e-12)
    ((kind, severity, *_),) = summaries(recording)
    assert (kind, severity) == ("axis beyond its limits", "warning")
    assert "axis 1 is up to 5.73 deg beyond its limits" in recording.report.findings[0].sentence


def test_an_axis_beyond_its_limits_by_rounding_is_no_finding(tmp_path: Path) -> None:
    """Every row of a controller that stops at its limit; 0.05 deg mean nothing for a robot."""
    q = joint_trajectory(ROBOT_T)
    beyond = np.deg2rad(0.05)
    q[:, 0] += ROBOT.axis_upper[0] - joints_to_axes(ROBOT, q)[:, 0].max() + beyond
    recording = read_recording(write(tmp_path, robot=motor_rows(joints_to_motors(ROBOT, q))))
    assert summaries(recording) == []


@pytest.mark.parametrize(
    ("robot", "ballbar", "message"),
    [
        (robot_lines()[:40], None, "raw/robot.csv: 39 usable rows; at least 50 are needed"),
        (None, bar_lines()[:50], "raw/ballbar.csv: 49 usable rows; at least 50 are needed"),
        (
            [line.rsplit(",", 1)[0] for line in robot_lines()],
            None,
            "raw/robot.csv:1: column m6 missing",
        ),
        (
            bar_lines(),
            None,
            "raw/robot.csv:1: columns m1, m2, m3, m4, m5, m6 missing; the header has 'time', 'b1'",
        ),
        (
            change_line(robot_lines(), 2, stamped(robot_lines()[1], -1.5)),
            None,
            "raw/robot.csv:2: time stamp -1.5 s is negative",
        ),
        (
            None,
            [
                bar_lines()[0],
                *(
                    ";".join((*row.split(";")[:3], "0", row.split(";")[4]))
                    for row in bar_lines()[1:]
                ),
            ],
            "raw/ballbar.csv: encoder column without counts: column b4 of encoder b4 is 0 in "
            "every row",
        ),
        (
            None,
            [bar_lines()[0] + ";s1", *(row + ";16" for row in bar_lines()[1:])],
            "raw/ballbar.csv: no usable row is left of 300; the encoders report faults throughout",
        ),
    ],
)
def test_a_device_file_that_cannot_be_trusted_is_refused(
    tmp_path: Path, robot: list[str] | None, ballbar: list[str] | None, message: str
) -> None:
    with pytest.raises(LogError, match=re.escape(message)):
        read_recording(write(tmp_path, robot=robot, ballbar=ballbar))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            put("sources", "robot", "dialect", value="abb-moto"),
            "sources.robot.dialect: unknown dialect 'abb-moto'. Did you mean abb-motor? "
            "Valid dialects: abb-egm, abb-egm-torque, abb-labcomm, abb-libegm, ",
        ),
        (
            put("sources", "robot", "dialect", value="../twincat-plc"),
            "unknown dialect '../twincat-plc'",
        ),
        (
            put("sources", "ballbar", "dialect", value="abb-motor"),
            "sources.ballbar.dialect: abb-motor describes logs of the robot, not of the ballbar. "
            "Are the files swapped? Exchange them, or name another dialect.",
        ),
        (put("encoders", value={}), "sources.ballbar is given, but no encoder is declared"),
        (
            put("sources", "ballbar", value=None),
            "encoders b1, b2, b4, b5 are declared, but no sources.ballbar",
        ),
        (
            put("encoders", "b2", "column", value="b1"),
            "encoders: column b1 is declared for 2 encoders",
        ),
        (put("robot", value="irb2401"), "unknown robot 'irb2401'. Did you mean irb2400?"),
        (put("ballbarr", value="lund_600"), "unknown key ballbarr"),
        (
            put(*ROBOT_FILES, value=["../outside.csv"]),
            "file '../outside.csv' lies outside the recording folder",
        ),
        (put(*ROBOT_FILES, value=["raw/../../outside.csv"]), "lies outside the recording folder"),
        (put(*ROBOT_FILES, value=["/etc/hostname"]), "lies outside the recording folder"),
        (put(*ROBOT_FILES, value=["C:\\logs\\robot.csv"]), "lies outside the recording folder"),
        (put(*ROBOT_FILES, value=["..\\outside.csv"]), "lies outside the recording folder"),
        (
            put(*ROBOT_FILES, value=["raw/link.csv"]),
            "file 'raw/link.csv' lies outside the recording folder",
        ),
        (put(*ROBOT_FILES, value=["raw/loop.csv"]), "lies outside the recording folder"),
    ],
)
def test_a_description_that_contradicts_itself_is_refused(
    tmp_path: Path, change: Callable[[dict], None], message: str
) -> None:
    folder = tmp_path / "recording"
    folder.mkdir()
    write(folder, change=change)
    (tmp_path / "outside.csv").write_text("\n".join(robot_lines()) + "\n")
    (folder / "raw/link.csv").symlink_to(tmp_path / "outside.csv")
    (folder / "raw/loop.csv").symlink_to(folder / "raw/loop.csv")
    with pytest.raises(DescriptionError, match=re.escape(message)):
        read_recording(folder)


@pytest.mark.parametrize("missing", ["recording.yaml", "raw/robot.csv", "raw/ballbar.csv"])
def test_a_file_that_is_missing_is_named(tmp_path: Path, missing: str) -> None:
    (write(tmp_path) / missing).unlink()
    with pytest.raises(InputError, match=f"{missing}: no such file"):
        read_recording(tmp_path)


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        DescriptionError,
        match=r"nowhere: no such folder\. A recording is a folder with recording.yaml",
    ):
        read_recording(tmp_path / "nowhere")


def test_every_dialect_says_what_its_side_needs() -> None:
    assert {
        "abb-motor",
        "abb-labcomm",
        "comau-joint",
        "abb-libegm",
        "joint-rad",
        "force-torque",
        "twincat-plc",
    } <= set(dialect_names())
    for name in dialect_names():
        dialect = load_dialect(name)
        assert len(dialect.angles) == (6 if dialect.source == "robot" else 0)
        assert len(dialect.torque_columns) in ((0, 6) if dialect.source == "robot" else (0,))
        assert len(dialect.wrench) == (6 if dialect.source == "force" else 0)
        assert 0.0 < dialect.period_s[0] < dialect.period_s[1]

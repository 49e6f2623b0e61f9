"""`ballbar new` with logs that fit no dialect: dates with the day first, decimal commas, damage."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import pytest
import yaml

from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import InputError
from ballbar.recordings.answers import Answers
from ballbar.recordings.proposals import counting
from ballbar.recordings.questions import one_of
from tests.helpers.command_line import output, refusal
from tests.helpers.device_logs import BAR_T, ROBOT_T, bar_lines, robot_lines
from tests.helpers.terminal import at_the_terminal, in_turn

START = datetime(2026, 3, 31, 8, 15)
NAMES = ["--robot", "irb2400", "--ballbar", "lund_600"]
OWN_BALLBAR = """schema: ballbar-dialect/1
source: ballbar
separators: [";"]
decimal: comma
time: {column: Zeit, forms: [date, dc]}
period_s: [0.001, 0.1]
"""


def day_first(lines: list[str], seconds: list[float], form: str = "%d.%m.%Y") -> str:
    """A German export: semicolons, decimal commas, dates with the day first."""
    names, *rows = (line.replace(",", ";").split(";") for line in lines)
    out = [";".join(["Zeit", *names[1:]])]
    for t, row in zip(seconds, rows, strict=True):
        at = START + timedelta(seconds=t)
        stamp = at.strftime(f"{form} %H:%M:%S,%f")
        out.append(";".join([stamp, *(cell.replace(".", ",") for cell in row[1:])]))
    return "\n".join(out) + "\n"


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    robot, bar = tmp_path / "robot.csv", tmp_path / "bar.csv"
    robot.write_text(day_first(robot_lines(), ROBOT_T.tolist()))
    bar.write_text(day_first(bar_lines(), BAR_T.tolist()))
    return robot, bar


def test_a_dialect_is_written_from_what_the_file_shows(
    logs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replies = in_turn("", "", "", "motors", "rad", "", "", "", "", "")
    asked = at_the_terminal(monkeypatch, replies)
    out = output("new", tmp_path / "made", *logs, *NAMES)
    assert "robot.csv fits no dialect" in asked[0][0]
    assert "or new to write one" in asked[0][0]
    assert "decimal comma; Zeit in dates with time of day" in out
    dialect = yaml.safe_load((tmp_path / "made/robot-dialect.yaml").read_text())
    assert dialect == {
        "schema": "ballbar-dialect/1",
        "source": "robot",
        "separators": [";"],
        "decimal": "comma",
        "time": {"column": "Zeit", "forms": ["date"]},
        "motors": ["m1", "m2", "m3", "m4", "m5", "m6"],
        "angle_unit": "rad",
        "period_s": [2e-4, 0.1],
    }
    recording = read_recording(tmp_path / "made")
    assert recording.robot_log.t == pytest.approx(ROBOT_T, abs=1e-6)
    assert recording.ballbar_log is not None
    assert recording.ballbar_log.t == pytest.approx(BAR_T, abs=1e-6)


def test_an_answer_is_checked_when_it_is_given(
    logs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replies = in_turn(
        *("irb24", "irb2400", "dial_gauge", "lund_600"),
        *("comau-joint", "new", "Zeiten", "Zeit", "m1, m2", "", "gears", "motors", "°", "rad"),
        *("new", "", "b1=x", "", "0", "", "14", "12"),
    )
    asked = at_the_terminal(monkeypatch, replies)
    output("new", tmp_path / "made", *logs)
    again = [question.splitlines()[0] for question, _ in asked if "\n" in question]
    for line, words in zip(
        again,
        (
            "unknown robot 'irb24'. Did you mean irb2400?",
            "not a length over time",
            "columns time, J1, J2, J3, J4, J5, J6 missing",
            "'Zeiten': expected Zeit, m1",
            "2 columns; expected one for each axis, 5 to 8.",
            "'gears': expected motors, axes or joints.",
            "'°': expected rad or deg.",
            "'x' is no column.",
            "'0': expected a whole number from 1 to",
            "'14': expected a whole number from 8 to 13.",
        ),
        strict=True,
    ):
        assert words in line


def test_years_of_two_digits_are_refused_with_the_reason(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "bar.yaml").write_text(OWN_BALLBAR)
    (tmp_path / "robot.csv").write_text("\n".join(robot_lines()) + "\n")
    logs[1].write_text(day_first(bar_lines(), BAR_T.tolist(), "%d.%m.%y"))
    own = ["--ballbar-dialect", tmp_path / "bar.yaml", "--yes"]
    err = refusal("new", tmp_path / "made", *logs, *NAMES, *own)
    assert "'31.03.26 08:15:00.000000': the year has two digits" in err
    assert "Export the log with years of four digits, such as 31.03.2026" in err
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("dated", [True, False])
def test_a_ballbar_dialect_of_ones_own_keeps_its_forms(
    dated: bool, logs: tuple[Path, Path], tmp_path: Path
) -> None:
    """The stamps show which of its forms they have, and nothing is asked."""
    (tmp_path / "own.yaml").write_text(OWN_BALLBAR)
    logs[0].write_text("\n".join(robot_lines()) + "\n")
    if not dated:
        logs[1].write_text("\n".join(bar_lines()).replace("time", "Zeit") + "\n")
    own = ["--ballbar-dialect", tmp_path / "own.yaml", "--yes"]
    out = output("new", tmp_path / "made", *logs, *NAMES, *own)
    form = "dates with time of day" if dated else "ns since 2000 (distributed clock)"
    assert f"Zeit in {form}" in out
    described = yaml.safe_load((tmp_path / "made/recording.yaml").read_text())
    copied = tmp_path / "made" / described["sources"]["ballbar"]["dialect"]
    assert copied.read_text() == OWN_BALLBAR
    assert "time" not in described["sources"]["ballbar"]


def test_damaged_rows_are_left_out_up_to_the_limit_and_reported(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    rows = robot_lines()
    for line in (100, 200, 300):
        rows[line] = rows[line].replace(rows[line].split(",")[2], "###", 1)
    logs[0].write_text("\n".join(rows) + "\n")
    command = ["new", tmp_path / "made", *logs, *NAMES, "--yes"]
    err = refusal(*command)
    assert "raw/robot.csv:101: column m2: '###' is not a number." in err
    assert "`--damaged-rows 5` of `ballbar new`" in err
    err = refusal(*command, "--damaged-rows", 2)
    assert "3 rows are damaged so, and `damaged_rows` allows 2" in err
    out = output(*command, "--damaged-rows", 3)
    assert "raw/robot.csv: 797 of 800 rows used" in out
    assert "raw/robot.csv:101,201,301: damaged row (3 times): column m2: '###'" in out
    assert read_recording(tmp_path / "made").robot_log.t.size == 797


def test_columns_that_count_on_are_seen() -> None:
    axes = tuple(f"A{k}" for k in range(1, 7))
    assert counting(["t", *axes, "X"]) == {"A#": axes}
    assert counting(["t", "q1", "q2", "q4", "q5", "q6", "q7"]) == {}
    names = tuple(f"Achse {k} Istwert 2" for k in range(1, 6))
    assert counting(names)["Achse # Istwert 2"] == names


@pytest.mark.parametrize(("choices", "words"), [("a", "a"), ("ab", "a or b"), ("abc", "a, b or c")])
def test_an_answer_that_is_none_of_the_choices_is_told_them(choices: str, words: str) -> None:
    with pytest.raises(InputError, match=f"'z': expected {words}\\."):
        one_of(*choices)("z")


def test_options_of_logs_and_of_still_poses_are_not_mixed() -> None:
    with pytest.raises(InputError, match="--encoder, --bits: not for still poses"):
        Answers(robot="ur5", encoder=["b1=a"], bits=12).refuse_others(poses=True)
    with pytest.raises(InputError, match="--seat: not for logs"):
        Answers(instrument="drawwire_2m", unit="mm", seat=["left"]).refuse_others(poses=False)
    Answers(robot="ur5", seat=["left"], joints="#1,#2").refuse_others(poses=True)

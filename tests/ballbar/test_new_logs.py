"""`ballbar new`: two files become a recording folder, and nothing about them is guessed."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from ballbar.acquisition.recording import read_recording
from ballbar.cell import load
from ballbar.cell.clock import Clock
from tests.helpers.command_line import ballbar, output, refusal
from tests.helpers.container_files import Written, egm, json_lines, mcap, mpe, rsi, scope
from tests.helpers.device_logs import bar_lines, robot_lines
from tests.helpers.length_recordings import wire_run, write_folder
from tests.helpers.terminal import at_the_terminal

SAID = ["--robot", "irb2400", "--ballbar", "lund_600"]


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    robot, bar = tmp_path / "robot.csv", tmp_path / "bar.csv"
    robot.write_text("\n".join(robot_lines()) + "\n")
    bar.write_text("\n".join(bar_lines()) + "\n")
    return robot, bar


def test_options_and_accepted_proposals_make_a_folder_that_reads(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    out = output("new", tmp_path / "made", *logs, *SAID, "--yes")
    assert "dialect abb-motor: motor angles in rad, time in s" in out
    assert "b1=b1 b2=b2 b4=b4 b5=b5" in out
    description = yaml.safe_load((tmp_path / "made/recording.yaml").read_text())
    assert description["encoders"]["b4"] == {"column": "b4", "lines": 3600, "bits": 12, "sign": 1}
    assert (tmp_path / "made/raw/bar.csv").read_bytes() == logs[1].read_bytes()
    assert read_recording(tmp_path / "made").robot_log.t.size == 800


@pytest.mark.parametrize(
    ("make", "dialect"),
    [
        (mcap, "ros-joint-state"),
        (egm, "abb-egm"),
        (json_lines, "comau-json"),
        (mpe, "abb-mpe"),
        (rsi, "kuka-rsi"),
    ],
)
def test_logs_that_are_no_tables_are_recognised_by_their_first_bytes(
    make: Callable[[], Written], dialect: str, tmp_path: Path
) -> None:
    robot, bar = tmp_path / f"robot{make().suffix}", tmp_path / "scope.csv"
    robot.write_bytes(make().content)
    bar.write_bytes(scope().content)
    code, out, err = ballbar("new", tmp_path / "made", robot, bar, *SAID, "--yes", "--json")
    assert code == 0
    assert f"{robot.name} fits the dialect {dialect}" in err
    told = json.loads(out)
    assert told["recording"] == str(tmp_path / "made")
    assert [(one["dialect"], one["rows_kept"]) for one in told["files"]] == [
        (dialect, 80),
        ("twincat-scope", 80),
    ]
    assert list(yaml.safe_load((tmp_path / "made/recording.yaml").read_text())["encoders"]) == [
        "b1",
        "b2",
    ]


def test_without_a_terminal_a_missing_answer_is_named_and_nothing_is_written(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    for words, missing in (
        (["--yes"], "Which robot?"),
        (SAID, "Proposed: abb-motor; --yes takes it."),
        ([*SAID, "--yes", "--encoder", "b9=b1"], "encoders are b1 to b5"),
        (
            [*SAID, "--yes", "--robot-dialect", "comau-joint"],
            "columns J1, J2, J3, J4, J5, J6 missing",
        ),
        ([*SAID, "--yes", "--encoder", "b1=time"], "column time holds the time stamps"),
    ):
        err = refusal("new", tmp_path / "made", *logs, *words)
        assert missing in err
        assert sorted(path.name for path in tmp_path.iterdir()) == ["bar.csv", "robot.csv"]


def test_the_form_of_up_time_stamps_is_asked(logs: tuple[Path, Path], tmp_path: Path) -> None:
    lines = bar_lines()
    logs[1].write_text(
        "\n".join(
            [lines[0], *(f"{10 * i};{line.split(';', 1)[1]}" for i, line in enumerate(lines[1:]))]
        )
        + "\n"
    )
    err = refusal("new", tmp_path / "made", *logs, *SAID, "--yes")
    assert "what are the time stamps? They do not show it" in err
    code, _, _ = ballbar(
        "new", tmp_path / "made", *logs, *SAID, "--yes", "--ballbar-time", "ms-32bit"
    )
    assert code == 0


def test_the_user_is_asked_at_the_prompt(
    logs: tuple[Path, Path], tmp_path: Path, monkeypatch
) -> None:
    answers = {"Which robot": "irb2400", "Which ball-bar": "lund_600"}

    def reply(question: str, _proposal: str | None) -> str | None:
        return next((a for start, a in answers.items() if question.startswith(start)), None)

    asked = at_the_terminal(monkeypatch, reply)
    output("new", tmp_path / "made", *logs)
    assert len(asked) == 7  # two dialects, robot, ball-bar, encoders, lines, bits


def test_a_folder_that_holds_something_is_left_alone(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "made").mkdir()
    (tmp_path / "made/mine.txt").write_text("mine")
    err = refusal("new", tmp_path / "made", *logs, *SAID, "--yes")
    assert "exists and holds something" in err
    assert (tmp_path / "made/mine.txt").read_text() == "mine"


@pytest.fixture(scope="module")
def wire(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with robot.csv and length.csv [mm] of a draw-wire, time in s."""
    folder = tmp_path_factory.mktemp("wire")
    write_folder(wire_run(Clock(0.4, 5e-5), seed=7), folder, "drawwire_2m")
    return folder / "raw"


def test_a_length_log_is_proposed_column_unit_and_time(wire: Path, tmp_path: Path) -> None:
    logs = (wire / "robot.csv", wire / "length.csv")
    said = ["--robot", "irb2400", "--instrument", "drawwire_2m", "--robot-time", "s", "--yes"]
    out = output("new", tmp_path / "made", *logs, *said)
    assert "length.csv fits the dialect length-table: a length. Which dialect?" in out
    assert (
        "length.csv: what are the time stamps? They do not show it; rows are 0.01 apart.\n"
        "  counted from any start: s, ms, us, 100ns, ns, ms-32bit, ns-32bit\n"
        "  counted since 1601, 1970 or 2000: filetime, dc, unix-s, unix-ms, unix-us, unix-ns\n"
        "  text: date, iec-time\n"
        "Which form? s\n"
    ) in out
    assert "which unit? (m, mm, um) mm" in out
    description = yaml.safe_load((tmp_path / "made/recording.yaml").read_text())
    assert description["instrument"] == "drawwire_2m"
    assert description["sources"]["length"] == {
        "files": ["raw/length.csv"],
        "dialect": "length-table",
        "time": "s",
        "column": "length",
        "unit": "mm",
    }
    out = output("check", tmp_path / "made")
    assert "coarse clock offset: +0.40 s over" in out
    assert "no dwell" not in out


def test_a_form_that_the_stamps_show_is_said_and_not_asked(wire: Path, tmp_path: Path) -> None:
    """A question named the twelve forms that a length may have."""
    log = tmp_path / "length.csv"
    start, rows = 1_774_944_900_000, range(0, 100_000, 10)
    log.write_text(
        "\n".join(["Zeit;mm", *(f"{start + t};{500.0 + 1e-3 * t}" for t in rows)]) + "\n"
    )
    said = ["--robot", "irb2400", "--instrument", "drawwire_2m", "--robot-time", "s", "--yes"]
    out = output("new", tmp_path / "made", wire / "robot.csv", log, *said)
    assert "dialect length-table: a length, time in ms since 1970. Which dialect?" in out
    assert "what are the time stamps?" not in out


def test_a_display_of_deviations_is_proposed_its_zero(wire: Path, tmp_path: Path) -> None:
    """Deviations in um of a bar of 300 mm; time in ms, one more column that cannot be a length."""
    rows = [
        f"{10 * k};{200.0 * (k % 7) / 7.0:.1f};{20.0 + 1e6 * (k % 2):.1f}" for k in range(12000)
    ]
    log = tmp_path / "bar.csv"
    log.write_text("\n".join(["Time [ms];dL;temp", *rows]) + "\n")
    said = ["--robot", "irb2400", "--instrument", "qc20w_300", "--robot-time", "s", "--yes"]
    output("new", tmp_path / "made", wire / "robot.csv", log, *said)
    source = yaml.safe_load((tmp_path / "made/recording.yaml").read_text())["sources"]["length"]
    assert (source["column"], source["unit"], source["zero_m"]) == ("dL", "um", 0.3)
    assert source["time"] == "ms"


def test_ball_bar_and_instrument_together_are_refused(wire: Path, tmp_path: Path) -> None:
    logs = (wire / "robot.csv", wire / "length.csv")
    said = [*SAID, "--instrument", "drawwire_2m", "--yes"]
    err = refusal("new", tmp_path / "made", *logs, *said)
    assert "either --ballbar or --instrument" in err


def test_a_dialect_of_ones_own_goes_into_the_folder(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    """And one that is shipped does not: the folder can be moved."""
    shipped = Path(load.__file__).parent / "dialects" / "abb-motor.yaml"
    own = tmp_path / "mine.yaml"
    own.write_text(f"{shipped.read_text()}# ours\n")
    output("new", tmp_path / "made", *logs, *SAID, "--yes", "--robot-dialect", own)
    sources = yaml.safe_load((tmp_path / "made/recording.yaml").read_text())["sources"]
    copied = tmp_path / "made" / sources["robot"]["dialect"]
    assert copied.read_text() == own.read_text()
    assert not sources["ballbar"]["dialect"].endswith(".yaml")
    assert len(list((tmp_path / "made").rglob("*.yaml"))) == 2

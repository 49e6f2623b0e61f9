"""`ballbar check`: the page, the reasons, the JSON, and --strict."""

import json
import shutil
from pathlib import Path

import pytest
import yaml

from tests.helpers.command_line import ballbar, output, refusal
from tests.helpers.device_logs import force_lines
from tests.helpers.simulated_recordings import Recorded


@pytest.fixture
def recording(recorded: Recorded, tmp_path: Path) -> Path:
    """The short run with a force sensor's log and one damaged stamp."""
    folder = Path(shutil.copytree(recorded.folder, tmp_path / "rec"))
    description = yaml.safe_load((folder / "recording.yaml").read_text())
    description["sources"]["force"] = {"files": ["raw/force.csv"], "dialect": "force-torque"}
    (folder / "recording.yaml").write_text(yaml.safe_dump(description, sort_keys=False))
    (folder / "raw/force.csv").write_text("\n".join(force_lines()) + "\n")
    return folder


def damage_stamp(folder: Path) -> None:
    file = folder / "raw/ballbar.csv"
    lines = file.read_bytes().split(b"\r\n")
    lines[99] = b"7" + lines[99][1:]
    file.write_bytes(b"\r\n".join(lines))


def test_the_page_names_every_log_and_every_repair(recording: Path) -> None:
    out = output("check", recording)
    assert "REPAIRED: none" in out
    assert "  force log: 400 samples over 0.80 s, median period 2 ms" in out
    assert "robot log: 14667 samples over 59.13 s, median period 4.032 ms; 3 dwells" in out
    damage_stamp(recording)
    _, out, _ = ballbar("check", recording)
    assert "REPAIRED\n  raw/ballbar.csv:100: damaged stamp: " in out
    assert "5888 of 5889 rows used" in out


def test_the_stage_is_shown_while_a_long_recording_is_read(recording: Path) -> None:
    _, _, stages = ballbar("check", recording, "--verbose")
    assert "reading the recording" in stages
    assert "aligning the logs" in stages


def test_strict_exits_with_1_where_anything_was_repaired(recording: Path) -> None:
    assert ballbar("check", "--strict", recording)[0] == 0
    damage_stamp(recording)
    code, out, err = ballbar("check", "--strict", recording)
    assert code == 1
    assert "damaged stamp" in out
    assert "1 kinds of repairs were needed" in err


def test_the_reasons_stand_before_the_page_and_nothing_is_guessed(recording: Path) -> None:
    _, out, _ = ballbar("check", "--explain", recording)
    reasons = out[: out.index("FILES")]
    for words in (
        "robot: dialect abb-motor, as recording.yaml has it; 1 file(s)",
        "motor angles, in rad: the dialect says so; numbers that contradict it are refused",
        "encoder b2: counter in column b2, 3600 lines at 12 bits (recording.yaml): "
        "0.426 urad a count",
        "raw/ballbar.csv: utf-8, semicolon between the fields",
        "time: ns since 2000 (distributed clock), since the stamps show it; "
        "first row at 2026-04-20T11:33:20",
        "not there, and not needed: tau1, tau2",
        "force: dialect force-torque",
    ):
        assert words in reasons
    (recording / "raw/robot.csv").write_text("time,m1\n0,1\n")
    err = refusal("check", "--explain", recording)
    assert "raw/robot.csv:1: columns m2, m3, m4, m5, m6 missing" in err


def test_the_report_as_json(recording: Path) -> None:
    damage_stamp(recording)
    out = output("check", "--json", recording)
    data = json.loads(out)
    assert [file["file"] for file in data["files"]] == [
        "raw/robot.csv",
        "raw/ballbar.csv",
        "raw/force.csv",
    ]
    assert ("damaged stamp", [100]) in [(one["kind"], one["lines"]) for one in data["findings"]]
    assert data["logs"]["ball-bar"]["rows"] == 5888
    assert len(data["logs"]["robot"]["rests_s"]) == 3
    assert data["coarse_clock"]["offset_s"] == pytest.approx(0.137, abs=0.1)

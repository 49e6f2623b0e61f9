"""The command line as a user meets it: words, exit codes, and nothing half-written."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ballbar.scenario import load_scenario
from tests.helpers.command_line import SHORT, ballbar
from tests.helpers.simulated_recordings import SCENARIOS, Recorded


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    file = tmp_path / "short.yaml"
    file.write_text(SHORT.replace("PATHS", str(SCENARIOS / "paths")))
    return file


@pytest.fixture
def recording(recorded: Recorded, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded.folder, tmp_path / "rec"))


@pytest.mark.slow
def test_a_scenario_runs_to_report_replay_and_limits(scenario: Path, tmp_path: Path) -> None:
    code, out, _ = ballbar("run", scenario, "--out", tmp_path / "out")
    assert code == 0
    assert out.splitlines()[0].startswith("Good fit")
    assert "met" in out
    assert {
        "calibration.yaml",
        "import_report.json",
        "report.html",
        "run.rrd",
        "recording",
        "recording.truth.yaml",
        "recording.scenario.yaml",
    } == {p.name for p in (tmp_path / "out").iterdir()}
    code, out, _ = ballbar("run", scenario, "--out", tmp_path / "out", "--set", "seed=4")
    assert code == 0, "a second run into the same folder replaces the first"
    assert load_scenario(tmp_path / "out/recording.scenario.yaml").seed == 4
    assert "--set seed=4</code>" in (tmp_path / "out/report.html").read_text()
    code, out, _ = ballbar(
        "compare", tmp_path / "out/calibration.yaml", tmp_path / "out/recording.truth.yaml"
    )
    assert code == 0
    assert "TCP error over the workspace: mean 0.00" in out
    assert "clock error: offset" in out
    code, out, _ = ballbar(
        "compare", tmp_path / "out/calibration.yaml", tmp_path / "out/calibration.yaml"
    )
    assert "Euclidean distance 0.0000 mm|mrad over 28" in out
    code, out, _ = ballbar("replay", tmp_path / "out", "--save", tmp_path / "copy.rrd")
    assert (tmp_path / "copy.rrd").read_bytes() == (tmp_path / "out/run.rrd").read_bytes()
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.slow
def test_a_limit_that_is_missed_exits_with_1(scenario: Path, tmp_path: Path) -> None:
    scenario.write_text(scenario.read_text().replace("tcp_mean_mm: 0.05", "tcp_mean_mm: 1e-6"))
    code, out, _ = ballbar("run", scenario, "--out", tmp_path / "out")
    assert code == 1
    assert "missed TCP error, mean" in out


@pytest.mark.slow
def test_simulate_check_and_identify_are_the_same_job_in_steps(
    scenario: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "logs"
    code, out, _ = ballbar("simulate", scenario, "--out", folder)
    assert code == 0
    assert (tmp_path / "logs.truth.yaml").is_file()
    code, out, _ = ballbar("check", folder)
    assert code == 0
    assert "raw/robot.csv" in out
    offset = float(out.split("coarse clock offset: ")[1].split(" s")[0])
    assert offset == pytest.approx(-3.0, abs=0.1)
    code, out, _ = ballbar("identify", folder, "--samples", "300")
    assert code == 0
    assert sorted(p.name for p in (tmp_path / "logs-identified").iterdir()) == [
        "calibration.yaml",
        "import_report.json",
        "report.html",
    ]
    _, out, _ = ballbar("check", "--json", folder)
    checked = json.loads(out)
    checked.pop("coarse_clock")
    assert json.loads((tmp_path / "logs-identified/import_report.json").read_text())[
        "recordings"
    ] == {"logs": checked}
    code, out, _ = ballbar("replay", tmp_path / "logs-identified")
    assert code == 2


def test_an_output_folder_with_something_else_is_left_alone(
    scenario: Path, recording: Path, tmp_path: Path
) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.docx").write_text("precious")
    for words in (("run", scenario), ("simulate", scenario), ("identify", recording)):
        code, _, err = ballbar(*words, "--out", mine)
        assert code == 2
        assert "holds something else (thesis.docx)" in err
        assert "Choose another folder" in err
    assert [p.name for p in mine.iterdir()] == ["thesis.docx"]
    file = tmp_path / "file"
    file.write_text("x")
    assert ballbar("run", scenario, "--out", file)[0] == 2


def test_a_real_recording_is_never_overwritten_by_a_simulation(
    scenario: Path, recording: Path
) -> None:
    yaml = recording / "recording.yaml"
    yaml.write_text(yaml.read_text().replace("kind: simulated", "kind: real"))
    before = (recording / "raw/robot.csv").read_bytes()
    code, _, err = ballbar("simulate", scenario, "--out", recording)
    assert code == 2
    assert "holds a real recording" in err
    assert (recording / "raw/robot.csv").read_bytes() == before


def nul_bytes(content: bytes) -> bytes:
    lines = content.splitlines()
    lines[300] = lines[300][:10] + b"\0\0" + lines[300][12:]
    return b"\n".join(lines) + b"\n"


def degrees(content: bytes) -> bytes:
    head, *lines = content.splitlines()
    rows = [line.split(b",") for line in lines]
    turned = [[r[0], *(b"%.9f" % (float(cell) * 57.29577951) for cell in r[1:])] for r in rows]
    return b"\n".join([head, *(b",".join(row) for row in turned)]) + b"\n"


# one fault of each kind; all others are those of the readers' own tests
BAD: dict[str, tuple[str, Callable[[bytes], bytes], tuple[str, ...]]] = {
    "no file": ("recording.yaml", lambda c: c.replace(b"robot.csv", b"r.csv"), ("raw/r.csv",)),
    "column": ("raw/robot.csv", lambda c: c.replace(b",m2", b",x2", 1), ("raw/robot.csv", "m2")),
    "NUL": ("raw/robot.csv", nul_bytes, ("raw/robot.csv:301", "NUL")),
    "degrees": ("raw/robot.csv", degrees, ("degrees",)),
    "empty": ("raw/ballbar.csv", lambda _: b"", ("raw/ballbar.csv", "empty")),
    "key": ("recording.yaml", lambda c: c.replace(b"robot: ", b"robott: "), ("yaml:3", "robott")),
    "outside": ("recording.yaml", lambda c: c.replace(b"raw/", b"../"), ("../robot.csv",)),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "damaged", "words"),
    [  # degrees are looked for among all causes, which takes seconds (test_read_with_causes)
        pytest.param(*BAD[kind], id=kind, marks=pytest.mark.long if kind == "degrees" else ())
        for kind in BAD
    ],
)
def test_bad_input_says_what_and_where_with_exit_code_2_and_writes_nothing(
    file: str,
    damaged: Callable[[bytes], bytes],
    words: tuple[str, ...],
    recording: Path,
    tmp_path: Path,
) -> None:
    (recording / file).write_bytes(damaged((recording / file).read_bytes()))
    before = sorted(tmp_path.rglob("*"))
    for command in (("check", recording), ("identify", recording, "--out", tmp_path / "out")):
        code, _, err = ballbar(*command)
        assert code == 2, err
        for word in words:
            assert word in err
    assert sorted(tmp_path.rglob("*")) == before


def test_a_cut_last_line_is_dropped_and_reported(recording: Path) -> None:
    path = recording / "raw/robot.csv"
    path.write_bytes(path.read_bytes()[:-4])
    code, out, _ = ballbar("check", recording)
    assert code == 0
    assert "last line" in out
    lines = len(path.read_bytes().splitlines())
    assert f"{lines - 2} of {lines - 2} rows used" in out


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("seed: 3", "sead: 3", ["short.yaml:12", "sead", "seed"]),
        ("duration_s: 40", "duration_s: forty", ["short.yaml:3", "path.duration_s", "forty"]),
        ("robot: irb2400", "robot: irb2401", ["short.yaml", "irb2401", "irb2400"]),
        ("plant: {kind: kinematic}", "plant: {servo: softt}", ["softt", "soft, stiff"]),
        ("[0.70, 0.0, 0.54]", "[700, 0.0, 540]", ["short.yaml:2", "[0] = 700", "20 or less"]),
        ("[0.70, 0.0, 0.54]", "[7.0, 0.0, 0.54]", ["short.yaml", "out of reach", "metres"]),
        ("fitted: [1, 2, 4, 5]", "fitted: [1, 2, 4, 6]", ["short.yaml:8", "6"]),
    ],
)
def test_a_wrong_scenario_names_line_key_and_value(
    scenario: Path, tmp_path: Path, old: str, new: str, words: list[str]
) -> None:
    assert old in scenario.read_text()
    scenario.write_text(scenario.read_text().replace(old, new, 1))
    code, _, err = ballbar("run", scenario, "--out", tmp_path / "out")
    assert code == 2
    for word in words:
        assert word in err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_logs_that_do_not_belong_together_exit_with_1(recording: Path, tmp_path: Path) -> None:
    described = recording / "recording.yaml"
    described.write_text(described.read_text().replace("lund_600", "lund_900"))
    code, out, _ = ballbar("identify", recording, "--out", tmp_path / "out", "--samples", "200")
    assert code == 1
    assert out.startswith("Not the declared cell")

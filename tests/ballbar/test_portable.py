"""Own robot and ball-bar by relative paths: what is written is whole, and can be moved."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from ballbar.cell.strict_yaml import load_yaml
from tests.helpers.command_line import SHORT, ballbar
from tests.helpers.simulated_recordings import SCENARIOS

SHIPPED = SCENARIOS.parent / "cell"
PLAN = """schema: ballbar-plan/1
name: own
cell:
  robot: own/arm.yaml
  ballbar: own/bar.yaml
  plate: own/plate.yaml
  ballbar_region_m: {lower: [0.6, -0.3, 0.35], upper: [1.05, 0.3, 0.7]}
seed: 62
"""
POSES = """name: still
cell: {robot: own/arm.yaml, instrument: own/tracker.yaml}
poses:
  count: 60
  seats: [{name: tracker, position_m: [3.0, -1.0, 0.5], rotvec_rad: [0, 0, 2.8]}]
  targets: [{name: reflector, position_m: [0.1, 0.0, 0.05]}]
errors: {geometry: {}, instrument_noise: {}}
seed: 1
"""


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as a user has it: descriptions in own/, scenarios beside it."""
    folder = tmp_path / "secret-customer"
    (folder / "own").mkdir(parents=True)
    for kind, name, own in (
        ("robots", "irb2400", "arm"),
        ("instruments", "lund_600", "bar"),
        ("instruments", "tracker_point", "tracker"),
        ("plates", "plate_250", "plate"),
    ):
        shutil.copyfile(SHIPPED / kind / f"{name}.yaml", folder / "own" / f"{own}.yaml")
    shutil.copytree(SCENARIOS / "paths", folder / "paths")
    cell = "robot: own/arm.yaml, ballbar: own/bar.yaml, plate: own/plate.yaml"
    scenario = SHORT.replace("PATHS/", "paths/").replace("robot: irb2400, ballbar: lund_600", cell)
    assert cell in scenario
    (folder / "short.yaml").write_text(scenario)
    (folder / "plan.yaml").write_text(PLAN)
    (folder / "still.yaml").write_text(POSES)
    monkeypatch.chdir(folder)
    return folder


def moved(work: Path, *names: str) -> Path:
    """Files that a command wrote, moved elsewhere, with all their sources deleted."""
    elsewhere = work.parent / "elsewhere"
    elsewhere.mkdir()
    for name in names:
        shutil.move(work / name, elsewhere / name)
    shutil.rmtree(work)
    return elsewhere


def texts(folder: Path) -> dict[Path, str]:
    """All files, replays unpacked, as text."""
    out = {}
    for file in folder.rglob("*"):
        if file.suffix == ".rrd":
            chunks = RrdReader(str(file)).stream().to_chunks()
            out[file] = "".join(str(chunk.to_record_batch().to_pydict()) for chunk in chunks)
        elif file.is_file():
            out[file] = file.read_bytes().decode("latin-1")
    return out


@pytest.mark.slow
@pytest.mark.long
def test_a_run_is_whole_and_names_no_folder_of_the_machine(
    work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, printed, error = ballbar("run", work / "short.yaml", "--json")
    assert code in (0, 1), error
    assert str(work.parent) not in printed
    raw = Path("runs/short/recording/raw")
    own = ["--robot", "own/arm.yaml", "--ballbar", "own/bar.yaml", "--yes"]
    assert ballbar("new", "made", raw / "robot.csv", raw / "ballbar.csv", *own)[0] == 0
    assert ballbar("simulate", "short.yaml", "--out", "simulated")[0] == 0
    elsewhere = moved(work, "runs", "made", "simulated")
    monkeypatch.chdir(elsewhere)
    assert load_yaml(Path("made/recording.yaml")).data["robot"] == "descriptions/robot/arm.yaml"
    Path("targets.csv").write_text("axis1_deg,axis2_deg,axis3_deg,axis4_deg,axis5_deg,axis6_deg\n"
                                   "0,10,10,0,20,0\n")  # fmt: skip
    for words in (
        ("check", "runs/short/recording"),
        ("check", "made"),
        ("check", "simulated"),
        ("identify", "made", "--samples", 300),
        ("export", "runs/short", "--to", "json"),
        ("compare", "runs/short", "runs/short/recording.truth.yaml"),
        ("correct", "targets.csv", "--with", "runs/short"),
    ):
        code, _, error = ballbar(*words)
        assert code in (0, 1), error
        assert "error" not in error, words
    for file, text in texts(elsewhere).items():
        assert "secret-customer" not in text, file
        assert str(elsewhere.parent) not in text, file


@pytest.mark.slow
@pytest.mark.long
def test_the_scenario_of_a_plan_takes_its_descriptions_along(
    work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, _, error = ballbar("plan", "plan.yaml", "--seconds", 0, "--out", "planned")
    assert code == 0, error
    monkeypatch.chdir(moved(work, "planned"))
    assert load_yaml(Path("planned/scenario.yaml")).data["cell"]["robot"] == (
        "descriptions/robot/arm.yaml"
    )
    code, _, error = ballbar("simulate", "planned/scenario.yaml", "--out", "simulated")
    assert code == 0, error
    for file, text in texts(Path.cwd()).items():
        assert "secret-customer" not in text, file


def test_simulated_still_poses_are_whole(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """poses.yaml named robot and instrument by their places on the machine."""
    code, _, error = ballbar("simulate", "still.yaml", "--out", "still")
    assert code == 0, error
    monkeypatch.chdir(moved(work, "still", "still.truth.yaml"))
    assert load_yaml(Path("still/poses.yaml")).data["instrument"] == (
        "descriptions/instrument/tracker.yaml"
    )
    code, _, error = ballbar("check", "still")
    assert code == 0, error
    assert all("secret-customer" not in text for text in texts(Path.cwd()).values())

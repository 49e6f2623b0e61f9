"""`ballbar list` and `ballbar init`: what is shipped, and copies of it that run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ballbar.cell.dialect import dialect_names
from ballbar.cell.load import robot_names
from ballbar.planning.request import load_request
from ballbar.scenario import load_scenario
from ballbar.sweep.check import load_sweep
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import SCENARIOS


@pytest.mark.slow
def test_one_command_lists_everything_that_can_be_named() -> None:
    code, out, _ = ballbar("list", "--json")
    assert code == 0
    listed = json.loads(out)
    assert list(listed) == [
        *("robots", "ballbars", "instruments", "plates", "dialects", "scenarios")
    ]
    assert list(listed["robots"]) == robot_names()
    assert list(listed["dialects"]) == dialect_names()
    assert set(listed["scenarios"]) == {file.stem for file in SCENARIOS.glob("*.yaml")}
    for titles in listed.values():
        assert all(
            len(title) > 10 and not title.endswith(("sec", ".")) for title in titles.values()
        )
    _, text, _ = ballbar("list")
    for name in (name for titles in listed.values() for name in titles):
        assert f"  {name} " in text


def test_copied_scenarios_and_what_they_name_are_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = ballbar("init", "study")
    assert code == 0
    assert "ballbar run study/irb2400.yaml" in out
    for file in Path("study").glob("*.yaml"):
        scenario = load_scenario(file)
        if scenario.path:
            assert (Path("study") / scenario.path.file).is_file()
    assert load_sweep(Path("study/sweeps/noise.yaml")).plan.data.name == "noise"
    assert load_request(Path("study/plans/irb2400.yaml")).name == "irb2400"
    code, _, err = ballbar("init", "study")
    assert code == 2
    assert "exists and holds something; nothing was written" in err


def test_copies_that_a_power_cut_left_unfinished_are_finished_and_others_refused(
    tmp_path: Path,
) -> None:
    study = tmp_path / "study"
    assert ballbar("init", study)[0] == 0
    whole = {path: path.read_bytes() for path in study.rglob("*") if path.is_file()}
    (study / "irb2400.yaml").rename(study / ".irb2400.yaml.part")
    (study / "sweeps/noise.yaml").unlink()
    assert ballbar("init", study)[0] == 0
    assert {path: path.read_bytes() for path in study.rglob("*") if path.is_file()} == whole
    (study / "sweeps/noise.yaml").unlink()
    (study / "nj220.yaml").write_text("changed")
    assert ballbar("init", study)[0] == 2
    assert (study / "nj220.yaml").read_text() == "changed"
    assert not (study / "sweeps/noise.yaml").exists()

"""Scenarios by file and by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from ballbar.cell.errors import DescriptionError
from ballbar.scenario import SHIPPED, load_scenario, scenario_file
from ballbar.sim.settings import OF_PATH, OF_POSES, ErrorSettings
from tests.helpers.command_line import ballbar


def test_a_bare_name_is_a_shipped_scenario_unless_a_file_is_called_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert scenario_file("nj220") == SHIPPED / "nj220.yaml"
    assert load_scenario("nj220").cell.robot == "nj220"
    (tmp_path / "nj220").mkdir()
    assert scenario_file("nj220") == SHIPPED / "nj220.yaml"
    (tmp_path / "irb2400").write_text("a file")
    assert scenario_file("irb2400") == Path("irb2400")
    assert scenario_file("nj220.yaml") == Path("nj220.yaml")
    assert scenario_file("own/nj220") == Path("own/nj220")


def test_a_name_that_is_no_shipped_scenario_is_refused_with_the_nearest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        DescriptionError, match=r"unknown scenario 'irb240'. Did you mean irb2400\? .*ends in .yaml"
    ):
        load_scenario("irb240")
    code, _, err = ballbar("simulate", "irb240")
    assert code == 2
    assert err.startswith("error: unknown scenario 'irb240'. Did you mean irb2400?")


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        (
            "ur10e_tracker",
            "errors.rod_backlash={}",
            "needs a robot that moves (path); leave it out",
        ),
        ("ur10e_tracker", "errors.outliers.size_rad=[0.1, 0.2]", "needs a robot that moves (path)"),
        ("ur10e_tracker", "plant.servo=stiff", "needs a robot that moves (path); leave it out"),
        ("ur10e_tracker", "clocks.offset_s=1", "clocks: needs a robot that moves (path)"),
        ("ur10e_tracker", "identify.samples=100", "identify: needs a robot that moves (path)"),
        ("ur10e_tracker", "accept.clock_offset_us=1", "needs a robot that moves (path)"),
        ("ur10e_tracker", "cell.instrument=null", "expected either ballbar or instrument"),
        ("irb2400", "errors.drift={}", "needs a robot that stands still (poses); leave it out"),
        ("irb2400", "errors.outliers.share=0.1", "needs a robot that stands still (poses)"),
        ("irb2400", "path=null", "expected either path or poses"),
        ("irb2400", "cell.ballbar_position_m=null", "Add `ballbar_position_m: ...` to cell"),
    ],
)
def test_what_belongs_to_the_other_kind_of_scenario_is_refused(
    name: str, change: str, says: str
) -> None:
    with pytest.raises(DescriptionError) as caught:
        load_scenario(name, overrides=[change])
    assert says in str(caught.value)


def test_a_robot_either_moves_or_stands_still(tmp_path: Path) -> None:
    file = tmp_path / "both.yaml"
    motion = "path: {kind: lissajous, file: a.yaml, duration_s: 60}\n"
    file.write_text(scenario_file("ur10e_tracker").read_text() + motion)
    with pytest.raises(DescriptionError, match="expected either path or poses"):
        load_scenario(file)


def test_every_error_source_is_of_a_robot_that_moves_or_stands_still_or_of_both() -> None:
    every = {f"errors.{name}" for name in ErrorSettings.model_fields}
    assert not set(OF_PATH) & set(OF_POSES)
    both = {"errors.joint_compliance", "errors.joint_noise", "errors.outliers"}
    both |= {"errors.gear_backlash"}
    assert every - {*OF_PATH, *OF_POSES} == both


@pytest.mark.parametrize(
    "stated", ["cost: length", "data: samples", "force: none", "rod_sigma_m: 1.0e-4"]
)
def test_what_needs_a_ballbar_with_encoders_is_refused_where_a_length_is_sensed(
    stated: str, tmp_path: Path
) -> None:
    scenario = load_scenario("ur10e_telescoping")
    assert scenario.cell.instrument is not None
    key, _, value = stated.partition(": ")
    words = rf"identify\.{key}.*needs a ball-bar with encoders \(cell\.ballbar\); leave it out"
    with pytest.raises(DescriptionError, match=words):
        load_scenario("ur10e_telescoping", overrides=[f"identify.{key}={value}"])

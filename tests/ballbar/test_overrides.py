"""`--set` and `extends`: what is read, what is recorded, what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ballbar.cell.errors import DescriptionError
from ballbar.cell.schema import describe_keys
from ballbar.cell.strict_yaml import load_yaml
from ballbar.planning.request import load_request
from ballbar.scenario import SCENARIOS as KIND
from ballbar.scenario import AcceptSettings, load_scenario
from ballbar.sim.settings import CellSettings, PathSettings
from ballbar.sweep.check import load_sweep
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import SCENARIOS


@pytest.mark.parametrize(
    ("command", "override", "words"),
    [
        (
            ("run", "irb2400"),
            "errors.joint_nose.sigma_rad=1",
            "unknown key errors.joint_nose. Did you mean joint_noise?",
        ),
        (("simulate", "panda_sockets"), "poses.cont=9", "unknown key poses.cont. Did you mean cou"),
        (("identifiability", "irb2400"), "sed=9", "unknown key sed. Did you mean seed?"),
        (("plan", SCENARIOS / "plans/irb2400.yaml"), "limits.force=9", "unknown key limits.force."),
        (("plan", SCENARIOS / "plans/irb2400_tracker.yaml"), "pose=9", "unknown key pose. Did you"),
        (("sweep", SCENARIOS / "sweeps/noise.yaml"), "seeds.cunt=9", "unknown key seeds.cunt. Did"),
    ],
)
def test_every_command_refuses_an_unknown_key_and_names_the_nearest(
    command: tuple[object, ...], override: str, words: str, tmp_path: Path
) -> None:
    code, _, err = ballbar(*command, "--out", tmp_path / "out", "--set", override)
    if command[0] == "identifiability":  # writes nothing
        code, _, err = ballbar(*command, "--set", override)
    assert code == 2
    assert err.startswith(f"error: --set {override}: {words}")
    assert not (tmp_path / "out").exists()


def test_a_recording_has_the_scenario_that_made_it_beside_it(tmp_path: Path) -> None:
    """Merged, with names of files that are valid there: it runs again to the same rows."""
    own = tmp_path / "own"
    own.mkdir()
    robot = (SCENARIOS.parent / "cell" / "robots" / "panda.yaml").read_text()
    (own / "robot.yaml").write_text(robot)
    (own / "base.yaml").write_text("extends: panda_sockets\ncell: {robot: robot.yaml}\n")
    (tmp_path / "mine.yaml").write_text("extends: own/base.yaml\nname: mine\nposes: {count: 10}\n")
    words = ("simulate", tmp_path / "mine.yaml", "--out", tmp_path / "a" / "rec")
    code, _, err = ballbar(*words, "--set", "seed=7", "--set", "errors.unit_weights=null")
    assert code == 0, err
    copy = tmp_path / "a" / "rec.scenario.yaml"
    again = load_scenario(copy)
    copied = "rec/descriptions/robot/robot.yaml"
    assert (again.name, again.seed, again.cell.robot) == ("mine", 7, copied)
    assert "extends" not in load_yaml(copy).data
    code, _, err = ballbar("simulate", copy, "--out", tmp_path / "rec")
    assert code == 0, err
    table = (tmp_path / "rec" / "poses.csv").read_bytes()
    assert table == (tmp_path / "a" / "rec" / "poses.csv").read_bytes()


def test_names_of_files_in_a_shipped_base_lead_to_its_files(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("extends: irb2400_full\nname: mine\n")
    scenario = load_scenario(tmp_path / "mine.yaml", overrides=("path.duration_s=60",))
    assert (tmp_path / scenario.path.file).samefile(SCENARIOS / "paths" / "irb2400_a.yaml")
    held_out = tmp_path / scenario.accept.held_out_file
    assert held_out.samefile(SCENARIOS / "paths" / "irb2400_b.yaml")
    assert (scenario.path.duration_s, scenario.cell.robot) == (60.0, "irb2400")


def test_every_key_of_a_file_name_is_rebased() -> None:
    """A key of the schema that names a file and is not listed would be looked for elsewhere."""
    describe_keys()
    sections = {"cell": CellSettings, "path": PathSettings, "accept": AcceptSettings}
    described = {
        f"{section}.{key}"
        for section, model in sections.items()
        for key, field in model.model_fields.items()
        if re.search(r"\bfile\b|[Ff]older|path\b|length: a telescoping", field.description or "")
        and field.annotation in (str, str | None)
    }
    assert described == {*KIND.files, *KIND.descriptions}


def test_the_errors_of_a_base_are_those_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(
        (SCENARIOS / "irb2400.yaml").read_text().replace("servo: soft", "servo: soft, kid: 1")
    )
    (tmp_path / "mine.yaml").write_text("extends: base.yaml\nname: mine\npath: {stops: 99}\n")
    with pytest.raises(DescriptionError) as caught:
        load_scenario(tmp_path / "mine.yaml")
    said = str(caught.value).replace(str(tmp_path), "").splitlines()
    assert [line.split(": ")[0] for line in said] == ["/base.yaml:9", "/mine.yaml:3"]
    assert said[0].endswith("unknown key plant.kid. Did you mean kind? " + said[0].split("? ")[1])


def test_requests_extend_and_are_set_too(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("extends: ur10e_telescoping\nname: mine\n")
    request = load_request(tmp_path / "mine.yaml", overrides=("seed=5",))
    assert (request.name, request.seed) == ("mine", 5)
    instrument = Path(request.cell.instrument or "")
    assert instrument.samefile(SCENARIOS / "plans" / "telescoping_1000.yaml")
    (tmp_path / "poses.yaml").write_text("extends: irb2400_tracker\nposes: 50\n")
    poses = load_request(tmp_path / "poses.yaml", overrides=("targets.0.cone_deg=30",))
    assert (poses.poses, poses.targets[0].cone_deg, poses.name) == (50, 30.0, "irb2400_tracker")


def test_a_sweep_extends_another_and_its_plan_states_what_was_set(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("extends: noise\nname: mine\n")
    overrides = ("seeds.count=2", "change.plant.servo=stiff", "vary.identify.cost=[ml]")
    data = load_sweep(tmp_path / "mine.yaml", overrides).plan.data
    assert (data.name, data.seeds.count, data.vary["identify.cost"]) == ("mine", 2, ["ml"])
    assert data.scenario["plant"]["servo"] == "stiff"
    assert data.scenario["name"] == "irb2400"

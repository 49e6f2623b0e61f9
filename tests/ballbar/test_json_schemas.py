"""JSON schemas of the YAML files: every shipped file is valid, and wrong ones are not."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ballbar.cell.files import write_yaml
from ballbar.cell.strict_yaml import load_yaml
from ballbar.json_schemas import KINDS, json_schema
from tests.helpers.command_line import ballbar
from tests.helpers.json_schema import faults
from tests.helpers.simulated_recordings import SCENARIOS, Recorded

ROOT = SCENARIOS.parent
SHIPPED = sorted([*ROOT.glob("cell/*/*.yaml"), *SCENARIOS.rglob("*.yaml")])
WRITTEN_BY_PEOPLE = set(KINDS) - {"claims", "calibration", "truth", "pose-truth"}


@cache
def schema(kind: str) -> dict[str, Any]:
    return json_schema(kind)


@cache
def kinds() -> dict[str, str]:
    """Value of `schema` in a file -> its kind."""
    stated = {kind: schema(kind)["properties"].get("schema", {}) for kind in KINDS}
    return {key["const"]: kind for kind, key in stated.items() if "const" in key}


def kind_of(data: dict[str, Any]) -> str:
    return kinds()[data["schema"]] if "schema" in data else "scenario"


def faults_of(data: dict[str, Any], kind: str | None = None) -> list[str]:
    chosen = schema(kind or kind_of(data))
    return list(faults(data, chosen, chosen))


def test_every_shipped_file_is_valid(recorded: Recorded) -> None:
    files = [*SHIPPED, recorded.folder / "recording.yaml"]
    every = {str(file): faults_of(load_yaml(file).data) for file in files}
    assert len(every) > 100
    assert {file: found for file, found in every.items() if found} == {}


@pytest.mark.parametrize(
    ("file", "change", "place"),
    [
        ("scenarios/irb2400.yaml", {"sed": 1}, ".sed"),
        ("scenarios/irb2400.yaml", {"path": {"kind": "lissajou"}}, ".path.kind"),
        ("scenarios/irb2400.yaml", {"errors": {"joint_noise": {"sigma_rad": -1}}}, ".sigma_rad"),
        ("scenarios/irb2400.yaml", {"cell": {"ballbar_position_m": [1, 2]}}, "position_m"),
        ("scenarios/panda_sockets.yaml", {"poses": {"count": 1}}, ".poses.count"),
        ("scenarios/sweeps/noise.yaml", {"seeds": {"count": "many"}}, ".seeds.count"),
        ("scenarios/plans/irb2400.yaml", {"limits": {"force": 1}}, ".limits.force"),
        ("cell/robots/irb2400.yaml", {"motor_to_joint": "identical"}, ".motor_to_joint"),
        ("cell/plates/plate_250.yaml", {"length_m": 0}, ".length_m"),
    ],
)
def test_a_wrong_value_is_marked(file: str, change: dict[str, Any], place: str) -> None:
    data = load_yaml(ROOT / file).data
    assert [fault[-len(place) :] for fault in faults_of(data | change)] == [place]


def test_a_file_that_extends_may_leave_every_mapping_to_its_base() -> None:
    data = {"extends": "irb2400", "path": {"stops": 1}, "errors": {"joint_noise": {}}}
    assert faults_of(data, "scenario") == []
    assert faults_of({k: v for k, v in data.items() if k != "extends"}, "scenario") == [".extends"]
    assert faults_of(data | {"path": {"stop": 1}}, "scenario") == [".path.stop"]
    request = load_yaml(SCENARIOS / "plans" / "irb2400_tracker.yaml").data
    short = request | {"extends": "irb2400_tracker", "seats": [{"name": "a"}]}
    assert faults_of(short) == [".seats[0].position_m"], "a list replaces the whole list"
    plate = load_yaml(ROOT / "cell/plates/plate_250.yaml").data
    assert faults_of(plate | {"extends": "plate_250"}) == [".extends"]


@pytest.mark.parametrize("kind", sorted(WRITTEN_BY_PEOPLE))
def test_what_a_key_means_is_said_at_the_key_or_by_its_mapping(kind: str) -> None:
    """Editors show it. `schema`, names and titles need no words."""
    top = schema(kind)
    silent = []
    for key, field in top["properties"].items():
        inner = field.get("items", field)
        names = [part["$ref"] for part in (inner, *inner.get("anyOf", ())) if "$ref" in part]
        described = [top["$defs"][name.rpartition("/")[2]].get("description") for name in names]
        if not field.get("description") and not all(described or [None]):
            silent.append(key)
    assert set(silent) <= {"schema", "name", "title", "notes"}


def test_the_command_writes_a_schema_of_every_kind(tmp_path: Path) -> None:
    code, out, _ = ballbar("schema", "--out", tmp_path / "schemas")
    assert code == 0
    assert out.startswith(f"{len(KINDS)} schemas in ")
    written = {file.name: json.loads(file.read_text()) for file in (tmp_path / "schemas").iterdir()}
    assert written == {f"{kind}.schema.json": schema(kind) for kind in KINDS}
    (tmp_path / "schemas" / "mine.yaml").touch()
    assert ballbar("schema", "--out", tmp_path / "schemas")[0] == 2


def test_a_first_line_for_the_editor_is_a_comment(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    write_yaml(file, {"extends": "irb2400"})
    file.write_text(f"# yaml-language-server: $schema=scenario.schema.json\n{file.read_text()}")
    assert load_yaml(file).data == {"extends": "irb2400"}

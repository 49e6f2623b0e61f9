"""Files that extend another, and values set from outside: what results, and what is named."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.extended_yaml import (
    ExtendableKind,
    files_of,
    load_extended,
    location_of,
    named_file,
    overlap,
    renamed,
    with_changes,
)
from ballbar.cell.schema import Strict
from ballbar.cell.strict_yaml import Place, parse_model

BASE = """name: base
cell: {robot: own.yaml, plate: plate_250, point: [1, 2, 3]}
path:
  file: paths/a.yaml
  stops: 2
errors:
  strain: {}
starts: [a.yaml, /abs/b.yaml]
"""


@pytest.fixture
def kind(tmp_path: Path) -> ExtendableKind:
    shipped = tmp_path / "shipped"
    shipped.mkdir()
    (shipped / "base.yaml").write_text(BASE)
    return ExtendableKind(
        what="thing",
        shipped=shipped,
        files=("path.file", "starts"),
        descriptions=("cell.robot", "cell.plate"),
    )


def written(folder: Path, text: str, name: str = "own.yaml") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    return folder / name


def refusal(path: Path, kind: ExtendableKind, *overrides: str) -> str:
    with pytest.raises(DescriptionError) as caught:
        load_extended(path, kind, overrides=overrides)
    return str(caught.value).replace(f"{path.parent}/", "")


def test_mappings_are_merged_and_lists_and_values_are_replaced(
    tmp_path: Path, kind: ExtendableKind
) -> None:
    own = "extends: base\nname: own\ncell: {point: [4]}\npath: {stops: null}\nerrors: {play: {}}\n"
    path = written(tmp_path / "shipped", own)
    document = load_extended(path, kind)
    assert document.path == path
    assert document.data == {
        "name": "own",
        "cell": {"robot": "own.yaml", "plate": "plate_250", "point": [4]},
        "path": {"file": "paths/a.yaml", "stops": None},
        "errors": {"strain": {}, "play": {}},
        "starts": ["a.yaml", "/abs/b.yaml"],
    }


def test_every_value_has_the_place_where_it_is_written(
    tmp_path: Path, kind: ExtendableKind
) -> None:
    path = written(tmp_path, "extends: base\ncell:\n  point: [4]\n")
    base = str(kind.shipped / "base.yaml")
    document = load_extended(path, kind, overrides=("path.stops=3", "new.key=[1]"))
    places = {
        (): Place(str(path), 1),
        ("cell",): Place(str(path), 2),
        ("cell", "robot"): Place(base, 2),
        ("cell", "point", 0): Place(str(path), 3),
        ("cell", "point", 2): Place(str(path), 3),  # of the base's list nothing is left
        ("path",): Place(base, 3),
        ("path", "stops"): Place("--set path.stops=3", 0),
        ("new",): Place("--set new.key=[1]", 0),
        ("new", "key", 0): Place("--set new.key=[1]", 0),
    }
    assert {loc: document.place_of(loc) for loc in places} == places


class Motion(Strict):
    file: str
    stops: int
    speed: float


class Model(Strict):
    path: Motion


def test_an_error_names_the_file_and_line_that_hold_it(
    tmp_path: Path, kind: ExtendableKind
) -> None:
    base = written(tmp_path, "path:\n  file: 3\n  stops: 1\n", "base.yaml")
    path = written(tmp_path, "extends: base.yaml\npath:\n  stop: 1\n")
    with pytest.raises(DescriptionError) as caught:
        parse_model(load_extended(path, kind, overrides=("path.stops=x",)), Model)
    assert str(caught.value).splitlines() == [
        "--set path.stops=x: path.stops = 'x': expected a whole number, without quotes or unit.",
        f"{base}:2: path.file = 3: expected text.",
        f"{path}:2: path.speed is missing. Add `speed: ...` to path.",
        f"{path}:3: unknown key path.stop. Did you mean stops? Valid keys: file, speed, stops.",
    ]


def test_files_of_a_base_stand_relative_to_the_base(tmp_path: Path, kind: ExtendableKind) -> None:
    path = written(tmp_path / "mine" / "deep", "extends: ../../shipped/base.yaml\n")
    data = load_extended(path, kind).data
    assert data["cell"] == {
        "robot": "../../shipped/own.yaml",
        "plate": "plate_250",
        "point": [1, 2, 3],
    }
    assert data["path"]["file"] == "../../shipped/paths/a.yaml"
    assert data["starts"] == ["../../shipped/a.yaml", "/abs/b.yaml"]
    (tmp_path / "link").symlink_to(tmp_path / "mine" / "deep")
    written(tmp_path / "link", "extends: base\n", "bare.yaml")
    linked = load_extended(tmp_path / "link" / "bare.yaml", kind).data["path"]["file"]
    assert (tmp_path / "link" / linked).parent.parent.samefile(kind.shipped)
    back = renamed(data, kind, path.parent, kind.shipped)
    assert back == load_extended(kind.shipped / "base.yaml", kind).data


def test_a_base_may_extend_another_in_a_third_folder(tmp_path: Path, kind: ExtendableKind) -> None:
    middle = written(tmp_path / "a" / "b", "extends: base\npath: {stops: 5}\n", "middle.yaml")
    path = written(tmp_path / "c", "extends: ../a/b/middle.yaml\nname: own\n")
    data = load_extended(path, kind).data
    assert (data["name"], data["path"]) == ("own", {"file": "../shipped/paths/a.yaml", "stops": 5})
    assert [file.resolve() for file in files_of(path, kind)] == [
        path,
        middle,
        kind.shipped / "base.yaml",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\nextends: own.yaml\n", "own.yaml:2: extends = 'own.yaml': a circle, own.yaml ext"),
        ("extends: 3\n", "own.yaml:1: extends = 3: expected the name of a file."),
        ("extends: no.yaml\n", "own.yaml:1: extends = 'no.yaml': no such file no.yaml. Name it"),
        ("extends: bse\n", "own.yaml:1: extends = 'bse': unknown thing 'bse'. Did you mean base?"),
        ("extends: bad.yaml\n", "bad.yaml:2: key a stands here and in line 1. Remove one."),
        ("extends: middle.yaml\n", "middle.yaml:1: extends = 'own.yaml': a circle, own.yaml exte"),
        ("extends: 1.yaml\n", "8.yaml:1: extends = '9.yaml': own.yaml extends 1.yaml extends 2"),
    ],
)
def test_what_cannot_be_extended_is_refused_with_its_line(
    text: str, words: str, tmp_path: Path, kind: ExtendableKind
) -> None:
    written(tmp_path, "a: 1\na: 2\n", "bad.yaml")
    written(tmp_path, "extends: own.yaml\n", "middle.yaml")
    for i in range(1, 10):
        written(tmp_path, f"extends: {i + 1}.yaml\n", f"{i}.yaml")
    written(tmp_path, "a: 1\n", "10.yaml")
    assert refusal(written(tmp_path, text), kind).startswith(words)


def test_set_values_are_strict_yaml_and_replace_the_whole_value(
    tmp_path: Path, kind: ExtendableKind
) -> None:
    overrides = (
        *("path.stops=1e-5", "cell.point.1=0x10", "errors={play: {a: no}}", "name=a=b"),
        "starts=",
    )
    data = load_extended(written(tmp_path, "extends: base\n"), kind, overrides=overrides).data
    assert data["path"]["stops"] == 1e-5
    assert data["cell"]["point"] == [1, 16, 3]
    assert data["errors"] == {"play": {"a": "no"}}
    assert data["name"] == "a=b"
    assert data["starts"] is None


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("seed", "--set seed: expected KEY=VALUE, such as seed=2."),
        ("=1", "--set =1: expected KEY=VALUE"),
        ("a..b=1", "--set a..b=1: expected KEY=VALUE"),
        ("a=[1", "--set a=[1: not valid YAML while parsing a flow sequence"),
        ("a={b: 1, b: 2}", "--set a={b: 1, b: 2}: key b stands twice. Remove one."),
        ("a=&x 1", "--set a=&x 1: &x: anchors and aliases are refused"),
        ("name.x=1", "--set name.x=1: name.x: the value 'base' above x has no keys of its own."),
        ("cell.point.3=1", "--set cell.point.3=1: cell.point.3: the list has no item 3; its 3"),
    ],
)
def test_a_wrong_set_value_is_refused_by_its_name(
    override: str, words: str, tmp_path: Path, kind: ExtendableKind
) -> None:
    assert refusal(written(tmp_path, BASE), kind, override).startswith(words)


def test_a_key_is_set_once(tmp_path: Path, kind: ExtendableKind) -> None:
    said = refusal(written(tmp_path, BASE), kind, "path.stops=1", "path.stops=2")
    assert said == "--set path.stops=2: path.stops is set twice. Remove one."


def test_a_bare_name_is_a_shipped_file_unless_a_file_is_called_that(
    tmp_path: Path, kind: ExtendableKind
) -> None:
    assert named_file("base", kind, relative_to=tmp_path) == kind.shipped / "base.yaml"
    (tmp_path / "base").write_text("a file")
    assert named_file("base", kind, relative_to=tmp_path) == tmp_path / "base"
    assert named_file("./base", kind, relative_to=tmp_path / "no") == tmp_path / "no" / "base"


def test_a_dotted_key_leads_through_keys_that_hold_dots() -> None:
    data = {"change": {"plant.kind": 1, "plant": {"servo": {"x": 2}}}, "rows": [{"a.b": 3}]}
    assert location_of(data, "change.plant.kind") == ("change", "plant.kind")
    assert location_of(data, "change.plant.servo.x") == ("change", "plant", "servo", "x")
    assert location_of(data, "rows.0.a.b") == ("rows", 0, "a.b")
    assert with_changes(data, {"rows.0.a.b": 4})["rows"] == [{"a.b": 4}]
    with pytest.raises(InputError, match=re.escape("rows.x: the list has no item x")):
        location_of(data, "rows.x")
    assert overlap("a.b", "a")
    assert not overlap("a.b", "a.bc")

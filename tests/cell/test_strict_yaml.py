"""The strict YAML loader: YAML 1.2 values, and refusals with file and line."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ballbar.cell import strict_yaml
from ballbar.cell.errors import DescriptionError
from ballbar.cell.files import write_yaml
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import MAX_BYTES, load_model, load_yaml, parse_model


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(folder: Path, text: str | bytes, model: type[BaseModel] | None = None) -> str:
    path = write(folder, text)
    with pytest.raises(DescriptionError, match=re.escape(str(path))) as caught:
        load_yaml(path) if model is None else load_model(path, model)
    return str(caught.value).replace(str(path), "file.yaml")


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Circle(Strict):
    kind: Literal["circle"]
    radius_m: Annotated[float, Field(gt=0.0, le=2.0)]


class Lissajous(Strict):
    kind: Literal["lissajous"]
    duration_s: float


class Run(Strict):
    path: Annotated[Circle | Lissajous, Field(discriminator="kind")] = Circle(
        kind="circle", radius_m=1.0
    )
    point_m: Annotated[tuple[float, ...], Field(min_length=3, max_length=3)] = (0.0, 0.0, 0.0)
    samples: int = 1
    dwell: bool = False
    cost: Literal["ml", "length"] = "ml"
    errors: dict[str, Circle] = {}
    stops: tuple[Lissajous, ...] = ()
    note: str | None = None


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-5", 1e-5),
        ("1e4", 1e4),
        ("1.0e-3", 1e-3),
        (".5", 0.5),
        ("5.", 5.0),
        ("-.5E+1", -5.0),
        ("7", 7),
        ("+7", 7),
        ("010", 10),
        ("0o17", 15),
        ("0x1F", 31),
        ("true", True),
        ("False", False),
        ("~", None),
        ("null", None),
        ("", None),
        ("'7'", "7"),
        ("!!str 7", "7"),
    ],
)
def test_a_scalar_of_the_core_schema_becomes_its_value(
    tmp_path: Path, text: str, value: object
) -> None:
    found = load_yaml(write(tmp_path, f"key: {text}")).data["key"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "no",
        "on",
        "yes",
        "off",
        "y",
        "2016-05-30",
        "1:30",
        "1_000",
        "0b11",
        "1e",
        "=",
        "<<",
        "1.2.3",
    ],
)
def test_what_only_yaml_1_1_converts_stays_text(tmp_path: Path, text: str) -> None:
    assert load_yaml(write(tmp_path, f"key: {text}")).data["key"] == text


def test_infinity_and_nan_are_read_where_they_are_written_out(tmp_path: Path) -> None:
    low, nan = load_yaml(write(tmp_path, "key: [-.inf, .nan]")).data["key"]
    assert low == -math.inf
    assert math.isnan(nan)


def test_every_key_and_item_knows_its_line_and_a_missing_one_that_of_its_parent(
    tmp_path: Path,
) -> None:
    document = load_yaml(write(tmp_path, "# robot\na: 1\nb:\n  c:\n    - 5\n    - {d: 6}\n"))
    assert document.data == {"a": 1, "b": {"c": [5, {"d": 6}]}}
    assert [
        document.place_of(loc).line
        for loc in ((), ("a",), ("b",), ("b", "c"), ("b", "c", 0), ("b", "c", 1, "d"))
    ] == [2, 2, 3, 4, 5, 6]
    assert document.place_of(("b", "missing", 3)).line == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "file.yaml: the file is empty; expected `key: value` lines."),
        ("# nothing\n", "file.yaml: the file is empty; expected `key: value` lines."),
        ("\n- 1\n", "file.yaml:2: the file holds a list; expected `key: value` lines."),
        ("text", "file.yaml:1: the file holds a single value; expected `key: value` lines."),
        ("a: 1\nb: 2\na: 3\n", "file.yaml:3: key a stands here and in line 1. Remove one."),
        ("x:\n  a: 1\n  a: 2\n", "file.yaml:3: key a stands here and in line 2. Remove one."),
        (
            "a: &big [1]\nb: *big\n",
            "file.yaml:1: &big: anchors and aliases are refused; write the value out.",
        ),
        (
            "a: 1\nb: *big\n",
            "file.yaml:2: *big: anchors and aliases are refused; write the value out.",
        ),
        (
            "1: 2",
            "file.yaml:1: key 1 is not text. "
            "Put keys that look like numbers, true or null in quotes.",
        ),
        (
            "[1, 2]: 3",
            "file.yaml:1: a key is not text. "
            "Put keys that look like numbers, true or null in quotes.",
        ),
        ("a: !!int x", "file.yaml:1: 'x' is no int, as its tag says; leave the tag out."),
        (
            "a: 1e999",
            "file.yaml:1: number 1e999 is beyond what can be represented; write a smaller one.",
        ),
        (
            "a: 1\n---\nb: 2\n",
            "file.yaml:2: a second document starts here. Keep one per file: remove the `---` line.",
        ),
        (b"a: 1\nb: \xff\n", "file.yaml:2: byte 0xff is not UTF-8. Save the file as UTF-8."),
        (
            "a: 1\nb: \x00\n",
            "file.yaml:2: character U+0000 is not allowed in YAML. Save the file as plain text.",
        ),
        (
            "a: " + 50 * "[" + 50 * "]",
            "file.yaml:1: nested more than 40 levels deep; write it flatter.",
        ),
    ],
)
def test_a_doubtful_file_is_refused_with_its_line_and_the_remedy(
    tmp_path: Path, text: str | bytes, message: str
) -> None:
    assert refusal(tmp_path, text) == message


@pytest.mark.parametrize(
    "tag", ["!!python/object/apply:os.getcwd", "!!set", "!!timestamp", "!!binary", "!mine"]
)
def test_a_tag_beyond_the_core_schema_is_refused(tmp_path: Path, tag: str) -> None:
    assert refusal(tmp_path, f"a: 1\nb: {tag} x\n").startswith(
        f"file.yaml:2: tag {tag} is refused; only plain text, numbers"
    )


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("a:\n\tb: 1\n", "Indent with spaces, not tabs."),
        ("a: b: c\n", "Text that holds `: ` needs quotes"),
        ("a: [1, 2\n", "expected ',' or ']'"),
        ("a: 'x\n", "while scanning a quoted scalar"),
    ],
)
def test_a_syntax_error_names_its_line_and_the_usual_cause(
    tmp_path: Path, text: str, hint: str
) -> None:
    message = refusal(tmp_path, "first: 1\n" + text)
    assert message.startswith(("file.yaml:2: not valid YAML", "file.yaml:3: not valid YAML"))
    assert hint in message


def test_a_missing_file_and_a_directory_are_distinguished(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"absent\.yaml: no such file\."):
        load_yaml(tmp_path / "absent.yaml")
    with pytest.raises(DescriptionError, match="this is a directory; name the YAML file within it"):
        load_yaml(tmp_path)


def test_a_log_given_by_mistake_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "log.yaml"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(
        DescriptionError, match=r"larger than 1 MB. So it is no description: was a log meant"
    ):
        load_yaml(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("samples: 1.5", "samples = 1.5: expected a whole number."),
        ("samples: '5'", "samples = '5': expected a whole number, without quotes or unit."),
        ("dwell: yes", "dwell = 'yes': expected true or false."),
        ("dwell: 1", "dwell = 1: expected true or false."),
        ("cost: lenght", "cost = 'lenght': expected 'ml' or 'length'; the nearest is length."),
        (
            "point_m: [1, 2, '0,25']",
            "point_m[2] = '0,25': expected a number; write the decimal point as 0.25.",
        ),
        ("point_m: [1, 2, .inf]", "point_m[2] = inf: expected a finite number."),
        ("point_m: [1, 2]", "point_m: expected at least 3 items, found 2."),
        ("point_m: 5", "point_m = 5: expected a list."),
        ("path: 3", "path = 3: expected a mapping of keys."),
        ("path: {kind: circle, radius_m: 0}", "path.radius_m = 0: expected more than 0."),
        ("path: {kind: circle, radius_m: 150}", "path.radius_m = 150: expected 2 or less."),
        (
            "path: {kind: circle}",
            "path.radius_m is missing. Add `radius_m: ...` to path. Or leave out path, which is "
            "optional.",
        ),
        (
            "path: {radius_m: 1}",
            "path.kind is missing. Add `kind: ...` to path. Or leave out path, which is optional.",
        ),
        ("path: {kind: spiral}", "path.kind = 'spiral': expected one of 'circle', 'lissajous'."),
        ("note: [1]", "note: expected text."),
    ],
)
def test_a_wrong_value_is_reported_with_key_value_and_expectation(
    tmp_path: Path, text: str, message: str
) -> None:
    assert refusal(tmp_path, f"# run\n{text}\n", Run) == f"file.yaml:2: {message}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "smaples: 3",
            "unknown key smaples. Did you mean samples? "
            "Valid keys: cost, dwell, errors, note, path, point_m, samples, stops.",
        ),
        (
            "path: {kind: circle, radius_m: 1, radius: 2}",
            "unknown key path.radius. Did you mean radius_m? Valid keys: kind, radius_m.",
        ),
        (
            "errors: {x: {kind: circle, radius_m: 1, r: 2}}",
            "unknown key errors.x.r. Valid keys: kind, radius_m.",
        ),
        (
            "stops: [{kind: lissajous, duration_s: 1, duration: 2}]",
            "unknown key stops[0].duration. Did you mean duration_s? Valid keys: duration_s, kind.",
        ),
    ],
)
def test_an_unknown_key_names_the_nearest_and_the_valid_ones(
    tmp_path: Path, text: str, message: str
) -> None:
    assert refusal(tmp_path, f"# run\n{text}\n", Run) == f"file.yaml:2: {message}"


def test_all_errors_of_a_file_are_reported_at_once_in_the_order_of_their_lines(
    tmp_path: Path,
) -> None:
    message = refusal(
        tmp_path, "wrong: 1\nsamples: x\npath:\n  kind: circle\n  radius_m: -1\n", Run
    )
    assert [line.split(": ")[0] for line in message.split("\n")] == [
        "file.yaml:1",
        "file.yaml:2",
        "file.yaml:5",
    ]


def test_a_good_document_becomes_the_model_with_lists_as_tuples(tmp_path: Path) -> None:
    document = load_yaml(
        write(tmp_path, "point_m: [1, 2.5, 1e-3]\npath: {kind: lissajous, duration_s: 120}\n")
    )
    run = parse_model(document, Run)
    assert run.point_m == (1.0, 2.5, 0.001)
    assert run.path == Lissajous(kind="lissajous", duration_s=120.0)


def test_a_check_of_the_model_itself_is_reported_at_the_key_it_names(tmp_path: Path) -> None:
    class Limits(Strict):
        lower: float
        upper: float

        @model_validator(mode="after")
        def _ordered(self) -> Limits:
            if self.lower >= self.upper:
                raise wrong_key("upper", message=f"expected more than lower, {self.lower:g}")
            return self

    assert (
        refusal(tmp_path, "lower: 2\nupper: 1\n", Limits)
        == "file.yaml:2: upper = 1: expected more than lower, 2."
    )


ROOT = Path(__file__).parents[2]
SHIPPED = sorted(
    file
    for folder in ("cell", "acquisition", "scenarios")
    for file in (ROOT / folder).rglob("*.yaml")
)


@pytest.mark.slow
def test_libyaml_and_pyyaml_read_every_shipped_description_alike(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fast = [load_yaml(path) for path in SHIPPED]
    monkeypatch.setattr(strict_yaml.yaml, "__with_libyaml__", False)
    slow = [load_yaml(path) for path in SHIPPED]
    assert len(SHIPPED) > 20
    assert [(one.data, one.places) for one in fast] == [(one.data, one.places) for one in slow]


@pytest.mark.parametrize("text", ["a: [1, b? c]\n", "a: {b: !length}\n", "a:\t1\n", "a: \t- 1\n"])
def test_what_libyaml_alone_would_take_is_judged_by_pyyaml(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    def outcome() -> object:
        try:
            return load_yaml(write(tmp_path, text)).data
        except DescriptionError as error:
            return str(error)

    fast = outcome()
    monkeypatch.setattr(strict_yaml.yaml, "__with_libyaml__", False)
    assert fast == outcome()


@pytest.mark.parametrize(
    "text", ["1e-12", "1e5", ".5", "0x1F", "0o17", "12", "yes", "null", "~", "-.inf", "2024-01-01"]
)
def test_text_that_looks_like_another_value_is_read_back_as_text(tmp_path: Path, text: str) -> None:
    """Regression: a row of a covariance that was `1e-12` came back as a number."""
    write_yaml(tmp_path / "a.yaml", {"row": [text, f"{text} 2"]})
    assert load_yaml(tmp_path / "a.yaml").data == {"row": [text, f"{text} 2"]}

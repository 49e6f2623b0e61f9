"""docs/scenario_reference.md has every key of a scenario, and every error source."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.scenario import Scenario
from ballbar.sim.settings import OF_POSES
from generators.scenario_reference.figures import PLOTS, read_sizes
from generators.scenario_reference.keys import keys_described, value_text
from generators.scenario_reference.keys import row as line_of
from generators.scenario_reference.page import PAGE, page_text
from generators.scenario_reference.sources import SOURCES

SECTIONS = ("plant", "errors", "encoders", "clocks", "logs")
ROUNDING = 5e-4  # defaults are printed to four digits


def held_model(annotation: Any) -> type[BaseModel] | None:
    """The settings model that a field holds, alone, as an option or in a tuple."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    models = [model for part in get_args(annotation) if (model := held_model(part))]
    return models[0] if models else None


def section_fields() -> Iterator[tuple[str, FieldInfo]]:
    """Dotted key and field of everything inside the sections of a scenario."""
    for section, outer in Scenario.model_fields.items():
        if model := held_model(outer.annotation):
            yield from ((f"{section}.{name}", info) for name, info in model.model_fields.items())
        else:
            yield section, outer


AS_ANOTHER = {"clocks.robot_wander": "clocks.wander"}  # with the same keys
SWITCHABLE = {
    key: model
    for key, info in section_fields()
    if key.startswith(SECTIONS) and key not in OF_POSES and (model := held_model(info.annotation))
}


@pytest.fixture(scope="module")
def page() -> str:
    """The page as committed; the models have their descriptions then, too."""
    keys_described()
    return PAGE.read_text(encoding="utf-8")


def row_of(page: str, key: str) -> str:
    """The text of one source: from its heading to the next."""
    rows: list[str] = re.findall(
        rf"^### {re.escape(key)}\n(.*?)(?=^#|^\*\*|\Z)", page, flags=re.MULTILINE | re.DOTALL
    )
    assert len(rows) == 1, f"{len(rows)} rows of {key}; run python -m generators.scenario_reference"
    return rows[0]


def printed(row: str, name: str) -> str:
    """Default in the line of a parameter."""
    values: list[str] = re.findall(rf"^\|`{re.escape(name)}`\|`([^`]*)`", row, flags=re.MULTILINE)
    assert len(values) == 1, f"{len(values)} times {name}"
    return values[0]


def as_default(text: str) -> Any:
    value = yaml.safe_load(text)
    if isinstance(value, str):
        try:
            return float(value)  # 5.0e7 is a number in YAML 1.2, text to this reader
        except ValueError:
            return value
    return tuple(as_default(str(item)) for item in value) if isinstance(value, list) else value


@pytest.mark.slow
def test_the_committed_page_is_what_the_generator_writes(page: str) -> None:
    assert page == page_text(), "run python -m generators.scenario_reference --text"
    assert not re.search(r"Annotated|NoneType|typing\.|<class", page)


def test_the_walk_finds_the_sources_of_every_section() -> None:
    assert {
        "errors.joint_compliance",
        "errors.slipped_periods",
        "errors.static",
        "clocks.wander",
        "logs.torque",
    } <= set(SWITCHABLE)
    assert len(SWITCHABLE) >= 32  # as many as there are today


@pytest.mark.parametrize("key", SWITCHABLE)
def test_every_switchable_error_source_has_its_row_and_plot(page: str, key: str) -> None:
    row = row_of(page, key)
    assert f"](images/effects/{key}.svg)" in row
    (source,) = (source for source in SOURCES if source.key == key)
    assert (f"Default: {source.origin}" in row) if source.origin else "Default: " not in row
    first = (SWITCHABLE[key].__doc__ or "?").splitlines()[0]
    assert (f"As `{AS_ANOTHER[key]}`." if key in AS_ANOTHER else first) in row


def test_every_key_of_a_scenario_stands_on_the_page(page: str) -> None:
    for key, info in section_fields():
        source, text = f"\n### {key}\n" in page, f"**`{key}`** "
        assert source or text in page or f"|`{key}`|" in page, key
        if source and key not in SWITCHABLE:
            assert as_default(printed(page, key)) == info.default
        inner = held_model(info.annotation) if text in page else None
        for each in inner.model_fields if inner else ():
            assert f"|`{each}`|" in re.split(r"\n#|\n\*\*", page.split(text)[1])[0]


def test_limits_and_choices_are_those_of_the_schema(page: str) -> None:
    for words in (
        "|`path.duration_s`|`required`|> 0, ≤ 3600|",
        "|`cell.ballbar_position_m`|`null`|3 numbers -20 to 20|",
        "|`identify.corrections`|`null`|at least 1 texts|",
        "|`noise_N`|`1.0`||",
        "|`identify.cost`|`ml`|`ml`, `length`,",
        "|list of integers 1 to 5|",
        "|`scale`|`1.0`||Factor on the stiffness",
        "|`delay_s`|`required`|-1 to 1|",
    ):
        assert words in page, words


def test_every_row_has_a_small_plot_and_every_plot_a_row() -> None:
    plots = {path.stem: path for path in PLOTS.glob("*.svg")}
    assert set(plots) == {source.key for source in SOURCES}
    for path in plots.values():
        text = path.read_text(encoding="utf-8")
        assert len(text) < 40_000, path.name
        assert (
            '<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="240pt" height="135pt"' in text
        )  # 320 x 180 px
        assert "<path" in text
    assert sum(path.stat().st_size for path in PLOTS.iterdir()) < 1_000_000


def test_the_size_of_every_error_source_was_measured() -> None:
    measured = {row["source"] for row in read_sizes()}
    assert {key for key in SWITCHABLE if key.startswith("errors.")} <= measured
    assert measured <= {source.key for source in SOURCES}


def test_a_changed_default_changes_what_is_printed() -> None:
    def item(default: float) -> str:
        field = FieldInfo(annotation=float, default=default, description="Total |width|.")
        return line_of("width_m", field)

    assumed = FieldInfo(annotation=float, default=5e-6, description="Total |width|. Assumed.")
    assert line_of("width_m", assumed) == item(5e-6)  # the head of the page says it of all
    assert item(5e-6) == "|`width_m`|`5.0e-6`||Total \\|width\\|.|\n"
    assert item(2e-6) == "|`width_m`|`2.0e-6`||Total \\|width\\|.|\n"
    needed = FieldInfo(annotation=float, description="When.")
    assert line_of("at_s", needed) == "|`at_s`|`required`||When.|\n"


@given(
    st.floats(min_value=1e-12, max_value=1e12)
    | st.floats(min_value=-1e12, max_value=-1e-12)
    | st.just(0.0)
)
def test_a_printed_number_reads_back_to_four_digits(value: float) -> None:
    assert float(value_text(value)) == pytest.approx(value, rel=ROUNDING)
    assert "." in value_text(value)

"""Defaults and limits of a scenario's keys are those of the published reference."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from ballbar.sim.settings import SimulationSettings
from generators.scenario_reference.keys import keys_described, models_in, row

PAGE = Path(__file__).parents[2] / "docs" / "scenario_reference.md"


def reached(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield model
    for field in model.model_fields.values():
        for inner in models_in(field.annotation):
            yield from reached(inner)


MODELS = sorted(
    {m for m in reached(SimulationSettings) if m.__module__.startswith("ballbar.sim.")},
    key=lambda model: model.__name__,
)


def test_the_settings_of_every_error_are_reached() -> None:
    assert len(MODELS) >= 60


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_key_has_the_default_and_limits_of_the_reference(model: type[BaseModel]) -> None:
    keys_described()
    page = PAGE.read_text()
    for name, field in model.model_fields.items():
        if not models_in(field.annotation):
            key, rest = row(field.alias or name, field).rstrip().split("|", 2)[1:]
            line = rf"^\|`(?:[\w.]+\.)?{key.strip('`')}`\|{re.escape(rest)}$"
            assert re.search(line, page, re.MULTILINE), row(name, field)

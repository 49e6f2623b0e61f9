"""Truth files and scenarios of earlier releases are refused with the remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from ballbar.cell.errors import DescriptionError
from ballbar.cell.schema_errors import RENAMED
from ballbar.cell.strict_yaml import load_model
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.truth import load_truth

SCENARIO = """\
cell: {robot: irb2400, ballbar: lund_600, ballbar_position_m: [0.7, 0.0, 0.54]}
path: {kind: lissajous, file: paths/irb2400_a.yaml, duration_s: 60}
"""


@pytest.mark.parametrize("old", RENAMED)
def test_a_renamed_key_is_refused_with_its_name_of_today(tmp_path: Path, old: str) -> None:
    section, key = old.split(".")
    file = tmp_path / "old.yaml"
    file.write_text(f"{SCENARIO}{section}: {{{key}: {{}}}}\n")
    with pytest.raises(DescriptionError) as caught:
        load_model(file, SimulationSettings)
    assert str(caught.value) == f"{file}:3: unknown key {old}: it is now {RENAMED[old]}."


def test_the_names_of_today_exist() -> None:
    for new in RENAMED.values():
        section, key = new.split(".")
        settings = SimulationSettings.model_fields[section].annotation
        assert settings is not None
        assert key in settings.model_fields


def test_the_truth_of_an_earlier_release_is_to_be_simulated_again(tmp_path: Path) -> None:
    """Regression: such a file met a list of missing keys, none of which said what to do."""
    file = tmp_path / "recording.truth.yaml"
    file.write_text("schema: ballbar-truth/1\nseed: 1\nsenses: {b1: 1}\n")
    with pytest.raises(DescriptionError) as caught:
        load_truth(file)
    assert str(caught.value) == (
        f"{file}:1: schema = 'ballbar-truth/1': this release reads ballbar-truth/2. "
        "Simulate it again."
    )

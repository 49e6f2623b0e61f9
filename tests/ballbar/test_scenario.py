"""Scenarios by file and by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from ballbar.scenario import SHIPPED, load_scenario, scenario_file
from cell.errors import DescriptionError
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

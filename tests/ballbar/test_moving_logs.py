"""The how-to page about moving logs of a real cell: its commands run on a measured robot."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from tests.helpers.command_line import ballbar
from tests.helpers.real_robots import DATA

VICON = DATA / "irb4400_vicon" / "record_20240711_144811.csv.gz"
PAGE = Path(__file__).parents[2] / "docs" / "how_to" / "moving_logs.md"


def commands() -> list[list[str]]:
    """The words of every command of the page's first block, without `ballbar`."""
    block = re.search(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert block is not None
    return [line.split()[1:] for line in block[1].splitlines() if line.startswith("ballbar ")]


def test_the_user_gives_at_most_four_options() -> None:
    options = [word for word in commands()[0] if word.startswith("--") and word != "--yes"]
    assert len(options) <= 4


@pytest.mark.slow
@pytest.mark.skipif(not VICON.exists(), reason="the measured robots are not beside the project")
def test_the_commands_of_the_page_lead_from_the_table_to_a_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cell.csv.gz").symlink_to(VICON)
    monkeypatch.chdir(tmp_path)
    said, codes = {}, {}
    for words in commands():
        codes[words[0]], said[words[0]], err = ballbar(*words)
    assert codes == {"new": 0, "check": 0, "identify": 1}, err
    assert "tracker log: 15" in said["check"]
    result = yaml.safe_load((tmp_path / "runs/cell-identified/calibration.yaml").read_text())
    (recording,) = result["recordings"]
    assert recording["position_rms_m"] < 2e-3
    assert "This path does not determine" in result["fit"]["verdict"]
    assert "step" not in said["check"]
    assert result["cross_validation"]["mean_m"] < result["fit"]["nominal_mean_m"]
    clock = recording["clock"]  # both begin within a few ms; a step would show as a skew of 100 ppm
    assert abs(clock["skew"] - 10e-6) < 15e-6

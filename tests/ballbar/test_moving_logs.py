"""The how-to page about moving logs of a real cell: its commands run on a measured robot."""

from __future__ import annotations

import gzip
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
        codes[words[0]], said[words[0]], _ = ballbar(*words)
    assert codes == {"new": 0, "check": 0, "identify": 1}  # 16 s do not determine the robot
    assert "Uncertain: " in said["identify"]
    assert "tracker log: 15" in said["check"]
    result = yaml.safe_load((tmp_path / "runs/cell-identified/calibration.yaml").read_text())
    (recording,) = result["recordings"]
    assert recording["position_rms_m"] < 2e-3
    assert "This path does not determine" in result["fit"]["verdict"]
    assert "step" not in said["check"]
    assert result["cross_validation"]["mean_m"] < result["fit"]["nominal_mean_m"]
    clock = recording["clock"]  # both begin within a few ms; a step would show as a skew of 100 ppm
    assert abs(clock["skew"] - 10e-6) < 15e-6


@pytest.mark.long
@pytest.mark.skipif(not VICON.exists(), reason="the measured robots are not beside the project")
def test_eight_seconds_beside_a_motion_capture_are_not_called_good(tmp_path: Path) -> None:
    """The first half of the log is fitted, the second held out: it is no worse than nominal."""
    with gzip.open(VICON, "rt") as file:
        head, *rows = file.readlines()
    halves = tmp_path / "first", tmp_path / "second"
    middle = len(rows) // 2
    for folder, part in zip(halves, (rows[:middle], rows[middle:]), strict=True):
        table = folder.with_suffix(".csv")
        table.write_text(head + "".join(part))
        named = ("--instrument", "tracker_point", "--values", "pv_x,pv_y,pv_z", "--yes")
        code, _, err = ballbar("new", str(folder), str(table), "--robot", "irb4400", *named)
        assert code == 0, err
    first, second = map(str, halves)
    code, out, _ = ballbar("identify", first, "--validate", second, "--out", str(tmp_path / "out"))
    assert (code, "Uncertain: " in out) == (1, True)
    assert "This path does not determine ra1, " in out
    stored = yaml.safe_load((tmp_path / "out" / "calibration.yaml").read_text())
    (held_out,) = stored["held_out"]
    assert held_out["mean_m"] < held_out["nominal_mean_m"]

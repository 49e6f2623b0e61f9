"""`ballbar verify` of a result made of recordings and still poses, with either of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.helpers.command_line import ballbar
from tests.helpers.pose_results import write_pose_table
from tests.helpers.simulated_recordings import Recorded
from tests.helpers.tracker_points import still_points

pytestmark = pytest.mark.slow


def written(folder: Path, recorded: Recorded, seed: int, turned: float = 0.0) -> Path:
    """Twelve points of the recorded robot; the zero of axis 4 turned by so much [rad]."""
    cell, truth = recorded.simulation.cell, recorded.simulation.truth
    table = still_points(cell, truth, seed)
    (group,) = table.groups
    q = group.q - [0.0, 0.0, 0.0, turned, 0.0, 0.0]
    table = replace(table, groups=(replace(group, q=q),))
    return write_pose_table(folder, table, "irb2400", q, "reflector")


@pytest.fixture(scope="module")
def mixed(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mixed")
    table = written(folder / "points", recorded, 1)
    code, _, error = ballbar(
        "identify", recorded.folder, table, "--out", folder / "result", "--samples", 300
    )
    assert code == 0, error
    return folder / "result"


def test_a_result_of_both_holds_for_its_recording(mixed: Path, recorded: Recorded) -> None:
    code, said, error = ballbar("verify", mixed, recorded.folder)
    assert (code, said.startswith("Holds: the loop closes to 0.0")) == (0, True), said + error


def test_a_result_of_both_holds_for_new_points(
    mixed: Path, recorded: Recorded, tmp_path: Path
) -> None:
    code, said, error = ballbar("verify", mixed, written(tmp_path / "today", recorded, 2))
    assert (code, said.startswith("Holds: 12 poses to 0.0")) == (0, True), said + error


def test_points_name_the_zero_of_an_axis_of_a_result_of_both(
    mixed: Path, recorded: Recorded, tmp_path: Path
) -> None:
    today = written(tmp_path / "today", recorded, 3, turned=1e-3)
    code, said, error = ballbar("verify", mixed, today, "--json")
    assert code == 1, error
    best = json.loads(said)["causes"][0]
    assert (best["kind"], best["name"], best["named"]) == ("axis", "4", True)
    assert best["size"][0] == pytest.approx(1e-3, abs=4.0 * best["sigma"][0])

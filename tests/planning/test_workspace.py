"""Workspaces of requests: boxes of the robot's axes, of a size over which an error can differ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.errors import DescriptionError
from ballbar.cell.load import load_robot
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.planning.request import load_request
from ballbar.planning.workspace import Workspace, workspace_grid
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import SCENARIOS

LOWER, UPPER = (-90.0, -20.0, -20.0, -90.0, -60.0, -90.0), (90.0, 40.0, 30.0, 90.0, 60.0, 90.0)


def test_by_default_the_workspace_is_the_accuracy_box_of_the_robot() -> None:
    robot = load_robot("irb2400")
    assert (workspace_grid(robot, None) == accuracy_grid(robot)).all()
    box = Workspace(lower_deg=LOWER, upper_deg=UPPER)
    assert not (workspace_grid(robot, box) == accuracy_grid(robot)).all()


def test_a_workspace_may_reach_to_the_ends_of_the_axes() -> None:
    robot = load_robot("irb2400")
    lower, upper = (np.degrees(end).tolist() for end in (robot.axis_lower, robot.axis_upper))
    box = Workspace(lower_deg=tuple(lower), upper_deg=tuple(upper))
    assert np.isfinite(workspace_grid(robot, box)).all()


@pytest.mark.parametrize(
    ("upper", "words"),
    [
        ((*UPPER[:5], -90.0), r"upper_deg\[5\].*expected more than lower_deg, -90"),
        ((*UPPER[:5], -91.0), r"upper_deg\[5\].*expected more than lower_deg, -90"),
        (UPPER[:5], "found 5 values, lower_deg has 6"),
    ],
)
@pytest.mark.parametrize("name", ["irb2400", "irb2400_tracker"])
def test_a_workspace_without_room_is_refused_by_its_key(
    name: str, upper: tuple[float, ...], words: str
) -> None:
    """A single pose was predicted to give 0.0 um, since the base is aligned to it."""
    changes = [f"workspace.lower_deg={list(LOWER)}", f"workspace.upper_deg={list(upper)}"]
    with pytest.raises(DescriptionError, match=words):
        load_request(SCENARIOS / "plans" / f"{name}.yaml", overrides=changes)


@pytest.mark.parametrize(
    ("axes", "end", "words"),
    [
        (5, 90.0, "5 values, but irb2400 has 6 axes. Give one for each axis"),
        (6, 900.0, "axis 1 from -90 to 900 deg, but irb2400 moves it from -180 to 180 deg"),
    ],
)
@pytest.mark.parametrize("name", ["irb2400", "irb2400_tracker"])
def test_a_workspace_of_another_robot_ends_with_a_sentence(
    tmp_path: Path, name: str, axes: int, end: float, words: str
) -> None:
    """Five values ended as a fault of the program."""
    lower, upper = list(LOWER[:axes]), [end, *UPPER[1:axes]]
    code, _, error = ballbar(
        *("plan", SCENARIOS / "plans" / f"{name}.yaml", "--out", tmp_path / "out"),
        *("--set", f"workspace.lower_deg={lower}", "--set", f"workspace.upper_deg={upper}"),
    )
    assert code == 2
    assert words in error
    assert not (tmp_path / "out").exists()

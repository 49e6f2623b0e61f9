"""A plan that is interrupted or made again leaves nothing that it does not stand for."""

from __future__ import annotations

import io
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from ballbar.plan import show as command
from ballbar.planning import plan as planned
from ballbar.planning.plan import plans
from ballbar.planning.request import load_request
from ballbar.planning.search import SearchProgress
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import SCENARIOS

REQUEST = SCENARIOS / "plans" / "irb2400.yaml"
PATH = SCENARIOS / "paths" / "irb2400_planned.yaml"
POSITION = (0.897, -0.195, 0.486)


def plan_into(folder: Path) -> None:
    silent = Console(file=io.StringIO())
    options = command.PlanOptions(
        folder=folder, seconds=0.0, out=silent, err=silent, path=PATH, position=POSITION
    )
    command.make_plan(load_request(REQUEST), REQUEST, options)


def test_ctrl_c_before_the_search_has_found_anything_keeps_the_first_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It ended as a fault of the program: StopIteration."""
    stopped = SearchProgress(stopped=True)
    monkeypatch.setattr(planned, "evaluating_processes", lambda *_: nullcontext())
    monkeypatch.setattr(planned, "search", lambda *_, **__: stopped)
    first, *calmer = plans(
        load_request(REQUEST),
        relative_to=REQUEST.parent,
        workers=1,
        seconds=10.0,
        evaluations=100,
        since=lambda: 1.0,
    )
    assert first.stopped
    assert first.tcp.max() < 1e-3
    for share, plan in zip(planned.CALMER, calmer, strict=True):  # for a servo beyond a limit
        before, after = (p.trajectory.acceleration for p in (first, plan))
        assert np.abs(after).max() == pytest.approx(share * np.abs(before).max(), rel=0.05)


def test_ctrl_c_while_it_runs_in_mujoco_leaves_no_unchecked_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """path.yaml and the controller's program stood there as if they had been checked."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "check_in_plant", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plan_into(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_answers_of_an_earlier_plan_do_not_stay_beside_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "check_in_plant", lambda *_: [])
    monkeypatch.setattr(command, "plan_picture", lambda _: b"")
    earlier = {"what_if.csv", "what_if.svg", "plate.svg"}
    for name in earlier | {"plan.svg", "plan.yaml"}:
        (tmp_path / name).write_text("of another plan")
    plan_into(tmp_path)
    left = {entry.name: entry.read_text() for entry in tmp_path.iterdir()}
    assert not earlier & set(left)
    assert {"plan.svg", "plan.yaml", "path.yaml", "request.yaml"} < set(left)
    assert "of another plan" not in left.values()


def test_a_position_without_a_path_is_refused(tmp_path: Path) -> None:
    """It was ignored, and the ball-bar planned elsewhere."""
    code, _, error = ballbar("plan", REQUEST, "--position", "0.7,0,0.5", "--out", tmp_path / "out")
    assert code == 2
    assert "--position belongs to --path" in error

"""The second path of the rehearsed day: planned after the first result, by the planner's files."""

from __future__ import annotations

import io
from pathlib import Path

from ballbar.cell.files import write_yaml
from ballbar.cell.strict_yaml import load_model, load_yaml
from ballbar.plan.show import PlanOptions, make_plan
from ballbar.planning.request import load_request
from ballbar.scenario import Scenario, with_absolute_names
from ballbar.sim.path_files import LissajousFile
from ballbar.terminal import PlainConsole

SEARCH = 10.0  # [s] of the search for the second path: the same search as of `plan`, shorter
REACH = 0.15  # [m] to each side of its first seat within which the ball-bar may be set up again
# [deg] about the vertical in which the rod of a telescoping bar may lean in its cup, as in
# scenarios/plans/ur10e_telescoping.yaml
CONE = 80.0
REQUEST, PLAN = "request.yaml", "plan"


def plan_second_path(
    scenario: Scenario, folder: Path, result: Path, named: Path
) -> tuple[Scenario, dict[str, float], bool]:
    """Plans in a folder the path that adds most to a result.

    named : folder to which the file names of the scenario are relative.

    Returns the scenario that records it, the predicted uncertainties [m] as in plan.yaml, and
    whether no limit is violated in MuJoCo.
    """
    plan, console = folder / PLAN, PlainConsole(file=io.StringIO())
    write_yaml(folder / REQUEST, request_data(scenario, named))
    options = PlanOptions(folder=plan, seconds=SEARCH, out=console, err=console, after=[result])
    feasible = make_plan(load_request(folder / REQUEST), folder / REQUEST, options)
    planned = load_yaml(plan / "plan.yaml").data
    if planned["search"]["stopped"]:  # a plan keeps its best path, a day does not go on
        raise KeyboardInterrupt
    return _along(scenario, plan / "path.yaml"), planned["tcp_sigma_m"], feasible


def _along(scenario: Scenario, path: Path) -> Scenario:
    """The scenario of the next recording, along a planned path."""
    position = load_model(path, LissajousFile).ballbar_position_m
    assert position is not None  # a plan states it
    changes = {
        "cell": scenario.cell.model_copy(update={"ballbar_position_m": position}),
        "path": scenario.needed_path.model_copy(update={"file": str(path.resolve())}),
        "recording": scenario.recording + 1,
    }
    return scenario.model_copy(update=changes)


def request_data(scenario: Scenario, relative_to: Path) -> dict[str, object]:
    """The planning request of a scenario's second path: its cell, times and sensors."""
    named = with_absolute_names(scenario, relative_to).cell
    position, encoders = named.position, scenario.encoders
    lower, upper = ((position + side).round(6).tolist() for side in (-REACH, REACH))
    request: dict[str, object] = {
        "schema": "ballbar-plan/1",
        "name": "path2",
        "timing": scenario.needed_path.model_dump(include={"duration_s", "dwell_s", "stops"}),
        "seed": scenario.seed,
    }
    cell: dict[str, object] = {
        "robot": named.robot,
        "plate": named.plate,
        "ballbar_region_m": {"lower": lower, "upper": upper},
    }
    if named.instrument is not None:
        seat = {"axis": [0.0, 0.0, 1.0], "cone_deg": CONE}
        return request | {"cell": cell | {"instrument": named.instrument, "seat": seat}}
    sensors = {"encoders": list(encoders.fitted)}
    return request | {"cell": cell | {"ballbar": named.ballbar}, "sensors": sensors}

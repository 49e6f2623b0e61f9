"""A path for a scenario that names none: the first that a plan of its cell finds."""

from __future__ import annotations

from pathlib import Path
from time import monotonic

from ballbar.cell.files import write_yaml
from ballbar.cell.load import load_robot
from ballbar.scenario import Scenario, with_absolute_names

CELL = {"robot", "ballbar", "instrument", "plate", "ballbar_position_m"}


def with_found_path(scenario: Scenario, folder: Path, file: Path) -> Scenario:
    """The scenario with a path and a place of the ball-bar where it states none.

    folder : of the scenario's file. file : to which the path is written. A ball-bar with fewer than
    two encoders is planned for with four. Raises InputError where no path is found in
    ballbar.planning.plan.SECONDS.
    """
    path, cell = scenario.path, scenario.cell
    if path is None or path.kind != "lissajous" or path.file:
        return scenario
    # A run whose path is known loads no planner.
    from ballbar.planning.files import planned_path_data  # noqa: PLC0415
    from ballbar.planning.plan import plans  # noqa: PLC0415
    from ballbar.planning.request import PlanRequest, completed  # noqa: PLC0415

    named, fitted = with_absolute_names(scenario, folder).cell, scenario.encoders.fitted
    data: dict[str, object] = {
        "schema": "ballbar-plan/1",
        "name": scenario.name,
        "cell": named.model_dump(include=CELL, exclude_none=True),
        "timing": path.model_dump(include={"duration_s", "dwell_s", "stops"}),
        "seed": scenario.seed,
    }
    if cell.ballbar is not None:
        data |= {"servo": scenario.plant.servo}
        data |= {"sensors": {"encoders": fitted}} if len(fitted) > 1 else {}
    request = completed(PlanRequest.model_validate(data), load_robot(named.robot))
    first = plans(request, relative_to=folder, workers=1, seconds=0, evaluations=0, since=monotonic)
    plan = next(first)
    write_yaml(file, planned_path_data(plan))
    place = tuple(plan.evaluation.candidate.position.tolist())
    path = path.model_copy(update={"file": str(file.resolve())})
    cell = cell.model_copy(update={"ballbar_position_m": place})
    return scenario.model_copy(update={"path": path, "cell": cell})

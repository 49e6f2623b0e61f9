"""A path for a scenario that names none: the first that a plan of its cell finds."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ballbar.scenario import Scenario, with_absolute_names
from cell.errors import InputError
from cell.files import write_yaml
from cell.load import load_robot
from planning.candidate import rounded
from planning.evaluation import evaluators
from planning.files import planned_path_data
from planning.plan import assess, first_path
from planning.request import PlanRequest, completed


@contextmanager
def with_found_path(scenario: Scenario, folder: Path) -> Iterator[Scenario]:
    """The scenario with a path and a place of the ball-bar where it states none.

    The path's file lasts as long as the context. folder : of the scenario's file. Raises InputError
    where no path is found in planning.plan.SECONDS.
    """
    path = scenario.path
    if path is None or path.kind != "lissajous" or path.file:
        yield scenario
        return
    request = _request(scenario, folder)
    of_rods = evaluators(request)
    first, _ = first_path(of_rods)
    evaluator = of_rods[first.rod]
    plan = assess(evaluator, rounded(evaluator.space.candidate(first.genome)))
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary) / "path.yaml"
        write_yaml(file, planned_path_data(plan))
        place = tuple(plan.evaluation.candidate.position.tolist())
        yield scenario.model_copy(
            update={
                "path": path.model_copy(update={"file": str(file)}),
                "cell": scenario.cell.model_copy(update={"ballbar_position_m": place}),
            }
        )


def _request(scenario: Scenario, folder: Path) -> PlanRequest:
    """The request of a scenario's cell, timing, encoders and servo.

    A ball-bar with fewer encoders than a plan takes is planned for with all of them.
    """
    path, cell = scenario.needed_path, with_absolute_names(scenario, folder).cell
    names = ("robot", "ballbar", "instrument", "plate", "ballbar_position_m")
    chosen = {name: value for name in names if (value := getattr(cell, name)) is not None}
    data: dict[str, object] = {
        "schema": "ballbar-plan/1",
        "name": scenario.name,
        "cell": chosen,
        "timing": path.model_dump(include={"duration_s", "dwell_s", "stops"}),
        "seed": scenario.seed,
    }
    if cell.instrument is None:
        data["servo"] = scenario.plant.servo
        if len(scenario.encoders.fitted) > 1:
            data["sensors"] = {"encoders": scenario.encoders.fitted}
    try:
        return completed(PlanRequest.model_validate(data), load_robot(cell.robot))
    except ValueError as error:
        raise InputError(f"path.file: none is named, and no path can be planned: {error}") from None

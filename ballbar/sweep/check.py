"""From a sweep file to its plan: every point is checked against the scenario's schema before anything runs.

The plan holds the hashes of the files that the scenario names, so that a file that changes cannot split a sweep in two.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ballbar.scenario import Scenario
from ballbar.sweep.file import Value, flattened, load_sweep, place_of
from ballbar.sweep.files import Files, digests, read_files
from ballbar.sweep.plan import Plan, point_of, scenario_data, with_changes
from ballbar.sweep.version import code_version
from cell.errors import DescriptionError, InputError
from cell.schema_errors import Loc, explain
from cell.strict_yaml import YamlDocument, load_yaml, parse_model

MAX_TOLD = 10  # refusals shown at once

_FILE_KEYS = (
    "path.file",
    "cell.robot",
    "cell.ballbar",
    "cell.plate",
)  # where a scenario names files


@dataclass(frozen=True, eq=False)
class LoadedSweep:
    """A sweep file, read."""

    plan: Plan
    files: Files  # that its scenarios name
    document: YamlDocument  # knows its lines


def load(path: Path) -> LoadedSweep:
    """A sweep, its points not yet checked.

    Raises DescriptionError naming file, line and key when the sweep or its scenario is wrong, InputError when a file that
    the scenario names cannot be read.
    """
    sweep, document = load_sweep(path)
    scenario_file = path.parent / sweep.scenario
    if not scenario_file.is_file():
        raise DescriptionError(
            f"{path}:{document.line_of(('scenario',))}: scenario = {sweep.scenario!r}: no such file {scenario_file}."
        )
    scenario = load_yaml(scenario_file)
    parse_model(scenario, Scenario)
    try:
        base = with_changes(scenario.data, flattened(sweep.change))
    except InputError as error:
        key = str(error).partition(":")[0]
        raise DescriptionError(
            f"{path}:{document.line_of(place_of(document, ('change',), key))}: {error}."
        ) from None
    data: dict[str, Any] = {
        "name": sweep.name,
        "version": code_version(),
        "scenario": base,
        "together": [flattened(row) for row in sweep.together or []],
        "vary": sweep.vary,
        "draw": {key: draw.model_dump(exclude_unset=True) for key, draw in sweep.draw.items()},
        "draws": sweep.draws,
        "seed": sweep.seed,
        "seeds": sweep.seeds.model_dump(),
    }
    files = read_files(_scenarios(data), scenario_file.parent)
    return LoadedSweep(Plan(json.dumps(data | {"files": digests(files)})), files, document)


def check_points(sweep: LoadedSweep) -> None:
    """Validates every point. Raises DescriptionError with a line for each thing that is wrong, up to ten."""
    plan, document = sweep.plan, sweep.document
    wrong: dict[tuple[int, str], None] = {}
    for point in range(plan.points):
        wrong |= dict.fromkeys(_wrong_at(plan, point, document))
        if len(wrong) >= MAX_TOLD:
            break
    if wrong:
        raise DescriptionError(
            "\n".join(f"{document.path}:{line}: {text}" for line, text in sorted(wrong)[:MAX_TOLD])
        )


def _wrong_at(plan: Plan, point: int, document: YamlDocument) -> list[tuple[int, str]]:
    """Line of the sweep file and sentence of everything that is wrong at a point."""
    values = point_of(plan, point)
    try:
        data = scenario_data(plan, values)
    except InputError as error:
        return [
            (
                document.line_of(_given_at(plan, point, str(error).partition(":")[0], document)),
                f"{error}.",
            )
        ]
    try:
        Scenario.model_validate_json(data, strict=True)
    except ValidationError as error:
        found = explain(error.errors(include_url=False), Scenario, json.loads(data))
        return [_told(loc, text, plan, point, document) for loc, text in found]
    return []


def _told(loc: Loc, text: str, plan: Plan, point: int, document: YamlDocument) -> tuple[int, str]:
    place = _given_at(plan, point, ".".join(map(str, loc)), document)
    if place or not plan.axes:
        return document.line_of(place), text
    return (
        document.line_of(()),
        f"{text.rstrip('.')}, with {json.dumps(point_of(plan, point))}.",
    )  # only together are they wrong


def _given_at(plan: Plan, point: int, key: str, document: YamlDocument) -> Loc:
    """Where the sweep file gives a point the value that stands at, above or below a key of the scenario; () if nowhere."""
    for axis in reversed(plan.axes):
        point, index = divmod(point, len(axis))
        for given in axis.rows[index]:
            if _meets(given, key):
                start: Loc = (
                    (axis.section, index) if axis.section == "together" else (axis.section,)
                )
                place = place_of(document, start, given)
                return (*place, index) if axis.section == "vary" else place
    for given in flattened(document.data.get("change", {})):
        if _meets(given, key):
            return place_of(document, ("change",), given)
    return ()


def _meets(given: str, key: str) -> bool:
    return f"{key}.".startswith(f"{given}.") or f"{given}.".startswith(f"{key}.")


def _scenarios(data: dict[str, Any]) -> Iterator[dict[str, Value]]:
    """The scenario, and with each row of the sweep alone: between them they name every file."""
    yield data["scenario"]
    for row in data["together"]:
        yield _changed(data["scenario"], row)
    for key, values in data["vary"].items():
        for value in values:
            yield _changed(data["scenario"], {key: value})


def _changed(scenario: dict[str, Value], changes: dict[str, Value]) -> dict[str, Value]:
    try:
        return with_changes(scenario, changes)
    except InputError:  # told, with its line, when the points are checked
        return {}

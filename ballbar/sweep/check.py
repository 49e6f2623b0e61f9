"""From a sweep file to its plan; every point is checked against the schema before anything runs.

The plan holds the hashes of the files that the scenario names, so that a file that changes cannot
split a sweep in two.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.extended_yaml import Value, load_extended, location_of, overlap, with_changes
from ballbar.cell.recording import load_recording_file
from ballbar.cell.schema_errors import Loc, explain
from ballbar.cell.strict_yaml import Place, YamlDocument
from ballbar.code_version import code_version
from ballbar.scenario import SCENARIOS, Scenario, load_scenario
from ballbar.sweep.chunk import Files
from ballbar.sweep.file import Changes, flattened, load_sweep_file
from ballbar.sweep.plan import Plan, PlanData, point_of, scenario_data, with_values

MAX_ERRORS = 10  # shown at once: about half a terminal

_PATH_FILE, _RECORDING = "path.file", "path.recording"


@dataclass(frozen=True, eq=False)
class LoadedSweep:
    """A sweep file as read."""

    plan: Plan
    files: Files  # files that its scenarios name
    document: YamlDocument  # knows its lines


def load_sweep(path: Path, overrides: Sequence[str] = ()) -> LoadedSweep:
    """A sweep whose points are not yet checked.

    overrides : texts `KEY=VALUE` that replace values of the sweep file.

    Raises DescriptionError naming file, line and key when the sweep or its scenario is wrong,
    InputError when a file that the scenario names cannot be read.
    """
    sweep, document = load_sweep_file(path, overrides)
    scenario_file = path.parent / sweep.scenario
    if not scenario_file.is_file():
        raise DescriptionError(
            f"{document.place_of(('scenario',))}: scenario = {sweep.scenario!r}: "
            f"no such file {scenario_file}. Name it relative to the sweep file."
        )
    scenario = load_extended(scenario_file, SCENARIOS)
    load_scenario(scenario_file, moving=True)
    try:
        base = with_changes(scenario.data, flattened(sweep.change))
    except InputError as error:
        place = document.place_of(_written(document, ("change",), _key_of(error)))
        raise DescriptionError(f"{place}: {error}.") from None
    together = [flattened(row) for row in sweep.together or []]
    files = read_files(_scenarios(base, together, sweep.vary), scenario_file.parent)
    data = PlanData(
        name=sweep.name,
        version=code_version(),
        scenario=base,
        together=together,
        vary=sweep.vary,
        draw=sweep.draw,
        draws=sweep.draws,
        seed=sweep.seed,
        seeds=sweep.seeds,
        files={name: hashlib.sha256(content).hexdigest() for name, content in files},
    )
    return LoadedSweep(Plan.of(data), files, document)


def check_points(sweep: LoadedSweep) -> None:
    """Validates every point.

    Raises DescriptionError with a line for each error, up to MAX_ERRORS.
    """
    plan, document = sweep.plan, sweep.document
    errors: dict[tuple[Place, str], None] = {}
    for point in range(plan.points):
        errors |= dict.fromkeys(_errors_at(plan, point, document))
        if len(errors) >= MAX_ERRORS:
            break
    if errors:
        lines = (f"{place}: {text}" for place, text in sorted(errors)[:MAX_ERRORS])
        raise DescriptionError("\n".join(lines))


def _errors_at(plan: Plan, point: int, document: YamlDocument) -> list[tuple[Place, str]]:
    """Place in the sweep file and sentence of every error at a point."""
    values = point_of(plan, point)
    try:
        data = scenario_data(plan, values)
    except InputError as error:
        return [(document.place_of(_source_of(plan, point, _key_of(error), document)), f"{error}.")]
    try:
        Scenario.model_validate_json(data, strict=True)
    except ValidationError as error:
        located = []
        for loc, text in explain(error.errors(include_url=False), Scenario, json.loads(data)):
            location, sentence = _source_of(plan, point, ".".join(map(str, loc)), document), text
            if not location and plan.axes:  # caused by no single value of the sweep
                sentence = f"{text.rstrip('.')}, with {json.dumps(values)}."
            located.append((document.place_of(location), sentence))
        return located
    return []


def _source_of(plan: Plan, point: int, key: str, document: YamlDocument) -> Loc:
    """Where the sweep file gives a point the value at, above or below a key of the scenario.

    () when it is nowhere in the sweep file.
    """
    for axis in reversed(plan.axes):
        point, index = divmod(point, len(axis))
        for varied in axis.rows[index]:
            if overlap(varied, key):
                row = (index,) if axis.section == "together" else ()
                location = _written(document, (axis.section, *row), varied)
                return (*location, index) if axis.section == "vary" else location
    for changed in flattened(document.data.get("change", {})):
        if overlap(changed, key):
            return _written(document, ("change",), changed)
    return ()


def _written(document: YamlDocument, start: Loc, key: str) -> Loc:
    """Location of a dotted key below `start`, whether its dots are nested mappings or not."""
    node: Value = document.data
    for step in start:
        node = node[step]
    return (*start, *location_of(node, key))


def _scenarios(
    base: dict[str, Value], together: list[Changes], vary: dict[str, list[Value]]
) -> Iterator[dict[str, Value]]:
    """The scenario, and with each value of the sweep alone: between them they name every file."""
    yield base
    grid = [{key: value} for key, values in vary.items() for value in values]
    for changes in (*together, *grid):
        try:
            yield with_values(base, changes)
        except InputError:
            continue  # reported with its line when the points are checked


def _key_of(error: InputError) -> str:
    """The dotted key with which the message of `with_changes` begins."""
    return str(error).partition(":")[0]


def read_files(scenarios: Iterable[Mapping[str, Any]], folder: Path) -> Files:
    """Every file that one of the scenarios names.

    scenarios : plain data, checked or not. folder : folder of the scenario file.

    Raises InputError when a file cannot be read.
    """
    contents: dict[str, bytes] = {}
    for key, name in sorted({named for scenario in scenarios for named in _named(scenario)}):
        for file in _recording_files(folder, name) if key == _RECORDING else [name]:
            try:
                contents[file] = (folder / file).read_bytes()
            except OSError as error:
                raise InputError(
                    f"{key} = {name!r}: {folder / file} cannot be read: {error.strerror}. "
                    "Correct the name."
                ) from None
    return tuple(sorted(contents.items()))


def _named(scenario: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Key and name of each file or recording that a scenario names."""
    for key in (*SCENARIOS.descriptions, _PATH_FILE, _RECORDING):
        section, _, last = key.partition(".")
        below = scenario.get(section)
        name = below.get(last) if isinstance(below, dict) else None
        described = key in SCENARIOS.descriptions
        if isinstance(name, str) and name and (not described or name.endswith(".yaml")):
            yield key, name


def _recording_files(folder: Path, name: str) -> list[str]:
    """recording.yaml, the device files, and the descriptions that are not the shipped ones."""
    content = load_recording_file(folder / name)
    sources = content.sources.named.values()
    device = [file for source in sources for file in source.files]
    described = [content.robot, content.measured_by, content.plate]
    users = [file for file in described if file.endswith(".yaml")]
    return [f"{name}/{file}" for file in ("recording.yaml", *device, *users)]

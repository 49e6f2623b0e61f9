"""Files that a sweep's scenarios name: kept with the sweep, and sent to workers on other machines.

They are found by the names in the scenario, also where those lead out of its folder
(`../paths/a.yaml`). An absolute name is left as it is: its file counts for the plan, but must be on
every machine.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ballbar.scenario import SCENARIOS
from cell.errors import InputError
from cell.recording import load_recording_file

Files = tuple[tuple[str, bytes], ...]  # (name in the scenario, content), in order of the names

_PATH_FILE, _RECORDING = "path.file", "path.recording"


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


def unpack(files: Files, top: Path) -> None:
    """Writes the files below `top`, to where their names lead from `scenario_folder`.

    Files with absolute names are left out.
    """
    folder = scenario_folder((name for name, _ in files), top)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files:
        if not Path(name).is_absolute():
            path = folder / os.path.normpath(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def scenario_folder(names: Iterable[str], top: Path) -> Path:
    """The folder below `top` that lies as deep as the names lead up."""
    depth = max((Path(os.path.normpath(name)).parts.count("..") for name in names), default=0)
    return Path(top, *["scenario"] * depth)


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
    sources = content.sources.every
    device = [file for source in sources for file in source.files]
    described = [content.robot, content.measured_by, content.plate]
    users = [file for file in described if file.endswith(".yaml")]
    return [f"{name}/{file}" for file in ("recording.yaml", *device, *users)]

"""Where a report comes from: command, versions, input files with their hashes.

Nothing in it names a folder of this computer.
"""

from __future__ import annotations

import hashlib
import platform
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath, PureWindowsPath

from ballbar.acquisition.recording import Recording
from ballbar.cell.plugins import LOADED
from ballbar.report.section import MACHINE, Section, section
from ballbar.result.run_data import RunData

_PACKAGES = ("ballbar-bench", "numpy", "scipy", "pydantic", "pyyaml", "jinja2")
_SIMULATOR = "mujoco-core"


@dataclass(frozen=True)
class InputFile:
    """An input file of a run."""

    name: str  # relative to the recording folder
    size: int  # [bytes]
    sha256: str


def provenance_section(run: RunData, command: str, written: datetime) -> Section:
    """The origin of a report; command : as the user typed it.

    Raises OSError when an input file is gone.
    """
    simulation = run.simulation
    cell = run.identification.robot.cell if run.recordings else None
    return section(
        "provenance.html",
        {"provenance": "Provenance"},
        MACHINE if cell else "",
        command=without_folders(command),
        cell=cell,
        seed=simulation.truth.seed if simulation else None,
        versions=versions(simulated=simulation is not None),
        inputs=_inputs(run),
        written=f"{written:%Y-%m-%d %H:%M:%S} UTC",
    )


def _inputs(data: RunData) -> list[InputFile]:
    """The files of every recording, below its name where there are several, and every table."""
    files = [hashed(scenario.parent, scenario.name) for scenario in data.scenario_files]
    for prefix, folder, name in input_places(data):
        file = hashed(folder, name)
        files.append(replace(file, name=f"{prefix}{file.name}"))
    return files


def input_places(data: RunData) -> Iterator[tuple[str, Path, str]]:
    """(prefix, folder, name) of each file of every recording and table; the prefix tells them
    apart.
    """
    for name, recording in data.read:
        several = len(data.read) > 1
        for file in input_names(recording):
            yield f"{name}/" if several else "", recording.folder or Path(), file
    held_out = [(outcome.name, content) for content, outcome in data.held_out_tables]
    for name, content in (*data.tables, *held_out):
        if (described := content.file) is None:  # poses that were given as arrays
            continue
        for each in dict.fromkeys((described.name, *(f.file for f in content.report.files))):
            yield f"{name}/", described.parent, each


def versions(*, simulated: bool) -> list[tuple[str, str]]:
    """(package, version) of Python and of what computed the numbers, plug-ins included, and made
    the page.
    """
    packages = (*_PACKAGES, _SIMULATOR) if simulated else _PACKAGES
    own = [("python", platform.python_version()), *((name, _version(name)) for name in packages)]
    return own + sorted(LOADED.items())


def input_files(recording: Recording) -> list[InputFile]:
    """The files of `input_names`. Raises OSError when one of them is gone."""
    return [hashed(recording.folder or Path(), name) for name in input_names(recording)]


def input_names(recording: Recording) -> list[str]:
    """recording.yaml, the device files, and the descriptions that the recording brings itself.

    Of logs that were given as arrays there are none.
    """
    file = recording.description
    if recording.folder is None:
        return []
    descriptions = [
        name
        for name in (file.robot, file.measured_by, file.plate)
        if name.endswith(".yaml") and not _is_absolute(name)
    ]
    return ["recording.yaml", *(source.file for source in recording.report.files), *descriptions]


def hashed(folder: Path, name: str) -> InputFile:
    """Size and SHA-256 of a file of `folder`. Raises OSError."""
    with (folder / name).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return InputFile(name, file.tell(), digest)


def without_folders(command: str) -> str:
    """The command with every absolute path cut down to its last part."""
    try:
        words = shlex.split(command)
    except ValueError:  # an open quotation mark: not a command of ours, shown word by word
        words = command.split()
    return " ".join(f'"{word}"' if " " in word else word for word in map(_cut, words))


def _cut(word: str) -> str:
    option, equals, value = word.rpartition("=")
    return f"{option}{equals}…/{PureWindowsPath(value).name}" if _is_absolute(value) else word


def _is_absolute(path: str) -> bool:
    return PurePosixPath(path).is_absolute() or bool(PureWindowsPath(path).drive)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"

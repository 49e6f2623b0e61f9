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

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.acquisition.table.text import MOST_BYTES
from ballbar.cell.foreign_files import open_regular
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
        shown = PureWindowsPath(name).name if _is_absolute(name) else name
        files.append(replace(hashed(folder, name), name=f"{prefix}{shown}"))
    return files


def input_places(data: RunData) -> Iterator[tuple[str, Path, str]]:
    """(prefix, folder, name) of each file of every recording and table; the prefix tells them
    apart.

    Of logs and poses that were given as arrays there are none.
    """
    for name, recording in data.read:
        prefix = f"{name}/" if len(data.read) > 1 else ""
        file = recording.folder and recording.folder / "recording.yaml"
        yield from _places(prefix, file, recording)
    held_out = [(outcome.name, content) for content, outcome in data.held_out_tables]
    for name, content in (*data.tables, *held_out):
        yield from _places(f"{name}/", content.file, content)


def _places(
    prefix: str, file: Path | None, read: Recording | PoseImport
) -> Iterator[tuple[str, Path, str]]:
    """A file that describes measured data, the data, and the descriptions that it brings itself."""
    if file is not None:
        keys = ("robot", "ballbar", "instrument", "plate")
        named = [getattr(read.description, key, None) for key in keys]
        named += [table.instrument for table in getattr(read.description, "tables", ())]
        described = [name for name in named if name and name.endswith(".yaml")]
        data = [source.file for source in read.report.files]
        for name in dict.fromkeys((file.name, *data, *described)):
            yield prefix, file.parent, name


def versions(*, simulated: bool) -> list[tuple[str, str]]:
    """(package, version) of Python and of what computed the numbers, plug-ins included, and made
    the page.
    """
    packages = (*_PACKAGES, _SIMULATOR) if simulated else _PACKAGES
    own = [("python", platform.python_version()), *((name, _version(name)) for name in packages)]
    return own + sorted(LOADED.items())


def hashed(folder: Path, name: str) -> InputFile:
    """Size and SHA-256 of a regular file of `folder`. Raises OSError."""
    with open_regular(folder / name, MOST_BYTES) as file:
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

"""recording.yaml: how to read the device files of one run (schema `ballbar-recording/1`).

Written by the simulator, or by hand for a real run; read by acquisition. It never holds a true parameter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from cell.errors import DescriptionError
from cell.schema import Strict
from cell.strict_yaml import load_model

EncoderName = Literal["b1", "b2", "b3", "b4", "b5"]
SourceName = Literal["robot", "ballbar", "force"]  # the sources of a recording


class SourceFile(Strict):
    """The device files of one side, and the dialect they are written in."""

    files: Annotated[
        tuple[str, ...], Field(min_length=1)
    ]  # relative to recording.yaml; .gz, .bz2 and .xz are unpacked
    dialect: str  # a shipped one, or a file of the recording folder that ends in .yaml
    time: str | None = (
        None  # form of the time stamps (acquisition.times), where they do not tell it themselves
    )
    columns: tuple[str, ...] | None = None  # names of all columns, for files without header
    quantised: bool = False  # the rows were taken evenly, but the clock of the stamps steps by more than can be neglected


class Sources(Strict):
    """Both sides of a recording."""

    robot: SourceFile
    ballbar: SourceFile | None = None  # none for a sensor-less ball-bar
    force: SourceFile | None = None  # six-axis sensor at the flange, on a clock of its own


class EncoderFitting(Strict):
    """One ball-bar encoder: counter column, resolution and declared sense of rotation."""

    column: str
    lines: Annotated[int, Field(gt=0)]
    bits: Annotated[int, Field(ge=8, le=13)]  # EL5021 object 8001:11
    sign: Literal[-1, 1] = 1


class RecordingFile(Strict):
    """recording.yaml"""

    schema_: Annotated[Literal["ballbar-recording/1"], Field(alias="schema")]
    kind: Literal["simulated", "real"]
    robot: str  # a file of cell/robots, or a path relative to this file
    ballbar: str  # a file of cell/ballbars, or a path
    plate: str = "plate_250"  # a file of cell/plates, or a path
    sources: Sources
    encoders: dict[EncoderName, EncoderFitting] = Field(default_factory=dict)
    notes: str = ""


def load_recording_file(folder: Path) -> RecordingFile:
    """The checked content of `folder/recording.yaml`.

    Raises DescriptionError naming file, line and key.
    """
    file = folder / "recording.yaml"
    if not file.exists() and (folder / "recording" / file.name).exists():
        raise DescriptionError(f"{file}: no such file. Is {folder / 'recording'} meant?")
    return load_model(file, RecordingFile)

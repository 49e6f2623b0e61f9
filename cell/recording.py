"""recording.yaml: how to read the device files of one run (schema `ballbar-recording/1`).

The simulator writes it, or a person for a real run; acquisition reads it. It holds no true
parameter.
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
    """The device files of one source, and the dialect they are written in."""

    # relative to recording.yaml; .gz, .bz2 and .xz are unpacked
    files: Annotated[tuple[str, ...], Field(min_length=1)]
    dialect: str  # a shipped one, or a file of the recording folder that ends in .yaml
    time: str | None = None  # form of the time stamps, where the stamps do not show it themselves
    columns: tuple[str, ...] | None = None  # names of all columns, for files without header
    # whether evenly taken rows have stamps of a clock with coarse steps
    quantised: bool = False


class Sources(Strict):
    """The sources of a recording."""

    robot: SourceFile
    ballbar: SourceFile | None = None  # none for a ball-bar without encoders
    force: SourceFile | None = None  # six-axis sensor at the flange, on a clock of its own


class EncoderFitting(Strict):
    """One ball-bar encoder: counter column, resolution and declared direction."""

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
        raise DescriptionError(
            f"{file}: no such file. Is {folder / 'recording'} meant? Name that folder."
        )
    return load_model(file, RecordingFile)

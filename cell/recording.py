"""recording.yaml: how to read the device files of one run (schema `ballbar-recording/1`).

The simulator writes it, or a person for a real run; acquisition reads it. It holds no true
parameter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from ballbar.cell.errors import DescriptionError
from ballbar.cell.file_units import AngleUnit, LogLengthUnit, Rotation
from ballbar.cell.logs import SourceName
from ballbar.cell.schema import Day, EncoderLines, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import load_model
from ballbar.cell.temperature import Temperatures

EncoderName = Literal["b1", "b2", "b3", "b4", "b5"]


class SourceFile(Strict):
    """The device files of one source, and the dialect they are written in."""

    files: Annotated[tuple[str, ...], Field(min_length=1)]
    """Relative to recording.yaml; .gz, .bz2 and .xz are unpacked."""
    dialect: str
    """A shipped one, or a file of the recording folder that ends in .yaml."""
    time: str | None = None
    """Form of the time stamps, where the stamps do not show it themselves."""
    columns: tuple[str, ...] | None = None
    """Names of all columns, for files without header."""
    damaged_rows: Annotated[int, Field(ge=0)] = 0
    """Rows of each file with cells that are no number, up to which they are left out and reported;
    a log with more is refused.
    """
    quantised: bool | None = None
    """Whether evenly taken rows have stamps of a clock with coarse steps; by default as the stamps
    show it.
    """


class LengthFile(SourceFile):
    """The device files of a sensor of one length, and the column that holds it."""

    column: str = Field(description="Column of the length.")
    unit: LogLengthUnit = Field("mm", description="Unit of that column.")
    zero_m: float = 0.0
    """Length where the column is zero, as the instrument declares it."""


class RotationColumns(Strict):
    """The columns in which a log holds the orientation of its target."""

    columns: Annotated[tuple[str, ...], Field(min_length=3, max_length=4)]
    """Three angles, a rotation vector, or a quaternion."""
    form: Rotation
    """Form of the rotation, as `values.rotation` of poses.yaml has it: `quat_wxyz`, `quat_xyzw`,
    `rotvec`, or angles in the order of scipy's `Rotation.from_euler`.
    """
    unit: AngleUnit = Field("rad", description="Unit of angles.")

    @model_validator(mode="after")
    def _count(self) -> Self:
        if len(self.columns) != 3 + self.form.startswith("quat"):
            message = f"{len(self.columns)} columns do not hold a rotation of the form {self.form}"
            raise wrong_key("columns", message=message)
        return self


class TrackerFile(SourceFile):
    """The device files of a tracker that follows a target on the tool: a reflector, an LED, or a
    body of markers whose orientation is measured too.
    """

    unit: LogLengthUnit = Field("mm", description="Unit of the coordinates.")
    rotation: RotationColumns | None = None
    """Orientation of the target in the tracker's frame, where it is measured."""
    accuracy_m: Annotated[float, Field(gt=0.0, le=0.01)] | None = None
    """Standard deviation along each axis; by default that of `instrument`, beside a ball-bar 90 um
    (thesis sec. 5.3: Nikon K600).
    """
    accuracy_rad: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """Standard deviation of the orientation about each axis; by default that of `instrument`."""


class Sources(Strict):
    """The sources of a recording."""

    robot: SourceFile
    ballbar: SourceFile | None = None  # none for a ball-bar without encoders
    length: LengthFile | None = None  # of an instrument whose rod or wire is sensed
    force: SourceFile | None = None  # six-axis sensor at the flange, on a clock of its own
    tracker: TrackerFile | None = None  # by itself, or beside a ball-bar or a length

    @property
    def named(self) -> dict[SourceName, SourceFile]:
        """The sources that the recording has, by their names."""
        every = ((name, getattr(self, name)) for name in get_args(SourceName))
        return {name: source for name, source in every if source is not None}


class EncoderFitting(Strict):
    """One ball-bar encoder: counter column, resolution and declared direction."""

    column: str = Field(description="Column of the counter.")
    lines: EncoderLines = Field(description="Lines per turn.")
    bits: Annotated[int, Field(ge=8, le=13)]
    """Interpolation of one line (EL5021 object 8001:11)."""
    sign: Literal[-1, 1] = Field(1, description="Declared direction.")


class RecordingFile(Temperatures):
    """recording.yaml"""

    schema_: Annotated[Literal["ballbar-recording/1"], Field(alias="schema")]
    kind: Literal["simulated", "real"] = Field(description="Where the logs come from.")
    robot: str = Field(description="A file of cell/robots, or a path relative to this file.")
    ballbar: str | None = Field(None, description="A file of cell/instruments, or a path.")
    instrument: str | None = None
    """A file of cell/instruments, or a path: what measured the length, or followed the target, in
    place of a ball-bar.
    """
    plate: str = Field("plate_250", description="A file of cell/plates, or a path.")
    sources: Sources
    encoders: dict[EncoderName, EncoderFitting] = Field(
        default_factory=dict, description="The ball-bar's, b1 to b5."
    )
    measured_on: Day | None = None
    """Day of the measurement, such as 2026-03-31; by default as the time stamps show it."""
    notes: str = Field("", description="Anything else that is to be remembered.")

    @model_validator(mode="after")
    def _ballbar_or_instrument(self) -> Self:
        if (self.ballbar is None) == (self.instrument is None):
            message = "expected either ballbar or instrument: what stood between floor and tool"
            raise wrong_key("ballbar", message=message)
        of_length, other = self.sources.length is not None, self.instrument is not None
        if (of_length and not other) or (other and not of_length and not self.followed):
            message = "expected sources.length of an instrument that measures a length alone, or "
            message += "sources.tracker of one that follows a target"
            raise wrong_key("sources", message=message)
        if other and (self.sources.ballbar is not None or self.encoders):
            message = "an instrument in place of a ball-bar has no encoders; leave out " + (
                "encoders" if self.encoders else "sources.ballbar"
            )
            raise wrong_key("encoders" if self.encoders else "sources", message=message)
        return self

    @property
    def followed(self) -> bool:
        """Whether a tracker alone measured: nothing held the tool."""
        sources = self.sources
        return bool(self.instrument) and sources.length is None and sources.tracker is not None

    @property
    def measured_by(self) -> str:
        """The ball-bar or the instrument that held the tool."""
        return self.ballbar or self.instrument or ""


def load_recording_file(folder: Path) -> RecordingFile:
    """The checked content of `folder/recording.yaml`.

    Raises DescriptionError naming file, line and key.
    """
    file = folder / "recording.yaml"
    if not file.exists() and (folder / "recording" / file.name).exists():
        what = f"no such file. Is {folder / 'recording'} meant?"
        raise DescriptionError.at(file, what, "Name that folder.")
    return load_model(file, RecordingFile)

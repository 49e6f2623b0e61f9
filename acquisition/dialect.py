"""Dialects: how one kind of logger writes its table, as data in `acquisition/dialects/*.yaml`.

The table reader is one; a dialect tells it the separators, the time column and its unit, and which columns hold what.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from cell.errors import DescriptionError
from cell.recording import EncoderName
from cell.schema_errors import nearest
from cell.strict_yaml import load_model

_FOLDER = Path(__file__).parent / "dialects"

SourceName = Literal["robot", "ballbar", "force"]  # the sources of recording.yaml
_Unit = Literal["ns", "us", "s"]
TICKS_PER_SECOND: dict[_Unit, int] = {"ns": 1_000_000_000, "us": 1_000_000, "s": 1}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class TimeColumn(_Strict):
    """The time stamps: integers stay exact, float seconds count from any origin."""

    column: str
    type: Literal["integer", "float"]
    unit: _Unit


class Dialect(_Strict):
    """One kind of device log. Encoder counters are named by the recording, the rest by the dialect."""

    schema_: Annotated[Literal["ballbar-dialect/1"], Field(alias="schema")]
    source: SourceName
    container: Literal["text", "twincat-scope", "json-lines", "egm", "rosbag", "abb-mpe"] = "text"
    separators: tuple[Literal[",", ";", "\t"], ...] = ()  # of a text
    time: TimeColumn
    motors: tuple[str, ...] = ()  # robot: the six motor angles [rad at the motor], in order of the joints
    axes: tuple[str, ...] = ()  # or the six angles that the controller shows
    angle_unit: Literal["rad", "deg"] = "rad"
    torques: tuple[str, ...] = ()  # robot: what each motor exerts [N m at the motor], positive along its angle; all six or none
    status: dict[EncoderName, str] = {}  # ballbar: EL5021 status word of each encoder; columns may be absent
    wrench: tuple[str, ...] = ()  # force: forces x y z [N], torques x y z [N m], what the flange feels in its own frame
    period_s: tuple[float, float]  # a median period outside this range is reported


def dialect_names() -> list[str]:
    """The names of all dialects, sorted."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def load_dialect(name: str) -> Dialect:
    """The dialect of that name.

    Raises DescriptionError naming the known ones, and the nearest.
    """
    if name not in dialect_names():
        raise DescriptionError(f"unknown dialect {name!r}.{nearest(name, dialect_names(), noun='dialect')}")
    return load_model(_FOLDER / f"{name}.yaml", Dialect)

"""Dialects: how one kind of logger writes its table, as data in `acquisition/dialects/*.yaml` or in a file of the user's.

The table reader is one; a dialect tells it the separators, the time column and its forms, and which columns hold what. A
column is named, found by a regular expression, or counted (acquisition.table.selectors).
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from acquisition.table.selectors import by_position, checked, spread
from acquisition.times import TimeForm
from cell.errors import DescriptionError
from cell.recording import EncoderName, SourceName
from cell.schema_errors import nearest
from cell.strict_yaml import load_model

_FOLDER = Path(__file__).parents[1] / "dialects"

Side = Literal["motors", "axes", "joints"]
Container = Literal["text", "twincat-scope", "json-lines", "egm", "rosbag", "abb-mpe"]
Separator = Literal[",", ";", "\t", " "]  # blank: any run of blanks
Selector = Annotated[str, AfterValidator(checked)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class TimeColumn(_Strict):
    """The time stamps: one declared unit, counted from any start, or several forms among which the stamps themselves tell."""

    column: Selector
    type: Literal["integer", "float"] | None = None
    unit: Literal["s", "ms", "us", "100ns", "ns"] | None = None
    forms: tuple[TimeForm, ...] = ()
    halves: tuple[Selector, Selector] | None = (
        None  # low and high 32 bits, read where `column` is absent
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if bool(self.forms) == (self.unit is not None):
            raise ValueError("give either unit, or forms to tell apart")
        return self

    @property
    def possible(self) -> tuple[TimeForm, ...]:
        """The forms a stamp may have."""
        return self.forms or ((self.unit,) if self.unit else ())


class Dialect(_Strict):
    """One kind of device log. Encoder counters are named by the recording, the rest by the dialect."""

    schema_: Annotated[Literal["ballbar-dialect/1"], Field(alias="schema")]
    source: SourceName
    container: Container = "text"
    separators: tuple[Separator, ...] = ()
    decimal: Literal["either", "point", "comma"] = "either"  # of numbers that are no integers
    time: TimeColumn
    motors: tuple[Selector, ...] = ()  # robot: the six motor angles, in order of the joints,
    axes: tuple[Selector, ...] = ()  # or the six angles that the controller shows,
    joints: tuple[Selector, ...] = ()  # or the six angles of the DH model
    angle_unit: Literal["rad", "deg"] = "rad"
    torques: tuple[
        Selector, ...
    ] = ()  # robot: what each motor exerts [N m at the motor], positive along its angle; all six or none
    sequence: Selector | None = (
        None  # number that grows with each row taken; the column may be absent
    )
    status: dict[
        EncoderName, Selector
    ] = {}  # ballbar: EL5021 status word of each encoder; columns may be absent
    wrench: tuple[
        Selector, ...
    ] = ()  # force: forces x y z [N], torques x y z [N m], what the flange feels in its own frame
    period_s: tuple[float, float]  # a median period outside this range is reported

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.container == "text" and not self.separators:
            raise ValueError("separators: name at least one of ',', ';', tab and blank")
        sides = [side for side in ("motors", "axes", "joints") if getattr(self, side)]
        if self.source == "robot" and len(sides) != 1:
            raise ValueError("a robot's dialect names one of motors, axes and joints")
        if self.source != "robot" and (sides or self.torques):
            raise ValueError(
                f"motors, axes, joints and torques are a robot's, not of a {self.source} log"
            )
        if (self.source == "force") != bool(self.wrench):
            raise ValueError("wrench: six columns, of a force sensor's log only")
        for what, columns in (
            *((side, self._selectors(side)) for side in sides),
            ("torques", self._selectors("torques")),
        ):
            if columns and len(columns) != 6:
                raise ValueError(f"{what}: six columns, or one `re:` that finds six")
        if self.wrench and len(self.wrench) != 6:
            raise ValueError("wrench: six columns")
        if not 0.0 < self.period_s[0] < self.period_s[1]:
            raise ValueError("period_s: shortest and longest usual period")
        return self

    @property
    def side(self) -> Side:
        """Which angles a robot's log holds."""
        return "motors" if self.motors else "axes" if self.axes else "joints"

    @property
    def angles(self) -> tuple[str, ...]:
        """The six columns of a robot's log that hold angles."""
        return self._selectors(self.side)

    @property
    def torque_columns(self) -> tuple[str, ...]:
        """The six columns of motor torques; empty where the dialect has none."""
        return self._selectors("torques")

    def _selectors(self, what: str) -> tuple[str, ...]:
        return spread(getattr(self, what), 6)

    @property
    def headerless(self) -> bool:
        """Whether all columns that it names are counted, so that no header is needed."""
        return (
            by_position((self.time.column, *self.angles, *self.wrench))
            if self.source != "ballbar"
            else by_position((self.time.column,))
        )


def dialect_names() -> list[str]:
    """The names of all dialects, sorted."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


@lru_cache(maxsize=64)
def load_dialect(name: str) -> Dialect:
    """The shipped dialect of that name.

    Raises DescriptionError naming the known ones, and the nearest.
    """
    if name not in dialect_names():
        raise DescriptionError(
            f"unknown dialect {name!r}.{nearest(name, dialect_names(), noun='dialect')} A dialect of your own is a file in the recording "
            "folder whose name ends in .yaml."
        )
    return load_model(_FOLDER / f"{name}.yaml", Dialect)


def dialect_file(path: Path) -> Dialect:
    """A user's dialect.

    Raises DescriptionError naming file, line and key.
    """
    return load_model(path, Dialect)

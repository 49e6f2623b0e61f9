"""Dialects: how one kind of logger writes its table, as data in a file.

They stand in `cell/dialects/*.yaml`, or in a file of the user's. There is one table reader;
a dialect gives it the separators, the time column and its forms, and which columns hold what. A
column is named, found by a regular expression, or counted (ballbar.cell.selectors).
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from ballbar.cell.errors import DescriptionError
from ballbar.cell.file_units import AngleUnit
from ballbar.cell.logs import SourceName
from ballbar.cell.plugins import PluginTable
from ballbar.cell.recording import EncoderName
from ballbar.cell.schema import Strict
from ballbar.cell.schema_errors import nearest
from ballbar.cell.selectors import by_position, checked, spread
from ballbar.cell.strict_yaml import load_model

_FOLDER = Path(__file__).parent / "dialects"

TimeForm = Literal[
    "s", "ms", "us", "100ns", "ns",
    "ms-32bit", "ns-32bit",
    "filetime", "dc", "unix-s", "unix-ms", "unix-us", "unix-ns",
    "date", "iec-time",
]  # fmt: skip
ABB_PERIOD = 0.004032  # [s] of a controller's rows (notes/log_formats sec. D)

AngleKind = Literal["motors", "axes", "joints"]
Separator = Literal[",", ";", "\t", " "]  # blank: any run of blanks
Selector = Annotated[str, AfterValidator(checked)]
CONTAINERS = PluginTable(
    "containers",
    dict.fromkeys(("text", "twincat-scope", "json-lines", "egm", "rosbag", "abb-mpe", "kuka-rsi")),
)
Container = Annotated[str, AfterValidator(CONTAINERS.known), Field(examples=list(CONTAINERS.own))]


class TimeColumn(Strict):
    """The time stamps: one declared unit, counted from any start, or several forms.

    Of several forms the stamps themselves show which one they have.
    """

    column: Selector
    type: Literal["integer", "float"] | None = None
    unit: Literal["s", "ms", "us", "100ns", "ns"] | None = None
    forms: tuple[TimeForm, ...] = ()
    # Low and high 32 bits, read where `column` is absent.
    halves: tuple[Selector, Selector] | None = None
    # Nanoseconds beside whole seconds in `column`; the form is that of both together, in ns.
    nanoseconds: Selector | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if bool(self.forms) == (self.unit is not None):
            raise ValueError("give either unit, or forms to tell apart")
        return self

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of a stamp."""
        return (self.column, *((self.nanoseconds,) if self.nanoseconds else ()))

    @property
    def possible(self) -> tuple[TimeForm, ...]:
        """The forms a stamp may have."""
        return self.forms or ((self.unit,) if self.unit else ())


class Written(Strict):
    """Details of a file that a reader need not know; the simulator writes it so."""

    period_s: Annotated[float, Field(gt=0.0)] = ABB_PERIOD  # of a robot's rows
    # Names of columns that the dialect finds by expression; `{}` is the number of the axis.
    time: str | None = None
    angle: str | None = None
    first_axis: int = 1
    digits: int | None = None  # significant ones of an angle; without: 1e-9 of its unit


class Dialect(Strict):
    """One kind of device log. The recording names encoder counters, the dialect the rest."""

    schema_: Annotated[Literal["ballbar-dialect/1"], Field(alias="schema")]
    source: SourceName
    """The device that is logged."""
    container: Container = "text"
    """Form of the file."""
    separators: tuple[Separator, ...] = ()
    """Separators of the columns of a text."""
    decimal: Literal["either", "point", "comma"] = "either"
    """Decimal sign of numbers that are no integers."""
    time: TimeColumn
    # Columns that count on from 1 are those of six axes and stand for as many as the robot has.
    motors: tuple[Selector, ...] = ()
    """Robot: motor angles, one column for each axis."""
    axes: tuple[Selector, ...] = ()
    """Robot: in place of motors, the angles that the controller shows."""
    joints: tuple[Selector, ...] = ()
    """Robot: in place of motors, the angles of the DH model."""
    angle_unit: AngleUnit = "rad"
    """Unit of these angles."""
    torques: tuple[Selector, ...] = ()
    """Robot: what each motor exerts [N m], positive along its angle; all or none."""
    torques_at: Literal["motors", "axes"] = "motors"
    """Robot: where these torques act; axes: behind the gears, positive along the controller's axis
    angles.
    """
    sequence: Selector | None = None
    """Number that grows with each row taken; the column may be absent."""
    status: dict[EncoderName, Selector] = Field(default_factory=dict)
    """Ball-bar: EL5021 status word of each encoder; columns may be absent."""
    wrench: tuple[Selector, ...] = ()
    """Force: forces x y z [N], torques x y z [N m], what the flange feels in its own frame."""
    point: tuple[Selector, ...] = ()
    """Tracker: x y z; recording.yaml names their unit."""
    written: Written = Written()
    period_s: tuple[float, float]
    """Shortest and longest usual period; a median outside of it is reported."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.container == "text" and not self.separators:
            raise ValueError("separators: name at least one of ',', ';', tab and blank")
        kinds = [kind for kind in ("motors", "axes", "joints") if getattr(self, kind)]
        if self.source == "robot" and len(kinds) != 1:
            raise ValueError("a robot's dialect names one of motors, axes and joints")
        if self.source != "robot" and (kinds or self.torques):
            raise ValueError(f"motors, axes, joints, torques are a robot's, not of a {self.source}")
        if (self.source == "force") != bool(self.wrench):
            raise ValueError("wrench: six columns, of a force sensor's log only")
        for key in (*kinds, "torques"):
            columns = self._selectors(key)
            if columns and not 5 <= len(columns) <= 8:
                raise ValueError(f"{key}: one column for each axis, 5 to 8, or one `re:` for all")
        if self.wrench and len(self.wrench) != 6:
            raise ValueError("wrench: six columns")
        if len(self.point) != (3 if self.source == "tracker" else 0):
            raise ValueError("point: three columns, of a tracker's log only")
        if not 0.0 < self.period_s[0] < self.period_s[1]:
            raise ValueError("period_s: shortest and longest usual period")
        return self

    @property
    def angle_kind(self) -> AngleKind:
        """Which angles a robot's log holds."""
        return "motors" if self.motors else "axes" if self.axes else "joints"

    @property
    def angles(self) -> tuple[str, ...]:
        """The columns of a robot's log that hold angles, in order of the axes."""
        return self._selectors(self.angle_kind)

    @property
    def torque_columns(self) -> tuple[str, ...]:
        """The columns of motor torques; empty where the dialect has none."""
        return self._selectors("torques")

    def for_axes(self, count: int) -> Dialect:
        """The dialect with the columns of a robot of so many axes.

        Raises DescriptionError if it names the columns of another number of axes.
        """
        columns = {key: self._selectors(key, count) for key in (self.angle_kind, "torques")}
        for key, names in columns.items():
            if names and len(names) != count:
                raise DescriptionError(
                    f"the dialect's {key} are {len(names)} columns, and the robot has {count} "
                    "axes. Name one column for each axis."
                )
        return self.model_copy(update=columns)

    def _selectors(self, key: str, count: int | None = None) -> tuple[str, ...]:
        """The columns as listed, those of one expression as six, or all as so many."""
        listed = getattr(self, key)
        return spread(listed, count or (6 if len(listed) == 1 else len(listed)))

    @property
    def headerless(self) -> bool:
        """Whether all columns that it names are counted, so that no header is needed."""
        columns = () if self.source in ("ballbar", "length") else (*self.angles, *self.wrench)
        return by_position((*self.time.columns, *columns, *self.point))


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
            f"unknown dialect {name!r}.{nearest(name, dialect_names(), noun='dialect')} A dialect "
            "of your own is a file in the recording folder whose name ends in .yaml."
        )
    return load_model(_FOLDER / f"{name}.yaml", Dialect)


def dialect_file(path: Path) -> Dialect:
    """A user's dialect.

    Raises DescriptionError naming file, line and key.
    """
    return load_model(path, Dialect)

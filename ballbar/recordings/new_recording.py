"""`ballbar new`: makes a recording folder from two log files.

What the files show is proposed, and the user confirms it at the prompt or by an option; what they
cannot show is asked for. The folder is made beside its place, read once as a whole, and only then
moved there.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.formats.registry import container_of
from acquisition.recording import Recording
from acquisition.sources import force_layout, robot_layout
from acquisition.table.fields import split_fields
from acquisition.table.header import read_header
from acquisition.table.preview import HEAD, column_names, likely_separator
from acquisition.table.text import LogText, read_filled, text_of
from acquisition.times import TIME_FORMS, recognised, words
from ballbar.recordings.read_with_causes import read_with_causes
from cell.arrays import Array
from cell.dialect import Container, Dialect, dialect_file, dialect_names, load_dialect
from cell.errors import InputError, LogError
from cell.files import write_yaml
from cell.instrument import Instrument
from cell.load import (
    ballbar_names,
    describes_instrument,
    length_names,
    load_ballbar,
    load_instrument,
    robot_names,
)
from cell.recording import SourceFile
from cell.selectors import find

Ask = Callable[[str, str | None], str]  # (question, proposed answer) -> answer

ENCODERS = ("b1", "b2", "b3", "b4", "b5")
UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}  # [m] of a length
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s]
SHOWN = 2000  # rows, from the first, whose values are looked at for a proposal
_ANGLES = {
    "motors": "motor angles",
    "axes": "axis angles as the controller shows them",
    "joints": "joint angles of the DH model",
}


@dataclass(frozen=True, kw_only=True)
class Answers:
    """Answers that the user gave as options; None or empty where a question will be asked."""

    robot: str | None = None
    ballbar: str | None = None
    instrument: str | None = None  # that measures a length, in place of the ball-bar
    robot_dialect: str | None = None
    ballbar_dialect: str | None = None
    robot_time: str | None = None
    ballbar_time: str | None = None
    encoders: tuple[str, ...] = ()  # b1=COLUMN, or b1=COLUMN:-1
    lines: int | None = None
    bits: int | None = None
    column: str | None = None  # of a length
    unit: str | None = None
    zero: float | None = None  # [m]


@dataclass(frozen=True, eq=False)
class _Preview:
    """What a log shows before a dialect is known."""

    name: str
    container: Container
    text: LogText | None  # None for a binary file

    @property
    def columns(self) -> list[str]:
        """Names of its columns, as far as they can be seen."""
        return [] if self.text is None else _column_names(self.text, self.container)

    def values(self, name: str | None) -> Array:
        """(N,) numbers of a column among the first rows; none of it where a field is no number."""
        if self.text is None or name is None:
            return np.zeros(0)
        separator, columns = likely_separator(self.text), self.columns
        rows = [split_fields(line, separator) for line in self.text.lines[:SHOWN]]
        first = rows.index(columns) + 1
        cells = [row[columns.index(name)] for row in rows[first:] if len(row) == len(columns)]
        try:
            return np.array([float(cell.replace(",", ".")) for cell in cells])
        except ValueError:
            return np.zeros(0)


def new_recording(
    folder: Path, robot_log: Path, ballbar_log: Path, answers: Answers, ask: Ask
) -> Recording:
    """Makes the recording folder and reads it.

    ballbar_log : of the ball-bar, or of the instrument that measures a length.

    Raises InputError if the folder holds something, an answer is missing, or the files cannot be
    read in the way that was answered; then nothing is left behind.
    """
    if folder.exists() and (folder.is_file() or any(folder.iterdir())):
        raise InputError(
            f"{folder}: exists and holds something; nothing was written. Choose another folder."
        )
    if robot_log.name == ballbar_log.name:
        raise InputError(f"{robot_log} and {ballbar_log} have the same name; rename one of them.")
    description = _description(_preview(robot_log), _preview(ballbar_log), answers, ask)
    aside = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(aside, ignore_errors=True)
    try:
        (aside / "raw").mkdir(parents=True)
        for log in (robot_log, ballbar_log):
            shutil.copyfile(log, aside / "raw" / log.name)
        for source in description["sources"].values():
            if source["dialect"].endswith(".yaml"):
                shutil.copyfile(source["dialect"], aside / Path(source["dialect"]).name)
                source["dialect"] = Path(source["dialect"]).name
        if (own := description.get("instrument", "")).endswith(".yaml"):
            shutil.copyfile(own, aside / Path(own).name)
            description["instrument"] = Path(own).name
        write_yaml(aside / "recording.yaml", description)
        recording = read_with_causes(aside)
        if folder.exists():
            folder.rmdir()
        aside.rename(folder)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return recording


def _description(
    robot_log: _Preview, bar_log: _Preview, answers: Answers, ask: Ask
) -> dict[str, Any]:
    """The content of recording.yaml."""
    if answers.ballbar and answers.instrument:
        raise InputError("give either --ballbar or --instrument: one of them made the second log.")
    robots, bars = ", ".join(robot_names()), ", ".join((*ballbar_names(), *length_names()))
    robot = answers.robot or ask(f"Which robot? ({robots}, or a .yaml file)", None)
    held = answers.ballbar or answers.instrument
    held = held or ask(f"Which ball-bar or other instrument? ({bars}, or a .yaml file)", None)
    kind = "length" if answers.instrument or describes_instrument(held) else "ballbar"
    robot_dialect = answers.robot_dialect or _ask_dialect("robot", robot_log, ask)
    bar_dialect = answers.ballbar_dialect or _ask_dialect(kind, bar_log, ask)
    sources = {
        "robot": _source(robot_log, robot_dialect, answers.robot_time, ask),
        kind: _source(bar_log, bar_dialect, answers.ballbar_time, ask),
    }
    head = {"schema": "ballbar-recording/1", "kind": "real", "robot": robot}
    if kind == "length":
        sources[kind] |= _length(bar_log, load_instrument(held), bar_dialect, answers, ask)
        return {**head, "instrument": held, "sources": sources, "notes": ""}
    encoders = _encoders(bar_log.columns, held, answers, ask)
    return {**head, "ballbar": held, "sources": sources, "encoders": encoders, "notes": ""}


def _preview(log: Path) -> _Preview:
    """What a log shows. Raises LogError if it cannot be opened."""
    content = read_filled(log, log.name)
    container = container_of(content.raw)
    text = text_of(content, log.name) if container in ("text", "twincat-scope") else None
    return _Preview(log.name, container, text)


def _ask_dialect(source: str, log: _Preview, ask: Ask) -> str:
    """The dialect of a log; proposed if it is the only one that fits."""
    dialects = {name: load_dialect(name) for name in dialect_names()}
    known = [name for name, dialect in dialects.items() if dialect.source == source]
    fitting = [name for name in known if _fits(dialects[name], log)]
    choices = f"({', '.join(known)}, or a .yaml file)"
    if not fitting:
        return ask(f"{log.name} fits no dialect. Which one? {choices}", None)
    first, meaning = fitting[0], _meaning(dialects[fitting[0]])
    question = f"{log.name} fits the dialect {first}: {meaning}. Which dialect? {choices}"
    return ask(question, first if len(fitting) == 1 else None)


def _fits(dialect: Dialect, log: _Preview) -> bool:
    """Whether the container, and for text the header, are those of the dialect."""
    if dialect.container != log.container:
        return False
    text = log.text
    if text is None or log.container != "text":
        return True
    source = SourceFile(files=(text.file,), dialect="")
    try:
        if dialect.source == "robot":
            read_header(text, robot_layout(source, dialect))
        elif dialect.source == "force":
            read_header(text, force_layout(source, dialect))
        elif dialect.source == "length":
            return len(_unstamped(log, dialect)) < len(log.columns)
        else:
            columns, halves = set(log.columns), dialect.time.halves
            return dialect.time.column in columns or bool(halves and set(halves) <= columns)
    except LogError:
        return False
    return True


def _meaning(dialect: Dialect) -> str:
    forms = " or ".join(words(form) for form in dialect.time.possible)
    if dialect.source == "robot":
        return f"{_ANGLES[dialect.angle_kind]} in {dialect.angle_unit}, time in {forms}"
    what = "a length" if dialect.source == "length" else "raw counters"
    return f"{what}, time in {forms}"


def _source(log: _Preview, dialect_name: str, time: str | None, ask: Ask) -> dict[str, Any]:
    """One source of recording.yaml; the form of the time stamps is asked for if it is not seen."""
    dialect = _dialect(dialect_name)
    source: dict[str, Any] = {"files": [f"raw/{log.name}"], "dialect": dialect_name}
    if time is None and dialect.time.forms and not _shows_time_form(dialect, log):
        time = ask(
            f"{log.name}: what are the time stamps? They do not show it. ({', '.join(TIME_FORMS)})",
            likely_time(dialect, log.values(_stamp_column(log, dialect))),
        )
    return source if time is None else source | {"time": time}


def _shows_time_form(dialect: Dialect, log: _Preview) -> bool:
    """Whether the stamp in the middle row of a log shows its form."""
    text, name = log.text, _stamp_column(log, dialect)
    if text is None or name is None:
        return True  # two halves, or binary: the reader knows
    column = log.columns.index(name)
    row = split_fields(text.lines[len(text.lines) // 2], likely_separator(text))
    return len(row) > column and recognised(row[column], dialect.time.forms) is not None


def _dialect(name: str) -> Dialect:
    return dialect_file(Path(name)) if name.endswith(".yaml") else load_dialect(name)


def _stamp_column(log: _Preview, dialect: Dialect) -> str | None:
    """Name of the column of the time stamps, None where the header shows none."""
    return next((log.columns[k] for k in find(dialect.time.column, log.columns)), None)


def _unstamped(log: _Preview, dialect: Dialect) -> list[str]:
    """The columns that hold no time stamps."""
    stamps = find(dialect.time.column, log.columns)
    return [name for k, name in enumerate(log.columns) if k not in stamps]


def _length(
    log: _Preview, instrument: Instrument, dialect: str, answers: Answers, ask: Ask
) -> dict[str, Any]:
    """Column, unit and zero of a length; those proposed put the log inside the stroke."""
    names = _unstamped(log, _dialect(dialect))
    fitting = {name: likely_unit(instrument, log.values(name)) for name in names}
    inside = [name for name, unit in fitting.items() if unit is not None]
    proposal = inside[0] if len(inside) == 1 else names[0] if len(names) == 1 else None
    column = answers.column or ask(
        f"Which column holds the length? Columns: {', '.join(names)}.", proposal
    )
    unit, zero = fitting.get(column) or (None, None)
    question = f"{column}: in which unit? ({', '.join(UNITS)})"
    out: dict[str, Any] = {"column": column, "unit": answers.unit or ask(question, unit)}
    if answers.zero is not None:
        return out | {"zero_m": answers.zero}
    if zero:  # the column shows deviations
        question = f"{column}: length where it shows zero, in m?"
        return out | {"zero_m": _number(ask(question, f"{zero:g}"))}
    return out


def likely_unit(instrument: Instrument, values: Array) -> tuple[str, float] | None:
    """Unit and zero [m] that put all values (N,) of a column inside the instrument's range.

    The largest unit, and lengths before deviations from the nominal one; None where none fits.
    """
    if not values.size:
        return None
    least, most = float(values.min()), float(values.max())
    for zero in (0.0, instrument.nominal):
        for unit, size in UNITS.items():
            if instrument.lower <= zero + size * least and zero + size * most <= instrument.upper:
                return unit, zero
    return None


def likely_time(dialect: Dialect, stamps: Array) -> str | None:
    """The unit in which stamps (N,) have a period that the dialect expects, if it is only one."""
    period = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    first, last = dialect.period_s
    fitting = [unit for unit, size in TIME_UNITS.items() if first <= size * period <= last]
    return fitting[0] if len(fitting) == 1 and fitting[0] in dialect.time.possible else None


def _number(answer: str) -> float:
    try:
        return float(answer)
    except ValueError:
        raise InputError(f"{answer!r} is not a number. Write metres, such as 0.3.") from None


def _encoders(
    columns: Sequence[str], ballbar: str, answers: Answers, ask: Ask
) -> dict[str, dict[str, Any]]:
    """The encoders of recording.yaml: counter column, lines, bits, direction."""
    chosen = _parsed_encoders(answers.encoders)
    if not chosen:
        proposal = " ".join(f"{name}={name}" for name in ENCODERS if name in columns) or None
        question = "Which column holds which encoder's counter?"
        answer = ask(
            f"{question} Columns: {', '.join(columns)}. (b1=COLUMN b2=COLUMN:-1 ...)", proposal
        )
        chosen = _parsed_encoders(answer.split())
    nominal = None if ballbar.endswith(".yaml") else load_ballbar(ballbar)
    lines = answers.lines or _whole_number(
        ask("Lines of the encoders per turn?", str(nominal.encoder_lines) if nominal else None)
    )
    bits = answers.bits or _whole_number(
        ask(
            "Bits of the interpolation (EL5021 object 8001:11)?",
            str(nominal.encoder_bits) if nominal else None,
        )
    )
    return {
        name: {"column": column, "lines": lines, "bits": bits, "sign": direction}
        for name, (column, direction) in sorted(chosen.items())
    }


def _parsed_encoders(texts: Sequence[str]) -> Mapping[str, tuple[str, int]]:
    """Encoder -> (counter column, direction +1 or -1), from `b1=COLUMN` or `b1=COLUMN:-1`."""
    encoders: dict[str, tuple[str, int]] = {}
    for text in texts:
        name, equals, column = text.partition("=")
        direction = "1"
        if column.endswith((":1", ":-1", ":+1")):
            column, _, direction = column.rpartition(":")
        if name not in ENCODERS or not equals or not column:
            raise InputError(
                f"encoder {text!r}: write b1=COLUMN, or b1=COLUMN:-1 where it counts in the other "
                "direction; encoders are b1 to b5."
            )
        encoders[name] = (column, int(direction))
    return encoders


def _whole_number(answer: str) -> int:
    if not answer.strip().isdigit():
        raise InputError(f"{answer!r} is not a whole number. Write digits alone, such as 3600.")
    return int(answer)


def _column_names(text: LogText, container: Container) -> list[str]:
    """Names in the header of a text log.

    In a TwinCAT Scope export it is the last of the first lines that begins with Name, and holds the
    names of the channels.
    """
    if container != "twincat-scope":
        return column_names(text)
    separator = likely_separator(text)
    head = [split_fields(line, separator) for line in text.lines[:HEAD] if line.startswith("Name")]
    return [name for name in head[-1] if name != "Name"] if head else []

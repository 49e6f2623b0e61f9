"""`ballbar new`: makes a recording folder from two log files.

What the files show is proposed, and the user confirms it at the prompt or by an option; what they
cannot show is asked for. The folder is made beside its place, read once as a whole, and only then
moved there.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.formats.registry import container_of
from acquisition.recording import Recording
from acquisition.sources import layout_of
from acquisition.table.fields import HEAD, column_names, likely_separator, split_fields
from acquisition.table.header import read_header
from acquisition.table.text import LogText, read_filled, text_of
from acquisition.times import TIME_FORMS, recognised, words
from ballbar.recordings.new_dialect import OWN, new_dialect
from ballbar.recordings.questions import Ask, answer, one_of, time_form, whole_number
from ballbar.recordings.read_with_causes import read_with_causes
from cell.arrays import Array
from cell.dialect import Container, Dialect, TimeForm, dialect_file, dialect_names, load_dialect
from cell.errors import InputError
from cell.files import copied_description, new_folder, write_yaml
from cell.instrument import Instrument
from cell.load import (
    ballbar_names,
    describes_instrument,
    length_names,
    load_ballbar,
    load_instrument,
    load_robot,
    load_telescoping_bar,
    robot_names,
)
from cell.logs import SourceName
from cell.recording import SourceFile
from cell.schema_errors import nearest
from cell.selectors import find

ENCODERS = ("b1", "b2", "b3", "b4", "b5")
UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}  # [m] of a length
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
    damaged_rows: int | None = None  # of each file, that may be left out


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
    if robot_log.name == ballbar_log.name:
        raise InputError(f"{robot_log} and {ballbar_log} have the same name; rename one of them.")
    with new_folder(folder) as aside:
        description, own = _description(_preview(robot_log), _preview(ballbar_log), answers, ask)
        (aside / "raw").mkdir()
        for log in (robot_log, ballbar_log):
            shutil.copyfile(log, aside / "raw" / log.name)
        for name, dialect in own.items():
            write_yaml(aside / name, dialect)
        for name, source in description["sources"].items():
            file = Path(source["dialect"])
            if file.suffix == ".yaml" and file.name not in own:
                source["dialect"] = copied_description(aside, f"{name}_dialect", file)
        for key in ("robot", "ballbar", "instrument"):
            if (name := description.get(key, "")).endswith(".yaml"):
                description[key] = copied_description(aside, key, Path(name))
        write_yaml(aside / "recording.yaml", description)
        return read_with_causes(aside)


def _description(
    robot_log: _Preview, bar_log: _Preview, answers: Answers, ask: Ask
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The content of recording.yaml, and that of new dialects by the names of their files."""
    if answers.ballbar and answers.instrument:
        raise InputError("give either --ballbar or --instrument: one of them made the second log.")
    robots, bars = ", ".join(robot_names()), ", ".join((*ballbar_names(), *length_names()))
    question = f"Which robot? ({robots}, or a .yaml file)"
    robot = answer(answers.robot, question, None, _robot, ask)
    question = f"Which ball-bar or other instrument? ({bars}, or a .yaml file)"
    held = answer(answers.ballbar or answers.instrument, question, None, _held, ask)
    kind: SourceName = "length" if answers.instrument or describes_instrument(held) else "ballbar"
    made: dict[str, dict[str, Any]] = {}
    _, robot_source = _source(
        "robot", robot_log, answers.robot_dialect, answers.robot_time, ask, made
    )
    bar_dialect, bar_source = _source(
        kind, bar_log, answers.ballbar_dialect, answers.ballbar_time, ask, made
    )
    sources = {"robot": robot_source, kind: bar_source}
    if answers.damaged_rows:
        sources = {n: s | {"damaged_rows": answers.damaged_rows} for n, s in sources.items()}
    head = {"schema": "ballbar-recording/1", "kind": "real", "robot": robot}
    if kind == "length":
        sources[kind] |= _length(bar_log, load_instrument(held), bar_dialect, answers, ask)
        return {**head, "instrument": held, "sources": sources, "notes": ""}, made
    encoders = _encoders(bar_log.columns, held, answers, ask)
    described = {**head, "ballbar": held, "sources": sources, "encoders": encoders, "notes": ""}
    return described, made


def _robot(name: str) -> str:
    load_robot(name)
    return name


def _held(name: str) -> str:
    """A ball-bar, or an instrument of lengths."""
    (load_telescoping_bar if describes_instrument(name) else load_ballbar)(name)
    return name


def _preview(log: Path) -> _Preview:
    """What a log shows. Raises LogError if it cannot be opened."""
    content = read_filled(log, log.name)
    container = container_of(content.raw)
    text = text_of(content, log.name) if container in ("text", "twincat-scope") else None
    return _Preview(log.name, container, text)


def _chosen_dialect(source: SourceName, given: str | None, log: _Preview, ask: Ask) -> str:
    """The dialect of a log; proposed if it is the only one that fits, a new one if none does."""
    dialects = {name: load_dialect(name) for name in dialect_names()}
    known = [name for name, dialect in dialects.items() if dialect.source == source]
    fitting = [name for name in known if _fits(dialects[name], log) and not _untold(dialects[name])]
    table = log.container == "text" and source != "force"
    own = f", or {OWN} to write one from what the file shows" if table else ""
    choices = f"({', '.join(known)}, or a .yaml file{own})"

    def check(name: str) -> str:
        if not (table and name == OWN):
            _refuse_other(_dialect(name), source, log)
        return name

    if fitting:
        first, meaning = fitting[0], _meaning(dialects[fitting[0]], log)
        question = f"{log.name} fits the dialect {first}: {meaning}. Which dialect? {choices}"
        return answer(given, question, first if len(fitting) == 1 else None, check, ask)
    question = f"{log.name} fits no dialect. Which one? {choices}"
    return answer(given, question, OWN if table else None, check, ask)


def _refuse_other(dialect: Dialect, source: SourceName, log: _Preview) -> None:
    """Raises InputError for a dialect of another source, or whose columns the log lacks."""
    if dialect.source != source:
        raise InputError(f"that dialect is of a {dialect.source} log, and {log.name} of {source}.")
    _refuse_unfit(dialect, log)


def _fits(dialect: Dialect, log: _Preview) -> bool:
    """Whether the container, and for text the header, are those of the dialect."""
    try:
        _refuse_unfit(dialect, log)
    except InputError:
        return False
    return True


def _untold(dialect: Dialect) -> bool:
    """Whether a dialect takes numbers for torques that no name in the file calls so."""
    return dialect.container == "egm" and bool(dialect.torques)


def _refuse_unfit(dialect: Dialect, log: _Preview) -> None:
    """Raises InputError unless the container, and for text the header, are those of the dialect."""
    if dialect.container != log.container:
        raise InputError(f"{log.name} is {log.container}, the dialect reads {dialect.container}.")
    text = log.text
    if text is None or log.container != "text":
        return
    source = SourceFile(files=(text.file,), dialect="")
    shown = _shown_form(dialect, log)
    if shown in ("date", "iec-time") and shown not in dialect.time.possible:
        raise InputError(f"the time stamps of {log.name} are {words(shown)}, not of that dialect.")
    if dialect.source in {"robot", "force"}:
        read_header(text, layout_of(source, dialect))
    elif dialect.source == "length":
        if len(_unstamped(log, dialect)) == len(log.columns):
            raise InputError(f"{log.name} has no column {dialect.time.column} of time stamps.")
    else:
        halves, present = dialect.time.halves, _stamp_column(log, dialect) is not None
        if not present and not (halves and set(halves) <= set(log.columns)):
            raise InputError(f"{log.name} has no column {dialect.time.column} of time stamps.")


def _meaning(dialect: Dialect, log: _Preview) -> str:
    """What a dialect takes a log for, as the part of a sentence."""
    if dialect.source == "robot":
        what = f"{_ANGLES[dialect.angle_kind]} in {dialect.angle_unit}"
    else:
        what = "a length" if dialect.source == "length" else "raw counters"
    possible = dialect.time.possible
    form = possible[0] if len(possible) == 1 else _shown_form(dialect, log)
    return what if form is None else f"{what}, time in {words(form)}"


def _source(
    name: SourceName,
    log: _Preview,
    given: str | None,
    time: str | None,
    ask: Ask,
    made: dict[str, dict[str, Any]],
) -> tuple[Dialect, dict[str, Any]]:
    """A dialect and its source in recording.yaml; a form of the stamps that hides is asked for.

    made : takes a dialect that is written.
    """
    chosen = _chosen_dialect(name, given, log, ask)
    source: dict[str, Any] = {"files": [f"raw/{log.name}"], "dialect": chosen}
    if chosen == OWN and log.text is not None:
        data, hidden = new_dialect(name, log.text, time, ask)
        source["dialect"] = f"{name}-dialect.yaml"
        made[source["dialect"]] = data
        dialect = Dialect.model_validate(json.loads(json.dumps(data)))
        return dialect, source if hidden is None else source | {"time": hidden}
    dialect = _dialect(chosen)
    if time is not None or (dialect.time.forms and not _shows_time_form(dialect, log)):
        source["time"] = time_form(
            log.name,
            log.values(_stamp_column(log, dialect)),
            periods=dialect.period_s,
            given=time,
            ask=ask,
            proposed=dialect.time.possible,
        )
    return dialect, source


def _shows_time_form(dialect: Dialect, log: _Preview) -> bool:
    """Whether the stamp in the middle row of a log shows its form."""
    if log.text is None or _stamp_column(log, dialect) is None:
        return True  # two halves, or binary: the reader knows
    return _shown_form(dialect, log) in dialect.time.forms


def _shown_form(dialect: Dialect, log: _Preview) -> TimeForm | None:
    """The form that the stamp in the middle row of a table shows."""
    text, name = log.text, _stamp_column(log, dialect)
    if text is None or name is None:
        return None
    row = split_fields(text.lines[len(text.lines) // 2], likely_separator(text))
    column = log.columns.index(name)
    if len(row) <= column:
        return None
    return recognised(row[column], dialect.time.forms) or recognised(row[column], TIME_FORMS)


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
    log: _Preview, instrument: Instrument, dialect: Dialect, answers: Answers, ask: Ask
) -> dict[str, Any]:
    """Column, unit and zero of a length; those proposed put the log inside the stroke."""
    names = _unstamped(log, dialect)
    fitting = {name: likely_unit(instrument, log.values(name)) for name in names}
    inside = [name for name, unit in fitting.items() if unit is not None]
    proposal = inside[0] if len(inside) == 1 else names[0] if len(names) == 1 else None
    question = f"Which column holds the length? Columns: {', '.join(names)}."
    column = answer(answers.column, question, proposal, one_of(*names), ask)
    unit, zero = fitting.get(column) or (None, None)
    question = f"{column}: in which unit? ({', '.join(UNITS)})"
    chosen = answer(answers.unit, question, unit, one_of(*UNITS), ask)
    out: dict[str, Any] = {"column": column, "unit": chosen}
    if answers.zero is not None:
        return out | {"zero_m": answers.zero}
    if zero:  # the column shows deviations
        question = f"{column}: length where it shows zero, in m?"
        return out | {"zero_m": answer(None, question, f"{zero:g}", _number, ask)}
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


def _number(reply: str) -> float:
    try:
        return float(reply)
    except ValueError:
        raise InputError(f"{reply!r} is not a number. Write metres, such as 0.3.") from None


def _encoders(
    columns: Sequence[str], ballbar: str, answers: Answers, ask: Ask
) -> dict[str, dict[str, Any]]:
    """The encoders of recording.yaml: counter column, lines, bits, direction."""

    def parsed(reply: str) -> Mapping[str, tuple[str, int]]:
        return _parsed_encoders(reply.split(), columns)

    proposal = " ".join(f"{name}={name}" for name in ENCODERS if name in columns) or None
    question = (
        f"Which column holds which encoder's counter? Columns: {', '.join(columns)}. "
        "(b1=COLUMN b2=COLUMN:-1 ...)"
    )
    chosen = (
        _parsed_encoders(answers.encoders, columns)
        if answers.encoders
        else answer(None, question, proposal, parsed, ask)
    )
    nominal = load_ballbar(ballbar)
    lines = answers.lines or answer(
        None,
        "Lines of the encoders per turn?",
        str(nominal.encoder_lines),
        whole_number(1, 10_000_000),
        ask,
    )
    bits = answers.bits or answer(
        None,
        "Bits of the interpolation (EL5021 object 8001:11)?",
        str(nominal.encoder_bits),
        whole_number(8, 13),
        ask,
    )
    return {
        name: {"column": column, "lines": lines, "bits": bits, "sign": direction}
        for name, (column, direction) in sorted(chosen.items())
    }


def _parsed_encoders(texts: Sequence[str], columns: Sequence[str]) -> Mapping[str, tuple[str, int]]:
    """Encoder -> (counter column, direction +1 or -1), from `b1=COLUMN` or `b1=COLUMN:-1`.

    columns : of the log, as far as they can be seen.

    Raises InputError also for a name that is none of them.
    """
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
        if columns and column not in columns:
            hint = nearest(column, columns, noun="column")
            raise InputError(f"encoder {text!r}: {column!r} is no column.{hint}")
        encoders[name] = (column, int(direction))
    if not encoders:
        raise InputError("no encoder was named: write b1=COLUMN, and so on.")
    return encoders


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

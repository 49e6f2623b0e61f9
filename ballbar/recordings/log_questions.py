"""Questions of `ballbar new` about two logs: the content of recording.yaml and of new dialects.

What the files show is proposed, and the user confirms it at the prompt or by an option; what they
cannot show is asked for.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, get_args

from ballbar.acquisition.explain import ANGLES
from ballbar.acquisition.faults.robot_angles import AngleReading
from ballbar.acquisition.sources import layout_of
from ballbar.acquisition.table.header import read_header
from ballbar.acquisition.table.text import split_fields
from ballbar.acquisition.times import TIME_FORMS, recognised, words
from ballbar.cell import load
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import BallBar
from ballbar.cell.dialect import Dialect, TimeForm, dialect_file, dialect_names, load_dialect
from ballbar.cell.errors import InputError
from ballbar.cell.file_units import METRES, LogLengthUnit
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.logs import SourceName
from ballbar.cell.recording import SourceFile, TrackerFile
from ballbar.cell.schema_errors import nearest
from ballbar.cell.selectors import find
from ballbar.recordings.answers import Answers
from ballbar.recordings.dialect_questions import new_dialect
from ballbar.recordings.preview import LogPreview
from ballbar.recordings.proposals import length_unit
from ballbar.recordings.questions import Ask, answer, loaded, one_of, time_form, whole_number
from ballbar.recordings.tracker_questions import target_columns, target_units

ENCODERS = ("b1", "b2", "b3", "b4", "b5")
UNITS = get_args(LogLengthUnit)
FOLLOWED = ("point", "pose")  # measured by what may follow a moving tool
OWN = "new"  # the answer that asks for a dialect of one's own


@dataclass(frozen=True, eq=False)
class LogDescription:
    """The content of recording.yaml, and that of new dialects by the names of their files."""

    recording: dict[str, Any]
    dialects: dict[str, dict[str, Any]] = field(default_factory=dict)


def log_description(
    robot_log: LogPreview, bar_log: LogPreview, answers: Answers, ask: Ask
) -> LogDescription:
    """The description that answers and files give; raises InputError where an answer is missing."""
    if answers.ballbar and answers.instrument:
        raise InputError("give either --ballbar or --instrument: one of them made the second log.")
    trackers = [n for n in load.instrument_names() if load.load_instrument(n).measured in FOLLOWED]
    robots = ", ".join(load.robot_names())
    bars = ", ".join((*load.ballbar_names(), *load.length_names(), *trackers))
    question = f"Which robot? ({robots}, or a .yaml file)"
    robot, arm = answer(answers.robot, question, None, loaded(load.load_robot), ask)
    head = {"schema": "ballbar-recording/1", "kind": "real", "robot": robot}
    question = f"Which ball-bar or other instrument? ({bars}, or a .yaml file)"
    bar, held = answer(answers.ballbar or answers.instrument, question, None, loaded(_holder), ask)
    kind: SourceName = "tracker" if isinstance(held, Instrument) else "ballbar"
    if kind == "ballbar" and (answers.instrument or load.describes_instrument(bar)):
        kind = "length"
    description = LogDescription({**head, "ballbar" if kind == "ballbar" else "instrument": bar})
    own, columns = OWN if answers.joints else None, list[str]()
    if isinstance(held, Instrument):
        columns = target_columns(bar_log, held, answers, ask)
    elif answers.values or answers.value_unit or answers.rotation:
        what = f"they are of a tracker, and {bar} held the tool."
        raise InputError.at("--values, --value-unit, --rotation", what, "Leave them out.")
    point, sources = columns[:3], dict[str, dict[str, Any]]()
    of_bar = answers.ballbar_dialect or (OWN if point and point != ["x", "y", "z"] else None)
    dialects: dict[SourceName, Dialect] = {}
    logs: tuple[tuple[SourceName, LogPreview, str | None, str | None], ...] = (
        ("robot", robot_log, answers.robot_dialect or own, answers.robot_time),
        (kind, bar_log, of_bar, answers.ballbar_time),
    )
    for name, log, dialect_name, time in logs:
        chosen = _chosen_dialect(name, dialect_name, log, ask)
        new = partial(new_dialect, name, log, time, answers, ask, axes=arm.joints)
        if name == "tracker":
            new.keywords["point"] = point
        made = _source(name, log, chosen, time, ask, description, new)
        dialects[name], sources[name] = made
        if answers.damaged_rows:
            sources[name]["damaged_rows"] = answers.damaged_rows
    description.recording["sources"] = sources
    if kind == "length":
        sources[kind] |= _length(bar_log, load.load_instrument(bar), dialects[kind], answers, ask)
    elif kind == "tracker":
        logged = robot_log.throughout(dialects["robot"].for_axes(arm.joints).angles)
        q = AngleReading(dialects["robot"].angle_kind, dialects["robot"].angle_unit)
        unit = length_unit(arm, q.joints(arm, logged), bar_log.throughout(point))
        sources[kind] |= target_units(columns, unit, answers, ask)
    else:
        encoders = _encoders(bar_log.columns, bar, answers, ask)
        description.recording["encoders"] = encoders
    description.recording["notes"] = ""
    return description


def _holder(name: str) -> BallBar | Instrument:
    """The ball-bar, or instrument of lengths, that held the robot; or what followed its tool."""
    if not load.describes_instrument(name):
        return load.load_ballbar(name)
    instrument = load.load_instrument(name)
    return instrument if instrument.measured in FOLLOWED else load.load_telescoping_bar(name)


def _dialect_for(source: SourceName, log: LogPreview, name: str, *, may_be_own: bool) -> str:
    """The name of a dialect that fits the log, or OWN. Raises InputError for another."""
    if may_be_own and name == OWN:
        return name
    dialect = _dialect(name)
    if dialect.source != source:
        other = f"that dialect is of a {dialect.source} log"
        raise InputError(f"{other}, and {log.name} of {source}.")
    _refuse_unfit(dialect, log)
    return name


def _chosen_dialect(source: SourceName, given: str | None, log: LogPreview, ask: Ask) -> str:
    """The dialect of a log; proposed if it is the only one that fits, a new one if none does."""
    dialects = {name: load_dialect(name) for name in dialect_names()}
    known = {name: dialect for name, dialect in dialects.items() if dialect.source == source}
    fitting = [
        name
        for name, dialect in known.items()
        if _fits(dialect, log)
        # numbers that no name in the file calls torques
        and not (dialect.container == "egm" and dialect.torques)
    ]
    table = log.container == "text" and source != "force"
    own = f", or {OWN} to write one from what the file shows" if table else ""
    choices = f"({', '.join(known)}, or a .yaml file{own})"
    check = partial(_dialect_for, source, log, may_be_own=table)
    if fitting:
        meaning = _meaning(known[fitting[0]], log)
        question = f"{log.name} fits the dialect {fitting[0]}: {meaning}. Which dialect? {choices}"
        return answer(given, question, fitting[0] if len(fitting) == 1 else None, check, ask)
    question = f"{log.name} fits no dialect. Which one? {choices}"
    return answer(given, question, OWN if table else None, check, ask)


def _fits(dialect: Dialect, log: LogPreview) -> bool:
    try:
        _refuse_unfit(dialect, log)
    except InputError:
        return False
    return True


def _refuse_unfit(dialect: Dialect, log: LogPreview) -> None:
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
    if dialect.source in {"robot", "force", "tracker"}:
        followed = TrackerFile(files=source.files, dialect="")
        read_header(text, layout_of(followed if dialect.source == "tracker" else source, dialect))
    else:
        halves = set(dialect.time.halves or ()) if dialect.source != "length" else set[str]()
        stamped = bool(halves) and halves <= set(log.columns)
        if _stamp_column(log, dialect) is None and not stamped:
            raise InputError(f"{log.name} has no column {dialect.time.column} of time stamps.")


def _meaning(dialect: Dialect, log: LogPreview) -> str:
    """Meaning of a log by a dialect, as the part of a sentence."""
    if dialect.source == "robot":
        what = f"{ANGLES[dialect.angle_kind]} in {dialect.angle_unit}"
    else:
        what = {"length": "a length", "tracker": "points"}.get(dialect.source, "raw counters")
    possible = dialect.time.possible
    form = possible[0] if len(possible) == 1 else _shown_form(dialect, log)
    return what if form is None else f"{what}, time in {words(form)}"


def _source(
    name: SourceName,
    log: LogPreview,
    chosen: str,
    time: str | None,
    ask: Ask,
    description: LogDescription,
    new: Callable[[], tuple[dict[str, Any], str | None]],
) -> tuple[Dialect, dict[str, Any]]:
    """The chosen dialect and its source in recording.yaml; asks for a form of stamps that hides.

    time : the form, where an option gave it. description : takes a dialect that is written. new :
    gives one, as `new_dialect`.
    """
    source: dict[str, Any] = {"files": [f"raw/{log.name}"], "dialect": chosen}
    if chosen == OWN and log.text is not None:
        data, hidden = new()
        source["dialect"] = f"{name}-dialect.yaml"
        description.dialects[source["dialect"]] = data
        dialect = Dialect.model_validate(json.loads(json.dumps(data)))
        return dialect, source if hidden is None else source | {"time": hidden}
    dialect, column = _dialect(chosen), None
    if log.text is not None:
        column = _stamp_column(log, dialect)  # none for two halves: the reader knows
    forms = dialect.time.forms
    hides = bool(forms) and column is not None and _shown_form(dialect, log) not in forms
    if time is not None or hides:
        source["time"] = time_form(
            log.name,
            log.values(column),
            periods=dialect.period_s,
            given=time,
            ask=ask,
            proposed=dialect.time.possible,
        )
    return dialect, source


def _shown_form(dialect: Dialect, log: LogPreview) -> TimeForm | None:
    """The form that the stamp in the middle row of a table shows."""
    text, name = log.text, _stamp_column(log, dialect)
    if text is None or name is None:
        return None
    row = split_fields(text.lines[len(text.lines) // 2], log.separator)
    column = log.columns.index(name)
    if len(row) <= column:
        return None
    return recognised(row[column], dialect.time.forms) or recognised(row[column], TIME_FORMS)


def _dialect(name: str) -> Dialect:
    return dialect_file(Path(name)) if name.endswith(".yaml") else load_dialect(name)


def _stamp_column(log: LogPreview, dialect: Dialect) -> str | None:
    """Name of the column of the time stamps, None where the header shows none."""
    return next((log.columns[k] for k in find(dialect.time.column, log.columns)), None)


def _length(
    log: LogPreview, instrument: Instrument, dialect: Dialect, answers: Answers, ask: Ask
) -> dict[str, Any]:
    """Column, unit and zero of a length; those proposed put the log inside the stroke."""
    stamps = find(dialect.time.column, log.columns)
    names = [name for k, name in enumerate(log.columns) if k not in stamps]
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
        return out | {"zero_m": answer(None, question, f"{zero:g}", _metres, ask)}
    return out


def likely_unit(instrument: Instrument, values: Array) -> tuple[str, float] | None:
    """Unit and zero [m] that put all values (N,) of a column inside the instrument's range.

    The largest unit, and lengths before deviations from the nominal one; None where none fits.
    """
    if not values.size:
        return None
    least, most = float(values.min()), float(values.max())
    for zero in (0.0, instrument.nominal):
        for unit in UNITS:
            size = METRES[unit]
            if instrument.lower <= zero + size * least and zero + size * most <= instrument.upper:
                return unit, zero
    return None


def _metres(reply: str) -> float:
    try:
        return float(reply)
    except ValueError:
        raise InputError(f"{reply!r} is not a number. Write metres, such as 0.3.") from None


def _encoders(
    columns: Sequence[str], ballbar: str, answers: Answers, ask: Ask
) -> dict[str, dict[str, Any]]:
    """The encoders of recording.yaml: counter column, lines, bits, direction."""
    if answers.encoder:
        chosen = _parsed_encoders(answers.encoder, columns)
    else:
        proposal = " ".join(f"{name}={name}" for name in ENCODERS if name in columns) or None
        listed = ", ".join(columns)
        question = (
            f"Which column holds which encoder's counter? Columns: {listed}. (b1=COLUMN "
            "b2=COLUMN:-1 ...)"
        )
        chosen = answer(
            None, question, proposal, lambda reply: _parsed_encoders(reply.split(), columns), ask
        )
    nominal = load.load_ballbar(ballbar)
    question, check = "Lines of the encoders per turn?", whole_number(1, 10_000_000)
    lines = answers.lines or answer(None, question, str(nominal.encoder_lines), check, ask)
    question, check = "Bits of the interpolation (EL5021 object 8001:11)?", whole_number(8, 13)
    bits = answers.bits or answer(None, question, str(nominal.encoder_bits), check, ask)
    return {
        name: {"column": column, "lines": lines, "bits": bits, "sign": direction}
        for name, (column, direction) in sorted(chosen.items())
    }


def _parsed_encoders(texts: Sequence[str], columns: Sequence[str]) -> Mapping[str, tuple[str, int]]:
    """Encoder -> (counter column, direction +1 or -1), from `b1=COLUMN` or `b1=COLUMN:-1`.

    columns : of the log, as far as they can be seen.

    Raises InputError also for a name that is none of them.
    """
    if not texts:
        raise InputError("no encoder was named: write b1=COLUMN, and so on.")
    return dict(_parsed_encoder(text, columns) for text in texts)


def _parsed_encoder(text: str, columns: Sequence[str]) -> tuple[str, tuple[str, int]]:
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
    return name, (column, int(direction))

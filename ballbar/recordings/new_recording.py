"""`ballbar new`: a recording folder from two log files; what the files show is proposed, what they cannot show is asked.

Nothing is guessed: every proposal is said in words and confirmed by the user, at the prompt or by an option. The folder is made
beside its place, read once as a whole, and only then put there.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquisition import Recording, read_recording
from acquisition.formats.dialect import (
    Container,
    Dialect,
    dialect_file,
    dialect_names,
    load_dialect,
)
from acquisition.formats.registry import container_of
from acquisition.sources import MINIMUM_ROWS, force_layout, robot_layout
from acquisition.table.fields import split_fields
from acquisition.table.header import read_header
from acquisition.table.text import LogText, read_filled, text_of
from acquisition.times import TIME_FORMS, recognised, words
from cell.errors import InputError, LogError
from cell.files import write_yaml
from cell.load import ballbar_names, load_ballbar, robot_names
from cell.recording import SourceFile

Ask = Callable[[str, str | None], str]  # (question, proposed answer) -> answer

ENCODERS = ("b1", "b2", "b3", "b4", "b5")
_SIDES = {
    "motors": "motor angles",
    "axes": "axis angles as the controller shows them",
    "joints": "joint angles of the DH model",
}


@dataclass(frozen=True)
class Told:
    """What the user said by options; None and empty for what is to be asked."""

    robot: str | None = None
    ballbar: str | None = None
    robot_dialect: str | None = None
    ballbar_dialect: str | None = None
    robot_time: str | None = None
    ballbar_time: str | None = None
    encoders: tuple[str, ...] = ()  # b1=COLUMN, or b1=COLUMN:-1
    lines: int | None = None
    bits: int | None = None


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a log shows without being read."""

    name: str
    container: Container
    text: LogText | None  # none where it is no text

    @property
    def names(self) -> list[str]:
        """Of its columns, as far as they can be seen."""
        return [] if self.text is None else _names(self.text, self.container)


def new_recording(
    folder: Path, robot_log: Path, ballbar_log: Path, told: Told, ask: Ask
) -> Recording:
    """Makes the folder and reads it.

    Raises InputError if something is there already, an answer is missing or the files cannot be read as told; then nothing is left.
    """
    if folder.exists() and (folder.is_file() or any(folder.iterdir())):
        raise InputError(
            f"{folder}: exists and holds something; nothing was written. Choose another folder."
        )
    if robot_log.name == ballbar_log.name:
        raise InputError(f"{robot_log} and {ballbar_log} have the same name; rename one of them.")
    description = _description(robot_log, ballbar_log, told, ask)
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
        write_yaml(aside / "recording.yaml", description)
        read = read_recording(aside)
        if folder.exists():
            folder.rmdir()
        aside.rename(folder)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return read


def _description(robot_log: Path, ballbar_log: Path, told: Told, ask: Ask) -> dict[str, Any]:
    robot_shown, bar_shown = _shown(robot_log), _shown(ballbar_log)
    robot_dialect = told.robot_dialect or _ask_dialect("robot", robot_shown, ask)
    bar_dialect = told.ballbar_dialect or _ask_dialect("ballbar", bar_shown, ask)
    robot = told.robot or ask(f"Which robot? ({', '.join(robot_names())}, or a .yaml file)", None)
    ballbar = told.ballbar or ask(
        f"Which ball-bar? ({', '.join(ballbar_names())}, or a .yaml file)", None
    )
    sources = {
        "robot": _source(robot_shown, robot_dialect, told.robot_time, ask),
        "ballbar": _source(bar_shown, bar_dialect, told.ballbar_time, ask),
    }
    encoders = _encoders(bar_shown, ballbar, told, ask)
    return {
        "schema": "ballbar-recording/1",
        "kind": "real",
        "robot": robot,
        "ballbar": ballbar,
        "sources": sources,
        "encoders": encoders,
        "notes": "",
    }


def _shown(log: Path) -> _Shown:
    """A log as far as it shows what it is. Raises LogError if it cannot be opened."""
    content = read_filled(log, log.name)
    container = container_of(content.raw)
    text = text_of(content, log.name) if container in ("text", "twincat-scope") else None
    return _Shown(log.name, container, text)


def _ask_dialect(side: str, shown: _Shown, ask: Ask) -> str:
    name = shown.name
    fits = [
        one
        for one in dialect_names()
        if load_dialect(one).source == side and _fits(load_dialect(one), shown)
    ]
    known = ", ".join(one for one in dialect_names() if load_dialect(one).source == side)
    if fits:
        question = f"{name} fits the dialect {fits[0]}: {_meaning(load_dialect(fits[0]))}. Which dialect? ({known}, or a .yaml file)"
    else:
        question = f"{name} fits no dialect. Which one? ({known}, or a .yaml file of your own)"
    return ask(question, fits[0] if len(fits) == 1 else None)


def _fits(dialect: Dialect, shown: _Shown) -> bool:
    if dialect.container != shown.container:
        return False
    text = shown.text
    if text is None or shown.container != "text":
        return True
    source = SourceFile(files=(text.file,), dialect="")
    try:
        if dialect.source == "robot":
            read_header(text, robot_layout(source, dialect))
        elif dialect.source == "force":
            read_header(text, force_layout(source, dialect))
        else:
            names = shown.names
            return dialect.time.column in names or bool(
                dialect.time.halves and set(dialect.time.halves) <= set(names)
            )
    except LogError:
        return False
    return True


def _meaning(dialect: Dialect) -> str:
    forms = " or ".join(words(form) for form in dialect.time.possible)
    if dialect.source == "robot":
        return f"{_SIDES[dialect.angle_kind]} in {dialect.angle_unit}, time in {forms}"
    return f"raw counters, time in {forms}"


def _source(shown: _Shown, dialect_name: str, time: str | None, ask: Ask) -> dict[str, Any]:
    own = dialect_name.endswith(".yaml")
    dialect = dialect_file(Path(dialect_name)) if own else load_dialect(dialect_name)
    source: dict[str, Any] = {"files": [f"raw/{shown.name}"], "dialect": dialect_name}
    if time is None and dialect.time.forms and not _time_shows(dialect, shown):
        time = ask(
            f"{shown.name}: what are the time stamps? They do not show it. ({', '.join(TIME_FORMS)})",
            None,
        )
    if time is not None:
        source["time"] = time
    return source


def _time_shows(dialect: Dialect, shown: _Shown) -> bool:
    text = shown.text
    if text is None or dialect.time.column not in shown.names:
        return True  # two halves, or no text: the reader sees
    column = shown.names.index(dialect.time.column)
    cells = [
        split_fields(line, _separator(text))
        for line in text.lines[len(text.lines) // 2 : len(text.lines) // 2 + 1]
    ]
    return any(
        len(row) > column and recognised(row[column], dialect.time.forms) is not None
        for row in cells
    )


def _encoders(bar: _Shown, ballbar: str, told: Told, ask: Ask) -> dict[str, dict[str, Any]]:
    names = bar.names
    chosen = _told_encoders(told.encoders)
    if not chosen:
        shown = [name for name in ENCODERS if name in names]
        proposed = " ".join(f"{name}={name}" for name in shown) or None
        answer = ask(
            f"Which column holds which encoder's counter? Columns: {', '.join(names)}. (b1=COLUMN b2=COLUMN:-1 ...)",
            proposed,
        )
        chosen = _told_encoders(answer.split())
    nominal = None if ballbar.endswith(".yaml") else load_ballbar(ballbar)
    lines = told.lines or _whole(
        ask("Lines of the encoders a turn?", str(nominal.encoder_lines) if nominal else None)
    )
    bits = told.bits or _whole(
        ask(
            "Bits of the interpolation (EL5021 object 8001:11)?",
            str(nominal.encoder_bits) if nominal else None,
        )
    )
    return {
        name: {"column": column, "lines": lines, "bits": bits, "sign": sign}
        for name, (column, sign) in sorted(chosen.items())
    }


def _told_encoders(said: Sequence[str]) -> Mapping[str, tuple[str, int]]:
    out: dict[str, tuple[str, int]] = {}
    for one in said:
        name, equals, column = one.partition("=")
        column, _, sign = (
            column.rpartition(":") if column.endswith((":1", ":-1", ":+1")) else (column, "", "1")
        )
        if name not in ENCODERS or not equals or not column:
            raise InputError(
                f"encoder {one!r}: write b1=COLUMN, or b1=COLUMN:-1 where it counts the other way; encoders are b1 to b5."
            )
        out[name] = (column, int(sign))
    return out


def _whole(answer: str) -> int:
    if not answer.strip().isdigit():
        raise InputError(f"{answer!r} is not a whole number.")
    return int(answer)


def _names(text: LogText, container: Container) -> list[str]:
    """Names of the header: the first of the first lines that has as many fields as most lines; of the channels of a Scope export."""
    separator = _separator(text)
    if container == "twincat-scope":
        heads = [
            split_fields(line, separator)
            for line in text.lines[:MINIMUM_ROWS]
            if line.startswith("Name")
        ]
        return [name for head in heads[-1:] for name in head if name != "Name"]
    width = len(split_fields(text.lines[-1], separator))
    rows = (split_fields(line, separator) for line in text.lines[:MINIMUM_ROWS])
    return next((row for row in rows if len(row) == width), [])


def _separator(text: LogText) -> str:
    return max((";", ",", "\t"), key=text.lines[-1].count)

"""Which seat and which target each of several files of still poses belongs to.

Files are taken one after the other. What one shares with those before it is shown by its poses and
values (`file_relations`); what it does not share is named by its path. Of sockets each file is a
seat, and the ball is one target. Where files show nothing there is no proposal, so `--yes` refuses.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import PurePosixPath

from ballbar.cell.errors import InputError
from ballbar.cell.foreign_text import is_printable, one_line
from ballbar.cell.poses import PoseTable
from ballbar.recordings.file_relations import MeasuredFile, Relation, relation
from ballbar.recordings.questions import Ask, answer

KEYS = ("seat", "target")  # of poses.yaml; names too, of the only one
RAW = "raw/"  # folder of the copied files
_PACKED = (".gz", ".bz2", ".xz")
_WORD = re.compile(r"[^_\-. ]+")

Name = str | dict[str, str]  # as poses.yaml has it: a name, or the column that holds it
# Seats and targets of all files, where they are given.
Given = tuple[Sequence[Name] | None, Sequence[Name] | None]


@dataclass(frozen=True)
class FilePlace:
    """Seat and target of one file."""

    names: tuple[Name | None, Name | None]  # None where nothing shows it
    reason: str = ""

    def lines(self, file: str) -> str:
        """Seat, target and reason as lines of text."""
        seat, target = (
            f"of column {name['column']}" if isinstance(name, dict) else name or "?"
            for name in self.names
        )
        reason = f"    {self.reason}\n" if self.reason else ""
        return f"  {file}: seat {seat}, target {target}\n{reason}"


def named_places(
    table: PoseTable, files: Sequence[str], given: Given, ask: Ask
) -> list[tuple[Name, Name]]:
    """Seat and target of each file: as given, else as proposed and accepted, or as answered.

    table : every file with the names that are given, and elsewhere names of its own. files : as
    the table calls them.
    """
    places = proposed_places(table, files, given)
    short = [file.removeprefix(RAW) for file in files]
    lines = "".join(place.lines(file) for file, place in zip(short, places, strict=True))
    question = f"Seats and targets of {len(files)} files:\n{lines}"
    proposed = [(place.names[0] or "", place.names[1] or "") for place in places]
    if all(all(names) for names in proposed):
        words = f"{question}Are they right? (yes, or no to name them)"
        if answer(None, words, "yes", _yes, ask):
            return proposed
        question = ""
    answers = list[tuple[Name, Name]]()
    for k, file in enumerate(short):
        names = list(proposed[k])
        for i, key in enumerate(KEYS):
            if given[i] is None:
                which = f": which {key}?"
                if not names[i]:
                    which = f" does not show its {key}: {places[k].reason}. Which is it?"
                words = f"{question}{file}{which} (or --{key} NAME, once for each file)"
                names[i] = answer(None, words, str(names[i]) or None, checked_name, ask)
                question = ""
        answers.append((names[0], names[1]))
    return answers


def _yes(reply: str) -> bool:
    word = reply.strip().lower()
    if word not in ("yes", "y", "no", "n"):
        raise InputError(f"{reply!r}: expected yes or no.")
    return word.startswith("y")


def checked_name(reply: str) -> str:
    """The name of a seat or target. Raises InputError for what is none."""
    name = reply.strip()
    if not name or not is_printable(name):
        raise InputError(f"{reply!r}: no name of a seat or target.")
    return name


def proposed_places(table: PoseTable, files: Sequence[str], given: Given) -> list[FilePlace]:
    """Seat and target of each file as far as they are given, or the files show them.

    Arguments as those of `named_places`.
    """
    short = [file.removeprefix(RAW) for file in files]
    if table.groups[0].measured == "socket":
        seats, targets = given[0] or labels(short), given[1] or [KEYS[1]] * len(files)
        rule = "a file of sockets is one socket, and the ball on the flange one target"
        pairs = zip(seats, targets, strict=True)
        return [FilePlace(names, "" if k else rule) for k, names in enumerate(pairs)]
    places, measured = list[FilePlace](), list[list[MeasuredFile]]()
    for k, label in enumerate(labels(short)):
        groups = [group for group in table.groups if group.file == files[k]]
        measured.append([MeasuredFile(short[k], group, table.robot) for group in groups])
        own = [None if names is None else names[k] for names in given]
        places.append(_place(own, label, places, measured))
    for i, key in enumerate(KEYS):
        if given[i] is None and len({place.names[i] for place in places}) == 1:
            names = [(*place.names[:i], key, *place.names[i + 1 :]) for place in places]
            places = [FilePlace((n[0], n[1]), p.reason) for n, p in zip(names, places, strict=True)]
    return places


def _place(
    given: Sequence[Name | None],
    label: str,
    earlier: Sequence[FilePlace],
    measured: Sequence[Sequence[MeasuredFile]],
) -> FilePlace:
    """Seat and target of the last one of the measured files.

    given : those that are known. label : the name of what it shares with no earlier file.
    """
    names, others = list(given), (list[Name](), list[Name]())
    unclear, reasons, differences = [False, False], list[str](), list[str]()
    for place, groups in zip(earlier, measured[:-1], strict=True):
        wanted = [i for i in (0, 1) if names[i] is None and place.names[i] not in others[i]]
        if not wanted:
            continue
        seen = _relation(groups, measured[-1], given)
        for i in wanted:
            shared, other = seen.shared[i], place.names[i]
            if shared is None or other is None:
                unclear[i] = unclear[i] or shared is not False
            elif shared:
                names[i] = other
            else:
                others[i].append(other)
        decides = any(seen.shared[i] is not False for i in wanted)
        (reasons if decides else differences).append(seen.reason)
    seat, target = (name or (None if unclear[i] else label) for i, name in enumerate(names))
    return FilePlace((seat, target), "; ".join(reasons or differences[:1]))


def _relation(
    earlier: Sequence[MeasuredFile], own: Sequence[MeasuredFile], given: Sequence[Name | None]
) -> Relation:
    """Whether a file shares seat and target with an earlier one, by the parts with most in common.

    A file has several parts where a column names their seats or targets.
    """

    def shared(pair: tuple[MeasuredFile, MeasuredFile]) -> tuple[bool | None, bool | None]:
        equal = [getattr(pair[0].group, key) == getattr(pair[1].group, key) for key in KEYS]
        seat, target = (e if known else None for e, known in zip(equal, given, strict=True))
        return seat, target

    def size(pair: tuple[MeasuredFile, MeasuredFile]) -> tuple[int, int]:
        return shared(pair).count(True), min(part.group.size for part in pair)

    pair = max(product(earlier, own), key=size)
    return relation(*pair, shared(pair))


def labels(files: Sequence[str]) -> list[str]:
    """Short names of files: what their paths differ in.

    `left/hole_0.csv`, `left/hole_1.csv`, ... become `left/hole_0`, `left/hole_1`;
    `grid_cleaned.csv` and `random_cleaned.csv` become `grid` and `random`.
    """
    paths = [PurePosixPath(file) for file in files]
    paths = [path.with_suffix("") if path.suffix in _PACKED else path for path in paths]
    parts = [path.with_suffix("").parts for path in paths]
    if len({part[0] for part in parts}) == len(files):
        parts = [part[:1] for part in parts]
    names = [one_line("/".join(part)) for part in parts]
    words = [list(_WORD.finditer(name)) for name in names]
    least = min(map(len, words)) - 1
    if len(set(names)) < len(files) or least < 0:
        return [one_line(file) for file in files]
    first, last = 0, 0
    while first < least and len({each[first][0] for each in words}) == 1:
        first += 1
    while last < least - first and len({each[-1 - last][0] for each in words}) == 1:
        last += 1
    short = [
        name[each[first].start() : each[-1 - last].end()]
        for name, each in zip(names, words, strict=True)
    ]
    telling = all(len(name) > 1 and re.search(r"[^\W\d]", name) for name in short)
    return short if telling and len(set(short)) == len(files) else names

"""`ballbar new`: a recording folder from two logs, or poses.yaml from tables of still poses.

The folder is made beside its place, read once as a whole, and only then moved there.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from copy import deepcopy
from itertools import count
from pathlib import Path
from typing import Any

import yaml

from ballbar.acquisition.pose_tables import PoseImport, import_poses
from ballbar.acquisition.recording import Recording
from ballbar.cell.errors import InputError
from ballbar.cell.files import copied_description, new_folder, write_whole, write_yaml
from ballbar.recordings.answers import Answers
from ballbar.recordings.log_questions import log_description
from ballbar.recordings.preview import LogPreview
from ballbar.recordings.questions import Ask
from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.recordings.seat_questions import KEYS, RAW, Name, checked_name, named_places
from ballbar.recordings.table_questions import table_description


def new_recording(
    folder: Path, robot_log: Path, ballbar_log: Path, answers: Answers, ask: Ask
) -> Recording:
    """Makes the recording folder and reads it.

    ballbar_log : of the ball-bar, or of the instrument that measures a length or follows the tool;
    the same file where one table holds both.

    Raises InputError if the folder holds something, an answer is missing, or the files cannot be
    read in the way that was answered; then nothing is left behind.
    """
    names = {log.name.casefold() for log in (robot_log, ballbar_log)}
    if len(names) == 1 and not robot_log.samefile(ballbar_log):
        raise InputError(f"{robot_log} and {ballbar_log} have the same name; rename one of them.")
    with new_folder(folder) as aside:
        previews = LogPreview.of(robot_log), LogPreview.of(ballbar_log)
        description = log_description(*previews, answers, ask)
        recording, dialects = description.recording, description.dialects
        (aside / "raw").mkdir()
        for log in (robot_log, ballbar_log):
            shutil.copyfile(log, aside / "raw" / log.name)
        for name, dialect in dialects.items():
            write_yaml(aside / name, dialect)
        for name, source in recording["sources"].items():
            if source["dialect"] not in dialects:
                _copy_inplace(aside, source, "dialect", f"{name}_dialect")
        for key in ("robot", "ballbar", "instrument"):
            _copy_inplace(aside, recording, key, key)
        write_yaml(aside / "recording.yaml", recording)
        return read_with_causes(aside)


def new_poses(
    folder: Path, tables: Sequence[Path], answers: Answers, ask: Ask
) -> tuple[PoseImport, str]:
    """Makes the folder with poses.yaml and copies of the tables; gives its poses and its text.

    tables : files, and folders of files. The first file answers for the others, which have the
    same columns; which seat and which target each of them belongs to is a question of its own.
    Raises InputError as `new_recording`.
    """
    sources = _sources(tables)
    files = list(sources)
    with new_folder(folder) as aside:
        description, table = table_description(sources[files[0]], answers, ask)
        seats, targets = (_given(key, getattr(answers, key) or (), table, files) for key in KEYS)
        for file, source in sources.items():
            (aside / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, aside / file)
        for key in ("robot", "instrument"):
            _copy_inplace(aside, description, key, key)
        if pictures := table.get("pictures"):
            pictures["board"] = copied_description(aside, "board", Path(pictures["board"]))
            corners = Path(pictures["corners"])
            pictures["corners"] = f"{RAW}pictures/{corners.name}"
            (aside / RAW / "pictures").mkdir(parents=True)
            shutil.copyfile(corners, aside / pictures["corners"])
        unnamed: Sequence[Name | None] = files if len(files) > 1 else [None]
        places = zip(seats or unnamed, targets or unnamed, strict=True)
        text = _written(aside, description, table, dict(zip(files, places, strict=True)))
        read = import_poses(aside)
        if len(files) > 1 and None in (seats, targets):
            named = named_places(read.table, files, (seats, targets), ask)
            text = _written(aside, description, table, dict(zip(files, named, strict=True)))
            import_poses(aside)
    return import_poses(folder), text


def _copy_inplace(folder: Path, description: dict[str, Any], key: str, kind: str) -> None:
    """Copies a description of one's own that a key names, so that the folder can be moved."""
    if (name := description.get(key, "")).endswith(".yaml"):
        description[key] = copied_description(folder, kind, Path(name))


def _sources(tables: Sequence[Path]) -> dict[str, Path]:
    """The files of tables and folders, by the name of their copy: as much of the path as differs.

    Raises InputError for an empty folder, and for a file that is named twice.
    """
    files = list[Path]()
    for table in tables:
        content = [table]
        if table.is_dir():
            content = sorted(file for file in table.rglob("[!.]*") if file.is_file())
        if not content:
            raise InputError(f"{table}: this folder holds no files. Name that of the tables.")
        files += content
    twice = [file for k, file in enumerate(files) if any(map(file.samefile, files[:k]))]
    if twice:
        raise InputError(f"{twice[0]} is named twice; name it once.")
    parts = [(file.parent.resolve() / file.name).parts for file in files]
    folded = [tuple(map(str.casefold, part)) for part in parts]
    if len({*folded}) < len(files):
        raise InputError(f"{files[0]}, ...: two names differ in case alone; rename one of them.")
    depth = next(k for k in count(1) if len({part[-k:] for part in folded}) == len(files))
    return {RAW + "/".join(part[-depth:]): file for part, file in zip(parts, files, strict=True)}


def _given(
    key: str, names: Sequence[str], table: dict[str, Any], files: Sequence[str]
) -> Sequence[Name] | None:
    """Seats or targets of files: by the options, or by a column; None where neither says them.

    Raises InputError unless there is one name for all files, or one for each.
    """
    if len(names) not in (0, 1, len(files)):
        listed = ", ".join(file.removeprefix(RAW) for file in files)
        raise InputError(
            f"{len(names)} times --{key} for {len(files)} files: give it once for all, or once for "
            f"each in this order: {listed}."
        )
    if names:
        return [checked_name(name) for name in names] * (len(files) if len(names) == 1 else 1)
    return [table[key]] * len(files) if key in table else None


def _written(
    folder: Path,
    description: dict[str, Any],
    table: dict[str, Any],
    places: Mapping[str, tuple[Name | None, Name | None]],
) -> str:
    """Writes poses.yaml and gives its text; files of one seat and one target are in one table.

    places : seat and target by file; None is left out.
    """
    tables = list[dict[str, Any]]()
    for file, place in places.items():
        named = {key: name for key, name in zip(KEYS, place, strict=True) if name is not None}
        for entry in tables:
            if all(entry.get(key) == named.get(key) for key in KEYS):
                entry["files"].append(file)
                break
        else:
            tables.append({"files": [file], **deepcopy(table), **deepcopy(named)})
    # Lists of columns on one line.
    text = yaml.safe_dump(
        {**description, "tables": tables, "notes": ""},
        sort_keys=False,
        allow_unicode=True,
        width=98,
        default_flow_style=None,
    )
    write_whole(folder / "poses.yaml", text.encode())
    return text

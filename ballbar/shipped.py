"""Shipped descriptions, dialects and scenarios by name; and copies of the scenarios."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path

from ballbar.cell import load
from ballbar.cell.dialect import dialect_names, load_dialect
from ballbar.cell.errors import InputError
from ballbar.cell.extended_yaml import SHIPPED
from ballbar.cell.files import aside_of, require_writable, write_whole

DIALECTS = SHIPPED.parent / "cell" / "dialects"
COPIED = ("*.yaml", "paths", "plans", "sweeps")  # of the scenarios; claims belong to the thesis

_SENTENCE_END = re.compile(r"(?<!\bsec)(?<!\bFigs)\. ")


def shipped() -> dict[str, dict[str, str]]:
    """Title or purpose of everything that is shipped, by kind and name."""
    dialects = {
        name: f"{load_dialect(name).source}: {_purpose(DIALECTS / f'{name}.yaml')}"
        for name in dialect_names()
    }
    return {
        "robots": {name: load.load_robot(name).title for name in load.robot_names()},
        "ballbars": {name: load.load_ballbar(name).title for name in load.ballbar_names()},
        "instruments": {name: load.load_instrument(name).title for name in load.instrument_names()},
        "plates": {name: load.load_plate(name).title for name in load.plate_names()},
        "dialects": dialects,
        "scenarios": {file.stem: _purpose(file) for file in sorted(SHIPPED.glob("*.yaml"))},
    }


def _purpose(file: Path) -> str:
    """First sentence of the comment at the beginning of a file."""
    lines = takewhile(lambda line: line.startswith("#"), file.read_text("utf-8").splitlines())
    comment = " ".join(line[1:].strip() for line in lines)
    return _SENTENCE_END.split(comment, maxsplit=1)[0].removesuffix(".")


def copy_scenarios(folder: Path) -> list[str]:
    """Copies the shipped scenarios, with their paths, plan requests and sweeps.

    folder : new, empty, or with a part of these copies, as a power cut leaves them. Returns the
    names of what stands in it.

    Raises InputError if it holds anything else, or all of them.
    """
    files = {
        file.relative_to(SHIPPED): file.read_bytes()
        for pattern in COPIED
        for source in sorted(SHIPPED.glob(pattern))
        for file in sorted(source.rglob("*") if source.is_dir() else [source])
        if file.is_file()
    }
    held = _held(folder, files)
    if held is None or files.keys() <= held:
        what = "exists and holds something; nothing was written."
        raise InputError.at(folder, what, "Choose another folder.")
    for name in held - files.keys():
        (folder / name).unlink()
    require_writable(folder)
    for name, content in files.items():
        write_whole(folder / name, content)
    return sorted({name.parts[0] for name in files})


def _held(folder: Path, files: Mapping[Path, bytes]) -> set[Path] | None:
    """Names of those files, or of their unfinished copies, in a folder; None if it holds others."""
    if folder.is_file():
        return None
    unfinished, held = {aside_of(name) for name in files}, set()
    for path in folder.rglob("*"):
        name = path.relative_to(folder)
        if path.is_dir() and any(name in file.parents for file in files):
            continue
        if name not in unfinished and (name not in files or path.read_bytes() != files[name]):
            return None
        held.add(name)
    return held

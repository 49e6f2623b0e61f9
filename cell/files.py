"""Output files that appear whole or not at all, and output folders."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import yaml

from ballbar.cell.core_yaml import CoreDumper
from ballbar.cell.errors import InputError
from ballbar.cell.foreign_files import read_regular
from ballbar.cell.foreign_text import printable
from ballbar.cell.strict_yaml import MAX_BYTES

if sys.platform != "win32":
    import fcntl

_LOCK = ".lock"  # in a folder that is written to, on Windows


def write_whole(path: Path, content: bytes) -> None:
    """Write a file beside its place, then rename it. Folders are made as needed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as aside, aside.open("wb") as file:
        file.write(content)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to, which is renamed to it at the end.

    It is deleted if anything fails. An error of the disk names the file.
    """
    aside = aside_of(path)
    try:
        yield aside
        with aside.open("r+b") as file:  # Windows writes out only what is open for writing
            os.fsync(file.fileno())
        aside.replace(path)
    except OSError as error:
        if error.filename is None or Path(error.filename) == aside:  # such as a full disk
            error.filename = str(path)
        raise
    finally:
        aside.unlink(missing_ok=True)


def require_writable(folder: Path) -> None:
    """Raises InputError if files cannot be made in a folder, or the folder itself cannot.

    A long computation asks before.
    """
    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not existing.is_dir():
        raise InputError(f"{existing}: is no folder, so {folder} cannot be made. Choose another.")
    if not os.access(existing, os.W_OK | os.X_OK):
        what = "cannot be written to (permission denied); nothing was written."
        raise InputError.at(existing, what, "Change its permissions, or choose another folder.")


def write_new(path: Path, content: bytes) -> None:
    """Writes a file that does not exist yet. Raises InputError rather than replace a file."""
    write_new_together({path: content})


def write_new_together(contents: Mapping[Path, bytes]) -> None:
    """Writes files that do not exist yet, all of them or none.

    Raises InputError rather than replace a file, and the error of the disk.
    """
    for path in contents:
        if path.exists():
            what = "exists already; nothing was written."
            raise InputError.at(path, what, "Name another file with --out.")
        path.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as written:
        for path, content in contents.items():
            written.enter_context(written_whole(path)).write_bytes(content)
        renames = written.pop_all()
    try:
        renames.close()
    except BaseException:
        for path in contents:
            path.unlink(missing_ok=True)
        raise


DESCRIPTIONS = "descriptions"  # folder of the files of one's own that a recording or result names


def copied_description(folder: Path, key: str, file: Path) -> str:
    """Copies a description of one's own into a folder, which may be moved with it.

    key : what it describes: robot, ballbar, plate ... Returns its name from the folder.
    """
    name = f"{DESCRIPTIONS}/{key}/{file.name}"
    write_whole(folder / name, read_regular(file, MAX_BYTES))
    return name


def portable_name(name: str, key: str, *, relative_to: Path, folder: Path) -> str:
    """A shipped name as it is; a file of one's own (`.yaml`) is copied, as `copied_description`.

    relative_to : folder from which the name is taken.
    """
    if not name.endswith(".yaml"):
        return name
    return copied_description(folder, key, relative_to / name)


def write_yaml(path: Path, data: dict[str, object]) -> None:
    """Write plain data as YAML, keys in their order, control characters of text as escapes."""
    text = yaml.dump(
        _printable(data), Dumper=CoreDumper, sort_keys=False, allow_unicode=True, width=120
    )
    write_whole(path, text.encode())


def _printable(data: object) -> object:
    """Plain data with all text printable, as the reader of YAML files wants it."""
    if isinstance(data, dict):
        return {_printable(key): _printable(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_printable(value) for value in data]
    return printable(data) if isinstance(data, str) else data


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path` to fill, which is renamed to it at the end.

    Nothing is left if anything fails. Raises InputError when the folder holds something, or cannot
    be made.
    """
    if path.exists():
        if path.is_file() or any(path.iterdir()):
            what = "exists and holds something; nothing was written."
            raise InputError.at(path, what, "Choose another folder.")
        if path.samefile(Path.cwd()):
            raise InputError(f"{path}: you are in this folder. Name a new one.")
    require_writable(path.absolute().parent)
    aside = aside_of(path)
    shutil.rmtree(aside, ignore_errors=True)
    try:
        aside.mkdir(parents=True)
        yield aside
        if path.exists():  # empty; Windows replaces no folder
            path.rmdir()
        aside.replace(path)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _tidied(path: Path, known: set[str]) -> None:
    """Deletes unfinished files of these names. Raises InputError where other files are."""
    unfinished = {aside_of(path / name).name for name in known}
    entries = {entry.name for entry in path.iterdir()} - {_LOCK}
    if foreign := sorted(entries - known - unfinished):
        what = f"exists and holds something else ({', '.join(foreign[:3])}); nothing was written."
        raise InputError.at(path, what, "Choose another folder with --out.")
    for name in entries & unfinished:
        (path / name).unlink()


@contextmanager
def claimed_folder(path: Path, known: set[str], what: str) -> Iterator[None]:
    """A folder for output alone: absent, empty, or with an earlier output only; made as needed.

    known : names of an earlier output. what : the kind of output, for the message. What a power cut
    left of one of those files is deleted.

    Raises InputError when the folder holds anything else, or another process writes to it.
    """
    if path.is_file():
        raise InputError(f"{path}: is a file; {what} needs a folder. Choose another with --out.")
    require_writable(path)
    made = not path.exists()
    path.mkdir(parents=True, exist_ok=True)
    try:
        with _locked(path):
            _tidied(path, known)
            yield
    finally:
        if made:
            with suppress(OSError):  # it holds something now
                path.rmdir()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keeps other processes out of a folder, as long as this one lives.

    Raises InputError if another one has locked it.
    """
    with ExitStack() as held:
        try:
            if sys.platform == "win32":  # a file that the system deletes when it is closed
                flags = os.O_CREAT | os.O_EXCL | os.O_TEMPORARY
                held.callback(os.close, os.open(folder / _LOCK, flags))
            else:
                descriptor = os.open(folder, os.O_RDONLY)
                held.callback(os.close, descriptor)
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, FileExistsError):
            remedy = "Wait for it, or choose another folder with --out."
            raise InputError.at(folder, "another process writes to this folder.", remedy) from None
        yield


def name_from(folder: Path, file: Path) -> str:
    """The name of a file from a folder, with slashes on every system; absolute on another drive."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # of another drive of Windows
        return file.resolve().as_posix()


def beside(path: Path, ending: str) -> Path:
    """The path with an ending at its name; `.` and `..` have the names of their folders."""
    named = path.resolve() if path.name in ("", "..") else path
    return named.with_name(named.name + ending)


def aside_of(path: Path) -> Path:
    """Where a file is written before it is renamed to its name."""
    return path.with_name(f".{path.name}.part")

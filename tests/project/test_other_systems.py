"""Windows and macOS by stand-ins: what they lack is taken away, what they refuse is refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path, PureWindowsPath
from tempfile import gettempdir

import pytest

from ballbar.cell import files, foreign_files
from ballbar.cell.errors import InputError
from ballbar.recordings.new import _sources
from ballbar.sweep.chunk import _reason
from tests.helpers.simulated_recordings import Recorded
from tests.helpers.source_imports import ROOT

# A process that finds itself on Windows: no locks and masks of POSIX, a descriptor that cannot be
# written does not reach the disk, no folder is opened or replaced, text without a stated encoding
# is an error. What the libraries ask of the system when they load, they ask before.
WINDOWS = """
import asyncio, concurrent.futures.process, errno, fcntl, json, multiprocessing.spawn, os, shutil
import signal, sqlite3, subprocess, sys, tempfile, warnings
import jinja2, numpy, pyarrow.csv, pydantic, rich.console, rich.progress, scipy, typer, yaml
import scipy.fft, scipy.interpolate, scipy.ndimage, scipy.optimize, scipy.signal, scipy.sparse
import scipy.spatial.transform, scipy.special, typer.rich_utils, typer.completion

access, descriptor_of, close, flush, replace = fcntl.fcntl, os.open, os.close, os.fsync, os.replace
GETFL, temporary = fcntl.F_GETFL, {}

def opened(path, flags, *rest, **named):
    if os.path.isdir(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))
    descriptor = descriptor_of(path, flags & ~os.O_TEMPORARY, *rest, **named)
    if flags & os.O_TEMPORARY:
        temporary[descriptor] = path
    return descriptor

def closed(descriptor):
    close(descriptor)
    if descriptor in temporary:
        os.unlink(temporary.pop(descriptor))

def flushed(descriptor):
    if access(descriptor, GETFL) & os.O_ACCMODE == os.O_RDONLY:
        raise OSError(errno.EBADF, "Bad file descriptor")
    flush(descriptor)

def replaced(source, target, **_):
    if os.path.isdir(target):
        raise PermissionError(errno.EACCES, "Access is denied", str(source))
    replace(source, target)

sys.platform = "win32"
for name in ("fcntl", "resource", "termios", "pwd", "grp"):
    sys.modules[name] = None
for module, names in ((signal, "pthread_sigmask SIG_BLOCK SIG_SETMASK"), (os, "nice O_NONBLOCK")):
    for name in names.split():
        delattr(module, name)
os.O_TEMPORARY, os.O_BINARY, os.O_ACCMODE = 1 << 40, 0, 3
os.open, os.close, os.fsync, os.replace = opened, closed, flushed, replaced
signal.SIGBREAK, signal.CTRL_BREAK_EVENT = signal.SIGUSR1, 1
subprocess.CREATE_NEW_PROCESS_GROUP = 0x200
warnings.filterwarnings("error", category=EncodingWarning, module="ballbar")
"""
COMMANDS = """
from ballbar.commands import cli
for words in json.loads(sys.argv[1]):
    sys.argv[:] = ["ballbar", *words]
    try:
        cli.main()
    except SystemExit as end:
        if end.code:
            print(words, end.code, file=sys.stderr)
            raise
"""


def on_windows(program: str, *words: str) -> subprocess.CompletedProcess[str]:
    """A Python program in such a process."""
    return subprocess.run(
        [sys.executable, "-X", "warn_default_encoding", "-c", WINDOWS + program, *words],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_recordings_are_made_read_identified_and_exported_on_windows(
    recorded: Recorded, tmp_path: Path
) -> None:
    made, result = tmp_path / "made", tmp_path / "result"
    made.mkdir()  # empty: it is replaced
    logs = [recorded.folder / "raw" / name for name in ("robot.csv", "ballbar.csv")]
    dialects = ["--robot-dialect", "abb-motor", "--ballbar-dialect", "twincat-plc", "--yes"]
    cell = ["--robot", "irb2400", "--ballbar", "lund_600"]
    commands = [
        ["new", made, *logs, *cell, *dialects],
        ["check", made],
        ["identify", made, "--samples", 300, "--out", result],
        ["export", result, "--to", "urdf", "--out", tmp_path / "robot.urdf"],
        ["list"],
    ]
    done = on_windows(COMMANDS, json.dumps([[str(word) for word in words] for words in commands]))
    assert done.returncode == 0, done.stderr
    assert "Good fit" in done.stdout
    assert (tmp_path / "robot.urdf").read_bytes().startswith(b"<?xml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made", "result", "robot.urdf"]
    assert not list(result.glob(".*"))  # the lock is gone


def test_a_folder_is_written_by_one_process_at_a_time_on_windows(tmp_path: Path) -> None:
    program = """
from pathlib import Path
from ballbar.cell.errors import InputError
from ballbar.cell.files import claimed_folder
folder = Path(sys.argv[1])
with claimed_folder(folder, set(), "the result"):
    try:
        with claimed_folder(folder, set(), "the result"):
            print("twice")
    except InputError as error:
        print(error)
with claimed_folder(folder, set(), "the result"):
    print("again")
print(folder.exists())
"""
    done = on_windows(program, str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert "another process writes to this folder" in done.stdout
    assert "twice" not in done.stdout
    assert done.stdout.endswith("again\nFalse\n")


def test_processes_start_and_stop_by_what_windows_has() -> None:
    program = """
from ballbar.cell.processes import on_stop_signals, process_apart, stop_signals_blocked
from ballbar.watch import beside
with stop_signals_blocked():
    pass
with on_stop_signals(lambda: print("stopped")):
    os.kill(os.getpid(), signal.SIGBREAK)
def started(command, **options):
    print(beside.END, options["creationflags"])
subprocess.Popen = started
process_apart(["viewer"])
from ballbar import __main__ as command
from ballbar.commands import cli
def main():
    try:
        os.kill(os.getpid(), signal.SIGBREAK)
    except KeyboardInterrupt:
        print("interrupted")
cli.main = main
command.main()
"""
    done = on_windows(program)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "stopped\n1 512\ninterrupted\n"


def test_names_of_files_have_slashes_and_name_other_drives_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "paths" / "a.yaml"
    assert files.name_from(tmp_path / "b", file) == "../paths/a.yaml"

    def on_other_drives(*_: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    with monkeypatch.context() as patch:
        patch.setattr(os.path, "relpath", on_other_drives)
        assert files.name_from(tmp_path / "b", file) == file.as_posix()
    monkeypatch.setattr(files, "Path", PureWindowsPath)
    monkeypatch.setattr(os.path, "relpath", lambda *_: r"..\paths\a.yaml")
    assert files.name_from(tmp_path / "b", file) == "../paths/a.yaml"


def test_two_files_on_a_disk_that_numbers_none_are_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some disks and shares of Windows give each file the number 0."""
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(name)

    class Status:
        st_dev, st_ino = 7, 0

    monkeypatch.setattr(foreign_files.os, "stat", lambda _: Status)
    assert foreign_files.repeated(tmp_path, ["a.csv", "b.csv"]) is None
    assert foreign_files.repeated(tmp_path, ["a.csv", "./a.csv"]) == ("a.csv", "./a.csv")


def test_copies_differ_by_more_than_capitals(tmp_path: Path) -> None:
    """Windows and macOS would write one over the other, there or where the recording is moved."""
    for place in ("one/Table.csv", "two/table.csv"):
        (tmp_path / place).parent.mkdir()
        (tmp_path / place).write_text(place)
    named = _sources([tmp_path / "one/Table.csv", tmp_path / "two/table.csv"])
    assert sorted(named) == ["raw/one/Table.csv", "raw/two/table.csv"]
    (tmp_path / "one/table.csv").write_text("the other one")
    if len(list((tmp_path / "one").iterdir())) == 2:  # a disk that tells capitals apart
        with pytest.raises(InputError, match="differ in case alone"):
            _sources([tmp_path / "one"])


@pytest.mark.parametrize("slash", ["/", "\\"])
def test_the_reason_of_a_failed_run_names_no_folder_of_the_machine(slash: str) -> None:
    temporary = f"{gettempdir()}{slash}ballbar-a1{slash}"
    reason = _reason(InputError(f"{temporary}path.yaml: no such file"))
    assert reason == "path.yaml: no such file"


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_only_what_a_system_has_is_called(system: str, tmp_path: Path) -> None:
    """Type checkers know which functions of the standard library a system lacks."""
    command = ["-m", "mypy", "--platform", system, "--cache-dir", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout

"""A fault that nobody foresaw ends with a sentence, a file of details and its own exit code."""

from __future__ import annotations

import os
import re
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from ballbar.acquisition.formats.ros_bag import read_ros_bag
from ballbar.acquisition.table.header import Layout
from ballbar.cell.errors import LogError
from ballbar.commands import cli
from tests.helpers.command_line import ballbar


def test_the_list_of_commands_says_what_each_is_for() -> None:
    code, said, _ = ballbar("--help")
    assert code == 0
    assert "Compare a calibration with the truth" in " ".join(said.split())


def failing(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> tuple[int, str, str]:
    """Code and output of a command whose work raises an error."""

    def fail() -> None:
        raise error

    monkeypatch.setattr(cli, "app", fail)
    return ballbar("check", "a")


def test_a_fault_says_what_happened_and_writes_the_details(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code, out, err = failing(monkeypatch, ZeroDivisionError("by \x1b[2J zero"))
    assert code == 3
    assert out == ""
    assert "fault of the program: ZeroDivisionError: by \\x1b[2J zero" in err
    assert "report it" in err
    assert "Traceback" not in err
    (details,) = tmp_path.iterdir()
    assert str(details) in err.replace("\n", "")
    assert re.search(r"ballbar check a\n.*Traceback.*fail", details.read_text(), re.DOTALL)


def test_details_that_cannot_be_written_are_printed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "absent"))
    code, _, err = failing(monkeypatch, ZeroDivisionError("by zero"))
    assert code == 3
    assert "Traceback" in err


def test_too_little_memory_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    code, _, err = failing(monkeypatch, MemoryError("Unable to allocate 894 GiB"))
    assert code == 3
    assert "not enough memory: Unable to allocate 894 GiB" in err


def test_an_error_that_ctrl_c_became_is_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    error = ImportError("cannot import")
    error.__cause__ = KeyboardInterrupt()
    code, _, err = failing(monkeypatch, error)
    assert code == 130
    assert "interrupted" in err


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_ctrl_c_while_libraries_load_gives_no_traceback(number: str) -> None:
    """In the first 1.4 s it gave one."""
    program = (
        "import builtins, os, signal\n"
        "from ballbar import __main__ as command\n"
        "real = builtins.__import__\n"
        "def load(name, *rest, **more):\n"
        "    if name == 'ballbar.commands.cli':\n"
        f"        os.kill(os.getpid(), signal.{number})\n"
        "    return real(name, *rest, **more)\n"
        "builtins.__import__ = load\n"
        "command.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert done.returncode == 130
    assert done.stderr == b"interrupted before it began\n"


@pytest.mark.parametrize(("words", "code"), [(["--version"], 0), (["check", "nowhere"], 2)])
def test_what_was_left_for_the_end_is_done_and_said(words: list[str], code: int) -> None:
    """The command leaves without taking down its libraries."""
    program = (
        "import atexit, sys\n"
        "from ballbar import __main__ as command\n"
        "atexit.register(lambda: print('the last word'))\n"
        f"sys.argv[1:] = {words!r}\n"
        "command.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert done.returncode == code
    assert done.stdout.endswith(b"the last word\n")


def test_a_bag_whose_messages_are_numbered_by_text_is_refused(tmp_path: Path) -> None:
    bag = tmp_path / "a.db3"
    with sqlite3.connect(bag) as made:
        made.execute("CREATE TABLE topics(id, name, type, serialization_format)")
        made.execute("CREATE TABLE messages(id, topic_id, timestamp, data)")
        made.execute("INSERT INTO topics VALUES(1, '/a', 'sensor_msgs/msg/JointState', 'cdr')")
        made.execute("INSERT INTO messages VALUES('first', 2, 0, x'00')")
        made.execute("INSERT INTO messages VALUES('second', 2, 0, x'00')")
    made.close()
    layout = Layout(separators=(",",), required={"time": "integer", "a": "float"}, optional={})
    with pytest.raises(LogError, match=r"a\.db3: a message has the number 'first'"):
        read_ros_bag(bag, "a.db3", "time", layout)

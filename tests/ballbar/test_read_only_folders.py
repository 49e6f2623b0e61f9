"""A folder that cannot be written to is named, before any work, to a user who is not root."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers.device_logs import write

NOBODY = 65534
# Libraries may lie where only root reads them, so they are imported before root is given up.
AS_NOBODY = f"""
import json, os, sys
import ballbar.commands.cli
for name in json.loads(sys.argv[1]):
    __import__(name)
if os.geteuid() == 0:
    os.setgroups([])
    os.setgid({NOBODY})
    os.setuid({NOBODY})
for words in json.loads(sys.argv[2]):
    sys.argv = ["ballbar", *words]
    try:
        ballbar.commands.cli.main()
    except SystemExit as end:
        print("code", end.code, flush=True)
"""
MODULES = [
    "acquisition.live.ads",
    "acquisition.live.session",
    "acquisition.recording",
    "ballbar.commands.identification",
    "ballbar.commands.live",
    "ballbar.commands.shipped",
    "ballbar.record.show",
    "ballbar.record.terminal",
    "ballbar.report.process",
]


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that everybody may enter and nobody but its owner write to, with a recording."""
    with tempfile.TemporaryDirectory() as made:
        path = Path(made)
        (path / "r").mkdir()
        write(path / "r")
        for entry in (path, *path.rglob("*")):
            entry.chmod(0o555 if entry.is_dir() else 0o444)
        yield path
        for entry in (path, *path.rglob("*")):
            entry.chmod(0o755)


def said(*commands: list[str]) -> str:
    """What the commands print and the codes they end with, to a user who is not root."""
    done = subprocess.run(
        [sys.executable, "-c", AS_NOBODY, json.dumps(MODULES), json.dumps(commands)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "COLUMNS": "400"},
        timeout=120.0,
    )
    return done.stdout + done.stderr


@pytest.mark.slow
def test_commands_name_a_folder_that_cannot_be_written_to(folder: Path) -> None:
    cell = ["--robot", "irb2400", "--ballbar", "lund_600"]
    commands = [
        ["identify", str(folder / "r")],
        ["identify", str(folder / "r"), "--out", str(folder / "out")],
        ["record", str(folder / "new"), *cell, "--egm", "16510"],
        ["init", str(folder / "new")],
    ]
    for command in commands:
        text = said(command)
        assert "code 2" in text, (command, text)
        assert "Traceback" not in text
        assert "ermission denied" in text, (command, text)
        assert str(folder) in text
    assert {path.name for path in folder.iterdir()} == {"r"}

"""A folder that cannot be written to is named, before any work, to a user who is not root."""

from __future__ import annotations

import ctypes
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from ballbar.cell.geometry import Geometry
from tests.helpers.calibrations import write_calibration_of
from tests.helpers.command_line import SHORT
from tests.helpers.device_logs import bar_lines, robot_lines, write
from tests.helpers.source_imports import ROOT

CHILD = """
import json, sys
from ballbar.commands import cli
for words in json.loads(sys.argv[1]):
    sys.argv = ["ballbar", *words]
    print("command", *words, flush=True)
    try:
        cli.main()
    except SystemExit as end:
        print("code", end.code, flush=True)
"""
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2  # linux/prctl.h, capability.h
CELL = ["--robot", "irb2400", "--ballbar", "lund_600"]
SWEEP = "schema: ballbar-sweep/1\nname: two\nscenario: short.yaml\nseeds: {first: 1, count: 2}\n"
TARGETS = "q1,q2,q3,q4,q5,q6\n0.1,0.2,0.1,0.0,0.5,0.0\n"


@pytest.fixture
def folder(nominal: Geometry) -> Iterator[Path]:
    """A folder that everybody may enter and nobody but its owner write to.

    It holds all that a command takes, and an empty folder of the same kind.
    """
    with tempfile.TemporaryDirectory() as made:
        path = Path(made).resolve()
        for name in ("r", "result", "empty"):
            (path / name).mkdir()
        shutil.copytree(ROOT / "scenarios/claims", path / "scenarios/claims")
        write(path / "r")
        write_calibration_of(path / "result" / "calibration.yaml", nominal, nominal)
        (path / "short.yaml").write_text(SHORT.replace("PATHS", str(ROOT / "scenarios/paths")))
        (path / "two.yaml").write_text(SWEEP)
        (path / "targets.csv").write_text(TARGETS)
        (path / "robot.csv").write_text("\n".join(robot_lines()))
        (path / "bar.csv").write_text("\n".join(bar_lines()))
        (path / "dh.csv").write_text(
            "a_mm,d_mm,alpha_deg,theta_deg,lower_deg,upper_deg\n"
            "100,615,-90,0,-180,180\n705,0,0,-90,-100,110\n135,0,-90,0,-60,65\n"
            "0,755,90,0,-200,200\n0,0,-90,0,-120,120\n0,85,0,180,-400,400\n"
        )
        for entry in (path, *path.rglob("*")):
            entry.chmod(0o555 if entry.is_dir() else 0o444)
        yield path
        for entry in (path, *path.rglob("*")):
            entry.chmod(0o755)


def bound_by_permissions() -> None:
    """The next processes of root may do no more than the owner of a file."""
    if os.geteuid() == 0:
        library = ctypes.CDLL(None)
        for right in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
            assert library.prctl(PR_CAPBSET_DROP, right, 0, 0, 0) == 0


def said(folder: Path, *commands: list[str]) -> list[str]:
    """Output and exit code of each command for a user who is not root."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(commands)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        env={**os.environ, "COLUMNS": "400", "PYTHONPATH": str(ROOT)},
        cwd=folder,
        timeout=120.0,
        preexec_fn=bound_by_permissions,
    )
    texts = re.split(r"^command .*\n", done.stdout, flags=re.MULTILINE)[1:]
    assert len(texts) == len(commands), done.stdout
    return texts


@pytest.mark.long
def test_every_command_that_writes_names_a_folder_that_it_cannot_write_to(folder: Path) -> None:
    new = ["robot.csv", "bar.csv", *CELL, "--yes"]
    commands = [
        *(
            [*words, *out]
            for words in (
                ["run", "short.yaml"],
                ["simulate", "short.yaml"],
                ["identify", "r"],
                ["sweep", "two.yaml"],
                ["plan", str(ROOT / "scenarios/plans/irb2400.yaml"), "--seconds", "0"],
                ["plan", str(ROOT / "scenarios/plans/ur10e_telescoping.yaml")],
                ["run", str(ROOT / "scenarios/panda_sockets.yaml")],
            )
            for out in ([], ["--out", "out"], ["--out", "empty"])
        ),
        *(["schema", "--out", out] for out in ("out", "empty")),
        *(["new", out, *new] for out in ("out", "empty")),
        *(["record", out, *CELL, "--egm", "16510"] for out in ("out", "empty")),
        *(["init", out] for out in ("out", "empty")),
        ["claims", "--quick", "--out", "claims.md"],
        ["export", "result", "--to", "urdf", "--out", "robot.urdf"],
        ["correct", "targets.csv", "--with", "result"],
        ["correct", "targets.csv", "--with", "result", "--out", "empty/corrected.csv"],
        ["robot", "new", "mine", "--dh", "dh.csv"],
        ["robot", "show", "irb2400", "--save", "empty/mine.rrd"],
    ]
    before = sorted(folder.rglob("*"))
    for command, text in zip(commands, said(folder, *commands), strict=True):
        assert text.endswith("code 2\n"), (command, text)
        line = text.removesuffix("code 2\n")
        assert line.count("\n") == 1, (command, text)
        assert "ermission denied" in line, (command, text)
        assert "Change its permissions" in line, (command, text)
    assert sorted(folder.rglob("*")) == before

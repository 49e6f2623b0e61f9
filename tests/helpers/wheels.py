"""Wheels, built without a download and installed outside the tree."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import venv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ballbar import PACKAGES
from tests.helpers.source_imports import ROOT

SHIPPED = (*PACKAGES, "scenarios")
BUILT_WITHIN = 600  # [s]
OFFLINE = ("--no-index", "--disable-pip-version-check")


def run(*command: object, cwd: Path) -> str:
    """Standard output of a command that sees nothing of the source tree. Fails with its errors."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


# Commands as lists of words, a line each, to exit code, standard output and error, a line each. Its
# arguments are folders of packages.
COMMANDS = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
sys.path[:0] = sys.argv[1:]
from ballbar.commands import cli

for line in sys.stdin:
    out, err, code = io.StringIO(), io.StringIO(), 0
    sys.argv[:] = ["ballbar", *json.loads(line)]
    with redirect_stdout(out), redirect_stderr(err):
        try:
            cli.main()
        except SystemExit as stop:
            code = int(stop.code or 0)
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""


@contextmanager
def commands_of(python: Path, cwd: Path) -> Iterator[Callable[..., str]]:
    """A function that runs a command of an interpreter's package and returns its standard output.

    All commands run in one process, which imports once. It fails with their errors.
    """
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    with subprocess.Popen(
        [python, "-c", COMMANDS],
        cwd=cwd,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:

        def say(*words: object) -> str:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(json.dumps(list(map(str, words))) + "\n")
            process.stdin.flush()
            code, out, err = json.loads(process.stdout.readline())
            assert code == 0, out + err
            return str(out)

        yield say


def copied(folder: Path) -> Path:
    """The source tree as git makes it: setuptools leaves its build folder beside the sources."""
    for name in SHIPPED:
        shutil.copytree(
            ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


def built(source: Path) -> Path:
    """The wheel of a tree or of a source distribution.

    Without build isolation nothing is downloaded; setuptools is a requirement of the tests.
    """
    options = ("--no-deps", "--no-build-isolation", *OFFLINE)
    run(sys.executable, "-m", "pip", "wheel", source, "-w", "dist", *options, cwd=source.parent)
    (made,) = (source.parent / "dist").glob("ballbar_bench-*.whl")
    return made


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Built from the source distribution, by the first worker that needs it for all of them."""
    folder = tmp_path_factory.getbasetemp()
    folder = (folder if worker_id == "master" else folder.parent) / "wheel"
    try:
        folder.mkdir()
    except FileExistsError:
        for _ in range(BUILT_WITHIN):
            if made := sorted(folder.glob("*.whl")):
                return made[0]
            time.sleep(1.0)
        pytest.fail(f"another worker did not build the wheel within {BUILT_WITHIN} s")
    tree = copied(folder / "tree")
    program = "from setuptools.build_meta import build_sdist; print(build_sdist('..'))"
    name = run(sys.executable, "-c", program, cwd=tree).splitlines()[-1]
    made = built(folder / name)
    return made.replace(folder / made.name)


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Interpreter of a fresh environment that holds the wheel alone.

    The dependencies are those of this environment, by a .pth file with its site-packages: this is
    quick and needs no network. The .pth files within a folder that a .pth file names are not read,
    so an editable install there, which would lead to the source tree, has no effect;
    --system-site-packages would give it one.
    """
    folder = tmp_path_factory.mktemp("alone")
    venv.create(folder, with_pip=False)
    interpreter = folder / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", interpreter)
    run(*pip, "install", "--no-deps", "--no-compile", *OFFLINE, wheel, cwd=folder)
    packages = [entry for entry in sys.path if entry.endswith("site-packages")]
    (own,) = folder.glob("lib/python*/site-packages")
    (own / "dependencies.pth").write_text("\n".join(packages) + "\n")
    return interpreter

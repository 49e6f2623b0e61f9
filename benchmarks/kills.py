"""Commands killed (SIGKILL) and interrupted (Ctrl-C) at random moments, and what they leave.

    python -m benchmarks.kills [--count 50] [--seed 1] [COMMAND ...]     # docs/studies/kills.csv

Every other time a command is killed; else it and its helpers get SIGINT, as from a terminal. The
moment is drawn evenly over the time that the command takes. Then:

half      a file of the result that is not whole: not as large as that of the undisturbed command
          within 2 %, or with another end; logs of a simulated recording byte for byte. Files still
          aside (`.NAME.part`) are no results
refused   the same command into the same folder does not end as the undisturbed one did, or leaves a
          file aside
traceback text of a Python error, exit code 3, or after Ctrl-C another code than 130, as a shell has
          it also of a command that SIGINT itself ended (of the two
          commands that Ctrl-C ends in order, `plan` and `record`: than theirs)
alive     a process that the command started, five seconds later

A recording is data: nothing replaces it. For `record` half is a row that is not whole before the
last line end, or a folder that neither can be checked nor says why; refused is a folder without a
single record that cannot be recorded into.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from benchmarks.study import ROOT, STUDIES, write_table
from tests.helpers.command_line import SHORT
from tests.helpers.plc_server import Plc

RESULT = STUDIES / "kills.csv"
ADDRESS = "127.0.0.41"
TOLERANCE = 0.02
CLAIM = "noise"  # the one file of claims that is judged and written as a page
RECORD_S = 4.0  # until which a recorder is killed: half of it before the first record
ENDS_IN_ORDER = {"plan": (0, 1), "record": (0, 1)}


@dataclass(frozen=True)
class Kill:
    """Remains of one disturbed command."""

    command: str
    signal: str
    after_s: float
    code: int
    half: str  # names of such files
    refused: str  # why
    traceback: bool
    alive: int


@dataclass(frozen=True)
class Undisturbed:
    """Result of a command that is left alone."""

    seconds: float
    code: int
    files: dict[str, tuple[int, bytes]]  # size and end of each by its name


def words(name: str, work: Path, out: Path, net_id: str) -> list[str]:
    """The arguments of a command that writes to `out`."""
    match name:
        case "run":
            return ["run", str(work / "short.yaml"), "--out", str(out)]
        case "plan":
            request = ROOT / "scenarios/plans/irb2400.yaml"
            return ["plan", str(request), "--seconds", "0", "--out", str(out)]
        case "claims":
            return ["claims", "--quick", "--out", str(out / "claims.md")]
        case "identify":
            return ["identify", str(work / "made/recording"), "--out", str(out)]
    cell = ["--robot", "irb2400", "--ballbar", "lund_600", "--plc", net_id, "--duration", "3"]
    return ["record", str(out), *cell]


def started(arguments: list[str], said: Path) -> subprocess.Popen[bytes]:
    """The command in a session of its own, in the folder of what it says."""
    with said.open("wb") as file:
        return subprocess.Popen(
            [sys.executable, "-m", "ballbar", *arguments],
            cwd=said.parent,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def files_of(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Size and end of each file of a result by its name, those aside left out."""
    out = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.name.endswith(".part"):
            content = path.read_bytes()
            out[str(path.relative_to(folder))] = (len(content), content[-24:])
    return out


def half_written(after: dict[str, tuple[int, bytes]], sound: Undisturbed) -> Iterator[str]:
    """Names of the files that are not whole."""
    for name, (size, end) in after.items():
        if name not in sound.files:
            yield name
            continue
        whole, whole_end = sound.files[name]
        allowed = 0.0 if "raw/" in name else TOLERANCE * whole
        ends = name.endswith((".html", ".svg", ".json", ".md"))
        if abs(size - whole) > allowed or (ends and end[-6:] != whole_end[-6:]):
            yield name


def recorded(folder: Path) -> tuple[int, str]:
    """Rows of a recording that broke off, and what is wrong with it."""
    rows = 0
    for path in folder.glob("raw/*.csv"):
        raw = path.read_bytes()
        lines = raw[: raw.rfind(b"\n") + 1].splitlines()
        rows += max(0, len(lines) - 1)
        if any(line.count(b";") != lines[0].count(b";") for line in lines):
            return rows, path.name
    if not rows:
        return 0, ""
    if not (folder / "recording.yaml").is_file():
        return rows, "recording.yaml missing"
    check = subprocess.run(
        [sys.executable, "-m", "ballbar", "check", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    # the robot's log is missing, which the reader says
    sensible = check.returncode in (0, 2) and "robot" in check.stderr + check.stdout
    return rows, "" if sensible else f"check: {check.stderr[-200:]}"


class Bench:
    """The commands, undisturbed once, and what disturbs them."""

    def __init__(self, work: Path, net_id: str) -> None:
        self.work, self.net_id = work, net_id
        paths = str(ROOT / "scenarios/paths")
        (work / "short.yaml").write_text(SHORT.replace("PATHS", paths))
        shutil.copytree(ROOT / "scenarios", work / "scenarios")
        for file in (work / "scenarios/claims").glob("*.yaml"):
            if file.stem != CLAIM:
                file.unlink()

    def undisturbed(self, name: str) -> Undisturbed:
        """The command left alone."""
        out = self.work / ("made" if name == "run" else f"{name}-sound")
        begin = time.monotonic()
        arguments = words(name, self.work, out, self.net_id)
        code = started(arguments, self.work / "said").wait()
        files = files_of(out) if out.is_dir() else {}
        return Undisturbed(time.monotonic() - begin, code, files)

    def kill(self, name: str, sound: Undisturbed, after: float, number: signal.Signals) -> Kill:
        """One disturbed command, and the same again."""
        out, said = self.work / "out", self.work / "said"
        shutil.rmtree(out, ignore_errors=True)
        arguments = words(name, self.work, out, self.net_id)
        command = started(arguments, said)
        time.sleep(after)
        helpers = []
        if command.poll() is None:
            helpers = psutil.Process(command.pid).children(recursive=True)
            if number == signal.SIGKILL:
                command.kill()
            else:
                os.killpg(command.pid, number)
        code = command.wait(timeout=120.0)
        alive = len(psutil.wait_procs(helpers, timeout=5.0)[1])
        text = said.read_text(errors="replace")
        expected = {sound.code, 130, *ENDS_IN_ORDER.get(name, ())}
        if number == signal.SIGKILL:
            expected |= {-signal.SIGKILL}
        else:
            expected |= {-signal.SIGINT}  # for a shell 130 too
        traceback = "Traceback" in text or code not in expected
        after_it = files_of(out) if out.is_dir() else {}
        if name == "record":
            rows, half = recorded(out)
            refused = "" if rows else self._again(arguments, sound, out)
        else:
            half = "" if code in (0, 1) else " ".join(half_written(after_it, sound))
            refused = self._again(arguments, sound, out) if out.is_dir() else ""
        return Kill(name, number.name, round(after, 3), code, half, refused, traceback, alive)

    def _again(self, arguments: list[str], sound: Undisturbed, out: Path) -> str:
        """Why the same command does not do what it does undisturbed; empty if it does."""
        said = self.work / "again"
        code = started(arguments, said).wait(timeout=300.0)
        text = said.read_text(errors="replace")
        if code != sound.code:
            return f"code {code}: {text[-200:]}"
        if out.is_dir():
            if aside := [path.name for path in out.rglob("*.part")]:
                return f"aside: {' '.join(aside)}"
            if set(files_of(out)) != set(sound.files):
                return "other files"
        return ""


def main() -> None:
    """Disturbs each command so many times, and writes a row for each."""
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "commands", nargs="*", default=["run", "plan", "claims", "identify", "record"]
    )
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    rows: list[Kill] = []
    with tempfile.TemporaryDirectory() as made, ExitStack() as stack:
        plc = stack.enter_context(Plc(ADDRESS, 100))
        bench = Bench(Path(made), plc.net_id)
        os.environ["TMPDIR"] = made  # what a killed command leaves there goes with it
        sound = {name: bench.undisturbed(name) for name in dict.fromkeys(["run", *given.commands])}
        rngs = {name: np.random.default_rng([given.seed, *name.encode()]) for name in sound}
        for k in range(given.count):
            for name in given.commands:
                longest = RECORD_S if name == "record" else sound[name].seconds
                after = float(rngs[name].uniform(0.0, longest))
                number = signal.SIGINT if k % 2 else signal.SIGKILL
                rows.append(bench.kill(name, sound[name], after, number))
                bad = rows[-1].half or rows[-1].refused or rows[-1].traceback or rows[-1].alive
                if bad:
                    print(rows[-1], (Path(made) / "said").read_text(errors="replace")[-1500:])
                write_table(given.out, rows)
            print(f"{k + 1} of {given.count} each", flush=True)
    for name in given.commands:
        own = [row for row in rows if row.command == name]
        counts = {
            field: sum(bool(getattr(row, field)) for row in own)
            for field in ("half", "refused", "traceback", "alive")
        }
        print(f"{name:9} {len(own)} times, {counts}")


if __name__ == "__main__":
    main()

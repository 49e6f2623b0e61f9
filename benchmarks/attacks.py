"""Files and descriptions made to hang, to fill the memory, to break out or to be shown: 66.

    python -m benchmarks.attacks [NAME ...]                  # docs/studies/attacks.csv

Each attack is a recording folder, or another file that a command reads, with something hostile in
it. The command runs as a process of its own. Judged are its processor time (limit 10 s) and peak
memory (limit 1 GB), whether it shows a traceback or ends with code 3 (a fault of the program), and
whether anything of the attack comes through: control characters on the terminal, a file outside
the folder that is written or shown.
"""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import os
import random
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import yaml

from ballbar.cell.egm_file import FILE_START
from benchmarks.study import STUDIES, write_table
from tests.helpers.command_line import SHORT
from tests.helpers.container_files import db3, json_lines, mcap, mpe, scope
from tests.helpers.device_logs import robot_lines, write

LIMIT_S, LIMIT_MB, PATIENCE_S = 10.0, 1000.0, 120.0
MB = 1_000_000
SECRET = "root-only-content-4711"  # of a file outside the folder
EVIL = "\x1b]0;owned\x07\x1b[2J\x9b2J\u202e<script>[red]"
SIGNS = ("\x1b]", "\x1b[2J", "\x9b", "\x07", "\u202e", SECRET)

Attack = Callable[[Path], list[str]]


@dataclass(frozen=True)
class Outcome:
    """Result of a command that met one attack."""

    attack: str
    code: int
    seconds: float  # of processor
    peak_mb: float
    traceback: bool
    injected: bool
    said: str


def spoilt(
    spoil: Callable[[Path], object], change: Callable[[dict], object] = lambda _: None
) -> Attack:
    """A recording whose recording.yaml was changed and whose folder was spoilt."""

    def made(folder: Path) -> list[str]:
        folder.mkdir()
        write(folder, change=change)
        spoil(folder)
        return ["check", str(folder)]

    return made


def robot_file(
    content: bytes | Callable[[], bytes], suffix: str = ".csv", dialect: str = "abb-motor"
) -> Attack:
    """A recording whose robot's log has this content."""
    name = f"raw/robot{suffix}"
    return spoilt(
        lambda folder: (folder / name).write_bytes(content() if callable(content) else content),
        lambda data: data["sources"]["robot"].update(files=[name], dialect=dialect),
    )


def recording(change: Callable[[dict], object]) -> Attack:
    """A recording whose recording.yaml was changed so."""
    return spoilt(lambda _: None, change)


def yaml_text(text: str) -> Attack:
    """A recording whose recording.yaml has this text."""
    return spoilt(lambda folder: (folder / "recording.yaml").write_text(text))


def put(*keys: str, value: object) -> Callable[[dict], object]:
    """Sets a value under nested keys."""

    def change(data: dict) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = value

    return change


def own_dialect(**changes: object) -> Attack:
    """A recording with a dialect of its own for the robot."""
    dialect = {
        "schema": "ballbar-dialect/1",
        "source": "robot",
        "separators": [","],
        "time": {"column": "time", "type": "float", "unit": "s"},
        "motors": [f"m{k}" for k in range(1, 7)],
        "angle_unit": "rad",
        "period_s": [0.001, 0.1],
    }
    return spoilt(
        lambda folder: (folder / "own.yaml").write_text(yaml.safe_dump(dialect | changes)),
        put("sources", "robot", "dialect", value="own.yaml"),
    )


def linked(name: str, target: str) -> Attack:
    """A recording one of whose files is a link."""

    def link(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).symlink_to(target.replace("OUTSIDE", str(folder.parent / "outside.csv")))

    return spoilt(link)


def pipe(name: str) -> Attack:
    """A recording one of whose files is a pipe."""

    def replace(folder: Path) -> None:
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return spoilt(replace)


def other_file(command: str, name: str, content: bytes | Callable[[], bytes], *more: str) -> Attack:
    """Another command and the file that it reads."""

    def made(folder: Path) -> list[str]:
        folder.mkdir()
        (folder / name).write_bytes(content() if callable(content) else content)
        return [command, str(folder / name), *(word.replace("DIR", str(folder)) for word in more)]

    return made


def bag(change: Callable[[sqlite3.Connection], object]) -> Attack:
    """A recording whose robot's log is a bag of SQLite, changed so."""

    def made(folder: Path) -> list[str]:
        with tempfile.TemporaryDirectory() as work:
            content = db3(Path(work)).content
        words = robot_file(content, ".db3", "ros-joint-state")(folder)
        with sqlite3.connect(folder / "raw/robot.db3") as base:
            change(base)
        base.close()
        return words

    return made


def _rows(lines: list[str]) -> bytes:
    return ("\n".join(lines) + "\n").encode()


def _large(pattern: bytes, size: int) -> bytes:
    return (pattern * (size // len(pattern) + 1))[:size]


def _laughs() -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    return "\n".join(lines) + "\n"


def attacks() -> dict[str, Attack]:
    """All attacks by name."""
    header, *rows = robot_lines()
    stripped = _rows([header, *rows])
    digits = "1" * 100_000
    noise = random.Random(1).randbytes(MB)
    robot = ("sources", "robot", "files")
    return {
        # text logs
        "header of 100 MB": robot_file(lambda: _large(b"column,", 100 * MB) + b"\n" + _rows(rows)),
        "header of 100 MB of separators": robot_file(
            lambda: b"," * (100 * MB) + b"\n" + _rows(rows)
        ),
        "200 lines of separators": robot_file((b"," * 99_000 + b"\n") * 201),
        "300 MB of newlines": robot_file(lambda: b"\n" * (300 * MB)),
        "300 MB of carriage returns": robot_file(lambda: b"\r" * (300 * MB)),
        "300 MB of quotes": robot_file(lambda: b'"' * (300 * MB)),
        "300 MB of newlines and quotes": robot_file(lambda: _large(b'"\n', 300 * MB)),
        "300 MB of lines of quotes": robot_file(
            lambda: header.encode() + b"\n" + _large(b'"' * 60 + b"\n", 300 * MB)
        ),
        "300 MB of torn rows": robot_file(lambda: stripped + _large(b"1,2,3,4\n", 300 * MB)),
        "300 MB of NUL": robot_file(lambda: bytes(300 * MB)),
        "300 MB of NUL behind rows": robot_file(lambda: stripped + bytes(300 * MB)),
        "300 MB of blanks": robot_file(lambda: b" " * (300 * MB)),
        "row of 100 MB": robot_file(
            lambda: _rows([header, *rows[:100]]) + b"1" * (100 * MB) + b"\n"),
        "number of 100 000 digits": robot_file(_rows([header, digits + rows[0], *rows])),
        "integers of 5000 digits": robot_file(
            _rows([header, *("9" * 5000 + row for row in rows[:100])])
        ),
        "exponents of a million": robot_file(
            _rows([header, *(row + "e999999999" for row in rows)])
        ),
        "time in exponents": robot_file(
            _rows([header, *("1e999999999," + row.partition(",")[2] for row in rows)])
        ),
        "control characters in a cell": robot_file(_rows([header, EVIL + rows[0], *rows])),
        "control characters in the header": robot_file(_rows([f"{header},{EVIL}", *rows])),
        "noise": robot_file(noise),
        "UTF-16 without mark": robot_file(stripped.decode().encode("utf-16-le")),
        "10 000 columns of one name": robot_file(_rows([header + ",m1" * 10_000, *rows])),
        "10 000 header lines": robot_file(_rows([header] * 10_000)),
        "stamps that go back in every row": robot_file(_rows([header, *rows[::-1]])),
        # packed
        "gzip bomb": robot_file(gzip.compress(bytes(MB)) * 3000, ".csv.gz"),
        "bzip2 bomb": robot_file(bz2.compress(bytes(10 * MB)) * 300, ".csv.bz2"),
        "xz bomb": robot_file(lzma.compress(bytes(10 * MB)) * 300, ".csv.xz"),
        "gzip of noise": robot_file(b"\x1f\x8b" + noise, ".csv.gz"),
        # containers
        "scope export of 300 MB of one line": robot_file(
            lambda: b"Starttime of export\t" + b"1\t" * (150 * MB), ".csv", "kuka-rsi"
        ),
        "scope export cut in its head": robot_file(scope().content[:300], dialect="abb-motor"),
        "JSON nested 100 000 deep": robot_file(b"{" * 1 + b"[" * 100_000, ".jsonl", "comau-json"),
        "JSON numbers of a million digits": robot_file(
            json_lines().content + b'{"a": ' + b"9" * MB + b"}\n", ".jsonl", "comau-json"
        ),
        "JSON line of 100 MB": robot_file(
            lambda: b'{"a": "' + b"x" * (100 * MB), ".jsonl", "comau-json"
        ),
        "EGM frame of 4 GB": robot_file(
            FILE_START + struct.pack("<II", 0xFFFFFFFF, 0) + noise, ".egm", "abb-egm"
        ),
        "EGM of empty frames": robot_file(
            lambda: FILE_START + bytes(50 * MB) + b"1", ".egm", "abb-egm"
        ),
        "abb-mpe with a text of 2 GB": robot_file(
            struct.pack("<ff", 10011.0, 2e9) + noise, ".bin", "abb-mpe"
        ),
        "abb-mpe with NaN for a length": robot_file(
            struct.pack("<ff", 10011.0, float("nan")) + noise, ".bin", "abb-mpe"
        ),
        "abb-mpe of NaN": robot_file(
            mpe().content[:200] + np.full(MB, np.nan, np.float32).tobytes(), ".bin", "abb-mpe"
        ),
        "MCAP with a chunk of 16 EB": robot_file(
            mcap().content.replace(b"\x06", b"\xff"), ".mcap", "ros-joint-state"
        ),
        "MCAP cut in the middle": robot_file(
            mcap().content[:2000], ".mcap", "ros-joint-state"
        ),
        "bag with a view without end": bag(
            lambda base: base.executescript(
                "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS WITH RECURSIVE r(n) AS "
                "(SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT m.* FROM m, r;"
            )
        ),
        "bag with blobs of 300 MB": bag(
            lambda base: base.execute("UPDATE messages SET data = zeroblob(10000000)")
        ),
        "RSI of entities": robot_file(
            b'<Rob TYPE="KUKA"><!DOCTYPE a [<!ENTITY b "c">]>' + b"<a>" * 100_000,
            ".xml", "kuka-rsi",
        ),
        # descriptions
        "ten billion laughs": yaml_text(_laughs()),
        "YAML nested 100 000 deep": yaml_text("a: " + "[" * 100_000),
        "YAML that makes an object": yaml_text("!!python/object/apply:os.system ['echo owned']\n"),
        "YAML of 100 MB": yaml_text("a: " + "x" * (100 * MB)),
        "YAML number of a million digits": yaml_text("schema: " + "9" * 900_000 + "\n"),
        "YAML key again": yaml_text("schema: ballbar-recording/1\nschema: ballbar-recording/1\n"),
        "control characters in recording.yaml": recording(put("robot", value=EVIL)),
        "file outside by name": recording(put(*robot, value=["../outside.csv"])),
        "file outside by an absolute name": recording(put(*robot, value=["/etc/passwd"])),
        "file outside by a link": linked("raw/robot.csv", "OUTSIDE"),
        "link to itself": linked("raw/robot.csv", "robot.csv"),
        "device without end": linked("raw/robot.csv", "/dev/zero"),
        "pipe for a log": pipe("raw/robot.csv"),
        "pipe for recording.yaml": pipe("recording.yaml"),
        "name with NUL and controls": recording(put(*robot, value=["raw/\x01a\x1b[2J.csv"])),
        "10 000 files": recording(put(*robot, value=[f"raw/{k}.csv" for k in range(10_000)])),
        "expression that backtracks": own_dialect(
            motors=[f"re:(([a-z0-9])+.)+[A-Z]([a-z0-9])+{k}$" for k in range(6)]
        ),
        "damaged_rows of 10^18": recording(
            put("sources", "robot", "damaged_rows", value=10**18)
        ),
        "encoder of 10^9 lines": recording(put("encoders", "b1", "lines", value=10**9)),
        # other files
        "calibration of nothing but braces": other_file(
            "compare", "calibration.yaml", b"{" * 100_000, "DIR/calibration.yaml"
        ),
        "plan request of laughs": other_file(
            "plan", "p.yaml", _laughs().encode(), "--out", "DIR/out"
        ),
        "program of 100 MB": other_file(
            "correct", "a.mod", lambda: b"MoveL " * (17 * MB), "--with", "DIR"
        ),
        "scenario of 10^9 s": other_file(
            "run", "s.yaml",
            SHORT.replace("duration_s: 40", "duration_s: 1e9").encode(), "--out", "DIR/out",
        ),
    }  # fmt: skip


def _make(attack: Attack, folder: Path, words: Path) -> None:
    words.write_text(json.dumps(attack(folder)))


def outcome(name: str, attack: Attack, work: Path) -> Outcome:
    """Runs the command on one attack."""
    folder = work / "recording"
    shutil.rmtree(folder, ignore_errors=True)
    (work / "outside.csv").write_text(SECRET + "\n" + "\n".join(robot_lines()) + "\n")
    # in a process of its own: the peak of a command is at least that of who starts it
    maker = get_context("fork").Process(target=_make, args=(attack, folder, work / "words"))
    maker.start()
    maker.join()
    words = json.loads((work / "words").read_text())
    said = work / "said"
    before = {path.name for path in work.iterdir()}
    with said.open("wb") as file:
        command = subprocess.Popen(
            ["timeout", "-s", "KILL", str(PATIENCE_S), sys.executable, "-m", "ballbar", *words],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
        )
        _, status, usage = os.wait4(command.pid, 0)
        command.returncode = os.waitstatus_to_exitcode(status)
    text = said.read_bytes().decode(errors="replace")
    stray = {path.name for path in work.iterdir()} - before - {"said"}
    return Outcome(
        name,
        command.returncode,
        round(usage.ru_utime + usage.ru_stime, 1),
        round(usage.ru_maxrss * 1.024e-3),
        "Traceback" in text or command.returncode not in (0, 1, 2),
        bool(stray) or any(sign in text for sign in SIGNS),
        " ".join(text.split())[:120],
    )


def main(only: list[str]) -> None:
    """Runs all attacks, or some, prints what fails and writes the table."""
    rows: list[Outcome] = []
    with tempfile.TemporaryDirectory() as made:
        for name, attack in attacks().items():
            if only and name not in only:
                continue
            row = outcome(name, attack, Path(made))
            rows.append(row)
            slow = row.seconds > LIMIT_S or row.peak_mb > LIMIT_MB
            bad = slow or row.traceback or row.injected
            print("BAD" if bad else "ok ", json.dumps(asdict(row)), flush=True)
    failed = [
        sum(row.seconds > LIMIT_S or row.peak_mb > LIMIT_MB for row in rows),
        sum(row.traceback for row in rows),
        sum(row.injected for row in rows),
    ]
    print(f"{len(rows)} attacks; over 10 s or 1 GB, traceback, injected: {failed}")
    if not only:
        write_table(STUDIES / "attacks.csv", rows)


if __name__ == "__main__":
    main(sys.argv[1:])

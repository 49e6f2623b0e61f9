"""Files made to use up memory or time are refused at once, by name: packed, repeated, waiting."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import time
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from ballbar.acquisition.formats.table_file import workbook_text
from ballbar.acquisition.pose_tables import read_poses
from ballbar.acquisition.recording import read_recording
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import read_table
from ballbar.acquisition.table.text import Content, read_bytes, read_text
from ballbar.cell.errors import DescriptionError, InputError, LogError
from ballbar.cell.load import load_robot
from ballbar.cell.strict_yaml import load_yaml
from tests.helpers.device_logs import ROBOT_FILES, put, write

MEGABYTE = 1_000_000
LAYOUT = Layout((",",), {"time": "decimal", "m1": "float"})


@pytest.mark.parametrize(
    ("suffix", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress), (".xz", lzma.compress)]
)
def test_a_packed_file_that_unpacks_without_end_is_refused(
    tmp_path: Path, suffix: str, pack: Callable[[bytes], bytes]
) -> None:
    bomb = tmp_path / f"robot.csv{suffix}"
    bomb.write_bytes(pack(b"0,0\n" * (MEGABYTE // 4)) * 60)
    tracemalloc.start()
    with pytest.raises(LogError, match=r"robot\.csv.*unpacks to more than 50 MB.*Unpack it your"):
        read_bytes(bomb, bomb.name)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 120 * MEGABYTE
    content = os.urandom(30_000).hex().encode() + b"\n"
    bomb.write_bytes(pack(content))
    assert read_bytes(bomb, bomb.name).raw == content


def test_a_workbook_that_unpacks_without_end_is_refused() -> None:
    pytest.importorskip("openpyxl")
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", bytes(60 * MEGABYTE))
    with pytest.raises(LogError, match=r"a\.xlsx: unpacks to more than 50 MB"):
        workbook_text(Content(packed.getvalue()), "a.xlsx", None)


def test_a_file_of_line_ends_is_refused_before_it_is_split(tmp_path: Path) -> None:
    for pattern in (b"\n", b'"\n', b'"' * 40 + b"\n"):
        (tmp_path / "a.csv").write_bytes(pattern * (11 * MEGABYTE // len(pattern)))
        with pytest.raises(LogError, match=r"a\.csv: hardly more than line ends or quotes"):
            read_text(tmp_path / "a.csv", "a.csv")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"name," * MEGABYTE + b"\n1,2\n", r"a\.csv:1: a line of 5000000 characters"),
        (b"time,m1\n1,2\n" + b"1" * MEGABYTE + b"\n", r"a\.csv:3: a line of 1000000 characters"),
    ],
)
def test_a_line_that_is_longer_than_any_of_a_log_is_refused(
    tmp_path: Path, content: bytes, words: str
) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(LogError, match=words):
        read_table(tmp_path / "a.csv", "a.csv", LAYOUT)


def test_lines_of_nothing_but_separators_are_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes((b"," * 99_000 + b"\n") * 201)
    begin = time.process_time()
    with pytest.raises(LogError, match=r"a\.csv:1: 99001 fields; logs have at most 2000"):
        read_table(tmp_path / "a.csv", "a.csv", LAYOUT)
    assert time.process_time() - begin < 2.0


def test_a_file_named_twice_is_refused(tmp_path: Path) -> None:
    names = ["raw/robot.csv", "raw/again.csv"]
    write(tmp_path, change=put(*ROBOT_FILES, value=names))
    (tmp_path / "raw" / "again.csv").symlink_to("robot.csv")
    with pytest.raises(DescriptionError, match=r"raw/robot\.csv' and 'raw/again\.csv' are one"):
        read_recording(tmp_path)
    write(tmp_path, change=put(*ROBOT_FILES, value=["raw/robot.csv", "raw/./robot.csv"]))
    with pytest.raises(DescriptionError, match="are one file"):
        read_recording(tmp_path)


def test_a_table_of_poses_named_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "poses.yaml").write_text(
        "schema: ballbar-poses/1\nkind: real\nrobot: irb2400\ninstrument: drawwire_2m\n"
        "tables:\n- files: [a.csv, ./a.csv]\n  joints: {columns: [a, b, c, d, e, f], unit: deg}\n"
        "  values: {columns: [l], unit: mm}\n"
    )
    (tmp_path / "a.csv").write_text("a,b,c,d,e,f,l\n")
    with pytest.raises(DescriptionError, match=r"tables\[0\]\.files: .* are one file"):
        read_poses(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "recording.yaml"
    os.mkfifo(pipe)
    for read in (load_yaml, lambda path: load_robot(str(path))):
        with pytest.raises(DescriptionError, match=r"recording\.yaml: .*it is no regular file"):
            read(pipe)
    with pytest.raises(InputError, match="no regular file"):
        read_recording(tmp_path)
    with pytest.raises(LogError, match="no regular file"):
        read_bytes(pipe, pipe.name)


@pytest.mark.long
def test_a_description_of_too_many_bytes_or_values_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("a: " + "[" + "[]," * (MEGABYTE // 3) + "]\n")
    with pytest.raises(DescriptionError, match=r"robot\.yaml: .*larger than 1 MB"):
        load_yaml(file)
    file.write_text("a: [" + "1," * 100_000 + "]\n")
    with pytest.raises(DescriptionError, match=r"robot\.yaml:1: more than 100000 keys and values"):
        load_yaml(file)

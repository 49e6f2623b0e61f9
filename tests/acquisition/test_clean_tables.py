"""Clean tables are read at once, and never otherwise than line by line."""

import sys
from collections.abc import Iterator
from io import SEEK_END, BytesIO
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.table import fast_path
from ballbar.acquisition.table.fast_path import clean_columns
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import read_table
from ballbar.cell.errors import LogError

BAR = Layout(
    (";", ","),
    {"time": "text", "b1": "integer", "b2": "integer"},
    {"s1": "integer"},
    instead={"time": ("lo", "hi")},
)
ROBOT = Layout((",", ";", "\t"), {"time": "decimal", "m1": "float", "m2": "float"})
ROWS = 12

Rng = np.random.Generator


def bar_file(rng: Rng) -> bytes:
    words = rng.integers(2**32, size=(ROWS, 3))
    separator, end = (";", "\r\n") if rng.random() < 0.5 else (",", "\n")
    rows = [["s1", "note", "b2", "time", "b1"][rng.integers(2) :]]
    for k, word in enumerate(words.tolist()):
        rows.append(
            [str(word[0] % 4), "1.5", str(word[1]), str(10**17 + k), str(word[2])][-len(rows[0]) :]
        )
    return "".join(separator.join(row) + end for row in rows).encode()


def robot_file(rng: Rng) -> bytes:
    first = (0.0, 1.7e9)[int(rng.integers(2))]
    lines = [
        "time,m1,m2",
        *(
            f"{first + 0.004 * k:.6f},{a!r},{b:.3e}"
            for k, (a, b) in enumerate(rng.normal(size=(ROWS, 2)).tolist())
        ),
    ]
    return "\n".join(lines).encode() + b"\n"


def damaged(raw: bytes, rng: Rng) -> bytes:
    """The file with up to three marks put in, cut out or doubled."""
    for _ in range(int(rng.integers(4))):
        at = int(rng.integers(len(raw)))
        mark = (
            b"x",
            b"0x",
            b"\r",
            b"\n",
            b" ",
            b"+",
            b"-",
            b".",
            b"e",
            b'"',
            b"\0",
            b"\xe4",
            b"nan",
            b",",
            b";",
            b"9" * 20,
            b"EOF\n",
            b"",
        )
        raw = raw[:at] + mark[rng.integers(len(mark))] + raw[at + int(rng.integers(3)) :]
    return raw


def outcome(path: Path, layout: Layout) -> object:
    try:
        table, form = read_table(path, "log.csv", layout)
    except LogError as error:
        return str(error)
    columns = {name: (column.dtype, column.tolist()) for name, column in table.columns.items()}
    rows = table.line.tolist(), table.flags.tolist(), table.begins.tolist()
    return columns, *rows, form, table.findings


def files(count: int) -> Iterator[tuple[bytes, Layout]]:
    rng = np.random.default_rng(4)
    for k in range(count):
        make, layout = ((bar_file, BAR), (robot_file, ROBOT))[k % 2]
        yield damaged(make(rng), rng), layout


def test_what_is_read_at_once_is_what_is_read_line_by_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fast_path, "_PART", 64)  # of a few rows
    path, clean = tmp_path / "log.csv", 0
    for raw, layout in files(200):
        path.write_bytes(raw)
        at_once = outcome(path, layout)
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, "pyarrow", None)
            assert at_once == outcome(path, layout), raw
        clean += clean_columns(BytesIO(raw), "log.csv", layout) is not None
    assert 20 < clean < 180  # both ways were taken


def test_a_clean_log_is_read_at_once() -> None:
    raw = b"note;b2;time;b1\r\n1;4294967295;100000000000000001;-7\r\n2;0;100000000000000002;3\r\n"
    read = clean_columns(BytesIO(raw), "log.csv", BAR)
    assert read is not None
    assert {name: column.tolist() for name, column in read[1].items()} == {
        "time": [100000000000000001, 100000000000000002],
        "b1": [-7, 3],
        "b2": [4294967295, 0],
    }
    assert [entry.kind for entry in read[2]] == ["column not used"]


def test_a_last_line_that_was_cut_off_is_dropped_at_once() -> None:
    raw = b"time;b1;b2\n100000000000000001;1;2\n100000000000000002;3;4\n1000000000"
    read = clean_columns(BytesIO(raw), "log.csv", BAR)
    assert read is not None
    assert read[1]["b2"].tolist() == [2, 4]
    assert [(entry.kind, entry.lines) for entry in read[2]] == [("unterminated last line", (4,))]


@pytest.mark.parametrize(
    "row",
    [
        b"0x10;1;2",
        b"1;2;3;4",
        b"1;2",
        b"1;2;",
        b"",
        b"1;2;1e3",
        b'1;2;"3"',
        b"1;2;\xe4",
        b"2024-01-01-00:00:00;1;2",
    ],
)
def test_a_row_that_is_not_plain_is_left_to_the_careful_reader(row: bytes) -> None:
    content = b"time;b1;b2\n1;2;3\n" + row + b"\n4;5;6\n"
    assert clean_columns(BytesIO(content), "log.csv", BAR) is None


class Growing(BytesIO):
    """A file to which a logger writes a row whenever a part of it is read."""

    def read(self, size: int | None = -1, /) -> bytes:
        part, place = super().read(size), self.tell()
        if self.seek(0, SEEK_END) < 10_000:
            self.write(b"1000000000000000009;1;2;0\n")
        self.seek(place)
        return part


def test_a_file_that_grows_meanwhile_is_read_as_it_was_at_first() -> None:
    rows = [f"{10**18 + k};{k};{2 * k};0\n" for k in range(ROWS)]
    raw = ("time;b1;b2;s1\n" + "".join(rows)).encode()
    read, still = (clean_columns(f(raw), "log.csv", BAR) for f in (Growing, BytesIO))
    assert read is not None
    assert still is not None
    assert read[2] == still[2] == ()
    for name, values in still[1].items():
        np.testing.assert_array_equal(read[1][name], values)

"""Tables in which every row fills the columns of one signal: what is read is that signal alone."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.acquisition.channels import read_channels
from ballbar.acquisition.sources import log_source, read_files
from ballbar.acquisition.stamps.order import STAMP
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Table, read_table
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.files import write_yaml
from ballbar.cell.recording import TrackerFile
from tests.helpers.real_robots import DATA

HEADER = "stamp,sec,nanosec,x,y,z,q1,q2,note"
Q = Layout((",",), {"stamp": "integer", "q1": "float", "q2": "float"}, signal=("q1", "q2"))
XYZ = Layout(
    (",",),
    {"stamp": "integer", "x": "float", "y": "float", "z": "float"},
    signal=("x", "y", "z"),
    all_empty=("x", "y", "z"),
)
EPOCH = 1_720_702_091
VICON = DATA / "irb4400_vicon" / "record_20240711_144811.csv.gz"


def read(folder: Path, rows: list[str], layout: Layout) -> Table:
    (folder / "log.csv").write_text("\n".join((HEADER, *rows)) + "\n")
    return read_table(folder / "log.csv", "log.csv", layout)[0]


def joints(k: int) -> str:
    return f"{k},,,,,,{k}.5,-{k}.25,"


def point(k: int) -> str:
    return f"{k},{EPOCH}.0,{1000 * k}.0,{k}.125,{2 * k},{3 * k},,,"


@settings(max_examples=40, deadline=None)
@given(order=st.lists(st.booleans(), min_size=2, max_size=60))
def test_each_signal_is_read_as_from_a_table_of_its_own(
    tmp_path_factory: pytest.TempPathFactory, order: list[bool]
) -> None:
    order = [True, False, *order]
    rows = [joints(k) if of_robot else point(k) for k, of_robot in enumerate(order)]
    folder = tmp_path_factory.mktemp("table")
    for layout, mine in ((Q, np.array(order)), (XYZ, ~np.array(order))):
        table = read(folder, rows, layout)
        alone = read(folder, [row for row, own in zip(rows, mine, strict=True) if own], layout)
        np.testing.assert_array_equal(table.line, np.flatnonzero(mine) + 2)
        for name, column in alone.columns.items():
            np.testing.assert_array_equal(table.columns[name], column)
        (entry,) = (f for f in table.findings if f.kind == "rows of other signals")
        assert entry.count == np.count_nonzero(~mine)
        assert not entry.notable
        assert not [f for f in alone.findings if f.kind == "rows of other signals"]


@pytest.mark.parametrize("cells", ["1.5,", ",1.5", "nan,1.5"])
def test_a_row_that_fills_some_of_the_columns_is_damaged(tmp_path: Path, cells: str) -> None:
    rows = [joints(0), point(1), f"2,,,,,,{cells},", joints(3)]
    with pytest.raises(LogError, match=r"log.csv:4: column q[12]: '(nan)?' is "):
        read(tmp_path, rows, Q)


def test_a_row_that_fills_nothing_is_damaged(tmp_path: Path) -> None:
    """It is of no other signal; of a tracker it is a hidden LED, as before."""
    rows = [joints(0), point(1), "2,,,,,,,,", joints(3)]
    with pytest.raises(LogError, match=r"log.csv:4: column q1: '' is an empty cell"):
        read(tmp_path, rows, Q)
    assert read(tmp_path, rows, XYZ).columns["x"].tolist() == [1.125, 0.0]


def test_a_stamp_that_is_missing_beside_values_is_damage(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"log.csv:3: column stamp: '' is an empty cell"):
        read(tmp_path, [joints(0), ",,,,,,1.5,2.5,", point(1)], Q)


def test_a_signal_without_any_row_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no row has a value in q1, q2\. Name the columns"):
        read(tmp_path, [point(0), point(1)], Q)


def tracker(folder: Path, rows: list[str]) -> Table:
    """The table of a tracker's log with stamps in two columns, in a new folder."""
    folder.mkdir(exist_ok=True)
    dialect = {
        **{"schema": "ballbar-dialect/1", "source": "tracker", "separators": [","]},
        "time": {"column": "sec", "nanoseconds": "nanosec", "forms": ["unix-ns", "ns"]},
        **{"point": ["x", "y", "z"], "period_s": [1e-4, 0.1]},
    }
    write_yaml(folder / "own.yaml", dialect)
    (folder / "log.csv.gz").write_bytes(gzip.compress("\n".join((HEADER, *rows, "")).encode()))
    declared = TrackerFile(files=("log.csv.gz",), dialect="own.yaml")
    return read_files(log_source(folder, "tracker", declared)).joined()


def test_seconds_and_nanoseconds_are_one_stamp(tmp_path: Path) -> None:
    ns = 999_999_000 + 500 * np.arange(60, dtype=np.int64)
    rows = [
        f"7,{EPOCH + t // 10**9}{end},{t % 10**9}{end},{k},{k},{k},,,"
        for k, (t, end) in enumerate(zip(ns.tolist(), ["", ".0"] * 30, strict=True))
    ]
    table = tracker(tmp_path / "rec", [joints(0), *rows])
    np.testing.assert_array_equal(table.columns[STAMP], EPOCH * 10**9 + ns)
    for cells in (f"{EPOCH}.5,7", f"{EPOCH},7.5", f"{EPOCH},1000000000", f"{EPOCH},-1"):
        with pytest.raises(
            LogError, match=r"log.csv.gz:61: column sec and nanosec: .* are no whole"
        ):
            tracker(tmp_path / "rec", [*rows[:-1], f"7,{cells},1,1,1,,,"])


def test_stamps_and_values_are_different_columns(tmp_path: Path) -> None:
    for time in ({"column": "x"}, {"column": "sec", "nanoseconds": "x"}):
        dialect = {
            **{"schema": "ballbar-dialect/1", "source": "tracker", "separators": [","]},
            **{"time": {**time, "forms": ["ns"]}, "point": ["x", "y", "z"]},
            "period_s": [1e-4, 0.1],
        }
        write_yaml(tmp_path / "own.yaml", dialect)
        declared = TrackerFile(files=("log.csv",), dialect="own.yaml")
        with pytest.raises(DescriptionError, match="column x holds the time stamps"):
            log_source(tmp_path, "tracker", declared)


def test_channels_are_read_with_the_stamps_that_their_rows_fill(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = [f(k * 10**9 + EPOCH * 10**9) for k in range(60) for f in (joints, point)]
    rows = [row.replace(f"{EPOCH}.0,", f"{EPOCH + 3 * k}.0,") for k, row in enumerate(rows)]
    rows = [re.sub(rf",({EPOCH // 1000}\d+\.0),[^,]*", r",\1,5.0", row) for row in rows]
    file.write_text("\n".join((HEADER, *rows)) + "\n")
    arrived, _ = read_channels(file, time="ns", channels=["q1", "q2"])
    np.testing.assert_array_equal(arrived.t, np.arange(60.0))
    own, findings = read_channels(file, channels=["x", "z"])
    np.testing.assert_array_equal(own.t, 6.0 * np.arange(60))
    assert [(f.kind, f.count) for f in findings] == [("rows of other signals", 60)]
    with pytest.raises(LogError, match=r"several signals\. Columns: .* Name the channels of one"):
        read_channels(file, time="ns")


@pytest.mark.skipif(not VICON.exists(), reason="the measured robots are not beside the project")
def test_the_signals_of_a_measured_robot_are_read() -> None:
    joints, findings = read_channels(VICON, channels=[f"joint_{k}" for k in range(1, 7)])
    vicon, _ = read_channels(VICON, channels=["pv_x", "pv_y", "pv_z"])
    held, torn = (
        next(f.count for f in findings if f.kind == k) for k in ("held values", "torn row")
    )
    assert (joints.t.size + held + torn, vicon.t.size) == (6308, 1590)
    assert np.median(np.diff(vicon.t)) == pytest.approx(0.01, rel=0.01)

"""Any table as channels over its clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.channels import read_channels
from ballbar.cell.errors import InputError, LogError


def table(tmp_path: Path, text: str, rows: int = 60) -> Path:
    """A file of a header and rows, `{k}` in them the row and `{t}` its time in ms."""
    header, row = text.split("\n")
    lines = [header] if header else []
    lines += [row.replace("{k}", str(k)).replace("{t}", str(20 + 10 * k)) for k in range(rows)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_a_german_export_gives_its_columns_of_numbers(tmp_path: Path) -> None:
    log, findings = read_channels(table(tmp_path, "Weg;Zeit [ms];Name;n\n{k},5;{t},0;Kugel;7"))
    assert log.names == ("Weg", "n")
    np.testing.assert_allclose(log.t, 0.01 * np.arange(60), atol=1e-12)
    np.testing.assert_allclose(log.values[:, 0], np.arange(60) + 0.5)
    assert [finding.kind for finding in findings] == ["decimal comma"]


def test_stamps_that_count_from_an_epoch_need_no_unit(tmp_path: Path) -> None:
    log, _ = read_channels(table(tmp_path, "stamp,z\n17000000{t}000000000,{k}", 8))
    assert log.t[1] == pytest.approx(10.0)


def test_a_number_of_nothing_is_refused_until_its_unit_is_declared(tmp_path: Path) -> None:
    file = table(tmp_path, "time,z\n{t},{k}")
    with pytest.raises(LogError, match=r"log.csv:2: column time: .* does not show"):
        read_channels(file)
    assert read_channels(file, time="us")[0].t[-1] == pytest.approx(590e-6)
    with pytest.raises(InputError, match="unknown form of time 'msec'"):
        read_channels(file, time="msec")


def test_a_name_that_ends_like_a_unit_by_chance_tells_none(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="form of the time stamps does not show"):
        read_channels(table(tmp_path, "timestamps,z\n{t},{k}"))


def test_a_table_without_header_has_its_time_first(tmp_path: Path) -> None:
    log, _ = read_channels(table(tmp_path, "\n{t},{k},1.5"), time="ms")
    assert log.names == ("#2", "#3")
    assert log.t.size == 60


def test_named_columns_alone_are_read(tmp_path: Path) -> None:
    file = table(tmp_path, "time_s,x,y\n{t},{k},")
    assert read_channels(file, channels=["x"])[0].names == ("x",)
    with pytest.raises(LogError, match=r"no column 'z'; the header has time_s, x, y"):
        read_channels(file, channels=["z"])


def test_a_clock_that_goes_back_is_refused_with_the_line(tmp_path: Path) -> None:
    file = table(tmp_path, "t_ms,x\n{t},{k}")
    file.write_text(file.read_text() + "".join(f"{10 * k},{k}\n" for k in range(30)))
    with pytest.raises(LogError, match=r"log.csv:62: the stamp goes back by 0.61 s"):
        read_channels(file)


def test_a_table_without_numbers_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no column of numbers beside the time stamps in 't_ms'"):
        read_channels(table(tmp_path, "t_ms,x\n{t},on"))


def test_a_table_has_no_sources(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a table has no source robot"):
        read_channels(table(tmp_path, "t_ms,x\n{t},{k}"), source="robot")

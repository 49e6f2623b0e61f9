"""`ballbar align` of two tables, and of a recording folder against a table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cell.clock import Clock
from cell.logs import ChannelLog
from tests.helpers.command_line import ballbar, refusal
from tests.helpers.two_recorders import two_logs, wandering

CLOCK = Clock(3.5, 6e-5)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two recorders of one motion: comma and decimal point, semicolon and decimal comma."""
    rng = np.random.default_rng(1)
    folder = tmp_path_factory.mktemp("logs")
    for log, name, comma in zip(
        two_logs(wandering(rng), CLOCK, rng), ("a.csv", "b.csv"), (False, True), strict=True
    ):
        _write(folder / name, log, comma=comma)
    return folder / "a.csv", folder / "b.csv"


def _write(file: Path, log: ChannelLog, *, comma: bool) -> None:
    separator = ";" if comma else ","
    rows = [separator.join(("time_s", *log.names))]
    for t, values in zip(log.t, log.values, strict=True):
        row = separator.join(f"{value:.9f}" for value in (t, *values))
        rows.append(row.replace(".", ",") if comma else row)
    file.write_text("\n".join(rows) + "\n")


@pytest.mark.slow
def test_two_tables_are_aligned_and_every_number_is_stated(tables: tuple[Path, Path]) -> None:
    data = json.loads(ballbar("align", *tables, "--json")[1])
    clock = data["clock"]
    assert clock["offset_s"] == pytest.approx(CLOCK.offset, abs=4.0 * clock["offset_sigma_s"])
    assert clock["skew"] == pytest.approx(CLOCK.skew, abs=4.0 * clock["skew_sigma"])
    assert clock["offset_sigma_s"] < 1e-5
    assert [(pair["a"], pair["b"]) for pair in data["channels"]] == [("x", "u"), ("y", "v")]
    page = ballbar("align", *tables, "--channel", "x=u")[1]
    assert "B begins 3.500 s after A" in page
    assert "b.csv: decimal comma" in page
    assert "correlation -1.000000" in page


def test_an_unknown_channel_is_bad_input(tables: tuple[Path, Path]) -> None:
    err = refusal("align", *tables, "--channel", "x=w")
    assert "b.csv: no column 'w'; the header has time_s, u, v" in err
    assert ballbar("align", *tables, "--channel", "x=")[0] == 2


def test_channels_of_another_motion_are_not_acceptable(tables: tuple[Path, Path]) -> None:
    code, _, err = ballbar("align", *tables, "--channel", "x=v")
    assert code == 1
    assert "no clock offset makes the channels of a.csv and b.csv move together" in err

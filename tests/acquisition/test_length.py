"""Logs of one length in a recording folder, and declarations that contradict each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.channels import read_channels
from ballbar.acquisition.explain import explain_lines
from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import DescriptionError, LogError

ROWS = 400
SOURCE = "  length: {files: [length.csv], dialect: length-table, column: Weg, unit: mm, time: ms}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot that moves its first axis, and a wire sensor with German column names."""
    t = 0.01 * np.arange(ROWS)
    q = np.zeros((ROWS, 6))
    q[:, 0], q[:, 4] = 0.3 * np.sin(t), 0.5
    np.savetxt(
        tmp_path / "robot.csv",
        np.c_[t, q],
        delimiter=",",
        header="time,q1,q2,q3,q4,q5,q6",
        comments="",
        fmt="%.9f",
    )
    rows = [f"{1000 * s:.0f};{1200 + 50 * np.sin(s):.5f}".replace(".", ",") for s in t]
    (tmp_path / "length.csv").write_text("Zeit;Weg\n" + "\n".join(rows) + "\n")
    declare(tmp_path)
    return tmp_path


def declare(folder: Path, *, held: str = "instrument: drawwire_2m", length: str = SOURCE) -> None:
    (folder / "recording.yaml").write_text(
        f"schema: ballbar-recording/1\nkind: real\nrobot: irb2400\n{held}\nsources:\n"
        f"  robot: {{files: [robot.csv], dialect: joint-rad}}\n{length}\n"
    )


def test_the_length_is_read_in_metres_on_its_own_clock(folder: Path) -> None:
    log = read_recording(folder).length_log
    assert log is not None
    np.testing.assert_allclose(log.t, 0.01 * np.arange(ROWS), atol=1e-12)
    np.testing.assert_allclose(log.length, 1.2 + 0.05 * np.sin(log.t), atol=6e-9)
    assert read_channels(folder, source="length")[0].names == ("length",)


def test_a_deviation_is_read_from_its_declared_zero(folder: Path) -> None:
    declare(folder, length=SOURCE.replace("unit: mm", "unit: um, zero_m: 1.2"))
    log = read_recording(folder).length_log
    assert log is not None
    assert log.length[0] == pytest.approx(1.2 + 1200e-6)
    assert "length in um from 1.2 m on, column Weg" in "\n".join(explain_lines(folder))


def test_a_length_that_the_instrument_cannot_have_is_refused(folder: Path) -> None:
    declare(folder, length=SOURCE.replace("unit: mm", "unit: m"))
    with pytest.raises(
        LogError, match=r"length.csv:2: a length of 1200 m, and Draw-wire sensor 2 m"
    ):
        read_recording(folder)


@pytest.mark.parametrize(
    ("held", "length", "message"),
    [
        ("ballbar: lund_600\ninstrument: drawwire_2m", SOURCE, "either ballbar or instrument"),
        ("ballbar: lund_600", SOURCE, "sources.length of an instrument"),
        ("instrument: drawwire_2m", "", "sources.length of an instrument"),
        ("notes: nothing", SOURCE, "either ballbar or instrument"),
    ],
)
def test_ball_bar_and_instrument_exclude_each_other(
    folder: Path, held: str, length: str, message: str
) -> None:
    declare(folder, held=held, length=length)
    with pytest.raises(DescriptionError, match=message):
        read_recording(folder)

"""Logs of hours: every row is checked, and a fit takes an even share of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition import fit_rows
from ballbar.acquisition.recording import read_recording
from tests.helpers.device_logs import write


def test_of_a_long_log_all_rows_are_checked_and_an_even_share_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(tmp_path)
    robot = folder / "raw/robot.csv"
    lines = robot.read_text().splitlines(keepends=True)
    cells = lines[404].split(",")  # row 403, which every third row from 0 leaves out
    lines[404] = ",".join([cells[0], str(float(cells[1]) + 1.0), *cells[2:]])
    robot.write_text("".join(lines))
    whole = read_recording(folder)
    monkeypatch.setattr(fit_rows, "MOST_ROWS", whole.robot_log.t.size // 2 - 10)
    short = read_recording(folder)
    kinds = [entry.kind for entry in short.report.findings]
    assert "implausible value" in kinds
    (entry,) = (entry for entry in short.report.findings if entry.kind == "long log")
    assert entry.file == "raw/robot.csv"
    assert f"{whole.robot_log.t.size} usable rows" in entry.sentence
    assert "one in 3 is used" in entry.sentence
    np.testing.assert_array_equal(short.robot_log.q, whole.robot_log.q[::3])
    np.testing.assert_array_equal(short.robot_log.t, whole.robot_log.t[::3])
    assert short.report.files[0].rows_kept == short.robot_log.t.size
    assert short.rows["robot"].used.sum() == short.robot_log.t.size

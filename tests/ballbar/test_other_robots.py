"""Recordings of other robots from device files to a calibration, its exports and corrections."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_robot
from ballbar.compensation.targets_file import correct_file
from ballbar.export.result import Result, load_result
from ballbar.export.rows import hayati_rows
from ballbar.export.tables import dh_table, hayati_table
from ballbar.ident.options import FitOptions
from ballbar.report.shapes import cell_bodies
from ballbar.result.identify import identify
from ballbar.result.names import CALIBRATION
from ballbar.result.write_calibration import write_calibration
from tests.helpers.other_robots import (
    FIVE_AXES,
    SEVEN_AXES,
    UR,
    Rows,
    cell_of,
    other_minute,
    write_other_recording,
)


def result_of(folder: Path, rows: Rows) -> Result:
    minute = other_minute(cell_of(folder, rows), rows)
    off = {"ra2": 1e-3, "ralpha1": 1e-3, "rtheta3": -1e-3}
    true = minute.nominal.replaced({k: minute.nominal[k] + v for k, v in off.items()})
    recording = write_other_recording(folder / "recording", rows, minute.logs(true))
    out = folder / "result"
    out.mkdir()
    options = FitOptions(samples=600)
    write_calibration(out / CALIBRATION, identify(recording, options=options).data)
    result = load_result(out)
    for name, value in off.items():
        entry = result.calibration.file.parameters[name]
        assert entry.value - entry.nominal == pytest.approx(value, abs=30e-6)
    return result


@pytest.mark.slow
@pytest.mark.parametrize("rows", [FIVE_AXES, UR, SEVEN_AXES], ids=["five", "ur", "seven"])
def test_a_recording_of_any_robot_becomes_a_calibration_and_its_tables(
    tmp_path: Path, rows: Rows
) -> None:
    """The file of the robot stands in the recording's folder, and the result names it there."""
    result = result_of(tmp_path, rows)
    assert result.cell.robot.joints == result.chain.rows == len(rows)
    assert result.calibration.file.robot == "descriptions/robot/other.yaml"
    for table in (dh_table(result), hayati_table(result)):
        lines = [line for line in table.splitlines() if not line.startswith("#")]
        assert len(lines) == 1 + len(rows) + 1  # header, joints, tool
    parallel = result.calibration.geometry.table.hayati_rows[:-1]
    assert not hayati_rows(result.chain, parallel).d[list(parallel)].any()
    nominal = nominal_geometry(result.cell, np.zeros(3))
    assert len(cell_bodies(result.cell, nominal)) == len(rows) + 1 + 1 + 6  # links, plate, ball-bar


@pytest.mark.slow
def test_targets_of_seven_axes_are_corrected_by_the_shortest_change(tmp_path: Path) -> None:
    result = result_of(tmp_path, SEVEN_AXES)
    targets = tmp_path / "targets.csv"
    targets.write_text("q1,q2,q3,q4,q5,q6,q7\n0.1,0.5,0.3,-1.3,0.2,1.0,0.3\n", encoding="utf-8")
    corrected = correct_file(targets, result).corrected
    assert corrected.q.shape == (1, 7)
    assert corrected.position_before.max() > 1e-4
    assert corrected.position_after.max() < 1e-9
    assert np.abs(corrected.q - [0.1, 0.5, 0.3, -1.3, 0.2, 1.0, 0.3]).max() < 0.02


@pytest.mark.slow
def test_a_recording_of_another_robot_is_refused_by_the_columns_of_its_log(tmp_path: Path) -> None:
    minute = other_minute(cell_of(tmp_path, FIVE_AXES), FIVE_AXES)
    folder = tmp_path / "recording"
    recording = write_other_recording(folder, FIVE_AXES, minute.logs(minute.nominal))
    cell_of(folder, UR)
    assert load_robot(str(folder / "other.yaml")).joints == 6
    with pytest.raises(InputError, match="column q6 missing"):
        identify(recording)

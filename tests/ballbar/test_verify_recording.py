"""`ballbar verify` with a recording: a result read back, changed by hand, and its refusals."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from ballbar.result.calibration import CalibrationFile, load_calibration
from ballbar.result.verification import temperature_remarks
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import Recorded


@pytest.fixture(scope="module")
def result(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verified") / "result"
    code, _, error = ballbar(
        "identify", recorded.folder, "--out", folder, "--model", "dh", "--samples", 300
    )
    assert code == 0, error
    return folder


def changed(result: Path, folder: Path, change: Any) -> Path:
    data = yaml.safe_load((result / "calibration.yaml").read_text())
    change(data)
    folder.mkdir()
    (folder / "calibration.yaml").write_text(yaml.safe_dump(data))
    return folder


@pytest.mark.slow
def test_a_result_holds_for_its_own_recording(result: Path, recorded: Recorded) -> None:
    code, said, error = ballbar("verify", result, recorded.folder)
    assert (code, said.startswith("Holds: the loop closes to 0.0")) == (0, True), said + error


@pytest.mark.slow
def test_a_zero_that_differs_is_named(result: Path, recorded: Recorded, tmp_path: Path) -> None:
    def before(data: dict[str, Any]) -> None:
        data["parameters"]["rtheta4"]["value"] -= 3.1e-4

    code, said, error = ballbar(
        "verify", changed(result, tmp_path / "before", before), recorded.folder, "--json"
    )
    assert code == 1, error
    data = json.loads(said)
    assert data["sentence"].startswith("Changed since: zero of axis 4 by +0.31 mrad")
    best = data["causes"][0]
    assert (best["kind"], best["axis"], best["named"]) == ("axis", 4, True)
    assert best["size"][0] == pytest.approx(3.1e-4, abs=2e-5)


def test_a_result_without_covariance_is_refused(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    older = changed(result, tmp_path / "older", lambda data: data.pop("covariance"))
    code, _, error = ballbar("verify", older, recorded.folder)
    assert (code, "Identify its recordings again" in error) == (2, True), error


def test_a_recording_on_another_plate_is_refused(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    other = changed(result, tmp_path / "other", lambda data: data.update(plate="plate_150"))
    code, _, error = ballbar("verify", other, recorded.folder)
    assert (code, "is of plate plate_250" in error) == (2, True), error


@pytest.fixture
def damaged(recorded: Recorded, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded.folder, tmp_path / "damaged"))


@pytest.mark.slow
def test_rows_that_were_left_out_are_named(result: Path, damaged: Path) -> None:
    """A channel stood still for two seconds, its rows were left out, and not a word said of it."""
    log = damaged / "raw" / "robot.csv"
    lines = log.read_text().splitlines()
    frozen = lines[3000].split(",")[2]
    for i in range(3001, 3500):
        cells = lines[i].split(",")
        lines[i] = ",".join([*cells[:2], frozen, *cells[3:]])
    log.write_text("\n".join(lines) + "\n")
    code, said, error = ballbar("verify", result, damaged, "--json")
    data = json.loads(said)
    assert code == 0, said + error
    assert any("frozen channel" in warning for warning in data["warnings"])


def test_a_recording_that_is_too_short_is_bad_input(result: Path, damaged: Path) -> None:
    """Its exit code was that of a machine that changed."""
    log = damaged / "raw" / "robot.csv"
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[: len(lines) // 20]) + "\n")
    code, _, error = ballbar("verify", result, damaged)
    assert (code, "cannot be held against" in error) == (2, True), error


@pytest.mark.slow
def test_a_result_that_is_itself_a_misfit_is_not_said_to_hold(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    def poor(data: dict[str, Any]) -> None:
        data["fit"]["status"] = "misfit"

    code, said, _ = ballbar("verify", changed(result, tmp_path / "poor", poor), recorded.folder)
    assert code == 2
    assert said.startswith('Not comparable: the stored result\'s own verdict is "misfit"')


def content(result: Path, *temperatures: float | None) -> CalibrationFile:
    file = load_calibration(result / "calibration.yaml").file
    (entry,) = file.recordings
    entries = [entry.model_copy(update={"temperature_C": t}) for t in temperatures]
    return file.model_copy(update={"recordings": tuple(entries)})


def test_another_temperature_is_said(result: Path) -> None:
    (said,) = temperature_remarks(content(result, 21.0, None, 22.0), 28.0)
    assert said.startswith("identified at 21.5 deg C, this recording is of 28.0 deg C")
    assert "of steel are longer by +78 um/m" in said
    assert temperature_remarks(content(result, 21.0), 22.0) == ()
    assert temperature_remarks(content(result, None), 30.0) == ()
    assert temperature_remarks(content(result, 21.0), None) == ()

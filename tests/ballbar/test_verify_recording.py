"""`ballbar verify` with a recording: a result read back, changed by hand, and its refusals."""

from __future__ import annotations

import json
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

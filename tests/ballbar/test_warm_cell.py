"""A cell at 30 degC: the plate's growth is counted, and lengths are referred to 20 degC."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import ballbar
from ballbar.cell.geometry import parameter_named
from ballbar.report.budget import temperature_sentence
from ballbar.report.terminal import budget_sentence
from ballbar.result.calibration import Calibration
from ballbar.sim.truth import load_truth
from ballbar.truth.compare import result_against_truth

SCENARIO = {
    "name": "warm",
    "cell": {
        "robot": "irb2400",
        "ballbar": "lund_600",
        "ballbar_position_m": [0.70, 0.0, 0.54],
        "temperature_C": 30.0,
        "temperature_sigma_K": 0.5,
    },
    "path": {"kind": "lissajous", "file": "irb2400_a.yaml", "duration_s": 60, "dwell_s": 2},
    "plant": {"kind": "kinematic"},
    "errors": {"static": {"table": "thesis_3_1"}},
    "encoders": {"fitted": [1, 2, 3, 4, 5], "bits": 12, "noise_sigma_rad": 2.0e-6},
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("warm")
    paths = Path(__file__).parents[2] / "scenarios" / "paths"
    path = SCENARIO["path"] | {"file": str(paths / "irb2400_a.yaml"), "stops": 0}  # type: ignore[operator]
    (folder / "warm.yaml").write_text(yaml.safe_dump(SCENARIO | {"path": path}))
    ballbar.simulate(folder / "warm.yaml", folder / "recording")
    return folder / "recording"


@pytest.fixture(scope="module")
def warm(recording: Path) -> Calibration:
    return ballbar.identify(recording)


def without_temperature(recording: Path, folder: Path) -> Path:
    """The recording, whose temperature nobody wrote down."""
    for file in recording.rglob("*"):
        place = folder / file.relative_to(recording)
        if file.is_dir():
            place.mkdir(exist_ok=True)
        elif file.name == "recording.yaml":
            lines = file.read_text().splitlines(keepends=True)
            place.write_text("".join(x for x in lines if not x.startswith("temperature")))
        else:
            place.write_bytes(file.read_bytes())
    return folder


def test_a_plate_that_is_warm_gives_the_right_scale(
    recording: Path, warm: Calibration, tmp_path: Path
) -> None:
    """58 um on 250 mm: 0.2 mm at the tool, beyond all that is stated, where nobody says so."""
    truth = recording.with_name("recording.truth.yaml")
    cold = ballbar.identify(without_temperature(recording, tmp_path))
    right, wrong = (result_against_truth(c, truth).tcp.mean for c in (warm, cold))
    assert right < 2e-6
    assert wrong > 1e-4
    assert cold.file.temperature is None
    assert "not stated" in temperature_sentence(cold.file.temperature)


def test_lengths_are_referred_to_20_degrees(recording: Path, warm: Calibration) -> None:
    stated = warm.file.temperature
    assert stated is not None
    assert stated.factor_to_20_C == pytest.approx(1.0 / (1.0 + 10.0 * 11.5e-6), abs=1e-12)
    true = load_truth(recording.with_name("recording.truth.yaml")).geometry  # type: ignore[union-attr]
    for name in ("ra2", "rd4"):
        at_20 = warm.geometry[name] * stated.factor_to_20_C
        cold = true[name] / (1.0 + 10.0 * 11.5e-6)
        assert at_20 == pytest.approx(cold, abs=5e-6)
        assert parameter_named(name).is_length
    sentence = temperature_sentence(stated)
    assert "robot 30.0 °C" in sentence
    assert "0.999885 ± 0.000012 at 20 °C" in sentence


def test_the_budget_has_a_row_of_the_temperature(warm: Calibration) -> None:
    assert warm.budget is not None
    rows = {row.name: row for row in warm.budget.rows}
    by_heat, plate = rows["temperature"], rows["plate"]
    assert by_heat.standard_uncertainty == pytest.approx(
        0.25 * np.hypot(23.1e-6 * 0.5, 10.0 * 1e-6), rel=1e-6
    )
    assert plate.standard_uncertainty == pytest.approx(5e-6, rel=1e-6)
    assert by_heat.sensitivity[0] == pytest.approx(plate.sensitivity[0], rel=1e-6)
    assert sum(row.share for row in warm.budget.rows) == pytest.approx(1.0, rel=1e-9)


def test_the_budget_is_read_back_and_shown(warm: Calibration, tmp_path: Path) -> None:
    warm.save(tmp_path)
    read = ballbar.load(tmp_path)
    assert read.budget == warm.budget
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<h2 id="budget">' in page
    assert "Temperature: growth of the plate from 20 deg C" in page
    sentence = budget_sentence(read.budget)
    assert sentence.startswith("expanded uncertainty of the tool (k = 1.9")
    assert "plate 36 %, temperature 21 %" in sentence


def test_a_file_of_an_older_version_has_no_budget(warm: Calibration, tmp_path: Path) -> None:
    warm.save(tmp_path)
    content = yaml.safe_load((tmp_path / "calibration.yaml").read_text(encoding="utf-8"))
    del content["uncertainty_budget"], content["temperature"]
    (tmp_path / "calibration.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    old = ballbar.load(tmp_path)
    assert old.budget is None
    assert budget_sentence(old.budget) == ""

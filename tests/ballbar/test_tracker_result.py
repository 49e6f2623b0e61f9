"""What an optical tracker leaves in console, JSON, calibration.yaml and report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ballbar.result.calibration import PointErrorsEntry, TrackerEntry, load_calibration
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import record

QUICK = {"plant": {"kind": "kinematic"}, "logs": {"tracker": {"offset_s": 3.7}}}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of one machine; half of the points of the second one are 2 mm off."""
    root = tmp_path_factory.mktemp("tracked")
    for number, name in enumerate(("fitted", "moved"), start=1):
        record(root / name, recording=number, **QUICK)
    file = root / "moved/raw/tracker.csv"
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    rows[len(rows) // 2 :, 1] += 2.0  # mm: somebody has touched the tracker
    np.savetxt(file, rows, delimiter=",", header="time,x,y,z", comments="", fmt="%.6f")
    return root


def test_a_result_says_how_far_the_tracker_is_from_both_robots(root: Path) -> None:
    out = root / "good"
    code, said, _ = ballbar("identify", root / "fitted", "--out", out, "--json")
    assert code == 0
    data = json.loads(said)
    (entry,) = (recording["tracker"] for recording in data["calibration"]["recordings"])
    assert entry["acceptable"]
    assert (entry["unknowns"], entry["degrees_of_freedom"]) == (11, 3 * entry["points"] - 11)
    assert entry["noise_m"] == pytest.approx(np.sqrt(3.0) * 9e-5, rel=0.03)
    assert entry["identified"]["rms_m"] == pytest.approx(entry["noise_m"], rel=0.03)
    assert entry["nominal"]["rms_m"] > 5.0 * entry["identified"]["rms_m"]
    assert entry["identified"]["clock_offset_s"] == pytest.approx(3.7, abs=3e-4)
    stored = load_calibration(out / "calibration.yaml").file.recordings[0].tracker
    assert isinstance(stored, TrackerEntry)
    assert isinstance(stored.nominal, PointErrorsEntry)
    assert stored.model_dump() == entry
    page = (out / "report.html").read_text()
    assert page.count('id="tracker-1"') == 1
    assert f"{entry['points']} points that the tracker measured" in page
    assert "Distance of the tracker" in page


def test_a_held_out_tracker_that_was_moved_stands_in_the_verdict(root: Path) -> None:
    out = root / "care"
    code, said, _ = ballbar("identify", root / "fitted", "--validate", root / "moved", "--out", out)
    assert code == 0
    assert "\nTracker: its 686 points are 0.15" in said
    assert "(11 unknowns, 2047 degrees of freedom), and what these absorb is not seen." in said
    assert "moved: Tracker: its 685 points are 0.9" in said
    result = load_calibration(out / "calibration.yaml").file
    (own,), (other,) = result.recordings, result.held_out
    assert own.tracker is not None
    assert other.tracker is not None
    assert (own.tracker.acceptable, other.tracker.acceptable) == (True, False)
    assert other.acceptable  # its loop closes all the same
    assert result.fit.status == "suspect"
    sentence = "Usable, with care: moved: the tracker contradicts the identified robot: "
    assert result.fit.verdict.startswith(sentence)
    assert "Optical tracker of moved" in (out / "report.html").read_text()

"""An optical tracker in console, calibration.yaml and report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.result.calibration import load
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


@pytest.mark.slow
def test_a_result_says_how_far_both_trackers_are_and_that_the_held_out_one_was_moved(
    root: Path,
) -> None:
    out = root / "result"
    code, said, _ = ballbar("identify", root / "fitted", "--validate", root / "moved", "--out", out)
    assert code == 0
    assert "\nTracker: its 686 points are 0.15" in said
    assert "(11 unknowns, 2047 degrees of freedom), and what these absorb is not seen." in said
    assert "moved: Tracker: its 685 points are 0.9" in said
    result = load(out / "calibration.yaml").file
    own, other = result.recordings[0].tracker, result.held_out[0].tracker
    assert own is not None
    assert other is not None
    assert own.acceptable
    assert (own.points, own.unknowns, own.degrees_of_freedom) == (686, 11, 2047)
    assert own.noise_m == pytest.approx(np.sqrt(3.0) * 9e-5, rel=0.03)
    assert own.identified.rms_m == pytest.approx(own.noise_m, rel=0.03)
    assert own.nominal.rms_m > 5.0 * own.identified.rms_m
    assert own.identified.clock_offset_s == pytest.approx(3.7, abs=3e-4)
    assert not other.acceptable
    assert result.held_out[0].acceptable  # its loop closes all the same
    assert result.fit.status == "suspect"
    sentence = "Usable, with care: moved: the tracker contradicts the identified robot: "
    assert result.fit.verdict.startswith(sentence)
    page = (out / "report.html").read_text()
    assert page.count('id="tracker-1"') == 1
    assert "the 686 points that the tracker measured" in page
    assert "Optical tracker of moved" in page

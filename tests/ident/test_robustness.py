"""Gross faults in a log of the full plant: what they cost, and how they are reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.neighbours import damaged_bursts
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Identification
from ballbar.scenario import load_scenario
from ballbar.sim.errors.sensor_errors import Outliers
from ballbar.sim.truth import Truth
from ballbar.truth.compare import identification_against_truth
from tests.helpers.drawn_robots import SCENARIOS, SLIP_S, STEP_S, faulty, recorded

FAULTS: dict[str, dict[str, object]] = {
    "errors": {"outliers": {}, "slipped_periods": [{"encoder": 2, "at_s": SLIP_S, "periods": 2}]},
    "clocks": {"step": {"at_s": STEP_S, "step_s": 0.05}},
}


def calibrated(folder: Path, faults: dict[str, dict[str, object]]) -> tuple[Identification, Truth]:
    """A recording of the full plant, everything on, with these faults."""
    cell, logs, truth = recorded(
        faulty(load_scenario(SCENARIOS / "irb2400_full.yaml"), faults), folder
    )
    options = FitOptions(model="complete", force="torque")
    return identify_together(cell, [logs], options=options), truth


@pytest.mark.slow
@pytest.mark.long
def test_gross_faults_are_repaired_reported_and_cost_little(tmp_path: Path) -> None:
    clean, truth = calibrated(tmp_path / "clean", {})
    assert clean.recordings[0].step_faults == ()
    dirty, faulty_truth = calibrated(tmp_path / "dirty", FAULTS)
    before, after = (
        identification_against_truth(clean, truth).tcp.mean,
        identification_against_truth(dirty, faulty_truth).tcp.mean,
    )
    # one draw; over many the median stays below 1.2 (docs/studies/robustness.csv)
    assert after < 1.3 * before
    start = faulty_truth.logs.first_rows.ballbar_s
    (recording,) = dirty.recordings
    slip, step = sorted(recording.step_faults, key=lambda fault: fault.time)
    assert (slip.kind, slip.joint, abs(slip.periods)) == ("encoder", 2, 2)
    assert slip.time + start == pytest.approx(SLIP_S, abs=0.02)
    assert step.kind == "clock"
    assert step.time + start == pytest.approx(STEP_S, abs=0.02)
    assert step.size == pytest.approx(0.05, abs=2e-4)
    assert all(fault.sentence in dirty.verdict.warnings for fault in recording.step_faults)


def motion(rows: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Two joints that move smoothly, 4 ms rows, 5 urad of noise."""
    t = 0.004 * np.arange(rows)
    angles = np.stack((0.8 * np.sin(0.9 * t), 0.3 * np.cos(2.1 * t)), axis=1)
    return t, angles + 5e-6 * np.random.default_rng(1).standard_normal(angles.shape)


def test_outliers_are_told_from_motion() -> None:
    t, angles = motion()
    assert not damaged_bursts(t, angles).any()
    thrown = Outliers().on_robot(t.size, 6, 3)[:, :2]
    found = damaged_bursts(t, angles + thrown)
    large = np.abs(thrown) > 1e-3
    assert found[large].mean() > 0.98
    assert found[thrown == 0.0].mean() < 1e-3


def test_a_jerk_of_the_motion_is_no_outlier() -> None:
    """Where a joint strikes in its backlash its angle bends within a few rows; none is left out."""
    t, angles = motion()
    angles[:, 1] += 1.25e-4 * np.tanh((t - 8.0) / 0.012)
    assert not damaged_bursts(t, angles).any()


def test_outliers_have_the_asked_share_and_size() -> None:
    asked = Outliers(robot_probability=0.1, size_rad=(1e-3, 1e-2))
    thrown = asked.on_robot(20_000, 6, 1)
    hit = thrown[thrown != 0.0]
    assert hit.size / 20_000 == pytest.approx(0.1, rel=0.05)
    assert ((thrown != 0.0).sum(axis=1) <= 1).all()
    assert (np.abs(hit) >= 1e-3).all()
    assert (np.abs(hit) <= 1e-2).all()
    assert np.median(np.abs(hit)) == pytest.approx(np.sqrt(1e-5), rel=0.05)
    assert (asked.on_ballbar(20_000, 4, 1) != asked.on_ballbar(20_000, 4, 2)).any()

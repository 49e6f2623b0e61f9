"""Every dialect that is read can be simulated and is read as it was; robots are identified from it.

The coarsest stands for all: what the others leave of angles and times is less.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from ballbar.acquisition.recording import read_recording
from ballbar.cell.dialect import dialect_names, load_dialect
from ballbar.cell.errors import InputError
from ballbar.ident.options import FitOptions
from ballbar.result.identify import identify
from ballbar.scenario import load_scenario
from ballbar.truth.compare import identification_against_truth
from tests.helpers.simulated_recordings import Recorded, lissajous, record

OF = {name: load_dialect(name).source for name in dialect_names()}
ROBOTS = [name for name, source in OF.items() if source == "robot"]
BALLBARS = [name for name, source in OF.items() if source == "ballbar"]
WRITTEN_ALWAYS = {
    "force-torque",
    "length-table",
    "tracker-points",
}  # by every scenario with such a sensor
# [rad], [s] what a dialect leaves of angles and times; of the others less than a nanoradian
COARSE = {"abb-libegm": (1e-5, 3e-5), "abb-mpe": (2e-7, 4e-6)}


def logged(folder: Path, **logs: Any) -> Recorded:
    """Half a minute of the kinematic plant without noise of the robot."""
    return record(
        folder / "recording",
        path=lissajous("paths/irb2400_a.yaml", 30.0),
        plant={"kind": "kinematic"},
        errors={"static": {"table": "thesis_3_1"}},
        clocks={"offset_s": 0.137, "skew": 5e-5},
        logs=logs,
    )


def test_no_dialect_is_left_out() -> None:
    assert {*ROBOTS, *BALLBARS} | WRITTEN_ALWAYS == set(OF)


@pytest.mark.parametrize("dialect", ROBOTS)
def test_a_robots_log_is_read_as_it_was_simulated(dialect: str, tmp_path: Path) -> None:
    done = logged(tmp_path, robot={"dialect": dialect})
    recording, simulation = read_recording(done.folder), done.simulation
    log = recording.robot_log
    period = load_dialect(dialect).written.period_s
    assert np.median(np.diff(log.t)) == pytest.approx(period, abs=1e-6)
    true = simulation.motion.shown_at(simulation.times.robot_true)
    fastest = np.abs(np.diff(true, axis=0)).max() / period
    angle, time = COARSE.get(dialect, (1e-9, 1e-9))
    if any(finding.kind == "quantised stamps" for finding in recording.report.findings):
        time += 1e-3  # a shift that all rows share, which belongs to the clock offset
    assert np.abs(log.q - true).max() < angle + time * fastest


@pytest.mark.slow
@pytest.mark.parametrize("dialect", BALLBARS)
@pytest.mark.parametrize("status", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_ball_bars_log_is_read_as_it_was_simulated(
    dialect: str, status: bool, tmp_path: Path
) -> None:
    done = logged(tmp_path, ballbar={"dialect": dialect, "status": status, "task_s": 0.002})
    recording = read_recording(done.folder)
    log = recording.ballbar_log
    assert log is not None
    assert np.diff(log.t) == pytest.approx(0.004, abs=1e-9)
    count = 2.0 * np.pi / (3600 << 12)
    true = done.simulation.motion.bar_at(done.simulation.times.bar_true)
    turned = true * [e.direction * e.declared for e in done.simulation.encoders]
    noise = (log.angles - log.angles[0]) - (turned - turned[0])
    assert np.abs(noise).max() < 12.0 * 1e-5 + count  # of the encoders, 10 urad
    missing = [f for f in recording.report.findings if f.kind == "no status word"]
    assert bool(missing) != status


def test_a_robot_logs_in_its_controllers_dialect_at_the_rate_that_is_chosen(tmp_path: Path) -> None:
    scenario = load_scenario("nj220").model_dump(mode="json", by_alias=True, exclude_none=True)
    nj220 = {"cell": scenario["cell"], "path": scenario["path"] | {"duration_s": 60.0}}
    kinematic: dict[str, Any] = {"plant": {"kind": "kinematic"}, "errors": {}}
    done = record(tmp_path / "nj220", **nj220, **kinematic, logs={"robot": {"rate_hz": 100.0}})
    recording = read_recording(done.folder)
    assert recording.description.sources.robot.dialect == "comau-joint"
    assert np.median(np.diff(recording.robot_log.t)) == pytest.approx(0.01, abs=1e-9)
    assert (done.folder / "raw/robot.csv").read_text().startswith("time,J1,J2,J3,J4,J5,J6\n")


@pytest.mark.parametrize(
    ("logs", "words"),
    [
        ({"robot": {"dialect": "twincat-plc"}}, "twincat-plc describes logs of a ballbar"),
        ({"ballbar": {"dialect": "abb-motor"}}, "abb-motor describes logs of a robot"),
        ({"robot": {"dialect": "comau-joint"}, "torque": {}}, "has no columns for torques"),
        ({"robot": {"dialect": "comau"}}, "unknown dialect 'comau'"),
    ],
)
def test_a_dialect_that_cannot_be_written_is_refused(
    logs: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises((InputError, ValidationError), match=words):
        record(tmp_path / "recording", logs=logs)


def test_a_robot_is_identified_from_the_coarsest_dialect(tmp_path: Path) -> None:
    coarsest = max(COARSE, key=lambda dialect: COARSE[dialect])
    done = record(
        tmp_path / "recording", plant={"kind": "kinematic"}, logs={"robot": {"dialect": coarsest}}
    )
    data = identify(done.folder, options=FitOptions(samples=300)).data
    assert data.acceptable, data.identification.verdict.sentence
    compared = identification_against_truth(data.identification, done.simulation.truth)
    assert compared.tcp.mean < 0.03e-3  # nominal 2.7 mm; steps of 17 urad

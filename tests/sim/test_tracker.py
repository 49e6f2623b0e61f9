"""The optical tracker: what it measures, how exactly, and that nothing else depends on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from ballbar.acquisition.recording import read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.sim.motion import deflect
from ballbar.sim.recording_files import truth_path
from tests.helpers.simulated_recordings import Recorded, record

TRACKER = {"offset_s": 3.7, "skew": 4e-5, "led_m": [-0.1, 0.02, 0.05]}
QUICK = {"plant": {"kind": "kinematic"}}


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A minute in MuJoCo with elastic gears and a bending plate."""
    errors = {"static": {"table": "thesis_3_1"}, "joint_compliance": {}, "plate_bending": {}}
    folder = tmp_path_factory.mktemp("tracked") / "recording"
    return record(folder, errors=errors, logs={"tracker": TRACKER})


def true_points(done: Recorded, t: Array) -> Array:
    """(N, 3) [m] of the LED in the tracker's frame at times t (N,) [s] of its log."""
    drawn, times = done.simulation.truth.logs.tracker, done.simulation.times.robot_true
    assert drawn is not None
    at = times[0] + drawn.offset_s + (1.0 + drawn.skew) * t
    motion, step = done.simulation.motion, slice(None, None, 10)
    n = motion.t[step].size
    ends = deflect(
        motion.geometry,
        motion.q[step],
        motion.b[step],
        stretch=motion.rod_stretch[step],
        plate=np.broadcast_to(motion.plate[step], n),
        base=np.zeros((n, 3)),
    )
    led = ends.tool + np.einsum("ijn,j->in", ends.tool_rotation, np.array(drawn.led_m))
    turn = matrix_from_rotvec(np.array(drawn.rotation_vector_rad)[:, None])[:, :, 0]
    there = turn.T @ (led - np.array(drawn.position_m)[:, None])
    return np.stack([np.interp(at, motion.t[step], row) for row in there], axis=1)


def test_it_measures_the_bent_tool_on_its_own_clock_with_the_stated_noise(
    tracked: Recorded,
) -> None:
    log = read_recording(tracked.folder).tracker_log
    assert log is not None
    assert np.ptp(tracked.simulation.motion.plate) > 1e-5  # rad
    error = log.points - true_points(tracked, log.t)
    np.testing.assert_allclose(error.std(axis=0), 9.0e-5, rtol=0.04)  # of 5800 rows: 0.9 %
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=5e-6)  # 9e-5 / sqrt(5800) = 1.2e-6
    assert abs(np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]) < 0.05


def test_the_tool_is_that_of_the_deflected_mechanism(tracked: Recorded) -> None:
    """Through a spline that passes through every step, and thus exactly there."""
    motion, rows = tracked.simulation.motion, np.arange(0, 60_000, 997)
    ends = deflect(
        motion.geometry,
        motion.q[rows],
        motion.b[rows],
        stretch=motion.rod_stretch[rows],
        plate=motion.plate[rows],
        base=np.zeros((rows.size, 3)),
    )
    grown = replace(motion, growth=np.array([[1e-4, 0.0, -2e-4]]))
    rotation, position = grown.tool_at(motion.t[rows])
    np.testing.assert_allclose(
        position.T - ends.tool.T, np.broadcast_to(grown.growth, (rows.size, 3)), atol=1e-9
    )
    np.testing.assert_allclose(rotation, ends.tool_rotation, atol=1e-9)


def test_switching_it_on_leaves_every_other_log_bit_identical(
    tracked: Recorded, tmp_path: Path
) -> None:
    without = record(
        tmp_path / "recording", errors=tracked.settings.errors.model_dump(exclude_unset=True)
    )
    names = {path.name for path in (without.folder / "raw").iterdir()}
    assert {path.name for path in (tracked.folder / "raw").iterdir()} == names | {"tracker.csv"}
    for name in names:
        assert (tracked.folder / "raw" / name).read_bytes() == (
            without.folder / "raw" / name
        ).read_bytes()
    truth, bare = (
        yaml.safe_load(truth_path(done.folder).read_text()) for done in (tracked, without)
    )
    del truth["logs"]["tracker"]
    assert truth == bare


def test_another_recording_of_the_machine_has_the_same_frame_and_other_noise(
    tmp_path: Path,
) -> None:
    runs = [
        record(tmp_path / f"{number}", logs={"tracker": TRACKER}, recording=number, **QUICK)
        for number in (1, 2)
    ]
    first, second = (run.simulation.truth.logs.tracker for run in runs)
    assert first == second
    one, other = (np.loadtxt(r.folder / "raw/tracker.csv", delimiter=",", skiprows=1) for r in runs)
    difference = (one - other)[:, 1:].std(axis=0) * 1e-3
    np.testing.assert_allclose(difference, np.sqrt(2.0) * 9.0e-5, rtol=0.04)

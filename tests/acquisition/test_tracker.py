"""Logs of an optical tracker: units, hidden LEDs, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.channels import read_channels
from ballbar.acquisition.explain import explain_lines
from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.load import load_instrument
from ballbar.recordings.check import CheckedRecording
from tests.helpers.followed_robot import FollowedRobot
from tests.helpers.simulated_recordings import record

ROWS = 2957  # at 50 Hz


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tracked") / "recording"
    return record(folder, plant={"kind": "kinematic"}, logs={"tracker": {"rate_hz": 50.0}}).folder


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    """The recording again, its files linked but for the tracker's and recording.yaml."""
    (tmp_path / "raw").mkdir()
    for path in (original / "raw").iterdir():
        if path.name != "tracker.csv":
            (tmp_path / "raw" / path.name).hardlink_to(path)
    for name in ("raw/tracker.csv", "recording.yaml"):
        (tmp_path / name).write_bytes((original / name).read_bytes())
    return tmp_path


def lines_of(folder: Path) -> list[str]:
    return (folder / "raw/tracker.csv").read_text().splitlines()


def rewrite(folder: Path, lines: list[str]) -> None:
    (folder / "raw/tracker.csv").write_text("\n".join(lines) + "\n")


def declare(folder: Path, was: str, now: str) -> None:
    text = (folder / "recording.yaml").read_text()
    assert was in text
    (folder / "recording.yaml").write_text(text.replace(was, now))


def test_points_are_read_in_metres_with_the_stated_accuracy(folder: Path) -> None:
    recording = read_recording(folder)
    log, rows = recording.tracker_log, np.loadtxt(lines_of(folder)[1:], delimiter=",")
    assert log is not None
    np.testing.assert_allclose(log.points, rows[:, 1:] * 1e-3, rtol=1e-12)
    np.testing.assert_allclose(log.t, rows[:, 0] - rows[0, 0], atol=1e-9)
    assert (log.sigma == 9.0e-5).all()
    assert read_channels(folder, source="tracker")[0].names == ("x", "y", "z")
    assert "points of a target in mm (recording.yaml), accuracy 90 um" in "\n".join(
        explain_lines(folder)
    )
    assert "  tracker log: 2957 samples over 59.12 s" in "\n".join(
        CheckedRecording(recording).lines()
    )


@pytest.mark.parametrize("cells", [",,", "0,0,0", "NaN,NaN,NaN", "0.000, 0.000, 0.000"])
def test_rows_of_a_hidden_led_are_left_out_and_reported(folder: Path, cells: str) -> None:
    lines = lines_of(folder)
    hidden = [*range(1, 4), *range(500, 560), *range(1000, 1003), ROWS]
    for row in hidden:
        lines[row] = lines[row].partition(",")[0] + "," + cells
    rewrite(folder, lines)
    recording = read_recording(folder)
    log = recording.tracker_log
    assert log is not None
    assert log.t.size == ROWS - len(hidden)
    kept = np.delete(np.loadtxt(lines_of(folder)[4:500], delimiter=","), 0, axis=1) * 1e-3
    np.testing.assert_array_equal(log.points[:496], kept)
    assert np.diff(log.t).max() == pytest.approx(61 * 0.02)
    (entry,) = (f for f in recording.report.findings if f.kind == "hidden target")
    assert (entry.severity, entry.count) == ("repaired", len(hidden))
    assert entry.lines[0] == 2


def test_sixty_stretches_without_a_point_are_still_one_log(folder: Path) -> None:
    lines = lines_of(folder)
    for start in range(20, 2900, 48):
        for row in range(start, start + 24):  # half a second each
            lines[row] = lines[row].partition(",")[0] + ",,,"
    rewrite(folder, lines)
    log = read_recording(folder).tracker_log
    assert log is not None
    assert log.t.size == ROWS - 60 * 24
    assert log.t[-1] == pytest.approx((ROWS - 1) * 0.02)
    assert log.segment is not None
    assert not log.segment.any()


@pytest.mark.parametrize("unit", ["m", "um"])
def test_another_unit_than_the_declared_one_is_refused(folder: Path, unit: str) -> None:
    declare(folder, "unit: mm", f"unit: {unit}")
    message = rf"tracker\.csv:2: the points spread over .* in {unit}\? Correct unit of sources"
    with pytest.raises(LogError, match=message):
        read_recording(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda row: row.rpartition(",")[0] + ",", "column z: .* is an empty cell"),
        (lambda row: row.rpartition(",")[0] + ",?", "is not a number"),
    ],
)
def test_a_point_without_one_of_its_coordinates_is_refused(
    folder: Path, change: Callable[[str], str], message: str
) -> None:
    lines = lines_of(folder)
    lines[700] = change(lines[700])
    rewrite(folder, lines)
    with pytest.raises(LogError, match=message):
        read_recording(folder)


def test_an_led_that_was_never_seen_is_refused(folder: Path) -> None:
    lines = lines_of(folder)
    rewrite(folder, [lines[0], *(line.partition(",")[0] + ",,," for line in lines[1:])])
    with pytest.raises(LogError, match=r"tracker\.csv: 0 usable rows"):
        read_recording(folder)


def test_the_log_of_another_device_is_refused(folder: Path) -> None:
    declare(folder, "dialect: tracker-points", "dialect: force-torque")
    with pytest.raises(DescriptionError, match="of the force sensor, not of the optical tracker"):
        read_recording(folder)


def test_a_tracker_alone_has_the_sigma_of_its_instrument_and_a_pose_its_rotation(
    tmp_path: Path,
) -> None:
    made = FollowedRobot(seed=5)
    for pose in (False, True):
        folder = made.write(tmp_path / str(pose), seconds=15.0, rate=50.0, pose=pose)
        log = read_recording(folder).tracker_log
        assert log is not None
        name = "tracker_pose" if pose else "tracker_point"
        np.testing.assert_allclose(log.values, made.measured(log.t, pose=pose), atol=2e-9)
        np.testing.assert_array_equal(log.sigma, load_instrument(name).sigma(log.values))
        assert log.measured == name.removeprefix("tracker_")
    declare(folder, "unit: mm", "unit: mm\n    accuracy_m: 1.0e-4\n    accuracy_rad: 2.0e-3")
    log = read_recording(folder).tracker_log
    assert log is not None
    assert (log.sigma == [1e-4] * 3 + [2e-3] * 3).all()


@pytest.mark.parametrize(
    ("pose", "was", "now", "message"),
    [
        (True, "tracker_pose", "tracker_point", "measures a point, and the columns hold a pose"),
        (False, "tracker_point", "tracker_pose", "measures a pose, and the columns hold a point"),
        (False, "tracker_point", "qc20w_300", "measures a length, and the columns hold a point"),
        (True, "rx, ry, rz", "rx, ry", "at least 3"),
        (True, "form: rotvec", "form: quat_xyzw", "3 columns do not hold a rotation of the form"),
        (False, "  tracker:", "  force:", "sources.tracker of one that follows a target"),
    ],
)
def test_an_instrument_that_does_not_fit_its_columns_is_refused(
    tmp_path: Path, pose: bool, was: str, now: str, message: str
) -> None:
    folder = FollowedRobot(seed=5).write(tmp_path / "moving", seconds=15.0, rate=50.0, pose=pose)
    text = (folder / "recording.yaml").read_text()
    if now == "  force:":
        text = text.replace("    unit: mm\n", "").replace("tracker-points", "force-torque")
    (folder / "recording.yaml").write_text(text)
    declare(folder, was, now)
    with pytest.raises(DescriptionError, match=message):
        read_recording(folder)

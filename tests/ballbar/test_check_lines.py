"""Lines of `ballbar check`: sizes in their units, and each thing counted once."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.acquisition.alignment import CoarseAlignment
from ballbar.cell.errors import InputError
from ballbar.cell.load import load_robot
from ballbar.recordings import check
from ballbar.recordings.check import CheckedPoses, CheckedRecording, holds_poses

Stub = SimpleNamespace
T = 0.004 * np.arange(1001)


def log(**own: Any) -> Any:
    segment = np.zeros(T.size, dtype=int)
    segment[250:] = 1
    segment[500:] = 2
    return Stub(t=T, segment=segment, torque=None, **own)


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A robot that rests twice, for 0.4 and 0.8 s, and a ball-bar; what the report says is else."""
    intervals = np.array([[100, 200], [300, 500]])
    monkeypatch.setattr(check, "find_dwells", lambda *_: Stub(intervals=intervals))
    monkeypatch.setattr(check, "report_lines", lambda _: ["REPORT"])
    bar = log(joints=(1, 4), angles=None)
    made = {
        "robot_log": log(q=None), "ballbar_log": bar, "force_log": Stub(t=T[:501]),
        "length_log": None, "tracker_log": None, "description": Stub(followed=False),
        "report": Stub(to_dict=dict),
    }  # fmt: skip
    return Stub(**made)


def test_each_log_has_its_samples_period_segments_and_dwells(read: Any) -> None:
    lines = CheckedRecording(read).lines()
    middle = "log: 1001 samples over 4.00 s, median period 4 ms"
    parts = ", 3 segments (new at 1.00, 2.00 s); 2 dwells, 1.2 s in all"
    assert lines == [
        "REPORT",
        "LOGS",
        f"  robot {middle}{parts}",
        f"  ball-bar {middle}, encoders b1, b4{parts}",
        "  force log: 501 samples over 2.00 s, median period 4 ms",
    ]


def test_what_has_no_dwell_or_encoder_says_so(read: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    none = Stub(intervals=np.zeros((0, 2), dtype=int))
    monkeypatch.setattr(check, "find_dwells", lambda *_: none)
    read.ballbar_log, read.force_log, read.robot_log.torque = None, None, 1
    read.robot_log.segment[:] = 0
    lines = CheckedRecording(read).lines()
    assert lines[2].endswith("median period 4 ms, with motor torques; no dwell")
    assert lines[3] == "  no encoders: the ball-bar's length is the only measurement"
    read.length_log = log()
    lines = CheckedRecording(read).lines()
    assert lines[3].endswith("median period 4 ms, 3 segments (new at 1.00, 2.00 s)")
    assert len(lines) == 4
    read.length_log, read.tracker_log, read.description.followed = None, log(), True
    assert CheckedRecording(read).lines()[3].startswith("  tracker log: 1001 samples")


def test_the_coarse_clock_is_shown_with_its_rival(read: Any) -> None:
    clear = CoarseAlignment(-3.04, 0.9, 55.4, None, 0.0)
    rival = CoarseAlignment(-3.04, 0.8, 55.4, 1.25, 0.6)
    assert CheckedRecording(read, clear).lines()[-2:] == [
        "CLOCKS", "  coarse clock offset: -3.04 s over 55 s of overlap",
    ]  # fmt: skip
    assert (
        CheckedRecording(read, rival)
        .lines()[-1]
        .endswith("; next best +1.25 s with 75% of the score")
    )
    data = CheckedRecording(read, rival).data()
    assert data["coarse_clock"] == {
        "offset_s": -3.04, "overlap_s": 55.4, "runner_up_offset_s": 1.25,
    }  # fmt: skip
    assert data["logs"]["robot"] == {
        "rows": 1001, "duration_s": pytest.approx(4.0), "median_period_s": pytest.approx(0.004),
        "segments": 3, "rests_s": [[0.4, 0.8], [1.2, 2.0]],
    }  # fmt: skip
    assert data["logs"]["force"]["segments"] == 1
    assert "coarse_clock" not in CheckedRecording(read).data()


def group(k: int, **changes: Any) -> Any:
    values = np.array([[0.1, -0.2, 0.3], [0.4, 0.5, 0.6], [0.2, 0.0, 0.3]])
    base = {
        "seat": f"s{k}", "target": "ball", "size": 3, "measured": "point", "values": values,
        "sigma": np.array([[1e-5, 2e-5, 1e-5], [1e-5, 4e-5, 1e-5], [1e-5, 9e-5, 3e-5]]),
        "kind": Stub(names=("x", "y", "z"), units=("m", "m", "m")), "file": "poses.csv",
        "time": None,
    }  # fmt: skip
    return Stub(**base | changes)


def imported(*groups: Any, distances: Any = ()) -> Any:
    robot = load_robot("irb2400")
    q = np.zeros((3, 6))
    table = Stub(
        robot=robot, size=3 * len(groups), groups=groups, seats=["a"], targets=["ball", "cup"],
        distances=distances, q=q,
    )  # fmt: skip
    report = Stub(to_dict=lambda: {"schema": "x"})
    return Stub(table=table, report=report, description=Stub(instrument=None))


def test_poses_are_counted_and_their_ranges_are_in_millimetres(read: Any) -> None:
    distance = Stub(seats=("a", "b"), length=0.05, sigma=2e-6)
    lines = CheckedPoses(imported(group(1), distances=[distance])).lines()
    assert lines[1] == "POSES"
    assert lines[2].endswith(" in 1 group: 1 seat, 2 targets")
    assert lines[2].startswith("  3 poses of ")
    assert lines[3] == (
        "  seat s1, target ball: 3 poses, point; x 100 to 400, y -200 to 500, z 300 to 600 mm; "
        "sigma 0.04 mm"
    )
    assert lines[4:6] == ["DISTANCES", "  a to b: 50 mm, sigma 0.002 mm"]
    assert lines[6] == "AXES"
    robot = load_robot("irb2400")
    low, high = np.degrees([robot.axis_lower[1], robot.axis_upper[1]])
    assert lines[8].startswith("  axis 2: ")
    assert lines[8].endswith(f"(limits {low:.4g} to {high:.4g})")


def test_of_many_groups_the_first_forty_are_listed(read: Any) -> None:
    lines = CheckedPoses(imported(*map(group, range(42)))).lines()
    assert sum("seat s" in line for line in lines) == 40
    assert "  and 2 more groups" in lines
    assert "DISTANCES" not in lines


def test_angles_and_pictures_have_units_of_their_own() -> None:
    aims = group(1, kind=Stub(names=("az", "el"), units=("rad", "rad")), size=1)
    line = check._group_line(aims)
    assert line.startswith(
        "seat s1, target ball: 1 pose, point; az 100 to 400, el -200 to 500 mrad"
    )
    nothing = group(1, kind=Stub(names=(), units=()))
    assert check._group_line(nothing) == "seat s1, target ball: 3 poses, point; sigma 0.04 mm"


def test_poses_as_data_are_in_si_units() -> None:
    timed = group(1, time=np.array([5.0, 9.5, 7.0]))
    distance = Stub(seats=("a", "b"), length=0.05, sigma=2e-6)
    data = CheckedPoses(imported(timed, distances=[distance])).data()["poses"]
    assert data["distances"] == [{"seats": ["a", "b"], "length_m": 0.05, "sigma_m": 2e-6}]
    (one,) = data["groups"]
    assert (one["lower"], one["upper"]) == ([0.1, -0.2, 0.3], [0.4, 0.5, 0.6])
    assert one["sigma_median"] == [1e-5, 4e-5, 1e-5]
    assert (one["poses"], one["duration_s"], data["poses"]) == (3, 4.5, 3)
    assert check._group_data(group(1))["duration_s"] is None


def test_a_folder_is_of_poses_or_of_a_recording(tmp_path: Path) -> None:
    assert not holds_poses(tmp_path)
    assert not holds_poses(tmp_path / "recording.yaml")
    assert holds_poses(tmp_path / "other.yaml")
    assert not holds_poses(tmp_path / "other.csv")
    (tmp_path / "poses.yaml").touch()
    assert holds_poses(tmp_path)
    (tmp_path / "recording.yaml").touch()
    with pytest.raises(InputError, match=r"holds poses\.yaml and recording\.yaml"):
        holds_poses(tmp_path)

"""Mistakes in recordings of the independent generator are named, and sound ones are not."""

from __future__ import annotations

from pathlib import Path

import pytest

from ballbar.acquisition.recording import read_recording
from ballbar.cell.load import load_cell
from ballbar.ident.causes import suspects
from ballbar.ident.recording_fit import Logs
from tests.independent.recording import Faults, Plan, record_path

SEEDS = (2,)
OFTEN = ("columns of encoders b1", "motion of axis 3", "not as long", "rd4")
MINUTE = 60.0  # [s]
SECOND = 1  # path that leaves the axes within their limits even where two are exchanged
CAUSES = {
    "the columns of encoders b1 and b2 are exchanged": Faults(swapped=(1, 2)),
    "the columns of encoders b4 and b5 are exchanged": Faults(swapped=(4, 5)),
    "the line count of encoder b1 is wrong": Faults(lines=1800),
    "the columns of motors 5 and 6 of the robot's log are exchanged": Faults(swapped_motors=(5, 6)),
    "axis 1 of the robot's log counts backwards": Faults(motor_sign=1),
    "motor 6 of the robot's log counts backwards": Faults(motor_sign=6),
    "the robot's log does not hold the motion of axis 3": Faults(still=(3,)),
    "the rod is not as long as stated": Faults(rod_error=20e-3),
    "rd4 of the file of robot robot is wrong by": Faults(forearm_error=0.1),
    "the logs are too short": Faults(keep=(20.0, 30.0)),
}
SOUND = {
    "nothing": Faults(),
    "an encoder that counts backwards": Faults(sign=1),
    "a late encoder": Faults(late=1),
    "a slip": Faults(slip=(2, 5e-4)),
    "a clock that was set": Faults(clock_step=0.02),
    "a motor's scale": Faults(scaled=(2, 1.001)),
}


def named(folder: Path, seed: int, faults: Faults) -> list[str]:
    record_path(Plan(seed, duration=MINUTE), SECOND, folder, faults)
    return causes_of(folder)


def causes_of(folder: Path) -> list[str]:
    recording = read_recording(folder)
    files = recording.description
    cell = load_cell(files.robot, files.measured_by, files.plate, relative_to=folder)
    return [s.cause for s in suspects(cell, Logs(recording.robot_log, recording.ballbar_log))]


@pytest.mark.slow
@pytest.mark.parametrize(
    "cause",
    [pytest.param(c, marks=() if any(o in c for o in OFTEN) else pytest.mark.long) for c in CAUSES],
)
def test_each_cause_is_named_first_of_every_machine(cause: str, tmp_path: Path) -> None:
    first = [named(tmp_path / str(seed), seed, CAUSES[cause])[:1] for seed in SEEDS]
    right = [names[0].startswith(cause) for names in first if names]
    print(f"{sum(right)} of {len(SEEDS)}: {cause}")
    assert sum(right) == len(SEEDS), first


@pytest.mark.long
@pytest.mark.slow
def test_logs_of_different_runs_are_named_of_every_machine(tmp_path: Path) -> None:
    for seed in SEEDS:
        folders = [tmp_path / f"{seed}-{k}" for k in range(2)]
        for k, folder in enumerate(folders):
            record_path(Plan(seed), k, folder)
        (folders[1] / "raw" / "robot.csv").rename(folders[0] / "raw" / "robot.csv")
        assert causes_of(folders[0]) == ["the logs are not of one run"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(
            f, marks=() if f in ("nothing", "a slip", "a motor's scale") else pytest.mark.long
        )
        for f in SOUND
    ],
)
def test_what_leaves_the_columns_right_has_no_suspect(fault: str, tmp_path: Path) -> None:
    assert [named(tmp_path / str(seed), seed, SOUND[fault]) for seed in SEEDS] == [[]] * len(SEEDS)

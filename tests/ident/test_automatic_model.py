"""The model that the data ask for, where the user names none, and what is said of a poor fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.cell.statistics import rms
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions, Listener
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.ident.verdict import Status
from tests.helpers.minute_logs import TRUE, minute_logs
from tests.helpers.synthetic_recording import CELL, UNIVERSAL_AND_GIMBAL

KNEES, JOINT_ERRORS = "searching gears that are softer below a knee", "searching joint errors"


def identified(*logs: Logs, **options: object) -> tuple[Identification, list[str]]:
    """The result of 200 samples, and the stages that were told on the way."""
    stages: list[str] = []
    chosen = FitOptions(samples=200, **options)  # type: ignore[arg-type]
    return identify_together(CELL, logs, options=chosen, listener=Listener(stages.append)), stages


def corrections(result: Identification) -> list[str]:
    return [correction.name for correction in result.robot.corrections]


def test_elastic_gears_are_asked_for_and_a_good_fit_ends_the_search() -> None:
    result, stages = identified(minute_logs(compliance=1.0))
    assert result.verdict.status is Status.GOOD
    assert corrections(result) == ["joint_compliance"]
    assert stages[-1] == KNEES
    assert JOINT_ERRORS not in stages


def test_two_recordings_that_ask_for_nothing_are_fitted_by_kinematics_and_the_rod_alone() -> None:
    """With all corrections they took the rod's backlash for what the geometry does."""
    result, stages = identified(minute_logs(seed=1), minute_logs(seed=2))
    assert result.verdict.status is Status.GOOD
    assert corrections(result) == ["rod_elongation"]
    assert KNEES not in stages


@pytest.mark.parametrize("encoders", [(), UNIVERSAL_AND_GIMBAL])
def test_kinematics_alone_are_fitted_to_several_recordings_together(
    encoders: tuple[int, ...],
) -> None:
    """`auto` did so where `dh` was refused."""
    logs = [minute_logs(true=TRUE, encoders=encoders, seed=seed) for seed in (1, 2, 3)]
    one, _ = identified(logs[0], model="dh")
    result, stages = identified(*logs, model="dh")
    assert result.verdict.status is Status.GOOD
    assert result.model == "dh"
    assert KNEES not in stages
    assert [r.clock is not None for r in result.recordings] == [bool(encoders)] * 3
    without_scale = [rms(each.robot.tcp.without_scale) for each in (one, result)]
    assert without_scale[1] < without_scale[0]
    errors = [
        (result.robot.geometry[name] - TRUE[name]) / sigma
        for name, sigma in result.robot.sigma.items()
    ]
    assert rms(np.array(errors)) < 1.5  # of 21 or 33 correlated deviations


def test_kinematics_alone_do_not_miss_what_corrections_would_need() -> None:
    """A robot's file without gears was named as a lack, of a model that has none."""
    logs = [minute_logs(seed=seed) for seed in (1, 2)]
    rigid = replace(CELL, robot=replace(CELL.robot, gears=None))
    result = identify_together(rigid, logs, options=FitOptions(samples=200, model="dh"))
    assert not any("were not fitted" in warning for warning in result.verdict.warnings)


def test_gears_that_are_all_softer_put_the_masses_in_doubt_and_joint_errors_are_tried() -> None:
    result, stages = identified(minute_logs(compliance=1.6))
    assert result.verdict.status is Status.SUSPECT
    assert "all gears together are 1.6" in result.verdict.sentence
    assert stages[-1] == JOINT_ERRORS


def test_two_encoders_are_too_few_for_elastic_gears_but_size_a_slip() -> None:
    logs = minute_logs(encoders=(1, 2), compliance=1.0, slip=(1, 20.0, 3e-3))
    result, _ = identified(logs)
    assert corrections(result) == []
    assert result.verdict.warnings[0].startswith("encoder b1 jumped by ")
    (fault,) = result.recordings[0].step_faults
    assert fault.size == pytest.approx(3e-3, rel=0.01)


def test_a_recording_of_another_machine_than_the_first_is_a_misfit() -> None:
    other = minute_logs(seed=1)
    q = other.robot.q + 1e-4 * np.eye(6)[3]
    result, _ = identified(
        minute_logs(),
        replace(other, robot=RobotLog(other.robot.t, q)),
        model="complete",
        corrections=(),
    )
    assert result.verdict.status is Status.MISFIT
    assert "recording 2 is not of the same machine as the others" in result.verdict.sentence


def test_of_a_fit_that_is_not_acceptable_the_cause_in_the_logs_is_named() -> None:
    logs, rows = minute_logs(encoders=(1, 2)), slice(1000, 2200)  # 12 s
    assert logs.ballbar is not None
    short = replace(
        logs,
        robot=RobotLog(logs.robot.t[rows], logs.robot.q[rows]),
        ballbar=BallBarLog(logs.ballbar.t[rows], logs.ballbar.angles[rows], (1, 2)),
    )
    result, _ = identified(short, model="dh")
    assert result.verdict.status is Status.UNCERTAIN
    assert "the logs are too short: they share at most 12.0 s" in result.verdict.sentence

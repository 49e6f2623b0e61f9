"""Single channels of single recordings that are late or scaled, beside a complete fit."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.ident.causes import beside_fit
from ballbar.ident.complete_fit import fit_complete
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs, fit_recording
from tests.helpers.minute_logs import minute_logs
from tests.helpers.synthetic_recording import CELL

OPTIONS = FitOptions(model="complete", samples=400, corrections=())


@cache
def sound(seed: int) -> Logs:
    return minute_logs(seed=seed)


def named(*logs: Logs) -> str:
    recordings = [fit_recording(CELL, each, OPTIONS) for each in logs]
    fit = fit_complete(CELL, recordings, (), OPTIONS)
    return beside_fit(CELL, fit, [f"run {k + 1}" for k in range(len(logs))])


def late_gear(logs: Logs, gear: int, late: float) -> Logs:
    log, gears = logs.robot, logs.robot.q @ CELL.robot.joint_to_gear
    gears[:, gear - 1] = np.interp(log.t - late, log.t, gears[:, gear - 1])
    return replace(logs, robot=RobotLog(log.t, gears @ CELL.robot.gear_to_joint))


def changed_encoder(logs: Logs, joint: int, *, late: float = 0.0, factor: float = 1.0) -> Logs:
    log = logs.ballbar
    assert log is not None
    angles, column = log.angles.copy(), log.joints.index(joint)
    angles[:, column] = factor * np.interp(log.t - late, log.t, angles[:, column])
    return replace(logs, ballbar=BallBarLog(log.t, angles, log.joints))


def test_sound_recordings_have_no_such_error() -> None:
    assert named(sound(0), sound(1)) == ""
    assert named(sound(2)) == ""


@pytest.mark.parametrize("gear", [2, 6])
def test_a_gear_of_one_recording_that_is_late_is_named(gear: int) -> None:
    text = named(sound(0), late_gear(sound(1), gear, 0.004))
    assert text.startswith(f"gear {gear} is logged later in run 2 than elsewhere")
    assert "Log all channels of a row at one instant" in text


@pytest.mark.slow
@pytest.mark.parametrize("joint", [1, 5])
def test_an_encoder_that_is_late_is_named(joint: int) -> None:
    late = changed_encoder(sound(0), joint, late=0.010)
    assert f"encoder b{joint} is logged late" in named(late)
    assert f"run 2: encoder b{joint} is logged late" in named(sound(1), late)


def test_an_encoder_that_is_scaled_is_named_with_its_remedy() -> None:
    text = named(sound(1), changed_encoder(sound(0), 2, factor=1.003))
    assert "run 2: encoder b2 is logged too large" in text
    assert "Correct its lines and bits in recording.yaml" in text

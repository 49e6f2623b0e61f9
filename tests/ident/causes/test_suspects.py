"""Each mistake in the files of a recording is named first; sound recordings are not suspected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import robot_frames
from ballbar.cell.inverse import bar_angles
from ballbar.cell.load import load_cell
from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.cell.robot_angles import joints_to_motors, motors_to_joints
from ballbar.ident.causes.channels import channel_errors
from ballbar.ident.causes.suspects import AGREES, SHORT, Causes, suspects
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs, fit_recording
from ballbar.ident.start.automatic import StartError
from ballbar.ident.verdict import Status
from tests.helpers.minute_logs import minute_logs
from tests.helpers.one_recording import identify
from tests.helpers.synthetic_recording import CELL, NOMINAL

FEW = FitOptions(samples=300)
ENCODERS = (1, 2, 4, 5)
OTHER = load_cell("nj220", "lund_600", "plate_250")


@lru_cache
def sound(encoders: tuple[int, ...] = ENCODERS, seed: int = 0) -> Logs:
    return minute_logs(encoders=encoders, seed=seed, name="first")


def with_encoders(change: Callable[[Array], Array], logs: Logs | None = None) -> Logs:
    logs = sound() if logs is None else logs
    assert logs.ballbar is not None
    bar = logs.ballbar
    return replace(logs, ballbar=BallBarLog(bar.t, change(bar.angles.copy()), bar.joints))


def with_motors(change: Callable[[Array], Array], logs: Logs | None = None) -> Logs:
    logs = sound() if logs is None else logs
    motors = change(joints_to_motors(CELL.robot, logs.robot.q))
    return replace(logs, robot=RobotLog(logs.robot.t, motors_to_joints(CELL.robot, motors)))


def exchanged(i: int, j: int) -> Callable[[Array], Array]:
    """Columns i and j, from 0."""

    def change(values: Array) -> Array:
        order = np.arange(values.shape[1])
        order[[i, j]] = j, i
        return values[:, order]

    return change


def scaled(column: int, factor: float) -> Callable[[Array], Array]:
    """One column, from 0, times a factor; 0 leaves no motion."""

    def change(values: Array) -> Array:
        values[:, column] *= factor
        return values

    return change


def late(column: int, seconds: float) -> Callable[[Array], Array]:
    """One encoder, from 0, whose angles are those of so many seconds before."""

    def change(values: Array) -> Array:
        bar = sound().ballbar
        assert bar is not None
        values[:, column] = np.interp(bar.t - seconds, bar.t, values[:, column])
        return values

    return change


def other_run() -> Logs:
    """The robot's log of the minute, the ball-bar's played backwards."""
    return with_encoders(lambda angles: angles[::-1])


def cut(seconds: float) -> Logs:
    logs = sound()
    assert logs.ballbar is not None
    bar, robot = logs.ballbar, logs.robot
    rows, bar_rows = (
        (robot.t > 10) & (robot.t < 10 + seconds),
        (bar.t > 10) & (bar.t < 10 + seconds),
    )
    return Logs(
        RobotLog(robot.t[rows], robot.q[rows]),
        BallBarLog(bar.t[bar_rows], bar.angles[bar_rows], bar.joints),
        name="first",
    )


def turning(factor: float) -> Cell:
    """The cell with a plate that is `factor` times as long."""
    return replace(CELL, plate=replace(CELL.plate, length=factor * CELL.plate.length))


# Those beside the ones of tests/independent/test_causes.py
MISTAKES: dict[str, tuple[Callable[[], Logs], str]] = {
    "b2 and b5": (
        lambda: with_encoders(exchanged(1, 3)),
        "the columns of encoders b2 and b5 are exchanged: once corrected, ",
    ),
    "three encoders": (
        lambda: with_encoders(lambda b: b[:, [1, 2, 0, 3]]),
        "the encoder columns are in another order: b1 in that of b4, b2 in that of b1, b4 in that",
    ),
    "one bit less": (
        lambda: with_encoders(lambda b: 0.5 * b),
        "the line count of encoder b1 and b2 and b4 and b5 is wrong: once corrected, ",
    ),
    "5000 lines of b5": (
        lambda: with_encoders(scaled(3, 0.72)),
        "the line count of encoder b5 is wrong: once corrected, ",
    ),
    "motor 5 backwards": (
        lambda: with_motors(scaled(4, -1.0)),
        "motor 5 of the robot's log counts backwards: once corrected, ",
    ),
    "degrees": (
        lambda: with_motors(np.rad2deg),
        "the robot's log is in degrees and was read as rad: once corrected, ",
    ),
    "b2 not logged": (
        lambda: with_encoders(scaled(1, 0.0)),
        "encoder b2 stands still: it turns by 0 mrad in the whole log, ",
    ),
    "another run": (other_run, "the logs are not of one run: the best of all clock offsets "),
}

OFTEN = ("three encoders", "one bit less", "motor 5 backwards", "degrees", "another run")


@pytest.mark.slow
@pytest.mark.parametrize(
    "mistake", [pytest.param(m, marks=() if m in OFTEN else pytest.mark.long) for m in MISTAKES]
)
def test_a_mistake_in_the_logs_is_named_first(mistake: str) -> None:
    logs, words = MISTAKES[mistake]
    first, *others = suspects(CELL, logs())
    assert str(first).startswith(words)
    assert not others


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        (
            load_cell("irb2400", "lund_900", "plate_250"),
            "the rod is not as long as stated: the tool's path by the robot lies on a sphere of 60",
        ),
        (turning(1.4), "the length of plate plate_250 (ra6) is wrong by -100.0 mm: so changed, "),
        (OTHER, "this is not the log of robot nj220 with "),
        (load_cell("irb1600", "lund_600", "plate_250"), "this is not the log of robot irb1600 "),
    ],
    ids=["rod", "plate", "robot", "robot of the same maker"],
)
def test_a_wrong_file_is_named_first(cell: Cell, words: str) -> None:
    assert str(suspects(cell, sound())[0]).startswith(words)


def test_evidence_and_remedy_of_a_line_count_give_its_factor() -> None:
    (suspect,) = suspects(CELL, with_encoders(scaled(0, 2.0)))
    assert suspect.evidence.endswith("angle of the encoder over that of the robot's pose: b1 2.000")
    assert suspect.remedy.startswith("Multiply `lines` in recording.yaml (b1 2.000), or correct")


def test_two_encoders_may_be_those_of_the_other_gimbal() -> None:
    logs = sound((4, 5))
    assert logs.ballbar is not None
    bar = BallBarLog(logs.ballbar.t, logs.ballbar.angles[:, ::-1], (1, 2))
    (suspect,) = suspects(CELL, replace(logs, ballbar=bar))
    assert suspect.cause == "the encoders b1 and b2 are those of b5 and b4"


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (scaled(4, -1.0), "motor 5 of the robot's log counts backwards"),
        (np.rad2deg, "the robot's log is in degrees and was read as rad"),
    ],
)
def test_without_encoders_the_sphere_alone_names_the_mistake(
    change: Callable[[Array], Array], cause: str
) -> None:
    (suspect,) = suspects(CELL, with_motors(change, sound(())))
    assert suspect.cause == cause
    assert "rms off a sphere" in suspect.evidence
    assert "unexplained" not in suspect.evidence


def test_without_encoders_a_sound_log_has_no_suspect_and_another_robot_is_named() -> None:
    assert suspects(CELL, sound(())) == []
    assert str(suspects(OTHER, sound(()))[0]).startswith("this is not the log of robot nj220")


@pytest.mark.parametrize("encoders", [ENCODERS, (1, 2), (1, 2, 3, 4, 5)])
def test_robots_that_are_not_calibrated_are_not_suspected(encoders: tuple[int, ...]) -> None:
    """DH errors of 3 mm and mrad, three times those of an industrial robot."""
    rng = np.random.default_rng(5)
    table = NOMINAL.table
    names = [n for n in table.robot if n not in table.gauge and n != table.plate]
    for seed in range(4):
        errors = dict(zip(names, 3e-3 * rng.standard_normal(len(names)), strict=True))
        true = NOMINAL.replaced({n: NOMINAL[n] + e for n, e in errors.items()})
        assert suspects(CELL, minute_logs(encoders=encoders, true=true, seed=seed)) == []


def test_a_reversed_encoder_is_no_suspect_for_the_start_finds_its_direction() -> None:
    assert suspects(CELL, with_encoders(scaled(0, -1.0))) == []
    assert suspects(CELL, with_encoders(scaled(1, -1.0))) == []


def test_joints_that_stand_still_on_a_sound_path_are_too_few_that_move() -> None:
    """Axis 1 and 4 at rest, the others on the sphere by Newton steps."""
    t, q, moving = sound().robot.t, sound().robot.q.copy(), [1, 2, 4, 5]
    q[:, [0, 3]] = q[0, [0, 3]]
    origin = NOMINAL.origin
    for _ in range(20):
        frames = robot_frames(NOMINAL, q)
        rod = frames.tip.T - origin
        distance = np.linalg.norm(rod, axis=1)
        slope = np.stack(
            [
                (np.cross(frames.z[k].T, frames.tip.T - frames.origin[k].T) * rod).sum(axis=1)
                / distance
                for k in moving
            ],
            axis=1,
        )
        step = slope / (slope**2).sum(axis=1)[:, None] * (distance - NOMINAL["bd3"])[:, None]
        q[:, moving] -= np.clip(step, -0.1, 0.1)
    assert np.abs(distance - NOMINAL["bd3"]).max() < 1e-9  # converged
    b = np.unwrap(bar_angles(robot_frames(NOMINAL, q).poses(), origin), axis=0)
    logs = Logs(RobotLog(t, q), BallBarLog(t, b[:, [0, 1, 3, 4]], ENCODERS))
    (suspect,) = suspects(CELL, logs)
    assert suspect.cause == "too few joints move"
    assert suspect.evidence == "there is no motion of axes 1, 4 of the robot in the whole log"
    assert not suspect.hopeless


@pytest.mark.long
@pytest.mark.slow
def test_the_verdict_begins_with_the_cause_and_the_fit_becomes_a_remark() -> None:
    logs = with_motors(scaled(4, -1.0))
    result = identify(CELL, logs.robot, logs.ballbar, options=FEW)
    assert result.verdict.status in (Status.IMPLAUSIBLE, Status.NOT_CONVERGED)
    assert ": motor 5 of the robot's log counts backwards: once" in result.verdict.sentence
    assert "off the catalogue" in result.verdict.warnings[0]


@pytest.mark.slow
def test_the_cause_stands_before_what_the_start_says() -> None:
    logs = with_motors(scaled(1, -1.0))
    words = r"^axis 2 of the robot's log counts backwards: .* \(the nominal robot reaches none of"
    with pytest.raises(StartError, match=words):
        identify(CELL, logs.robot, logs.ballbar, options=FEW)


@pytest.mark.slow
def test_of_several_recordings_the_one_with_the_mistake_is_named_before_the_complete_fit() -> None:
    wrong = replace(with_encoders(exchanged(2, 3)), name="second")
    with pytest.raises(StartError, match=r"^second: the columns of encoders b4 and b5 are exch"):
        identify_together(CELL, [sound(), wrong], options=FEW)


def test_a_cause_that_all_recordings_share_stands_once() -> None:
    wrong = with_encoders(exchanged(0, 1))
    causes = Causes.of(CELL, [wrong, replace(wrong, name="second")])
    assert causes.hopeless
    assert str(causes).startswith("the columns of encoders b1 and b2 are exchanged")
    assert str(causes).count("exchanged") == 1
    assert not Causes.of(CELL, [sound()])


def test_the_limits_are_far_from_a_sound_recording_and_from_chance() -> None:
    assert 0.03 < AGREES < 0.2
    assert len(suspects(CELL, cut(SHORT + 5.0))) == 0


@pytest.mark.parametrize(
    ("logs", "channel", "size"),
    [
        (lambda: with_motors(scaled(5, 1.01)), "gear 6", 0.01),
        (lambda: with_motors(scaled(1, 0.98)), "gear 2", -0.02),
        (lambda: with_encoders(late(1, 0.05)), "encoder b2", 0.05),
        (lambda: with_encoders(scaled(3, 1.02)), "encoder b5", 0.02),
    ],
)
def test_a_channel_that_is_late_or_scaled_is_named_first(
    logs: Callable[[], Logs], channel: str, size: float
) -> None:
    fit = fit_recording(CELL, logs(), FEW)
    first = channel_errors(CELL, fit)[0]
    assert first.channel == channel
    assert first.size == pytest.approx(size, rel=0.1)  # to first order
    assert str(Causes.of(CELL, [fit.logs], [fit])).startswith(f"{channel} is logged ")


def test_no_channel_of_a_sound_recording_is_late_or_scaled() -> None:
    assert channel_errors(CELL, fit_recording(CELL, sound(), FEW)) == []


def test_a_robot_that_stands_on_its_path_is_said_to_move_too_few_joints() -> None:
    """No sphere can be laid through one point: nothing is off it, whatever the log lacks."""
    robot = sound().robot
    still = replace(sound(), robot=RobotLog(robot.t, np.tile(robot.q[:1], (robot.t.size, 1))))
    (named,) = suspects(CELL, still)
    assert named.cause == "too few joints move"
    assert "no motion of axes 1, 2, 3, 4, 5, 6 of the robot" in named.evidence

"""Remarks on a log that was repaired."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.ident.corrections.link_growth import UNIT
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.order_search import JointOrder
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.remarks import change_remarks, joint_error_remark, log_remarks, wrong_ratios
from ballbar.ident.result import CoefficientEstimate, CorrectionEstimate
from ballbar.ident.signals.smooth_log import LogOutliers
from ballbar.ident.signals.steps import LogStep, StepFault
from tests.helpers.synthetic_recording import recording


@pytest.fixture(scope="module")
def samples() -> Samples:
    return recording()


def out(channels: list[int], times: list[float], rows: int) -> LogOutliers:
    return LogOutliers(np.array(times), np.array(channels, dtype=np.intp), rows, 60_000)


def test_nothing_is_said_of_clean_logs(samples: Samples) -> None:
    assert log_remarks(samples, ()) == ()


def test_every_step_fault_has_its_sentence(samples: Samples) -> None:
    faults = (
        StepFault(0, "clock", 0, 12.345, -0.0502),
        StepFault(0, "encoder", 4, 20.0, 3.49e-3, periods=-2),
        StepFault(0, "encoder", 2, 30.0, 1e-3),
    )
    assert log_remarks(samples, faults) == (
        "clock step of -50.2 ms (ball-bar's against robot's) at t = 12.35 s; repaired. Do not "
        "set clocks while recording",
        "encoder b4 slipped -2 signal periods at t = 20.00 s; repaired. Check its cable and speed",
        "encoder b2 jumped by +1.000 mrad at t = 30.00 s (slipping coupling?); repaired. "
        "Tighten its coupling",
    )


def test_a_joint_that_jumped_in_the_robots_log_is_named_by_its_row(samples: Samples) -> None:
    robot = replace(samples.robot, steps=(LogStep(250, 12.5, 2, -2e-3),))
    assert log_remarks(replace(samples, robot=robot), ()) == (
        "robot joint 3 jumped by -2.000 mrad at row 250 of its log; taken out of it. Record again "
        "if it was not its resolver",
    )


def test_a_step_of_the_robots_clock_is_said_once(samples: Samples) -> None:
    """With encoders it is a step fault of the recording; without, nobody else speaks of it."""
    robot = replace(samples.robot, steps=(LogStep(250, 12.5, None, 0.03),))
    assert log_remarks(replace(samples, robot=robot), ()) == ()
    alone = replace(samples, robot=robot, ballbar=None, encoders=(), directions=np.empty(0))
    assert log_remarks(alone, ()) == (
        "the robot's clock stepped by +30.0 ms at row 250 of its log; taken out of it. Do not set "
        "clocks while recording",
    )


def test_outliers_are_counted_by_rows_and_the_first_one_is_named(samples: Samples) -> None:
    robot = replace(samples.robot, outliers=out([5, 0, 1], [9.0, 2.5, 9.0], 2))
    assert samples.ballbar is not None
    # encoders b1, b2, b4, b5: the third channel is b4
    ballbar = replace(samples.ballbar, outliers=out([2], [40.004], 1))
    assert log_remarks(replace(samples, robot=robot, ballbar=ballbar), ()) == (
        "2 of 60 000 robot rows are outliers and were left out: joint 1 first at t = 2.50 s. "
        "A few do no harm; of many, check cable and shield",
        "1 of 60 000 ball-bar rows is an outlier and was left out: b4 first at t = 40.00 s. "
        "A few do no harm; of many, check cable and shield",
    )


def test_joint_errors_are_named_with_their_amplitudes_and_what_they_may_be_instead() -> None:
    values = {"joint2_17_cos": 1.5e-4, "joint2_17_sin": -2e-4, "joint3_52.6_cos": 4e-5}
    values["joint3_52.6_sin"] = 3e-5
    correction = CorrectionEstimate(
        "joint_harmonics",
        "errors of the joints",
        tuple(CoefficientEstimate(n, "rad", v, 1e-6, 0.0, 3e-4, 1.0) for n, v in values.items()),
    )
    orders = [JointOrder(1, 17, 50.0, 0.4, ()), JointOrder(2, 52.6, 30.0, 0.1, (52, 53))]
    assert joint_error_remark(orders, [correction]) == (
        "joint errors found by evidence: joint 2: 17 cycles a turn, 250 urad; "
        "joint 3: 52.6 cycles a turn (or 52, 53), 50 urad. They are in the result; a held-out "
        "recording (--validate) confirms them"
    )
    assert joint_error_remark(orders, []) == ""  # the data did not support them in the end


def test_a_joint_error_that_moves_the_tool_by_less_than_5_um_is_not_named() -> None:
    """Thousands of rows find one of a microradian; it stays in the result."""
    values = {"joint2_17_cos": 1e-6, "joint2_17_sin": 1e-6}
    correction = CorrectionEstimate(
        "joint_harmonics",
        "errors of the joints",
        tuple(CoefficientEstimate(n, "rad", v, 1e-8, 0.0, 3e-4, 1.0) for n, v in values.items()),
    )
    orders = [JointOrder(1, 17, 50.0, 0.4, ())]
    assert joint_error_remark(orders, [correction]) == ""
    large = replace(
        correction, coefficients=tuple(replace(c, value=5e-6) for c in correction.coefficients)
    )
    assert "joint 2: 17 cycles a turn, 7 urad" in joint_error_remark(orders, [large])


def fit_of(values: dict[str, float], *times: float) -> Fit:
    """A fit of these unknowns, whose recordings end at these times [s]."""
    ends = [SimpleNamespace(times=np.array([0.0, time])) for time in times]
    model = SimpleNamespace(unknowns=SimpleNamespace(names=(*values,)), recordings=ends)
    return cast("Fit", SimpleNamespace(model=model, x=np.array([*values.values()])))


def test_a_link_that_grew_is_named_with_its_recording() -> None:
    """From the line and the square of time, at the end of that recording."""
    growth = {"growth_ra2_line@2": 3e-5, "growth_ra2_square@2": -1e-5}
    fit = fit_of(growth, 0.5 * UNIT, 2.0 * UNIT)
    assert change_remarks(fit, np.diag([1e-6, 1e-6]) ** 2) == [
        "a2 grew by +20 um during recording 2: it warmed up. The result is the robot at the start "
        "of the first one; warm it up before"
    ]
    assert change_remarks(fit, np.diag([1e-5, 1e-5]) ** 2) == []  # 20 um known to 45 um


def test_growth_below_the_least_size_is_not_named_however_certain() -> None:
    growth = {"growth_ra2_line@1": 4e-6, "growth_ra2_square@1": 0.0}
    certain = np.diag([1e-9, 1e-9]) ** 2
    assert change_remarks(fit_of(growth, UNIT), certain) == []
    growth["growth_ra2_line@1"] = 6e-6
    assert "a2 grew by +6 um" in change_remarks(fit_of(growth, UNIT), certain)[0]


@pytest.mark.parametrize(
    ("shift", "sigma", "named"), [(5e-5, 3e-6, True), (5e-5, 3e-5, False), (4e-6, 1e-8, False)]
)
def test_a_remounted_tool_is_named_by_its_size_and_beyond_chance(
    shift: float, sigma: float, named: bool
) -> None:
    values = {"remount_ra6@2": shift, "remount_rtheta6@2": 0.0}
    remarks = change_remarks(fit_of(values, 60.0, 60.0), np.eye(2) * sigma**2)
    assert bool(remarks) == named
    if named:
        assert "in recording 2 than in the first, by 50 um and 0 urad" in remarks[0]


@pytest.mark.parametrize(
    ("ratio", "sigma", "named"), [(1e-5, 1e-7, False), (1e-3, 1e-5, True), (1e-3, 1e-3, False)]
)
def test_a_gear_ratio_is_wrong_by_its_size_and_beyond_chance(
    ratio: float, sigma: float, named: bool
) -> None:
    """`gear 3 turns 1.00001 times as far as logged` was certain and no other gear."""
    assert bool(wrong_ratios(fit_of({"ratio3": ratio}, 60.0), np.array([sigma]))) == named

"""Two logs paired as in thesis sec. 5.2: clock, encoder offsets and outliers without a start."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.ident.thesis.costs import cost_named
from ballbar.ident.thesis.pairing import (
    PERIOD,
    is_standing,
    moving_average,
    pair_logs,
    rough_offset,
)
from ballbar.sim.path import ReferencePath
from tests.helpers.synthetic_recording import exact_log

OFFSET = 0.7131  # [s] robot time at the ball-bar's first row
READ = np.array([2.5, -1.2, 0.3, -2.9, 1.7])  # [rad] joint angles at which the counters read 0


def logs(path: ReferencePath, b: Array | None = None) -> tuple[RobotLog, BallBarLog]:
    """Exact logs of the nominal mechanism, the ball-bar's counted from its first row."""
    t = np.arange(0.0, path.t[-1] - OFFSET, 0.01)  # no multiple of its rows is the offset
    angles = exact_log(path.t, path.b if b is None else b).spline(t + OFFSET) - READ
    return RobotLog(path.t, path.q), BallBarLog(t, angles, (1, 2, 3, 4, 5))


@pytest.mark.parametrize("name", ["position", "position_angles", "transform"])
def test_clock_and_encoder_offsets_of_an_exact_recording_are_recovered(
    path: ReferencePath, nominal: Geometry, name: str
) -> None:
    """From the files alone: neither the clock nor the offsets over the full turn are given."""
    cost = cost_named(name, "thesis")  # type: ignore[arg-type]
    paired = pair_logs(cost, nominal, *logs(path), count=500)
    # what the moving average bends: both logs by 100 ms, over unlike angles
    assert paired.offset == pytest.approx(OFFSET, abs=1e-3)
    found = paired.start.bar.theta - nominal.bar.theta
    joints = {"position": [0, 1], "position_angles": [0, 1, 3, 4]}.get(name, range(5))
    away = np.angle(np.exp(1j * (found - READ)))[list(joints)]
    assert np.abs(away).max() < 3e-3
    assert paired.q.shape == (500, 6)
    assert paired.b.shape == (500, 5)


def test_the_ball_bar_is_matched_in_whichever_configuration_it_was(
    path: ReferencePath, nominal: Geometry
) -> None:
    """Reading b2 the other way round is the same as the mirrored gimbal (docs/conventions)."""
    b = path.b * (1.0, -1.0, 1.0, 1.0, 1.0) + (np.pi, 0.0, np.pi, 0.0, 0.0)
    paired = pair_logs(cost_named("transform", "thesis"), nominal, *logs(path, b), count=500)
    assert paired.offset == pytest.approx(OFFSET, abs=1e-3)


def test_rows_that_stand_still_and_outliers_are_left_out(
    path: ReferencePath, nominal: Geometry
) -> None:
    b = path.b.copy()
    b[2000:2040, 1] += 0.3
    cost = cost_named("position", "thesis")
    clean = pair_logs(cost, nominal, *logs(path), count=500)
    robot, bar = logs(path, b)
    paired = pair_logs(cost, nominal, robot, bar, count=500)
    assert 480 < len(paired.q) < 500
    assert paired.offset == pytest.approx(clean.offset, abs=2e-4)
    standing = is_standing(robot.t, robot.q)
    assert standing[:100].all()
    assert np.ptp(clean.q[:3], axis=0).max() > 0.0


def test_the_rough_offset_lies_within_100_ms(path: ReferencePath) -> None:
    robot, bar = logs(path)
    standing = is_standing(robot.t, robot.q), is_standing(bar.t, bar.angles)
    assert rough_offset(robot.t, standing[0], bar.t, standing[1]) == pytest.approx(OFFSET, abs=0.1)


def test_a_cost_without_encoders_keeps_the_rough_offset(
    path: ReferencePath, nominal: Geometry
) -> None:
    paired = pair_logs(cost_named("length", "thesis"), nominal, *logs(path), count=300)
    assert paired.offset == pytest.approx(OFFSET, abs=0.1)
    assert np.array_equal(paired.start.values, nominal.values)


def test_logs_without_common_motion_are_refused(path: ReferencePath, nominal: Geometry) -> None:
    robot, bar = logs(path)
    rows = slice(0, 100)  # all of the first dwell
    still = BallBarLog(bar.t[rows], bar.angles[rows], bar.joints)
    stands = RobotLog(robot.t[rows], robot.q[rows])
    with pytest.raises(ValueError, match="no motion in common"):
        pair_logs(cost_named("length", "thesis"), nominal, stands, still, count=300)


def test_of_few_rows_each_is_paired_once(path: ReferencePath, nominal: Geometry) -> None:
    robot, bar = logs(path)
    few = RobotLog(robot.t[::20], robot.q[::20])
    paired = pair_logs(cost_named("length", "thesis"), nominal, few, bar, count=1000)
    assert len(np.unique(paired.q, axis=0)) == len(paired.q) > 200


def test_each_row_is_the_mean_of_its_neighbours_within_the_period() -> None:
    t = np.arange(200) * 0.01
    angles = np.random.default_rng(5).normal(size=(200, 2))
    averaged = moving_average(t, angles)
    for row in (5, 77, 194):
        assert np.abs(averaged[row] - angles[row - 5 : row + 6].mean(axis=0)).max() < 1e-12
    assert np.abs(averaged[[0, -1]] - angles[[0, -1]]).max() < 1e-12


def test_a_straight_motion_is_kept_and_a_bent_one_loses_what_the_formula_says() -> None:
    """The mean of t^2 / 2 over +-T/2 in steps h is (T^2 + 2 T h) / 24 more."""
    t = np.arange(401) * 0.002
    straight, bent = t[:, None], 0.5 * t[:, None] ** 2
    assert np.abs(moving_average(t, straight) - straight).max() < 1e-12
    inside = slice(30, -30)
    expected = (PERIOD**2 + 2.0 * PERIOD * 0.002) / 24.0
    assert np.abs((moving_average(t, bent) - bent)[inside] - expected).max() < 1e-12

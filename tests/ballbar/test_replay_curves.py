"""Lanes of events and curves of a replay, of made logs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.load import load_robot
from ballbar.cell.logs import RobotLog
from ballbar.replay import entities, events
from ballbar.replay.blueprint import rounded_up
from ballbar.replay.events import _configuration, _lane, _log_spans, _Span, _spans_lane
from ballbar.replay.parameters import units_of
from ballbar.replay.series import _residual_series, _rod_series, clock_error_series, truth_series
from ballbar.robot_file.picture import bent_pose, corners, frames_at
from ballbar.robot_file.view import _motion


def space(**given: Any) -> Any:
    return SimpleNamespace(**given)


def test_a_lane_has_an_instant_for_each_change_and_a_colour_for_each_state() -> None:
    t = np.arange(6.0)
    lane = _lane(t, np.array(["a", "a", "b", "b", "a", "c"]), marked="b")
    assert lane.t.tolist() == [0.0, 2.0, 4.0, 5.0]
    assert list(lane.states) == ["a", "b", "a", "c"]
    assert lane.colours["b"] == events._MARKED
    assert len(set(lane.colours.values())) == 3
    many = _lane(t, np.array(list("abcdef")))
    assert len(set(many.colours.values())) == 4


def test_gaps_and_new_segments_of_a_log_are_events_where_they_begin() -> None:
    """Rows of 10 ms: 31 ms are a gap, 29 ms are none; shown on the robot's clock."""
    t = np.cumsum(np.r_[0.0, np.full(99, 0.01)])
    t[40:] += 0.021
    t[70:] += 0.019
    log = RobotLog(
        t, np.sin(t)[:, None] * np.ones(6), segment=np.repeat([0, 1], 50).astype(np.uint16)
    )
    spans = _log_spans("robot's log", log, log.q, t + 2.0)
    assert [(s.state, round(s.begin, 3), round(s.end, 3)) for s in spans] == [
        ("gap", 2.39, 2.421), ("restart", round(t[50] + 2.0, 3), round(t[50] + 2.0, 3)),
    ]  # fmt: skip
    assert spans[0].sentence == "robot's log: no rows for 31 ms"
    assert spans[1].sentence == "robot's log: a new segment begins"


def test_rows_that_were_left_out_are_one_event_within_half_a_second() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    flags = np.zeros(t.size, dtype=np.uint32)
    flags[[100, 140, 195, 400]] = events.EXCLUDED
    log = RobotLog(t, np.sin(t)[:, None] * np.ones(6), flags=flags)
    spans = _log_spans("encoders", log, log.q, t)
    ends = np.array([(s.begin, s.end) for s in spans])
    assert ends == pytest.approx(np.array([(1.0, 1.4), (1.95, 1.95), (4.0, 4.0)]))
    assert spans[0].sentence == "encoders: 2 rows that no motion explains, left out"
    assert spans[1].sentence == "encoders: 1 row that no motion explains, left out"


def test_spans_are_long_enough_to_be_seen_and_run_into_each_other() -> None:
    t = np.array([0.0, 10.0])
    spans = [_Span(2.1, 2.1, "outlier", ""), _Span(2.0, 2.0, "gap", ""), _Span(5.0, 6.0, "gap", "")]
    lane = _spans_lane(t, spans)
    assert list(lane.states) == ["rows", "gap", "outlier", "rows", "gap", "rows", "ended"]
    assert lane.t == pytest.approx([0.0, 2.0, 2.1, 2.4, 5.0, 6.0, 10.0], abs=1e-5)
    assert (np.diff(lane.t) > 0.0).all()
    late = _spans_lane(t, [_Span(9.9, 9.9, "restart", "")])
    assert late.t == pytest.approx([0.0, 9.9, 10.2, 10.2], abs=1e-5)
    first = _spans_lane(t, [_Span(0.0, 0.0, "gap", "")])
    assert list(first.states) == ["rows", "gap", "rows", "ended"]


def test_a_configuration_names_the_sides_of_wrist_and_ballbar() -> None:
    """Outside the ball-bar's log it stays what it was at its ends."""
    t = np.arange(5.0)
    motion = space(t=t, q=np.zeros((5, 6)), b=np.full((5, 5), 0.1))
    motion.q[:, 4] = [0.1, 0.1, -0.1, -0.1, 0.1]
    motion.b[:, 1] = [-0.1, 0.2, 0.2, -0.2, 0.3]
    motion.b[:, 3] = np.pi + np.array([-0.1, 0.1, -0.1, -0.1, 0.1])
    geometry = space(bar=space(theta=np.zeros(5)))
    estimate = space(geometry=geometry, clock=Clock(1.0, 0.0))
    bare = space(estimate=estimate, recording=space(ballbar_log=None))
    assert _configuration(bare, motion).tolist() == [
        "q5 +, b2 -, b4 +", "q5 +, b2 +, b4 -", "q5 -, b2 +, b4 +", "q5 -, b2 -, b4 +",
        "q5 +, b2 +, b4 -",
    ]  # fmt: skip
    logged = space(estimate=estimate, recording=space(ballbar_log=space(t=np.array([0.0, 2.0]))))
    assert _configuration(logged, motion).tolist() == [
        "q5 +, b2 +, b4 -", "q5 +, b2 +, b4 -", "q5 -, b2 +, b4 +", "q5 -, b2 -, b4 +",
        "q5 +, b2 -, b4 +",
    ]  # fmt: skip


def residuals(size: float) -> Any:
    return space(
        t=np.arange(2.0), position=np.full((2, 3), size), angle=np.full((2, 3), 2.0 * size)
    )


def test_residuals_are_in_micrometres_and_microradians_and_a_length_has_no_angle() -> None:
    estimate = space(before=residuals(1e-3), after=residuals(1e-5), clock=Clock(0.5, 0.0))
    drawn = _residual_series(estimate, angles=True)
    assert len(drawn) == 4
    after = drawn[f"{entities.AFTER}/{entities.POSITION}"]
    assert after.values[0] == pytest.approx([10.0] * 3)
    assert after.t.tolist() == [0.5, 1.5]
    assert list(after.names) == ["x after", "y after", "z after"]
    assert drawn[f"{entities.BEFORE}/{entities.ANGLE}"].values[0] == pytest.approx([2000.0] * 3)
    assert len(_residual_series(estimate, angles=False)) == 2


def test_the_rod_has_its_force_and_the_elongation_of_its_compliance() -> None:
    estimate = space(after=residuals(0.0), clock=None, tension=np.array([100.0, -50.0]))
    coefficient = space(name="rod_compliance", value=2e-8)
    robot = space(corrections=[space(coefficients=[space(name="other", value=1.0), coefficient])])
    drawn = _rod_series(estimate, robot)
    assert drawn[entities.FORCE_IDENTIFIED].values[:, 0].tolist() == [100.0, -50.0]
    assert drawn[entities.STRAIN_IDENTIFIED].values[:, 0] == pytest.approx([2.0, -1.0])
    assert _rod_series(space(tension=None), robot) == {}
    assert set(_rod_series(estimate, space(corrections=[]))) == {entities.FORCE_IDENTIFIED}


def a_simulation(**given: Any) -> Any:
    """The robot's clock is exact; the ball-bar's began 0.25 s later and runs fast by 100 ppm."""
    true = np.arange(0.0, 10.01, 0.5)
    bar = true[true >= 1.0]
    stamp = np.round((bar - 1.0) * 1.0001 * 1e9).astype(np.int64) + 77
    times = space(bar_stamp=stamp, bar_true=bar, robot_stamp=true.copy(), robot_true=true)
    return space(**{"times": times, "instrument": None} | given)


def test_a_clocks_error_is_identified_minus_true_where_the_ballbar_was_logged() -> None:
    clock = Clock(1.0 + 3e-6, -1e-4)
    t = np.array([0.2, 1.0, 5.0, 10.0])
    drawn = clock_error_series(a_simulation(), space(clock=clock), t)
    true, error = drawn[entities.CLOCK_TRUE], drawn[entities.CLOCK_ERROR]
    assert true.t.tolist() == [1.0, 5.0, 10.0]
    stamps = (true.t - 1.0) * 1.0001
    assert true.values[:, 0] == pytest.approx(1e3 * (true.t - stamps), abs=1e-5)
    expected = true.t - clock.ballbar_time(true.t) - (true.t - stamps)
    assert error.values[:, 0] == pytest.approx(1e6 * expected, abs=0.01)
    assert clock_error_series(a_simulation(), space(clock=None), t) == {}


def test_forces_of_the_truth_are_drawn_where_the_plant_knows_them() -> None:
    t = np.array([0.0, 1.0])
    truth = space(
        nominal_error=np.array([[3e-3, 4e-3, 0.0]] * 2),
        identified_error=np.array([[0.0, 0.0, 1e-5]] * 2),
        rod_force=np.array([0.0, 50.0]), rod_strain=np.array([0.0, 2e-6]),
    )  # fmt: skip
    bare = space(clock=None)
    drawn = truth_series(a_simulation(), bare, truth, t)
    assert drawn[entities.TCP_BEFORE].values[:, 0] == pytest.approx([5000.0] * 2)
    assert drawn[entities.TCP_AFTER].values[:, 0] == pytest.approx([10.0] * 2)
    assert drawn[entities.FORCE_TRUE].values[:, 0].tolist() == [0.0, 50.0]
    assert drawn[entities.STRAIN_TRUE].values[:, 0] == pytest.approx([0.0, 2.0])
    sensed = truth_series(a_simulation(instrument="length"), bare, truth, t)
    assert entities.STRAIN_TRUE not in sensed
    assert entities.FORCE_TRUE in sensed
    truth.rod_force = np.zeros(2)
    assert set(truth_series(a_simulation(), bare, truth, t)) == {
        entities.TCP_BEFORE, entities.TCP_AFTER,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("value", "end"),
    [(0.0, 1.0), (-3.0, 1.0), (1.0, 1.0), (1.01, 2.0), (4.9, 5.0), (5.1, 10.0), (0.003, 0.005)],
)
def test_an_axis_ends_at_1_2_or_5(value: float, end: float) -> None:
    assert rounded_up(value) == pytest.approx(end)


def test_lengths_are_shown_in_millimetres_and_angles_in_milliradians() -> None:
    assert units_of("ra2") == ("mm", "um")
    assert units_of("rtheta2") == ("mrad", "urad")


@pytest.mark.parametrize("name", ["irb2400", "ur10e"])
def test_a_robot_that_is_shown_moves_one_axis_after_the_other_to_its_bent_pose_and_back(
    name: str,
) -> None:
    robot = load_robot(name)
    motion, bent = _motion(robot), bent_pose(robot)
    parts = motion.reshape(robot.joints, -1, robot.joints)
    for i, part in enumerate(parts):
        others = np.delete(part, i, axis=1)
        assert not others.any()
        assert part[[0, -1], i] == pytest.approx(0.0, abs=1e-12)
        assert np.abs(part[:, i]).max() == pytest.approx(abs(bent[i]), rel=2e-3)
    assert (np.abs(bent) > 0.05).all()
    assert (bent >= robot.axis_lower).all()
    assert (bent <= robot.axis_upper).all()


def test_the_rows_of_a_robot_are_drawn_along_z_by_d_and_then_along_x_by_a() -> None:
    robot = load_robot("irb2400")
    frames = frames_at(robot, bent_pose(robot))
    points = corners(robot, frames)
    assert len(points) == 2 * robot.joints + 1
    steps = np.diff(points, axis=0)
    for i in range(robot.joints):
        assert steps[2 * i] == pytest.approx(robot.d[i] * frames.z[i, :, 0], abs=1e-12)
        assert steps[2 * i + 1] == pytest.approx(robot.a[i] * frames.x[i + 1, :, 0], abs=1e-9)

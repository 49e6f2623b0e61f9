"""A robot that moves while an instrument follows its target: clock, robot, and what is stated."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.logs import RobotLog, TrackerLog
from ballbar.cell.poses import PoseTable
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimates import result_at_rest
from ballbar.ident.estimator.build_unknowns import still_unknowns
from ballbar.ident.estimator.model import still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.regions import SAME_POSE, pose_regions
from ballbar.ident.options import FitOptions
from ballbar.ident.signals.smooth_log import motion_of, smooth_log
from ballbar.ident.start.automatic import StartError
from ballbar.ident.start.followed import followed_table, poses_at_rows
from ballbar.ident.start.placements import PoseStartError, placed_by
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_fit import fit_table
from ballbar.ident.verdict import Status
from tests.helpers.followed_robot import FollowedRobot
from tests.helpers.still_poses import angles, table_of, true_robot

SECONDS, RATE = 20.0, 100.0
ROBOT = load_robot("ur10e")


def logs_of(made: FollowedRobot, *, pose: bool = False) -> tuple[RobotLog, TrackerLog]:
    """Both logs, the tracker's shorter by a second."""
    t, rows = np.arange(0.0, SECONDS, 0.004), np.arange(0.0, SECONDS - 1.0, 1.0 / RATE)
    values = made.measured(rows, pose=pose)
    kind = "pose" if pose else "point"
    sigma = load_instrument(f"tracker_{kind}").sigma(values)
    return RobotLog(t, made.logged(t)), TrackerLog(rows, values, sigma, kind)  # type: ignore[arg-type]


def table_by(robot: RobotLog, tracker: TrackerLog) -> PoseTable:
    """The poses as a fit takes them."""
    return followed_table(
        "moving", ROBOT, robot_geometry(ROBOT), motion_of(robot, robot.q), tracker
    )


@cache
def fitted(made: FollowedRobot, *, pose: bool = False) -> TableEstimate:
    """The robot that the logs identify."""
    return fit_table(table_by(*logs_of(made, pose=pose)))


MADE = FollowedRobot(seed=3)


def tool_error(result: TableEstimate, made: FollowedRobot) -> Array:
    """(N, 3) [m] of the target at poses of the path by the true robot, in the frame of the seat."""
    q = made.angles(np.linspace(0.0, SECONDS, 80))
    true = (made.points(q) - np.array(made.seat)) @ made.turn
    layout, x = result.fit.model.unknowns, result.fit.x
    seat = layout.seat(x, "tracker")
    found = result.identified_robot().frames(q).tip.T
    return np.asarray((found - seat.origin) @ seat.rotation - true)


@pytest.mark.parametrize("pose", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_robot_and_the_clock_of_the_independent_arithmetic_are_found(pose: bool) -> None:
    result = fitted(MADE, pose=pose)
    clock, sigma = result.clocks["moving"]
    assert abs(clock.offset - MADE.offset) < 4.0 * sigma[0]
    assert abs(clock.skew - MADE.skew) < 4.0 * sigma[1]
    assert sigma[0] < 1e-4
    error = np.linalg.norm(tool_error(result, MADE), axis=1)
    nominal = float(result.residual_nominal.mean())
    noise = MADE.noise_m[0] + MADE.noise_m[1] * float(np.linalg.norm(MADE.seat))
    assert np.sqrt((error**2).mean()) < noise / 3.0  # 1900 rows, some forty unknowns
    assert nominal > 1e-4
    assert result_at_rest(result).verdict.status is Status.GOOD


def test_a_clock_that_is_shifted_is_found_shifted() -> None:
    """By stamps that count from elsewhere, and by an instrument that is late."""
    robot, tracker = logs_of(MADE)
    plain = fitted(MADE).clocks["moving"][0]
    later = fit_table(table_by(robot, replace(tracker, t=tracker.t + 0.431)))
    found, sigma = later.clocks["moving"]
    assert found.offset + 0.431 * (1.0 + found.skew) == pytest.approx(plain.offset, abs=1e-8)
    late = replace(MADE, offset=MADE.offset - 0.013)  # its rows tell of what was 13 ms before
    found, sigma = fitted(late).clocks["moving"]
    assert abs(found.offset - late.offset) < 4.0 * sigma[0]


def test_derivatives_are_those_of_central_differences() -> None:
    """They are taken for clock and skew too, away from the start; the weights are held."""
    for pose in (False, True):
        table = table_by(*logs_of(MADE, pose=pose))
        thin = replace(table, groups=(table.groups[0].part(np.arange(0, 1500, 7)),))
        chosen = (unit_weights(ROBOT), joint_harmonics([(1, 3)]))
        nominal = robot_geometry(ROBOT)
        placed = placed_by(nominal, thin)
        layout = still_unknowns(nominal, placed, chosen)
        model = still_model(placed.table, layout, chosen, np.zeros(ROBOT.joints))
        rng = np.random.default_rng(2)
        x = layout.mean + 1e-3 * rng.normal(size=layout.count)
        (point,) = model.at_rest(x)
        weights = model.weights(x, point, ExcessNoise(position=1e-4, rotation=1e-4))
        found = whole_jacobian(model, x, 0, point, weights)
        for i, name in enumerate(layout.names):
            step = 1e-6 * np.eye(layout.count)[i]
            ahead, behind = (
                weights(model.at_rest(v)[0].closure.error) for v in (x + step, x - step)
            )
            expected = (ahead - behind) / 2e-6
            assert np.abs(found[i] - expected).max() < 2e-5 * (np.abs(expected).max() + 1.0), name


@dataclass(frozen=True, eq=False)
class Standing:
    """A robot that stands at each row, whatever the clock says."""

    q: Array
    name: str = "standing"
    clock: Clock = field(default_factory=lambda: Clock(0.0, 0.0))

    def angles(self, at: Array) -> Array:
        del at
        return self.q

    def speed(self, at: Array) -> Array:
        del at
        return np.zeros_like(self.q)

    def arm(self, at: Array) -> tuple[Array, Array]:
        del at
        return np.zeros_like(self.q), np.zeros_like(self.q)

    def carried(self, at: Array) -> Array | None:
        del at
        return None

    def within(self, at: Array) -> Array:
        return at

    def noise(self, spacing: float) -> tuple[Array, float]:
        del spacing
        return np.zeros(self.q.shape[1]), 0.0

    def by(self, clock: Clock) -> Standing:
        return replace(self, clock=clock)


@pytest.mark.parametrize("measured", ["point", "pose"])
def test_a_robot_that_stands_gives_the_same_as_the_table_of_its_still_poses(measured: str) -> None:
    table = table_of(true_robot("ur10e"), measured, q=angles("ur10e", 150))  # type: ignore[arg-type]
    (group,) = table.groups
    moving = replace(group, time=np.arange(150.0), motion=Standing(np.array(group.q)))
    still, stands = fit_table(table), fit_table(replace(table, groups=(moving,)))
    names = still.fit.model.unknowns.names
    at = [stands.fit.model.unknowns.names.index(name) for name in names]
    sigma = np.sqrt(np.diag(still.fit.covariance))
    assert np.abs(stands.fit.x[at] - still.fit.x).max() < 1e-9
    assert np.sqrt(np.diag(stands.fit.covariance))[at] == pytest.approx(sigma, rel=1e-4)
    assert stands.clocks["standing"][1] == pytest.approx([1.0, 1e-3])  # as its prior: nothing shows


def test_rows_are_counted_from_one_and_those_that_stand_out_left_out() -> None:
    tracker = logs_of(FollowedRobot(seed=3))[1]
    values = tracker.values.copy()
    values[500] += 0.05
    whole: Any = SimpleNamespace(
        within=lambda t: t,
        angles=lambda t: np.zeros((t.size, 6)),
        clock=Clock(0.0, 0.0),
        name="log",
    )
    smooth = smooth_log(tracker.t, values[:, :3], widest_knot_spacing=0.1)
    group = poses_at_rows(replace(tracker, values=values), smooth, whole)
    left_out = set(range(1, tracker.t.size + 1)) - set(group.rows.tolist())
    assert 501 in left_out
    assert len(left_out) < 20
    assert group.rows.max() == tracker.t.size
    assert (group.values == values[group.rows - 1]).all()
    assert (group.time == tracker.t[group.rows - 1]).all()


@pytest.mark.long
def test_rows_of_a_slow_robot_are_no_single_pose() -> None:
    """Neighbouring rows are less than half a milliradian apart, all along the path."""
    table = table_by(*logs_of(replace(MADE, speed=0.02)))
    assert np.median(np.linalg.norm(np.diff(table.q, axis=0), axis=1)) < SAME_POSE
    sizes = np.bincount(pose_regions(table))
    assert sizes.size == 8
    assert sizes.max() - sizes.min() <= 8


def test_logs_that_share_too_little_motion_are_refused() -> None:
    robot, tracker = logs_of(MADE)
    few = tracker.t < 4.0
    short = TrackerLog(tracker.t[few], tracker.values[few], tracker.sigma[few])
    with pytest.raises(StartError, match="shares no 5 s of motion with the robot's"):
        table_by(robot, short)


def test_a_frame_with_a_wrong_sign_is_refused_as_a_mirror_image() -> None:
    robot, tracker = logs_of(MADE)
    with pytest.raises(PoseStartError, match="only as a mirror image"):
        table_by(robot, replace(tracker, values=tracker.values * [1.0, 1.0, -1.0]))


@pytest.mark.long
def test_stated_intervals_hold_the_truth_as_often_as_they_claim() -> None:
    """Twelve drawn robots give 24 errors of the clock over what is stated."""
    clocks, tools = [], []
    for seed in range(20, 32):
        made = FollowedRobot(seed=seed)
        result = fitted(made)
        clock, sigma = result.clocks["moving"]
        clocks += [(clock.offset - made.offset) / sigma[0], (clock.skew - made.skew) / sigma[1]]
        tools.append(tool_error(result, made).std() * 1e6)
    assert 0.5 < float(np.sqrt(np.mean(np.square(clocks)))) < 1.5  # of 24 numbers: 0.72 to 1.28
    assert max(tools) < 5.0  # um


@pytest.mark.long
def test_intervals_of_the_clock_hold_the_truth_where_errors_of_the_robot_last() -> None:
    """Errors of 0.7 mm that last for a second, and of the joints, which no model has: rows beside
    each other tell hardly more than one, and how often the path comes by does not average them.
    """
    errors = []
    for seed in range(40, 60):
        made = FollowedRobot(seed=seed, noise_m=(5e-4, 0.0))
        robot, tracker = logs_of(made)
        rng, keep = np.random.default_rng([seed, 9]), np.exp(-1.0 / RATE)
        drift = rng.normal(size=tracker.values.shape)
        for k in range(1, len(drift)):
            drift[k] = keep * drift[k - 1] + np.sqrt(1.0 - keep**2) * drift[k]
        order, phase = rng.integers(3, 12, 6), rng.uniform(0.0, 6.0, 6)
        robot = replace(robot, q=robot.q + 5e-4 * np.sin(order * robot.q + phase))
        tracker = replace(tracker, values=tracker.values + 7e-4 * drift)
        result = fit_table(table_by(robot, tracker), FitOptions(joint_errors="none"))
        clock, sigma = result.clocks["moving"]
        errors += [(clock.offset - made.offset) / sigma[0], (clock.skew - made.skew) / sigma[1]]
    assert np.mean(np.abs(errors) < 2.0) >= 0.9  # of 40 numbers; 0.95 is claimed
    assert 0.6 < float(np.sqrt(np.mean(np.square(errors)))) < 1.4


def test_a_path_that_does_not_turn_the_tool_is_said_to_leave_the_robot_open() -> None:
    """Nothing but the first three joints moves, as of many robots beside a motion capture."""
    made = FollowedRobot(seed=4, resting=(3, 4, 5), noise_m=(5e-4, 0.0))
    verdict = result_at_rest(fitted(made)).verdict
    assert verdict.status is Status.UNCERTAIN
    assert "This path does not determine " in verdict.sentence
    assert "rtheta5" in verdict.sentence

"""Loop closure of still poses and its derivatives, against plain geometry and differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.instruments import kind_named, kinds
from ballbar.cell.poses import PoseTable
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.cross_validation import position_rows
from ballbar.ident.estimator.build_unknowns import arm_parameters, still_unknowns
from ballbar.ident.estimator.model import Model, still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.observations import StillPoses
from ballbar.ident.estimator.target_closure import close_on_target
from ballbar.ident.estimator.whitening import Whitening
from ballbar.ident.start.placements import start_of_poses
from tests.helpers.still_poses import SEAT, TARGET, socket_table, table_of, true_robot

LEFT_OVER = ExcessNoise(position=1e-4, rotation=1e-4)


def model_of(table: PoseTable) -> Model:
    """Geometry, sag and two joint errors."""
    nominal = robot_geometry(table.robot)
    start = start_of_poses(table, nominal.robot)
    chosen = (unit_weights(table.robot), joint_harmonics([(1, 3), (2, 17)]))
    layout = still_unknowns(nominal, start, chosen)
    return still_model(table, layout, chosen, np.zeros(table.robot.joints))


@pytest.mark.parametrize("measured", list(kinds()))
def test_jacobian_is_the_difference_of_the_whitened_residual(measured: str) -> None:
    """All unknowns, at a value away from the start; the weights are held."""
    true = true_robot("ur5")
    table = socket_table(true, count=4) if measured == "socket" else table_of(true, measured)  # type: ignore[arg-type]
    model = model_of(table)
    rng = np.random.default_rng(2)
    x = model.unknowns.mean + rng.normal(0.0, 2e-3, model.unknowns.count)
    points = model.at_rest(x)
    weights = [model.weights(x, p, LEFT_OVER) for p in points]
    pairs = zip(points, weights, strict=True)
    found = [whole_jacobian(model, x, k, *pair) for k, pair in enumerate(pairs)]
    step = 1e-6
    for i, name in enumerate(model.unknowns.names):
        ahead, behind = (
            [w(p.closure.error) for p, w in zip(model.at_rest(at), weights, strict=True)]
            for at in (x + step * np.eye(x.size)[i], x - step * np.eye(x.size)[i])
        )
        for jacobian, plus, minus in zip(found, ahead, behind, strict=True):
            expected = (plus - minus) / (2.0 * step)
            scale = np.abs(expected).max() + 1.0
            assert np.abs(jacobian[i] - expected).max() < 2e-5 * scale, name


def test_a_joint_without_sensor_leaves_what_the_sensors_tell() -> None:
    """One equation of a length, three of a point or a socket, six of a pose."""
    true = true_robot("ur5")
    for measured, equations in (("length", 1), ("point", 3), ("pose", 6)):
        model = model_of(table_of(true, measured, count=60))  # type: ignore[arg-type]
        x = model.unknowns.mean
        weights = model.weights(x, model.at_rest(x)[0], LEFT_OVER)
        assert weights.matrix.shape == (equations, 6, 60)


def test_the_whitened_residual_of_a_length_is_its_own_error_over_its_sigma() -> None:
    """Elimination of the universal and the ball joint leaves the direction along the rod."""
    table = table_of(true_robot("ur5"), "length", count=50)
    model = model_of(table)
    x = model.unknowns.mean
    point = model.at_rest(x)[0]
    weights: Whitening = model.weights(x, point, ExcessNoise())
    seat = model.unknowns.seat(model.unknowns.mean, point.still.seat)
    away = np.linalg.norm(point.target_closure.robot.tip - seat.origin[:, None], axis=0)
    expected = (point.still.values[:, 0] - away) / np.hypot(2e-5, 1e-7)  # floor of the covariance
    assert np.allclose(np.abs(weights(point.closure.error)[0]), np.abs(expected), rtol=1e-6)
    along = position_rows(point)(point.closure.error)[0]
    assert np.allclose(along, point.still.values[:, 0] - away, atol=1e-12)


def test_a_pose_closes_at_the_true_placements() -> None:
    true = true_robot("ur5")
    table = table_of(true, "pose", noise=0.0)
    group = table.groups[0]
    frames = true.frames(group.q, TARGET)
    closure = close_on_target(kind_named("pose"), group.values, SEAT, frames)
    assert np.abs(closure.error[:3]).max() < 1e-12
    assert np.abs(closure.error[3:]).max() < 1e-3  # white noise of 0.1 mrad on the orientation


def test_parameters_that_seats_and_targets_can_take_over_stay_nominal() -> None:
    names = {p.name for p in arm_parameters(table_of(true_robot("ur10")).robot)}
    assert not names & {"rd1", "rtheta1", "ra6", "rd6", "rtheta6", "ralpha6", "rd3", "rd4"}
    assert {"rbeta2", "rbeta3", "rd2", "ralpha3"} <= names
    panda = {p.name for p in arm_parameters(table_of(true_robot("panda")).robot)}
    assert not any(name.startswith("rbeta") for name in panda)
    assert "ra7" not in panda
    assert "ra6" in panda


def test_a_still_pose_has_no_speed_no_clock_and_no_ball_bar() -> None:
    """So no unknown of a recording moves it, and its corrections see a robot at rest."""
    robot = true_robot("ur5")
    model = model_of(table_of(robot))
    poses, x = StillPoses(model.poses.groups[0], np.zeros(6)), model.unknowns.mean
    geometry, clock, at = poses.mechanism(model.unknowns, x, 0)
    assert clock == Clock(0.0, 0.0)
    assert not at.any()
    assert not poses.bar_angles(geometry, poses.joint_angles(at), poses.group.q).any()


def test_rounded_angles_count_less() -> None:
    """Their noise goes through the Jacobian of the joints."""
    model = model_of(table_of(true_robot("ur5")))
    coarse = replace(model, angle_noise=np.full(6, 1e-3))
    for weigh, larger in ((model, False), (coarse, True)):
        x = weigh.unknowns.mean
        point = weigh.at_rest(x)[0]
        residual = weigh.weights(x, point, ExcessNoise(position=1e-5))(point.closure.error)
        assert (np.abs(residual).mean() < 10.0) == larger


@pytest.mark.parametrize("measured", ["length", "point", "pose"])
def test_noise_of_a_measured_value_moves_the_error_as_the_value_does(measured: str) -> None:
    """Also of rotations, which change the error about the seat's axes."""
    table = table_of(true_robot("ur5"), measured, count=20)  # type: ignore[arg-type]
    (group,) = table.part(np.arange(len(table.q)) < 20).groups[:1]
    alone = replace(table, groups=(group,))
    model = model_of(table)
    x = model.unknowns.mean

    def error(values: np.ndarray) -> np.ndarray:
        changed = replace(alone, groups=(replace(group, values=values),))
        return replace(model, table=changed).at_rest(x)[0].closure.error

    closure = replace(model, table=alone).at_rest(x)[0].target_closure
    columns = closure.sensor_columns(group.sigma)
    assert len(columns) == {"length": 1, "point": 3, "pose": 6}[measured]
    for k in range(3 if measured == "pose" else len(columns)):
        step = 1e-6 * np.eye(group.values.shape[1])[k]
        slope = (error(group.values + step) - error(group.values - step)) / 2e-6
        expected = slope * group.sigma[:, k]
        assert np.abs(columns[k]) == pytest.approx(np.abs(expected), abs=1e-3 * 2e-5)


@pytest.mark.parametrize(
    ("measured", "framed"),
    [("length", set()), ("socket", set()), ("point", {"seat"}), ("pose", {"seat", "target"})],
)
def test_only_what_measures_an_orientation_has_one_to_be_found(
    measured: str, framed: set[str]
) -> None:
    true = true_robot("ur5")
    table = socket_table(true, count=4) if measured == "socket" else table_of(true, measured)  # type: ignore[arg-type]
    layout = model_of(table).unknowns
    kinds = {"seat": set(table.seats), "target": set(table.targets)}
    assert layout.framed == set().union(*(kinds[kind] for kind in framed))

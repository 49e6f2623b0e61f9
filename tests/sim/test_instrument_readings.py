"""Still readings get drift, outliers, early readings, noise and rounding as they are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.instruments.base import TrueStand
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.sim.errors.pose_errors import Drift, Rounding, Unsettled
from ballbar.sim.errors.sensor_errors import JointNoise, Outliers
from ballbar.sim.instrument_readings import (
    logged_axes,
    measured,
    outliers,
    seat_motion,
    seen_from,
    stand_of,
    unsettled,
)
from ballbar.sim.settings import ErrorSettings
from ballbar.sim.true_robot import true_arm
from ballbar.sim.truth import TruePlace

ROBOT = load_robot("ur5")
ARM = true_arm(ROBOT, ErrorSettings(), 1)
COUNT = 4000
Q = np.random.default_rng(1).uniform(-1.0, 1.0, (COUNT, 6))


def test_seats_drift_by_the_stated_amounts_in_drawn_directions() -> None:
    errors = ErrorSettings(drift=Drift(shift_m=3e-4, turn_rad=2e-5))
    first, second = (seat_motion(errors, seed) for seed in (1, 2))
    for motion in (first, second):
        assert np.linalg.norm(motion.shift_m) == pytest.approx(3e-4)
        assert np.linalg.norm(motion.turn_rad) == pytest.approx(2e-5)
    cosine = np.dot(first.shift_m, second.shift_m) / 9e-8
    assert abs(cosine) < 0.999
    still = seat_motion(ErrorSettings(), 1)
    assert not np.any([still.shift_m, still.turn_rad])


def test_a_seat_sees_a_target_in_its_own_frame() -> None:
    turn = Rotation.from_rotvec([0.2, -0.4, 0.9])
    origin = np.array([0.5, -0.3, 0.1])
    seat = np.tile(origin[:, None], COUNT), np.tile(turn.as_matrix()[:, :, None], COUNT)
    target = TruePlace(position_m=(0.02, 0.03, 0.1), rotvec_rad=(0.1, 0.0, 0.3))
    stand = stand_of(ARM, Q, target, seat)
    poses = ARM.flange(Q).poses()
    place = poses[:, :3, 3] + poses[:, :3, :3] @ target.position
    rod = turn.inv().apply(place - origin)
    assert stand.rod == pytest.approx(rod.T, abs=1e-12)
    assert stand.distance == pytest.approx(np.linalg.norm(place - origin, axis=1))
    expected = turn.as_matrix().T @ poses[:, :3, :3] @ target.rotation
    assert stand.rotation.transpose(2, 0, 1) == pytest.approx(expected, abs=1e-12)
    again = seen_from(seat, place.T, (poses[:, :3, :3] @ target.rotation).transpose(1, 2, 0))
    assert again.rod == pytest.approx(stand.rod)


def test_noise_of_a_length_has_the_stated_size_times_the_scale() -> None:
    instrument = load_instrument("qc20w_300")
    rod = np.tile(np.array([[0.0], [0.0], [0.3]]), COUNT)
    exact = TrueStand(rod, np.full(COUNT, 0.3), np.tile(np.eye(3)[:, :, None], COUNT))
    for scale in (0.0, 1.0, 3.0):
        values = measured(instrument, exact, scale=scale, rng=np.random.default_rng(2))
        assert values.shape == (COUNT, 1)
        assert np.std(values - 0.3) == pytest.approx(scale * instrument.sigma_length, rel=0.05)


def test_outliers_come_as_often_and_as_large_as_stated() -> None:
    errors = ErrorSettings(outliers=Outliers(share=0.1, size_m=(1e-3, 1e-1)))
    out = outliers(errors, load_instrument("tracker_point"), COUNT, 3)
    size = np.linalg.norm(out, axis=1)
    wrong = size > 0.0
    assert wrong.mean() == pytest.approx(0.1, abs=0.02)
    assert size[wrong].min() >= 1e-3 - 1e-12
    assert size[wrong].max() <= 1e-1 + 1e-12
    assert np.median(size[wrong]) == pytest.approx(1e-2, rel=0.4)  # as many above as below
    assert np.abs(out[wrong].mean(axis=0)).max() < 5e-3  # in all directions
    length = outliers(errors, load_instrument("qc20w_300"), COUNT, 3)
    assert not length[:, 1:].any()
    assert np.abs(length[:, 0]) == pytest.approx(size)
    assert not outliers(ErrorSettings(), load_instrument("qc20w_300"), 5, 3).any()


def test_poses_that_are_read_too_early_miss_a_share_of_the_last_move() -> None:
    errors = ErrorSettings(unsettled=Unsettled(share=0.2, fraction=0.05))
    read, early = unsettled(errors, Q, 4)
    assert early.mean() == pytest.approx(0.2, abs=0.03)
    assert not early[0]
    assert np.array_equal(read[~early], Q[~early])
    rows = np.flatnonzero(early)
    assert read[rows] == pytest.approx(Q[rows] - 0.05 * (Q[rows] - Q[rows - 1]))
    same, none = unsettled(ErrorSettings(), Q, 4)
    assert same is Q
    assert not none.any()


def test_logged_axes_have_noise_and_are_rounded_to_the_step_of_the_table() -> None:
    exact = logged_axes(ARM, ErrorSettings(), Q, 5)
    assert exact == pytest.approx(joints_to_axes(ROBOT, Q))
    noisy = logged_axes(ARM, ErrorSettings(joint_noise=JointNoise(sigma_rad=1e-4)), Q, 5)
    error = controller_to_joints(ROBOT, noisy) - Q
    assert error.std(axis=0) == pytest.approx(np.full(6, 1e-4), rel=0.1)
    step = np.deg2rad(0.05)
    rounded = logged_axes(ARM, ErrorSettings(rounding=Rounding(step_deg=0.05)), Q, 5)
    assert np.abs(rounded / step - np.round(rounded / step)).max() < 1e-6
    assert np.abs(rounded - exact).max() <= 0.5 * step * (1.0 + 1e-9)

"""Distances of measured points from the nominal robot, moved onto some of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.acquisition.faults.nominal_robot import _distances, judged, nominal_frames
from ballbar.cell.arrays import Array
from ballbar.cell.load import load_robot

ROBOT = load_robot("ur5")
Q = np.random.default_rng(2).uniform(-1.5, 1.5, (60, 6))
SEAT = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix(), np.array([1.0, -0.4, 0.3])
TARGET = np.array([0.05, -0.02, 0.11])  # [m] in the flange


def points(origin: Array = SEAT[1]) -> Array:
    """(60, 3) [m] of the target in the frame of the seat."""
    poses = nominal_frames(ROBOT, Q).poses()
    return (poses[:, :3, 3] + poses[:, :3, :3] @ TARGET - origin) @ SEAT[0]


def test_points_of_the_nominal_robot_lie_on_it_whatever_seat_and_target_are() -> None:
    for chosen in (np.arange(8), np.arange(30, 60)):
        assert _distances(ROBOT, Q, points(), chosen).max() < 1e-9


def test_points_of_another_seat_lie_as_far_off_as_it_stands_apart() -> None:
    shift = np.array([0.0, 0.12, 0.0])
    mixed = points()
    mixed[40:] = points(SEAT[1] + shift)[40:]
    off = _distances(ROBOT, Q, mixed, np.arange(20))
    assert off[:40].max() < 1e-9
    assert off[40:] == pytest.approx(np.full(20, 0.12))


def test_of_many_poses_some_are_judged_all_along() -> None:
    assert judged(7, 10).tolist() == list(range(7))
    some = judged(1000, 10)
    assert some.size <= 10
    assert (np.diff(some) > 90).all()
    assert some[0] < 100
    assert some[-1] > 850

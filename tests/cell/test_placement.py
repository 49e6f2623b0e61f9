"""Frames fixed to another one: moved about either's axes, and carried on a flange."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.chain import Chain, forward
from ballbar.cell.placement import Placement, target_frames

PLACE = Placement(Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix(), np.array([0.1, 0.2, -0.4]))
CHANGE = np.array([0.01, -0.02, 0.03, 0.2, 0.1, -0.3])


def test_a_frame_is_shifted_along_the_other_ones_axes() -> None:
    for own in (True, False):
        moved = PLACE.moved(CHANGE[:3], about_own_axes=own)
        assert moved.origin == pytest.approx([0.11, 0.18, -0.37])
        assert moved.rotation is PLACE.rotation


def test_a_frame_is_turned_about_its_own_axes_or_the_other_ones() -> None:
    turn = Rotation.from_rotvec(CHANGE[3:]).as_matrix()
    own = PLACE.moved(CHANGE, about_own_axes=True)
    other = PLACE.moved(CHANGE, about_own_axes=False)
    assert own.rotation == pytest.approx(PLACE.rotation @ turn, abs=1e-15)
    assert other.rotation == pytest.approx(turn @ PLACE.rotation, abs=1e-15)
    assert own.origin == pytest.approx(other.origin)
    assert own.origin == pytest.approx([0.11, 0.18, -0.37])


def test_a_target_on_the_flange_is_the_last_frame() -> None:
    rng = np.random.default_rng(2)
    chain = Chain(*rng.uniform(-1.0, 1.0, (5, 3)))
    flange = forward(chain, rng.uniform(-2.0, 2.0, (7, 3)))
    frames = target_frames(flange, PLACE)
    offset = np.eye(4)
    offset[:3, :3], offset[:3, 3] = PLACE.rotation, PLACE.origin
    assert frames.poses() == pytest.approx(flange.poses() @ offset, abs=1e-15)
    assert len(frames.origin) == len(flange.origin) + 1
    assert np.array_equal(frames.z[:-1], flange.z)

"""Clocks and frames of two recorders of one rigid body, against those that were planted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.errors import LogError
from ballbar.cell.logs import ChannelLog
from ballbar.ident.channel_groups import groups_by_name
from ballbar.ident.estimator.channel_map import ChannelMap, Trace, first_map, linearised
from ballbar.ident.log_alignment import AlignmentError, align_logs
from tests.helpers.moving_body import KINDS, POINT, RATE, TURN, two_recorders, wandering

SEEDS = 40


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_errors_of_the_clock_and_of_the_frames_are_as_large_as_stated(kind: str) -> None:
    clocks, constants = [], []
    for seed in range(SEEDS):
        true = two_recorders(kind, seed, jitter=0.002 if seed % 2 else 0.0)
        result = align_logs(true.a, true.b)
        middle = result.middle
        error = result.clock.robot_time(middle) - true.clock.robot_time(middle)
        clocks.append(error / result.middle_sigma)
        (pair,) = result.pairs
        if kind != "rates":
            expected = {"turn": true.turn, "hand": true.hand, "zero": true.shift}
            for name, value in (expected | {"lever": true.lever, "gain": np.ones(1)}).items():
                if name not in pair.sigma:
                    continue
                own = pair.constants()[name]
                off = (
                    (Rotation.from_quat(own) * value.inv()).as_rotvec()
                    if isinstance(value, Rotation)
                    else own - value
                )
                constants.append(off / pair.sigma[name])
    # 40 draws scatter by 11 %.
    assert 0.75 < np.sqrt(np.square(clocks).mean()) < 1.25, clocks
    assert not constants or 0.75 < np.sqrt(np.square(np.concatenate(constants)).mean()) < 1.3


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_names_show_the_group_and_its_clock_follows(kind: str) -> None:
    true = two_recorders(kind, 100)
    assert groups_by_name(true.a, true.b) == [KINDS[kind]]
    result = align_logs(true.a, true.b)
    assert result.clock.offset == pytest.approx(true.clock.offset, abs=5.0 * result.offset_sigma)
    assert result.middle_sigma < 3e-4
    assert result.pairs[0].undetermined == ()
    exchanged = align_logs(true.b, true.a)
    inverse = float(result.clock.ballbar_time(np.zeros(1))[0])
    assert exchanged.clock.offset == pytest.approx(inverse, abs=result.offset_sigma)


@pytest.mark.long
def test_a_body_that_turns_about_one_axis_has_a_clock_but_no_whole_hand() -> None:
    true = two_recorders("pose", 3, axes=(1.0, 0.0, 0.0))
    result = align_logs(true.a, true.b)
    assert result.clock.offset == pytest.approx(true.clock.offset, abs=4.0 * result.offset_sigma)
    assert result.middle_sigma < 2e-4
    words = " ".join(result.pairs[0].undetermined)
    assert "lever arm, and the shift with it, along (0.00, 0.00, 1.00)" in words.replace(
        "-0.", "0."
    )
    only_turns = two_recorders("rotation", 3, axes=(1.0, 0.0, 0.0))
    result = align_logs(only_turns.a, only_turns.b)
    words = " ".join(result.pairs[0].undetermined)
    assert "the rotation about (" in words
    assert "the rotation of the body frame about (" in words


@pytest.mark.long
def test_a_held_signal_counts_where_it_is_new_and_is_not_late() -> None:
    """A source of 24 ms read every 4 ms: taken as a signal it is late by 10 ms."""
    rng = np.random.default_rng(1)
    motion = wandering(rng, 0.3)
    t, t_b = np.arange(0.0, 40.0, 0.004), np.arange(0.0, 40.0, 0.01)
    held = motion(np.floor(t / 0.024 + 1e-9) * 0.024)
    a = ChannelLog("A", t, held, POINT)
    b = ChannelLog("B", t_b, motion(t_b) + 1e-4 * rng.standard_normal((t_b.size, 3)), POINT)
    result = align_logs(a, b)
    assert result.clock.offset == pytest.approx(0.0, abs=1e-4)
    assert result.middle_sigma == pytest.approx(0.004 / np.sqrt(12.0), rel=0.05)
    assert any("83 % of the rows repeat x,y,z: held values" in line for line in result.remarks)
    everywhere = held + 1e-5 * rng.standard_normal(held.shape)
    late = align_logs(replace(a, values=everywhere), b)
    assert late.clock.offset == pytest.approx(0.010, abs=5e-4)


def test_a_path_that_repeats_itself_is_refused() -> None:
    def ring(t: np.ndarray) -> np.ndarray:
        angle = np.pi * t
        return np.stack((np.cos(angle), np.sin(angle), 0.3 * np.sin(2.0 * angle)), axis=1)

    true = two_recorders("vector", 4, position=ring)
    with pytest.raises(AlignmentError, match="the motion repeats itself"):
        align_logs(true.a, true.b)


def test_quaternions_are_known_by_their_norm_and_refused_without_it() -> None:
    true = two_recorders("pose", 5)
    long = replace(true.b, values=true.b.values * 2.0)
    assert groups_by_name(true.a, long) == [(POINT + TURN, POINT)]
    with pytest.raises(LogError, match="qx,qy,qz,qw is no quaternion, of norm 2"):
        align_logs(true.a, long, groups=[(TURN, TURN)])
    with pytest.raises(LogError, match="are no pair: three coordinates"):
        align_logs(true.a, true.b, groups=[(TURN, POINT[:2])])


def test_three_channels_beside_a_quaternion_are_coordinates_and_angles_are_not() -> None:
    values = np.random.default_rng(6).normal(size=(50, 7))
    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1)[:, None]
    t = np.arange(50.0)
    a = ChannelLog("A", t, values, ("pos_x", "pos_y", "pos_z", "o_x", "o_y", "o_z", "o_w"))
    b = ChannelLog("B", t, values, ("u", "v", "w", "rx", "ry", "rz", "rw"))
    assert groups_by_name(a, b) == [(a.names, b.names)]
    angles = ChannelLog("C", t, values[:, :3], ("rx", "ry", "rz"))
    assert groups_by_name(angles, angles) == []
    gyro = ChannelLog("D", t, values[:, :3], RATE)
    assert groups_by_name(a, gyro) == [(a.names[3:], RATE)]


@pytest.mark.parametrize(("turns_a", "turns_b"), [(1, 1), (1, 0), (0, 1), (0, 0)])
def test_columns_of_the_map_are_its_central_differences(turns_a: int, turns_b: int) -> None:
    rng = np.random.default_rng(7)

    def trace(turns: int) -> Trace:
        turn = Rotation.from_quat(rng.normal(size=(5, 4))) if turns else None
        return Trace(
            rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), turn, rng.normal(size=(5, 3))
        )

    a, b = trace(turns_a), trace(turns_b)
    turn, hand = (Rotation.from_quat(rng.normal(size=4)) for _ in range(2))
    if turns_a and turns_b:  # small angles between measured and predicted
        assert a.turn is not None
        b = replace(b, turn=turn.inv() * a.turn * hand)
    else:
        hand = None
    lever = rng.normal(size=3) if turns_a or turns_b else None
    at = ChannelMap(1.3, turn, rng.normal(size=3), lever, hand)
    columns = linearised(at, a, b).columns
    for k, step in enumerate(1e-6 * np.eye(columns.shape[2])):
        up, down = (linearised(at.moved(s), a, b).residual for s in (step, -step))
        np.testing.assert_allclose(columns[:, :, k], (up - down) / 2e-6, atol=1e-8)


def test_the_first_map_of_points_alone_has_their_rotation_gain_and_shift() -> None:
    rng = np.random.default_rng(8)
    turn, zero, points = Rotation.from_rotvec([0.4, -2.0, 1.1]), np.array([1.0, 2.0, -3.0]), 20
    b = Trace(rng.normal(size=(points, 3)), np.zeros((points, 3)), None, np.zeros((points, 3)))
    found = first_map(replace(b, point=1.3 * turn.apply(b.point) + zero), b)
    assert found.turn is not None
    assert (found.turn.inv() * turn).magnitude() < 1e-12
    assert found.gain == pytest.approx(1.3)
    assert found.zero == pytest.approx(zero)
    assert found.lever is None

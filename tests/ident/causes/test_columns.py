"""Other ways to read the columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.ident.causes.agreement import LoggedMotion, motion_of, tool_path
from ballbar.ident.causes.columns import encoder_orders, encoder_scales, robot_columns
from ballbar.ident.causes.suspects import EXPLAINS
from tests.helpers.synthetic_recording import CELL, NOMINAL, minute

ENCODERS = (1, 2, 4, 5)
PATH = minute(0.05)


def motion(scale: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)) -> LoggedMotion:
    bar = PATH.b[:, [0, 1, 3, 4]] * np.array(scale)
    return motion_of(PATH.t, PATH.q, PATH.t, bar, ENCODERS)


TOOL = tool_path(NOMINAL, motion().q)


def test_there_are_23_other_orders_of_four_encoders_and_none_explains_a_sound_recording() -> None:
    orders = encoder_orders(motion(), TOOL)
    assert len(orders) == 23
    assert len({order.cause for order in orders}) == 23
    assert min(order.left for order in orders) > 2.0 * EXPLAINS


def test_sound_line_counts_are_left_alone() -> None:
    assert encoder_scales(motion(), TOOL) == []


@pytest.mark.parametrize("scale", [(2.0, 1.0, 1.0, 1.0), (1.0, 0.25, 1.0, 0.72)])
def test_line_counts_follow_from_the_poses(scale: tuple[float, ...]) -> None:
    (reading,) = encoder_scales(motion(scale), TOOL)
    for joint, factor in zip(ENCODERS, scale, strict=True):
        assert (f"b{joint} {factor:.3f}" in reading.remark) == (factor != 1.0)
    assert reading.left < 0.02


def test_a_short_arc_makes_no_line_counts() -> None:
    """The centre of its sphere is open: sound encoders were said to count 0.75 and 0.41 times."""
    off = np.array([0.751, 1.026, 0.410, 1.030])
    for shares, named in ((off, False), (np.where(off < 0.5, 0.5, 1.0), True)):
        warped = motion(tuple(shares.tolist()))
        noise = 0.1 * np.sin(np.arange(warped.readings.size)).reshape(warped.readings.shape)
        unlike = replace(warped, readings=warped.readings + noise)
        assert bool(encoder_scales(unlike, TOOL)) == named


@pytest.mark.parametrize(("noise", "named"), [(0.018, False), (0.005, True)])
def test_unlike_ratios_must_leave_a_tenth_of_what_is_declared(noise: float, named: bool) -> None:
    """A sound machine on a planned path left 0.03 of 0.12 with them."""
    warped = motion((0.891, 0.927, 1.0, 1.0))
    off = noise * np.sin(np.arange(warped.readings.size)).reshape(warped.readings.shape)
    assert bool(encoder_scales(replace(warped, readings=warped.readings + off), TOOL)) == named


def test_no_other_columns_of_a_sound_robot_are_nearer_to_a_sphere() -> None:
    assert robot_columns(CELL.robot, NOMINAL, motion(), TOOL.rms) == []


def test_without_encoders_a_reading_leaves_its_distance_from_the_sphere() -> None:
    """A share of the rod: axis 1 alone turns backwards, which no other reading puts right."""
    read = PATH.q * np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    bare = motion_of(PATH.t, read, np.zeros(0), np.zeros((0, 0)), ())
    readings = robot_columns(CELL.robot, NOMINAL, bare, tool_path(NOMINAL, read).rms)
    assert readings
    for reading in readings:
        assert reading.left == pytest.approx(reading.rms / NOMINAL["bd3"], rel=1e-9)


def two(first: int, second: int, held: tuple[int, int]) -> LoggedMotion:
    """Two encoders, declared as `first` and `second`, that hold the angles of others."""
    bar = PATH.b[:, [joint - 1 for joint in held]]
    return motion_of(PATH.t, PATH.q, PATH.t, bar, (first, second))


def test_two_encoders_may_be_those_of_the_other_gimbal_in_either_order() -> None:
    for held, cause in (
        ((5, 4), "the encoders b1 and b2 are those of b5 and b4"),
        ((4, 5), "the encoders b2 and b1 are those of b5 and b4"),
        ((2, 1), "the columns of encoders b1 and b2 are exchanged"),
    ):
        orders = encoder_orders(two(1, 2, held), TOOL)
        assert len(orders) == 3
        best = min(orders, key=lambda order: order.left)
        assert (best.cause, best.rms) == (cause, TOOL.rms)
        assert best.left < 0.02


def test_columns_in_another_order_are_named_each() -> None:
    bar = PATH.b[:, [1, 3, 0, 4]]
    mixed = motion_of(PATH.t, PATH.q, PATH.t, bar, ENCODERS)
    best = min(encoder_orders(mixed, TOOL), key=lambda order: order.left)
    assert best.cause == (
        "the encoder columns are in another order: b1 in that of b4, b2 in that of b1, b4 in that "
        "of b2"
    )
    assert best.left < 0.02

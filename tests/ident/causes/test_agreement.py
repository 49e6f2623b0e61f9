"""Agreement of robot and encoders without a fit."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.geometry import robot_frames
from ballbar.ident.causes.agreement import (
    LONGEST_STEP,
    STEP,
    Gimbal,
    left,
    left_of,
    motion_of,
    tool_path,
)
from tests.helpers.synthetic_recording import NOMINAL, closed, minute

ENCODERS = (1, 2, 4, 5)
PATH = minute(0.05)
BAR = PATH.b[:, [0, 1, 3, 4]]


def test_a_closed_mechanism_leaves_nothing_and_another_motion_everything() -> None:
    motion = motion_of(PATH.t, PATH.q, PATH.t, BAR, ENCODERS)
    path = tool_path(NOMINAL, motion.q)
    assert path.rms < 1e-4  # the prior of the radius
    assert path.radius == pytest.approx(NOMINAL["bd3"], abs=1e-4)
    assert left_of(motion, path) < 0.02
    assert left_of(motion.reversed(), path) > 0.8


def test_offsets_and_directions_of_the_encoders_do_not_matter() -> None:
    changed = BAR * np.array([-1.0, 1.0, 1.0, -1.0]) + np.array([1.0, -2.0, 0.5, 3.0])
    motion = motion_of(PATH.t, PATH.q, PATH.t, changed, ENCODERS)
    assert left_of(motion, tool_path(NOMINAL, motion.q)) < 0.02


def test_a_shorter_overlap_explains_less() -> None:
    motion = motion_of(PATH.t, PATH.q, PATH.t + 5.0, BAR, ENCODERS)
    u = tool_path(NOMINAL, motion.q).directions[1]
    half = len(u) // 2
    whole = Gimbal(motion.column(1), motion.column(2), u, motion.step)
    rolled = np.roll(u, half, axis=0)
    part = Gimbal(motion.column(1), motion.column(2), rolled, motion.step)
    assert left([whole]) < left([part]) < 0.5


def test_small_motions_agree_as_well() -> None:
    """Two degrees about the first pose, less than the grid of the scan's offsets."""
    q, b = PATH.q, PATH.b
    small = b[0] + 0.03 * (b - b[0])
    q = closed(NOMINAL, small, np.repeat(q[:1], len(q), axis=0))
    motion = motion_of(PATH.t, q, PATH.t, small[:, [0, 1, 3, 4]], ENCODERS)
    assert left_of(motion, tool_path(NOMINAL, motion.q)) < 0.15  # floor of 3 mrad in 26


def test_long_logs_take_longer_steps() -> None:
    t = np.linspace(0.0, 6000.0, 1000)
    zero = np.zeros((t.size, 4))
    assert motion_of(t, np.zeros((t.size, 6)), t, zero, ENCODERS).step == LONGEST_STEP
    assert motion_of(t[:5], np.zeros((5, 6)), t[:5], zero[:5], ENCODERS).step == STEP


def test_the_radius_is_as_uncertain_as_the_path_is_short() -> None:
    errors = NOMINAL.replaced({"ra2": NOMINAL["ra2"] + 2e-3, "ralpha3": NOMINAL["ralpha3"] + 2e-3})
    whole, part = tool_path(errors, PATH.q), tool_path(errors, PATH.q[200:300])
    assert part.radius_sigma / part.rms > 2.0 * whole.radius_sigma / whole.rms
    assert abs(whole.radius - NOMINAL["bd3"]) < 2.0 * whole.radius_sigma
    assert robot_frames(errors, PATH.q).poses().shape == (len(PATH.q), 4, 4)

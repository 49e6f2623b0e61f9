"""Gears of a robot whose file states none: wide priors that hold what published robots have."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.load import load_robot
from ballbar.ident.corrections import correction_named
from ballbar.ident.corrections.gear_backlash import gear_backlash
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.corrections.typical_gears import (
    typical_backlash,
    typical_compliance,
    typical_friction,
)
from tests.helpers.synthetic_recording import CELL


@pytest.mark.parametrize("name", ["irb2400", "nj220"])
def test_published_gears_lie_within_the_priors_of_a_robot_of_their_size(name: str) -> None:
    robot = load_robot(name)
    gears = robot.required("gears")
    silent = replace(CELL, robot=replace(robot, links=None, gears=None, servo=None, armature=None))
    for made, published in (
        (correction_named("typical_compliance", silent, ()), 1.0 / gears.stiffness),
        (correction_named("typical_backlash", silent, ()), 0.5 * gears.lost_motion),
    ):
        means, sigmas = np.array([(c.mean, c.sigma) for c in made.coefficients]).T
        assert means.shape == published.shape
        assert (np.abs(published - means) < 2.0 * sigmas).all()
        assert (sigmas >= 0.8 * means * (1.0 - 1e-9)).all()  # typical is no catalogue's value
        assert (sigmas <= means * (1.0 + 1e-9)).all()
        again = pickle.loads(pickle.dumps(made))
        assert again.coefficients == made.coefficients


def test_their_coefficients_are_not_taken_for_those_of_a_file() -> None:
    """A complete robot gives the same gears and values, under names of their own."""
    for typical, stated in (
        (typical_compliance(CELL, ()), joint_compliance(CELL.robot)),
        (typical_backlash(CELL, ()), gear_backlash(CELL.robot)),
    ):
        own, other = typical.coefficients, stated.coefficients
        assert [c.name for c in own] == [f"typical_{c.name}" for c in other]
        assert typical.name != stated.name
        neutral = [replace(c, name="", sigma=0.0) for c in own]
        assert neutral == [replace(c, name="", sigma=0.0) for c in other]


def test_gears_yield_to_the_friction_of_the_ball_bar_as_to_any_load() -> None:
    soft, rubs = typical_compliance(CELL, ()), typical_friction(CELL, ())
    torque = CELL.ballbar.friction_torque
    assert torque == 0.05  # N m
    for compliance, friction in zip(soft.coefficients, rubs.coefficients, strict=True):
        assert friction.mean == torque * compliance.mean
        assert friction.channel == compliance.channel

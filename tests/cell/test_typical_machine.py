"""Typical values of a robot of a size, against robots that state or publish it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.descriptions import Robot
from ballbar.cell.load import load_robot, robot_names
from ballbar.cell.typical_machine import (
    GEAR_SPREAD,
    KEYS,
    STIFFNESS_SPREAD,
    motor_turns,
    with_typical,
)

# [kg] data sheets of the makers, as docs/how_to/own_robot.md lists them
MASSES = {
    "irb120": 25.0, "irb1600": 250.0, "irb2400": 380.0, "irb4600": 435.0, "irb6640": 1310.0,
    "kr10_r1100": 54.0, "kr210": 1068.0, "m20ia": 250.0, "gp25": 250.0, "nj220": 1220.0,
    "ur5": 18.4, "ur5e": 20.6, "ur10": 28.9, "ur10e": 33.5, "panda": 18.0, "iiwa14": 29.9,
}  # fmt: skip
COMPLETE = ("irb2400", "nj220")


def bare(robot: Robot) -> Robot:
    """The robot as if its file stated no more than rows and limits."""
    return replace(robot, links=None, servo=None, gears=None, armature=None)


def mass(robot: Robot) -> float:
    return sum(link.mass for link in robot.required("links"))


@pytest.mark.parametrize("name", COMPLETE)
def test_a_robot_whose_file_is_complete_stays_itself_and_has_no_spread(name: str) -> None:
    robot = load_robot(name)
    typical, spread = with_typical(robot)
    assert typical is robot
    assert spread.keys == ()
    assert spread.drawn(robot, np.random.default_rng(1)) is robot


def test_masses_of_published_robots_lie_about_the_typical_ones_as_the_spread_says() -> None:
    scores = []
    for name, published in MASSES.items():
        typical, spread = with_typical(bare(load_robot(name)))
        scores.append(np.log(published / mass(typical)) / spread.mass)
    assert np.abs(scores).max() < 2.6  # of 16 normal draws, one in eleven sets
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.3  # 0.65 to 1.35 of 16, one in twenty
    assert abs(np.mean(scores)) < 0.5


@pytest.mark.parametrize("name", COMPLETE)
def test_what_the_complete_files_state_lies_within_three_spreads_of_what_is_typical(
    name: str,
) -> None:
    robot = load_robot(name)
    typical, spread = with_typical(bare(robot))
    rng = np.random.default_rng(2)
    drawn = [spread.drawn(typical, rng) for _ in range(300)]

    def score(value: object) -> float:
        """Largest deviation of a machine's logarithms from the mean, over their spread."""
        of_drawn = np.log([value(r) for r in drawn])  # type: ignore[operator]
        off = np.log(value(robot)) - of_drawn.mean(axis=0)  # type: ignore[operator]
        return float(np.abs(off / of_drawn.std(axis=0)).max())

    assert score(lambda r: r.required("gears").stiffness) < 3.0
    assert score(lambda r: r.required("gears").coulomb) < 3.0
    assert score(lambda r: r.required("gears").viscous) < 3.0
    assert score(lambda r: r.required("servo")["soft"].kp) < 3.0
    assert score(lambda r: r.required("rotor_inertia_kg_m2")) < 3.0
    assert score(lambda r: [mass(r)]) < 3.0


@pytest.mark.parametrize("name", robot_names())
def test_typical_bodies_are_bodies_and_every_key_is_filled(name: str) -> None:
    typical, spread = with_typical(bare(load_robot(name)))
    assert spread.keys == KEYS
    assert not any(typical.lacks(key) for key in KEYS)
    for link in spread.drawn(typical, np.random.default_rng(3)).required("links"):
        low, middle, high = np.linalg.eigvalsh(link.inertia)
        assert low > 0.0
        assert high <= low + middle
        assert link.mass > 0.0


def test_what_a_file_states_is_neither_replaced_nor_drawn() -> None:
    stated = load_robot("irb2400")
    robot = replace(stated, servo=None, gears=None, armature=None)
    typical, spread = with_typical(robot)
    drawn = spread.drawn(typical, np.random.default_rng(4))
    assert spread.keys == ("servo", "gears", "rotor_inertia_kg_m2")
    assert drawn.links is typical.links is stated.links
    assert not np.allclose(drawn.required("gears").stiffness, typical.required("gears").stiffness)


@pytest.mark.slow
def test_draws_have_the_stated_spread_and_a_scale_of_zero_draws_the_typical_robot() -> None:
    typical, spread = with_typical(load_robot("ur5e"))
    rng = np.random.default_rng(5)
    drawn = np.log([spread.drawn(typical, rng).required("gears").stiffness for _ in range(2000)])
    expected = np.hypot(STIFFNESS_SPREAD, GEAR_SPREAD)
    assert np.allclose(drawn.std(axis=0), expected, rtol=0.06)  # 2000 draws: 1.6 %
    same = spread.drawn(typical, rng, scale=0.0)
    assert np.allclose(same.required("gears").stiffness, typical.required("gears").stiffness)


def test_an_arm_twice_as_long_weighs_eight_times_and_has_gears_sixteen_times_as_stiff() -> None:
    """These are of the industrial class, whose masses go with the cube of the length."""
    robot = bare(load_robot("irb4600"))
    (small, _), (large, _) = map(
        with_typical, (robot, replace(robot, a=2 * robot.a, d=2 * robot.d))
    )
    assert mass(large) == pytest.approx(8.0 * mass(small))
    ratio = large.required("gears").stiffness / small.required("gears").stiffness
    assert np.allclose(ratio, 16.0)


def test_typical_gear_ratios_stand_for_those_that_no_file_states() -> None:
    assert (motor_turns(load_robot("irb2400")) == 1.0).all()
    assert motor_turns(load_robot("ur5e")).tolist() == [130.0] * 3 + [60.0] * 3
    assert motor_turns(load_robot("panda")).size == 7

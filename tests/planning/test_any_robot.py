"""A path on a ball-bar for a robot whose file states neither masses nor gears nor servo."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_cell, load_robot
from ballbar.cell.strict_yaml import load_model
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.evaluation import evaluator_of
from ballbar.planning.force import Forces, force_model, predicted_forces
from ballbar.planning.request import PlanRequest, completed, load_request
from ballbar.planning.trajectory import trajectories
from ballbar.sim.path_files import LissajousFile, lissajous
from tests.helpers.drawn_robots import SCENARIOS


def bare(robot: Robot) -> Robot:
    """The robot as if its file stated no more than rows and limits."""
    return replace(robot, links=None, servo=None, gears=None, armature=None)


def request_for(folder: Path, cell: str, rest: str = "") -> PlanRequest:
    file = folder / "request.yaml"
    file.write_text(f"schema: ballbar-plan/1\nname: any\ncell: {{{cell}}}\n{rest}\n")
    request = load_request(file)
    assert isinstance(request, PlanRequest)
    return request


@pytest.mark.parametrize(
    ("robot", "bar", "force"),
    [
        ("irb120", "lund_600", 200.0),
        ("iiwa14", "lund_600", 200.0),
        ("kr210", "lund_900", 450.0),
        ("irb2400", "lund_600", 200.0),
        ("nj220", "lund_900", 200.0),  # its servo is known, and the request's limit is the default
    ],
)
def test_a_request_of_the_robot_alone_gets_what_fits_its_reach(
    tmp_path: Path, robot: str, bar: str, force: float
) -> None:
    request = request_for(tmp_path, f"robot: {robot}")
    low, high = map(np.array, request.cell.region)
    assert request.cell.rods == (bar,)
    assert (low < high).all()
    assert low[2] > 0.05  # above the floor
    assert request.limits.force_N == pytest.approx(force, rel=1e-2)


def test_what_a_request_states_stays(tmp_path: Path) -> None:
    stated = "robot: kr210, ballbar: lund_1200, ballbar_position_m: [1.4, 0.0, 0.7]"
    request = request_for(tmp_path, stated, "limits: {force_N: 123}")
    assert request.cell.rods == ("lund_1200",)
    assert request.cell.ballbar_position_m == (1.4, 0.0, 0.7)
    assert request.limits.force_N == 123.0
    again = completed(request, load_robot("kr210"))
    assert again == request


def test_five_axes_are_refused_in_words(tmp_path: Path) -> None:
    whole = load_cell("irb2400", "lund_600", "plate_250")
    rows = {key: getattr(whole.robot, key)[:5] for key in ("a", "d", "alpha", "theta")}
    axes = ("controller_offset", "axis_lower", "axis_upper", "axis_speed_max")
    axes += ("accuracy_lower", "accuracy_upper")
    rows |= {key: getattr(whole.robot, key)[:5] for key in axes}
    five = replace(bare(whole.robot), **rows, transmission=np.eye(5), controller_to_joint=np.eye(5))
    request = request_for(tmp_path, "robot: irb2400")
    with pytest.raises(InputError, match=r"has 5 axes.*needs 6.*still poses"):
        evaluator_of(request, "lund_600", replace(whole, robot=five))


def forces(cell: Cell, seed: int) -> Forces:
    """Predicted forces of a cell on the shipped planned path of an NJ 220."""
    file = load_model(SCENARIOS / "paths" / "nj220_planned.yaml", LissajousFile)
    candidate = PathCandidate(lissajous(file), np.array(file.ballbar_position_m))
    timing = PlanRequest.model_validate(
        {"schema": "ballbar-plan/1", "name": "any", "cell": {"robot": "nj220"}}
    ).timing
    trajectory = trajectories(cell, candidate, timing)[0]
    return predicted_forces(force_model(cell, "soft", seed=seed), trajectory)


def test_the_force_of_a_robot_unknown_to_the_interval_lies_within_it() -> None:
    """The interval is what 63 other robots and 8 typical ones reach at each instant."""
    cell = load_cell("nj220", "lund_900", "plate_250")
    unknown = replace(cell, robot=bare(cell.robot))
    stated, others = forces(unknown, seed=1), forces(unknown, seed=2)
    low, high = stated.extent
    outside = ((others.extent[0] < low) | (others.extent[1] > high)).mean()
    assert outside < 0.9  # the extremes of others are further out half the time
    known = forces(cell, seed=3).tension  # the robot itself, with its masses, gears and servo
    assert ((known < low) | (known > high)).mean() < 0.05
    assert max(map(abs, stated.interval)) > 1.2 * np.abs(known).max()  # it knows less


def test_the_interval_of_a_complete_robot_is_that_of_its_own_tensions() -> None:
    cell = load_cell("nj220", "lund_900", "plate_250")
    predicted = forces(cell, seed=1)
    tension: Array = predicted.tension
    assert np.array_equal(predicted.extent, [tension.min(axis=0), tension.max(axis=0)])
    assert predicted.interval == (tension.min(), tension.max())


def test_a_spread_of_nothing_leaves_the_typical_robot_alone() -> None:
    """The drawn robots' formula at the typical robot is the formula of a known one."""
    cell = load_cell("nj220", "lund_900", "plate_250")
    unknown = replace(cell, robot=bare(cell.robot))
    model = force_model(unknown, "soft", seed=1)
    assert model.drawn is not None
    errors = model.robots.errors[:, :1]
    one = replace(model.robots, errors=errors)
    tiled = {f.name: np.tile(getattr(one, f.name), (63, 1)) for f in fields(one)[1:]}
    same = replace(model.drawn, errors=np.tile(errors, (1, 63)), **tiled)
    one = replace(model, robots=one, drawn=same)
    nominal = nominal_geometry(unknown, np.array([1.5, 0.0, 0.7]))
    assert nominal.table.joints == 6
    file = load_model(SCENARIOS / "paths" / "nj220_planned.yaml", LissajousFile)
    timing = PlanRequest.model_validate(
        {"schema": "ballbar-plan/1", "name": "any", "cell": {"robot": "nj220"}}
    ).timing
    candidate = PathCandidate(lissajous(file), np.array(file.ballbar_position_m))
    predicted = predicted_forces(one, trajectories(unknown, candidate, timing)[0])
    assert np.allclose(predicted.extent, predicted.tension, rtol=1e-9, atol=1e-9)

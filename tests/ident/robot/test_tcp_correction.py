"""Parts of the correction of the tool, against full kinematics in random order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.cell.statistics import rms
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.result import (
    CoefficientEstimate,
    CorrectionEstimate,
    NamedCovariance,
    RobotEstimate,
    identified_robot,
)
from ballbar.ident.robot.accuracy import accuracy_grid, position_error, rigid_basis
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tcp_correction import correction_parts
from ballbar.ident.robot.tcp_uncertainty import TcpUncertainty
from tests.helpers.synthetic_recording import CELL, NOMINAL

CHANGED = {"ra2": 1.5e-3, "rd4": -0.8e-3, "ralpha3": 1e-3, "rtheta5": -1.2e-3, "ra5": 2e-3}
GRID = accuracy_grid(CELL.robot)[::8]
COMPLIANCES = ("compliance2", "compliance3")


def robot_of(geometry: Geometry, *corrections: CorrectionEstimate) -> RobotEstimate:
    """An identified robot; its changed parameters are known to 1, 2, ... um or urad."""
    sigmas = np.arange(1.0, len(CHANGED) + 1.0) * 1e-6
    nothing = np.zeros(len(GRID))
    return RobotEstimate(
        identified=identified_robot(CELL, geometry, (1, 2, 4, 5), corrections),
        nominal=NOMINAL,
        sigma={},
        covariance=NamedCovariance(tuple(CHANGED), np.diag(sigmas**2), np.diag(sigmas**2)),
        corrections=corrections,
        tcp=TcpUncertainty(nothing, nothing, ()),
    )


def changed(names: set[str]) -> Geometry:
    return NOMINAL.replaced({n: NOMINAL[n] + CHANGED[n] for n in names})


@pytest.fixture(scope="module")
def robot() -> RobotEstimate:
    """An identified robot that differs from the nominal one in five parameters."""
    return robot_of(changed(set(CHANGED)))


def field(geometry: Geometry) -> Array:
    """(3G,) motion of the tool from nominal, base aligned; full kinematics."""
    nominal = IdentifiedRobot(CELL, NOMINAL).tool(GRID)
    moved = (IdentifiedRobot(CELL, geometry).tool(GRID) - nominal).ravel()
    basis = rigid_basis(nominal)
    return np.asarray(moved - basis @ (basis.T @ moved))


def test_shares_are_those_of_changing_one_after_the_other(robot: RobotEstimate) -> None:
    """Mean over random orders of what each change adds along the whole (Shapley values)."""
    whole, rng = field(robot.geometry), np.random.default_rng(7)
    shares, draws = dict.fromkeys(CHANGED, 0.0), 40
    for _ in range(draws):
        done: set[str] = set()
        before = field(NOMINAL)
        for name in rng.permutation(list(CHANGED)):
            done.add(str(name))
            after = field(changed(done))
            shares[str(name)] += float((after - before) @ whole / (whole @ whole)) / draws
            before = after
    parts = {part.name: part.share for part in correction_parts(robot, GRID)}
    # the draws scatter by 1e-5; derivatives at one end of the way would be 8e-5 off
    assert parts == pytest.approx(shares, abs=3e-5)
    assert sum(parts.values()) == pytest.approx(1.0)


def test_a_part_by_itself_is_the_error_of_a_robot_with_nothing_else(robot: RobotEstimate) -> None:
    parts = {part.name: part for part in correction_parts(robot, GRID)}
    assert set(parts) == set(CHANGED)
    nominal = IdentifiedRobot(CELL, NOMINAL).tool(GRID)
    for k, name in enumerate(CHANGED, start=1):
        other = IdentifiedRobot(CELL, changed({name})).tool(GRID)
        alone = rms(position_error(nominal, other).error)
        assert parts[name].size == pytest.approx(alone, rel=5e-3)
        uncertain = alone * k * 1e-6 / abs(CHANGED[name])
        assert parts[name].sigma == pytest.approx(uncertain, rel=5e-3)
        assert parts[name].source == ""


def test_the_largest_stands_first(robot: RobotEstimate) -> None:
    sizes = [part.size for part in correction_parts(robot, GRID)]
    assert sizes == sorted(sizes, reverse=True)


def test_soft_gears_are_a_part_for_each_gear() -> None:
    """Against the tool of a robot whose other gears are rigid, under the same weight."""
    correction = CORRECTIONS["joint_compliance"](CELL, (1, 2, 4, 5))
    gears = tuple(
        CoefficientEstimate(c.name, c.unit, c.mean, 0.1 * c.mean, c.mean, c.sigma, 0.9)
        for c in correction.coefficients
    )
    robot = robot_of(NOMINAL, CorrectionEstimate(correction.name, correction.sentence, gears))
    parts = {p.name: p for p in correction_parts(robot, GRID) if p.source == "joint_compliance"}
    assert set(COMPLIANCES) <= set(parts)
    identified, rigid = robot.identified, IdentifiedRobot(CELL, robot.geometry).tool(GRID)
    for k, name in enumerate(f"compliance{i}" for i in range(1, 7)):
        single = replace(identified, values=np.where(np.arange(6) == k, identified.values, 0.0))
        alone = rms(position_error(rigid, single.tool(GRID)).error)
        if name in COMPLIANCES:
            assert alone > 1e-5
        assert parts[name].size == pytest.approx(alone, rel=0.02) if name in parts else alone < 1e-9

"""Predicted characteristics: laws of normal errors, and robots whose true errors are known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.chain import forward
from ballbar.cell.geometry import geometry_of_chain, nominal_chain, parameter_table
from ballbar.cell.load import load_robot
from ballbar.ident.performance.characteristics import Characteristic, Statement, merged, not_stated
from ballbar.ident.performance.cube import TestCube, fitting_cube
from ballbar.ident.performance.predicted import (
    RobotPair,
    known_deviation,
    length_moments,
    predict,
    unknown_error,
)
from ballbar.ident.robot.identified_kinematics import kinematics
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.ident.table_fit import fit_table
from tests.helpers.still_poses import TARGET, TrueRobot, table_of, true_robot


def test_an_error_that_is_equal_along_three_axes() -> None:
    """Sigma 2 along each axis: rms 2 sqrt(3); the 95 % quantile of chi-square with 3 degrees of
    freedom is 7.814727903251179; mean and deviation of a Maxwell distribution.
    """
    covariance = 4.0 * np.eye(3)
    stated = unknown_error(covariance)
    assert stated.value == pytest.approx(3.464101615137755, abs=1e-9)
    assert stated.high == pytest.approx(2.0 * 2.795483482915109, abs=1e-9)
    moments = length_moments(covariance)
    assert moments == pytest.approx((2.0 * 1.595769121605731, 2.0 * 0.673439611642852), abs=1e-9)


def test_an_error_along_one_axis() -> None:
    """Sigma 3: the 95 % quantile is 1.959963984540054 sigma."""
    stated = unknown_error(np.diag([0.0, 9.0, 0.0]))
    assert (stated.value, stated.high) == pytest.approx((3.0, 3.0 * 1.959963984540054), abs=1e-9)


def test_a_deviation_with_an_uncertainty_along_it() -> None:
    """(3, 4, 0) with variances 1, 2.25, 0: along it 0.36 + 0.64 * 2.25 = 1.8, across 1.45."""
    stated = known_deviation(np.array([3.0, 4.0, 0.0]), np.diag([1.0, 2.25, 0.0]))
    width, across = 1.959964 * np.sqrt(1.8), 1.959964 * np.sqrt(1.45)
    assert stated.value == pytest.approx(5.0, abs=1e-12)
    assert stated.low == pytest.approx(5.0 - width, abs=1e-9)
    assert stated.high == pytest.approx(np.hypot(5.0 + width, across), abs=1e-9)


def test_nothing_is_stated_where_nothing_is_known() -> None:
    infinite = np.full((3, 3), np.inf)
    assert unknown_error(infinite).value is None
    assert known_deviation(np.ones(3), infinite).origin == "not stated"


@cache
def predicted() -> tuple[TrueRobot, RobotPair, TestCube]:
    """A robot of drawn errors, identified from 200 points, and its test cube."""
    true = true_robot("ur5", seed=5)
    robot = fit_table(table_of(true)).identified_robot("ball")
    chain = nominal_chain(robot.robot)
    geometry = geometry_of_chain(parameter_table(robot.robot), chain)
    robots = RobotPair(kinematics(robot.rigid(geometry), chain), kinematics(robot, chain))
    cube = fitting_cube(robots.nominal, robot)
    assert cube is not None
    return true, robots, cube


def true_shifts(q: np.ndarray) -> np.ndarray:
    """(N, 3) [m] of the true robot from the nominal one at q, aligned by scipy over the grid."""
    true, robots, _ = predicted()
    chain = nominal_chain(load_robot(true.name))

    def nominal(angles: np.ndarray) -> np.ndarray:
        frames = forward(chain, angles).poses()
        return np.asarray(frames[:, :3, 3] + frames[:, :3, :3] @ TARGET.origin)

    own, other = true.positions(robots.grid), nominal(robots.grid)
    turn, _ = Rotation.align_vectors(other - other.mean(axis=0), own - own.mean(axis=0))
    shift = other.mean(axis=0) - turn.apply(own.mean(axis=0))
    return np.asarray(turn.apply(true.positions(q)) + shift - nominal(q))


def test_predicted_accuracies_hold_the_true_ones() -> None:
    """AP of the nominal robot lies in its interval at each pose, and over the workspace."""
    _, robots, cube = predicted()
    rows = {(row.symbol, row.place): row for row in predict(robots, cube)}
    truth = np.linalg.norm(true_shifts(cube.q), axis=1)
    for k, size in enumerate(truth, start=1):
        nominal, identified, corrected = rows["AP_p", f"P{k}"].statements
        assert nominal.origin == "predicted"
        assert nominal.low is not None
        assert nominal.high is not None
        assert nominal.value is not None
        assert nominal.low <= size <= nominal.high
        assert size > 3e-4  # far from none, so that the interval says something
        assert nominal.high - nominal.low < 0.5 * size
        assert identified.value is not None
        assert identified.value < 0.2 * size
        assert corrected == identified
    mean = rows["AP_p", "workspace, mean"].statements[0]
    expected = np.linalg.norm(true_shifts(robots.grid), axis=1)
    assert mean.value == pytest.approx(expected.mean(), rel=0.05)
    largest = rows["AP_p", "workspace, largest"].statements[0]
    assert largest.value == pytest.approx(expected.max(), rel=0.05)


def test_the_predicted_distance_has_the_sign_of_the_true_one() -> None:
    _, robots, cube = predicted()
    (row,) = (row for row in predict(robots, cube) if row.symbol == "AD_p")
    shift = true_shifts(cube.q[[1, 3]])
    commanded = cube.poses[[1, 3], :3, 3]
    off = np.linalg.norm(np.diff(commanded + shift, axis=0))
    off -= np.linalg.norm(np.diff(commanded, axis=0))
    nominal = row.statements[0]
    assert nominal.low is not None
    assert nominal.high is not None
    assert nominal.low <= off <= nominal.high
    assert abs(off) > 1e-4


def test_intervals_follow_the_stated_region_and_both_ends_of_a_distance() -> None:
    """A region of four times the squared size doubles every interval; the deviations of the two
    ends of a distance add up, for their correlation is not stated.
    """
    _, pair, cube = predicted()
    stated = pair.robot.stated
    assert isinstance(stated, PoseCovariance)
    wider = replace(pair.robot, stated=replace(stated, factor=4.0 * stated.factor))
    other = replace(pair, identified=replace(pair.identified, identified=wider))
    q = cube.q[[1, 3]]
    assert other.covariance(q) == pytest.approx(4.0 * pair.covariance(q), rel=1e-12)
    along = np.diff(cube.poses[[1, 3], :3, 3], axis=0)[0]
    along /= np.linalg.norm(along)
    sigma = sum(np.sqrt(along @ c @ along) for c in pair.covariance(q))
    (row,) = (row for row in predict(pair, cube) if row.symbol == "AD_p")
    assert row.statements[1].high == pytest.approx(1.959964 * sigma, rel=1e-6)


def test_no_repeatability_is_predicted() -> None:
    _, robots, cube = predicted()
    rows = {row.symbol: row for row in predict(robots, cube)}
    for symbol in ("RP_l", "vAP_p", "RD", "dAP_p", "dRP_l", "RT_p"):
        assert {s.origin for s in rows[symbol].statements} == {"not stated"}
        assert "measure repetitions" in rows[symbol].statements[0].reason


def test_a_measured_row_takes_what_it_lacks_from_the_predicted_one() -> None:
    """At the same place; rows that state nothing give way to measured ones anywhere."""
    measured = Statement("measured", 1.0)
    guess = Statement("predicted", 2.0)
    none = not_stated("why")
    rows = merged(
        [
            Characteristic("RP_l", "P1", (measured,) * 3, 30),
            Characteristic("AP_p", "P1", (measured, measured, none), 30),
        ],
        [
            Characteristic("AP_p", "P1", (guess,) * 3),
            Characteristic("AP_p", "P2", (guess,) * 3),
            Characteristic("RP_l", "test poses", (none,) * 3),
            Characteristic("RD", "P2-P4", (none,) * 3),
        ],
    )
    assert [(r.symbol, r.place) for r in rows] == [
        ("AP_p", "P1"), ("AP_p", "P2"), ("RP_l", "P1"), ("RD", "P2-P4"),
    ]  # fmt: skip
    assert rows[0].statements == (measured, measured, guess)

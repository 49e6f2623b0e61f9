"""The result of an identification, and the unloaded robot that follows from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.result import (
    CoefficientEstimate,
    CorrectionEstimate,
    FitStatistics,
    Identification,
    NamedCovariance,
    RecordingEstimate,
    Residuals,
    RobotEstimate,
    identified_robot,
)
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tcp_uncertainty import TcpUncertainty
from ballbar.ident.start.automatic import Start
from ballbar.ident.verdict import Status, Verdict
from tests.helpers.start_candidates import candidate
from tests.helpers.synthetic_recording import CELL, NO_CLOCK_ERROR, NOMINAL, recording

ENCODERS = (1, 2, 4, 5)
GEOMETRY = NOMINAL.replaced({"ra2": NOMINAL["ra2"] + 1e-3})


def estimate_of(name: str, value: float) -> CorrectionEstimate:
    """A correction with `value` standard deviations added to each prior."""
    return estimate_from(CORRECTIONS[name](CELL, ENCODERS), value)


def estimate_from(correction: Correction, value: float) -> CorrectionEstimate:
    return CorrectionEstimate(
        correction.name,
        correction.sentence,
        tuple(
            CoefficientEstimate(c.name, c.unit, c.mean + value * c.sigma, 0.1, c.mean, c.sigma, 0.9)
            for c in correction.coefficients
        ),
    )


def robot_of(*corrections: CorrectionEstimate) -> RobotEstimate:
    return RobotEstimate(
        identified=IdentifiedRobot(CELL, GEOMETRY),
        nominal=NOMINAL,
        sigma={"ra2": 1e-5},
        covariance=NamedCovariance(("ra2",), np.array([[1e-10]]), np.array([[1e-11]])),
        corrections=corrections,
        tcp=TcpUncertainty(np.full(10, 1e-5), np.full(10, 9e-6), ()),
        encoders=ENCODERS,
    )


def identification(robot: RobotEstimate) -> Identification:
    samples = recording()
    residuals = Residuals(samples.times, np.zeros((286, 3)), np.zeros((286, 3)))
    recorded = RecordingEstimate(
        name="a",
        encoders=ENCODERS,
        directions=(1, 1, 1, 1),
        geometry=NOMINAL,
        nominal=NOMINAL,
        sigma={"ox": 2e-5, "btheta1": 3e-5},
        clock=NO_CLOCK_ERROR,
        clock_sigma=(1e-6, 1e-8),
        noise=samples.log_noise,
        before=residuals,
        after=residuals,
        whitened=np.zeros((5, 286)),
        start=Start(candidate(0.0), (), 1),
    )
    statistics = FitStatistics(True, 4, 30, 1.0, ExcessNoise())
    return Identification(robot, (recorded,), statistics, Verdict(Status.GOOD, "Good fit.", ()))


@pytest.fixture(scope="module")
def q() -> Array:
    return np.random.default_rng(121).uniform(-0.5, 0.5, (10, 6))


def test_the_identified_robot_has_the_fitted_geometry_and_corrections_in_their_order(
    q: Array,
) -> None:
    """Also those that act elsewhere than in the gears: their coefficients stand in between."""
    names = ("rod_strain", "encoder_harmonics", "joint_compliance", "gear_ripple")
    estimates = tuple(estimate_of(name, 0.3) for name in names)
    robot = identified_robot(CELL, GEOMETRY, ENCODERS, estimates)
    makers = [CORRECTIONS[name](CELL, ENCODERS) for name in names]
    values = [c.mean + 0.3 * c.sigma for m in makers for c in m.coefficients]
    assert robot.values == pytest.approx(values)
    expected = IdentifiedRobot(CELL, robot.geometry, tuple(makers), np.array(values))
    assert np.array_equal(robot.tool(q), expected.tool(q))
    only_gears = IdentifiedRobot(
        CELL,
        robot.geometry,
        tuple(makers[2:]),
        np.array([c.mean + 0.3 * c.sigma for m in makers[2:] for c in m.coefficients]),
    )
    assert robot.tool(q) == pytest.approx(only_gears.tool(q), abs=1e-15)
    assert robot.geometry["ra2"] == NOMINAL["ra2"] + 1e-3


def test_without_corrections_the_identified_robot_is_kinematics_alone(q: Array) -> None:
    robot = identified_robot(CELL, NOMINAL, ENCODERS, ())
    assert robot.joints(q) is q
    assert robot.corrections == ()


def test_joint_errors_are_formed_again_from_the_names_of_their_coefficients(q: Array) -> None:
    ratio = 1.0 / abs(float(CELL.robot.transmission[1, 1]))  # 129.99
    made = joint_harmonics([(1, 17), (0, 3), (1, ratio)])
    estimate = estimate_from(made, 0.4)
    estimates = [estimate_of("joint_compliance", 0.1), estimate]
    robot = identified_robot(CELL, NOMINAL, ENCODERS, estimates)
    compliance = CORRECTIONS["joint_compliance"](CELL, ENCODERS)
    expected = IdentifiedRobot(CELL, robot.geometry, (compliance, made), robot.values)
    assert robot.tool(q) == pytest.approx(expected.tool(q), abs=1e-12)
    assert robot.corrections[1].coefficients == made.coefficients
    strange = replace(estimate.coefficients[0], name="joint2_17_tan")
    with pytest.raises(InputError, match=r"joint_harmonics.joint2_17_tan: expected joint2_17_cos"):
        identified_robot(CELL, NOMINAL, ENCODERS, [replace(estimate, coefficients=(strange,))])


def test_a_correction_that_the_program_does_not_know_is_refused_by_name() -> None:
    strange = replace(estimate_of("rod_strain", 0.0), name="rod_torsion")
    with pytest.raises(KeyError, match="rod_torsion"):
        identified_robot(CELL, NOMINAL, ENCODERS, [strange])


def test_an_identification_is_complete_when_it_has_corrections() -> None:
    assert identification(robot_of()).model == "dh"
    assert identification(robot_of(estimate_of("rod_strain", 0.0))).model == "complete"


def test_deviations_are_those_of_the_machine_and_of_the_first_recording() -> None:
    found = identification(robot_of())
    assert found.sigma == {"ra2": 1e-5, "ox": 2e-5, "btheta1": 3e-5}
    assert found.recordings[0].samples == 286

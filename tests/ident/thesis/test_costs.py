"""The thesis's four cost functions: values, derivatives, and what they cannot see."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.cell.inverse import refine
from ballbar.ident.estimator.closure import close_loop
from ballbar.ident.thesis.costs import EQUATIONS, Form, cost_named
from ballbar.ident.thesis.names import CostName
from tests.helpers.simulated_recordings import perturbed
from tests.helpers.six_axes import INDEX, NAMES, PARAMETERS
from tests.helpers.synthetic_recording import Loop

COSTS = get_args(CostName)
FORMS = get_args(Form)
STEP = 1e-6  # central differences: truncation 1e-12, cancellation 1e-10
# The error may be tenths of a radian here, so third derivatives are of order 10.
TOLERANCE = 2e-9

# Thesis Table 3.3, and the base tilt and Hayati angles that the thesis does not have.
ZERO_JACOBIAN = {
    "length": "ralpha6 rbeta6 ba1 ba2 ba3 ba4 ba5 bd1 bd2 bd4 bd5 "
    "balpha1 balpha2 balpha3 balpha4 balpha5 "
    "btheta1 btheta2 btheta3 btheta4 btheta5 otx oty",
    "position": "ralpha6 rbeta6 balpha3 balpha4 balpha5 btheta3 btheta4 btheta5",
    "position_angles": "balpha3 balpha4 balpha5 btheta3",
    "transform": "",
}

Angles = tuple[Array, Array]


@pytest.fixture(scope="module")
def closed(loop: Loop) -> Angles:
    """Angles at which the nominal loop closes."""
    return loop.q, loop.b


def robot_at(nominal: Geometry, b: Array) -> Array:
    start = np.array([-0.13, 0.4, 0.16, -0.17, -1.0, 2.3]) + np.zeros((len(b), 6))
    return refine(nominal.robot, start, bar_frames(nominal, b).poses(), iterations=60)


@pytest.fixture(scope="module")
def off(nominal: Geometry) -> Geometry:
    """A mechanism whose every parameter is off by centimetres or hundredths of a radian."""
    return perturbed(nominal, np.random.default_rng(21), 0.02)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", COSTS)
def test_every_jacobian_is_the_central_difference_of_its_cost(
    closed: Angles, off: Geometry, name: CostName, form: Form
) -> None:
    cost = cost_named(name, form)
    columns = cost.jacobian(close_loop(off, *closed), PARAMETERS)
    assert columns.shape == (51, EQUATIONS[name] if form == "vector" else 1, 9)
    for column, parameter in zip(columns, NAMES, strict=True):
        ahead, behind = (
            cost.residual(close_loop(off.replaced({parameter: off[parameter] + s * STEP}), *closed))
            for s in (1, -1)
        )
        assert np.abs(column - (ahead - behind) / (2 * STEP)).max() < TOLERANCE, parameter


@pytest.mark.parametrize("name", COSTS)
def test_what_a_cost_does_not_see_has_a_column_of_exact_zeros(
    closed: Angles, nominal: Geometry, name: CostName
) -> None:
    columns = cost_named(name, "vector").jacobian(close_loop(nominal, *closed), PARAMETERS)
    assert [
        n for n, column in zip(NAMES, columns, strict=True) if not column.any()
    ] == ZERO_JACOBIAN[name].split()


def test_a_cost_reports_only_the_parameters_asked_for_and_in_that_order(
    closed: Angles, off: Geometry
) -> None:
    closure = close_loop(off, *closed)
    for name in COSTS:
        cost = cost_named(name, "vector")
        every = cost.jacobian(closure, PARAMETERS)
        some = [INDEX[n] for n in ("bd3", "ra1", "oy")]
        assert np.array_equal(cost.jacobian(closure, [PARAMETERS[i] for i in some]), every[some])
        assert cost.jacobian(closure, []).shape == (0, *every.shape[1:])


def test_costs_are_those_printed_in_the_thesis(closed: Angles, off: Geometry) -> None:
    """Eqs. 2.1, 2.2 and 2.4 from homogeneous matrices, sample by sample."""
    closure = close_loop(off, *closed)
    robot, bar = robot_frames(off, closed[0]).poses(), bar_frames(off, closed[1]).poses()
    length = [
        float((r[:3, 3] - off.origin) @ (r[:3, 3] - off.origin) - off["bd3"] ** 2) for r in robot
    ]
    position = [float(((r - b)[:3, 3] ** 2).sum()) for r, b in zip(robot, bar, strict=True)]
    transform = [float(((r - b) ** 2).sum()) for r, b in zip(robot, bar, strict=True)]
    for name, expected in (("length", length), ("position", position), ("transform", transform)):
        assert cost_named(name, "thesis").residual(closure)[0] == pytest.approx(expected, rel=1e-12)
    assert (
        np.abs(closure.error[:3] - cost_named("position", "vector").residual(closure)).max() < 1e-15
    )  # ball-bar minus robot
    signed = cost_named("length", "vector").residual(closure)[0]
    assert signed == pytest.approx(
        [off["bd3"] - np.linalg.norm(r[:3, 3] - off.origin) for r in robot], abs=1e-14
    )


def test_cardan_angles_are_compared_with_those_that_would_hold_the_robots_tool(
    closed: Angles, nominal: Geometry
) -> None:
    """The robot stands where the ball-bar would be with other b3, b4, b5.

    The position agrees, and the angles differ by just that.
    """
    _, b = closed
    turned = np.random.default_rng(22).uniform(-0.3, 0.3, (9, 3))
    elsewhere = b + np.column_stack((np.zeros((9, 2)), turned))
    residual = cost_named("position_angles", "vector").residual(
        close_loop(nominal, robot_at(nominal, elsewhere), b)
    )
    assert np.abs(residual[:3]).max() < 1e-12
    assert np.abs(residual[3:].T - np.sin(-turned[:, 1:])).max() < 1e-11


def test_encoders_may_be_whole_turns_off_in_any_cost(closed: Angles, off: Geometry) -> None:
    q, b = closed
    for name in COSTS:
        here, there = (
            cost_named(name, "vector").residual(close_loop(off, q, angles))
            for angles in (b, b + 2 * np.pi * np.arange(-2, 3))
        )
        assert np.abs(here - there).max() < 1e-13


def test_c_ptheta_tells_bd2_from_balpha2_and_c_p_does_not(
    closed: Angles, nominal: Geometry
) -> None:
    """Thesis Table 3.2: bd2 | balpha2 stands in the row of C_P only, ra6 | ba5 in both."""
    for name, equal in (("position", True), ("position_angles", False)):
        pair = columns_of(name, closed, nominal, "bd2", "balpha2")
        assert (
            np.linalg.svd(pair / np.linalg.norm(pair, axis=1, keepdims=True), compute_uv=False)[-1]
            < 1e-9
        ) == equal
        plate = columns_of(name, closed, nominal, "ra6", "ba5")
        assert np.abs(plate.sum(axis=0)).max() < 1e-12


def columns_of(name: CostName, angles: Angles, geometry: Geometry, *parameters: str) -> Array:
    columns = cost_named(name, "vector").jacobian(
        close_loop(geometry, *angles), [PARAMETERS[INDEX[p]] for p in parameters]
    )
    return columns.reshape(len(parameters), -1)


def test_an_unknown_cost_or_form_is_refused_with_the_choices() -> None:
    with pytest.raises(
        ValueError,
        match="unknown cost 'lenght'; there are length, position, position_angles, transform",
    ):
        cost_named("lenght", "vector")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="unknown form 'scalar'; there are vector and thesis"):
        cost_named("length", "scalar")  # type: ignore[arg-type]

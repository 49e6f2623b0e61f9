"""Where an identified robot puts its tool when it stands free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, robot_frames, robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.payload import Payload, with_payload
from ballbar.cell.placement import Placement
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.loads.at_rest import UNDECIDED, UNDECIDED_WRIST, backlash_flanks
from ballbar.ident.loads.gear_loads import mass_model, own_weight
from ballbar.ident.robot.identified import IdentifiedRobot
from tests.helpers.six_axes import INDEX

CHOSEN = ("joint_compliance", "gear_backlash", "gear_ripple", "rod_strain", "encoder_harmonics")


@pytest.fixture(scope="module")
def q() -> Array:
    return np.random.default_rng(101).uniform(-0.6, 0.6, (20, 6))


@pytest.fixture(scope="module")
def robot(cell: Cell, nominal: Geometry) -> IdentifiedRobot:
    """Corrections of gears, rod and encoders, at values drawn about their priors."""
    corrections = tuple(CORRECTIONS[name](cell, (1,)) for name in CHOSEN)
    coefficients = [c for correction in corrections for c in correction.coefficients]
    drawn = np.random.default_rng(102).standard_normal(len(coefficients))
    values = np.array(
        [c.mean + 0.3 * c.sigma * z for c, z in zip(coefficients, drawn, strict=True)]
    )
    return IdentifiedRobot(cell, nominal, corrections, values)


def test_without_corrections_the_joints_are_as_logged(
    cell: Cell, nominal: Geometry, q: Array
) -> None:
    bare = IdentifiedRobot(cell, nominal)
    assert bare.joints(q) is q
    assert np.array_equal(bare.tool(q), robot_frames(nominal, q).tip.T)
    assert bare.jacobian(q, np.array([INDEX["ra2"]])).shape == (1, 3, 20)


def test_elastic_gears_yield_to_the_weight_of_arm_and_plate(
    cell: Cell, nominal: Geometry, q: Array
) -> None:
    compliance = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-6
    robot = IdentifiedRobot(cell, nominal, (CORRECTIONS["joint_compliance"](cell, ()),), compliance)
    lag = compliance[:, None] * own_weight(mass_model(cell), nominal, q).gear
    assert robot.joints(q) == pytest.approx(q - lag.T @ cell.robot.gear_to_joint, abs=1e-15)


def test_backlash_lies_on_the_flank_that_the_weight_presses_it_to(
    cell: Cell, nominal: Geometry, q: Array
) -> None:
    """Fully, however little the load exceeds what decides, and in the middle below it."""
    half = np.full(6, 1e-4)
    robot = IdentifiedRobot(cell, nominal, (CORRECTIONS["gear_backlash"](cell, ()),), half)
    load = own_weight(mass_model(cell), nominal, q).gear
    gears = (robot.joints(q) - q) @ cell.robot.joint_to_gear
    decided = np.abs(load) >= np.repeat([UNDECIDED, UNDECIDED_WRIST], 3)[:, None]
    assert decided.any()
    assert not decided.all()
    assert pytest.approx(np.where(decided, -1e-4 * np.sign(load), 0.0), abs=1e-15) == gears.T


def test_a_load_that_hardly_decides_leaves_a_gear_in_the_middle() -> None:
    load = np.array([[2.9, 3.1, -3.1]] * 3 + [[0.14, 0.16, -0.16]] * 3)
    assert np.array_equal(backlash_flanks(load), [[0, 1, -1]] * 6)


def test_the_tool_moves_as_its_jacobian_says(robot: IdentifiedRobot, q: Array) -> None:
    """Central differences; rod and encoders do not move a free tool."""
    names = ["ra2", "rtheta4", "ralpha1", "bd3", "ox"]
    parameters = np.array([INDEX[name] for name in names])
    columns = robot.jacobian(q, parameters)
    assert len(columns) == 5 + robot.values.size
    for k, name in enumerate(names):
        ahead, behind = (
            IdentifiedRobot(
                robot.cell,
                robot.geometry.replaced({name: robot.geometry[name] + h}),
                robot.corrections,
                robot.values,
            ).tool(q)
            for h in (1e-6, -1e-6)
        )
        # The arm's weight moves with its lengths, which the column leaves out: a thousandth.
        numeric = (ahead - behind).T / 2e-6
        assert columns[k] == pytest.approx(numeric, abs=1e-3), name
    for k, column in enumerate(columns[5:]):
        step = np.zeros_like(robot.values)
        step[k] = 1e-7
        ahead, behind = (
            IdentifiedRobot(
                robot.cell, robot.geometry, robot.corrections, robot.values + s * step
            ).tool(q)
            for s in (1.0, -1.0)
        )
        numeric = (ahead - behind).T / 2e-7
        assert column == pytest.approx(numeric, abs=1e-6 * max(1.0, np.abs(numeric).max())), k
    assert not columns[-8:].any()  # two of the rod, six of one encoder
    assert not columns[3:5].any()


@pytest.fixture(scope="module")
def still() -> IdentifiedRobot:
    """A robot of still poses: sag under unit weights, joint errors, links without masses."""
    ur5, rng = load_robot("ur5"), np.random.default_rng(103)
    corrections = (unit_weights(ur5), joint_harmonics([(1, 2), (3, 1)]))
    sigma = np.array([c.sigma for correction in corrections for c in correction.coefficients])
    values = sigma * rng.standard_normal(sigma.size)
    return IdentifiedRobot(ur5, robot_geometry(ur5), corrections, values)


@pytest.mark.parametrize(("name", "tolerance"), [("robot", 1e-3), ("still", 1e-7)])
def test_a_placed_tool_moves_as_its_jacobian_says(
    name: str, tolerance: float, q: Array, request: pytest.FixtureRequest
) -> None:
    """Central differences; the weight of a cell moves with its lengths, which is left out."""
    turn = matrix_from_rotvec(np.array([[0.1], [0.4], [-0.3]]))[:, :, 0]
    target = Placement(turn, np.array([0.02, -0.03, 0.11]))
    robot = replace(request.getfixturevalue(name), target=target)
    names, geometry = ("ra2", "rtheta4"), robot.geometry
    columns = robot.jacobian(q, np.array([geometry.table.index[n] for n in names]))
    changed = [
        [replace(robot, geometry=geometry.replaced({n: geometry[n] + h})) for h in (1e-6, -1e-6)]
        for n in names
    ]
    steps = 1e-6 * np.eye(robot.values.size)[:8]
    changed += [[replace(robot, values=robot.values + s * step) for s in (1, -1)] for step in steps]
    for column, (ahead, behind) in zip(columns, changed, strict=False):
        numeric = (ahead.tool(q) - behind.tool(q)).T / 2e-6
        assert column == pytest.approx(numeric, abs=tolerance * max(1.0, np.abs(numeric).max()))
    assert np.array_equal(robot.poses(q)[:, :3, 3], robot.tool(q))


def test_values_that_do_not_fit_the_corrections_are_refused(
    robot: IdentifiedRobot, q: Array
) -> None:
    short = IdentifiedRobot(robot.cell, robot.geometry, robot.corrections, robot.values[:-1])
    with pytest.raises(ValueError, match="zip"):
        short.tool(q)


def test_the_tool_moves_with_the_masses_as_the_robot_of_the_other_cell(
    cell: Cell, robot: IdentifiedRobot, q: Array
) -> None:
    """Every correction that does not depend on loads cancels."""
    body = cell.plate.body
    other = with_payload(cell, Payload(1.2 * body.mass, body.com + 0.01, 1.02))
    expected = replace(robot, description=other).tool(q) - robot.tool(q)
    moves = robot.moved_by_masses([other, cell], q)
    assert np.linalg.norm(expected, axis=1).min() > 5e-6
    # turns by 3e-5 rad under displacements of 1e-4 rad: second order is 1e-8 of a metre
    assert np.abs(moves[0].T - expected).max() < 2e-8
    assert not moves[1].any()


def test_the_structure_that_gives_way_moves_with_the_masses_too(
    cell: Cell, nominal: Geometry, q: Array
) -> None:
    """Bearings that tilt under the arm's weight: the difference of both motions, to first order."""
    tilt = CORRECTIONS["bearing_tilt"](cell, ())
    values = 3e-7 * np.linspace(1.0, 2.0, len(tilt.coefficients))
    soft = IdentifiedRobot(cell, nominal, (tilt,), values)
    body = cell.plate.body
    other = with_payload(cell, Payload(2.0 * body.mass, body.com, 1.0))
    expected = replace(soft, description=other).tool(q) - soft.tool(q)
    assert np.linalg.norm(expected, axis=1).max() > 1e-5
    moves = soft.moved_by_masses([other, cell], q)
    assert np.abs(moves[0].T - expected).max() < 1e-9
    assert not moves[1].any()

"""A result as a service: poses, joint angles, Jacobian and uncertainty with arrays."""

from __future__ import annotations

import runpy
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, nominal_chain, robot_frames
from ballbar.cell.numerical_inverse import dexterity, turned_near
from ballbar.cell.payload import Payload, with_deviations
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.export.formats import exported
from ballbar.export.result import load_result
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics, kinematics
from ballbar.ident.robot.tool_covariance import ToolCovariance
from ballbar.result.calibration import Calibration, load
from ballbar.result.machine_entries import covariance_entry
from tests.helpers.calibrations import GEARS, corrections_of, write_calibration_of
from tests.helpers.pose_results import RANGE, write_pose_result
from tests.helpers.simulated_recordings import perturbed
from tests.helpers.source_imports import ROOT

LOADED = (*GEARS, "bearing_tilt")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, cell: Cell, nominal: Geometry) -> Path:
    rng = np.random.default_rng(3)
    return write_calibration_of(
        tmp_path_factory.mktemp("run") / "calibration.yaml",
        nominal,
        perturbed(nominal, rng, 5e-4),
        corrections=corrections_of(cell, LOADED, rng),
    )


@pytest.fixture(scope="module")
def calibration(result: Path) -> Calibration:
    return load(result.parent)


@pytest.fixture(scope="module")
def robot(calibration: Calibration) -> IdentifiedKinematics:
    return calibration.kinematics()


def random_angles(robot: IdentifiedKinematics, count: int, seed: int = 1) -> Array:
    own, rng = robot.robot, np.random.default_rng(seed)
    return controller_to_joints(
        own, rng.uniform(own.accuracy_lower, own.accuracy_upper, (count, own.joints))
    )


def test_geometry_alone_puts_the_tool_where_mujoco_puts_that_of_the_exported_model(
    result: Path, calibration: Calibration
) -> None:
    bare = Calibration(calibration.file.model_copy(update={"corrections": {}}), result)
    robot = bare.kinematics()
    q = random_angles(robot, 50)
    model = mujoco.MjModel.from_xml_string(exported(load_result(result), "mjcf"))
    data, site = mujoco.MjData(model), mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tool")
    poses = robot.forward(q)
    for angles, pose in zip(q, poses, strict=True):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.site_xpos[site], pose[:3, 3], rtol=0.0, atol=1e-9)
        turned = data.site_xmat[site].reshape(3, 3)
        np.testing.assert_allclose(turned, pose[:3, :3], rtol=0.0, atol=1e-9)


def compliant(cell: Cell, nominal: Geometry, payload: Payload) -> IdentifiedKinematics:
    """A robot of which nothing but the catalogue's gear compliance is known."""
    made = joint_compliance(cell.robot)
    values = np.array([c.mean for c in made.coefficients])
    robot = IdentifiedRobot(cell, nominal, (made,), values)
    return kinematics(robot, nominal.robot, payload=payload)


def test_a_payload_winds_the_gears_up_by_its_weight(cell: Cell, nominal: Geometry) -> None:
    """Against torque times compliance, with the lever arms taken from the frames."""
    payload, nothing = Payload(12.0, np.array([0.03, -0.02, 0.15])), Payload(1e-12, np.zeros(3))
    light, heavy = (compliant(cell, nominal, p) for p in (nothing, payload))
    q = random_angles(light, 20)
    frames = forward(nominal_chain(cell.robot), q)
    centre = (frames.poses() @ np.r_[payload.com, 1.0])[:, :3]
    lift = -payload.mass * cell.robot.gravity
    arms = [centre - origin.T for origin in frames.origin[:6]]
    torque = [
        np.einsum("nc,cn->n", np.cross(arm, lift), axis)
        for arm, axis in zip(arms, frames.z[:6], strict=True)
    ]
    compliance = 1.0 / cell.robot.required("gears").stiffness
    to_joint = cell.robot.gear_to_joint
    expected = -((to_joint @ np.stack(torque)) * compliance[:, None]).T @ to_joint
    moved = heavy.identified.joints(q) - light.identified.joints(q)
    np.testing.assert_allclose(moved, expected, rtol=0.0, atol=1e-12)
    assert np.abs(expected).max() > 1e-4


def test_a_tool_is_placed_in_the_flange_and_the_default_is_the_end_of_the_plate(
    cell: Cell, nominal: Geometry
) -> None:
    robot = IdentifiedRobot(cell, nominal)
    q = random_angles(kinematics(robot, nominal.robot), 5)
    tool = np.eye(4)
    tool[:3, 3] = [0.1, 0.2, 0.3]
    placed = kinematics(robot, nominal.robot, tool=tool).forward(q)
    expected = forward(nominal_chain(cell.robot), q).poses() @ tool
    np.testing.assert_allclose(placed, expected, rtol=0.0, atol=1e-12)
    end = kinematics(robot, nominal.robot).forward(q)
    np.testing.assert_allclose(end, robot_frames(nominal, q).poses(), rtol=0.0, atol=1e-12)


def test_every_configuration_leads_to_its_pose_and_the_given_angles_are_among_them(
    robot: IdentifiedKinematics,
) -> None:
    q = random_angles(robot, 200)
    every = robot.inverse(robot.forward(q))
    reached = robot.forward(every.q[every.reached])
    wanted = np.broadcast_to(robot.forward(q), (8, 200, 4, 4))[every.reached]
    assert np.abs(reached - wanted).max() < 2e-7
    plain = ~every.singular.any(axis=0)
    off = np.abs(every.q[:, plain] - q[plain]).max(axis=2)
    assert (np.nanmin(off, axis=0) < 1e-6).mean() > 0.99, "but where backlash has both flanks"
    assert every.reached.sum(axis=0).max() == 8, "wrist, elbow and shoulder both ways"
    axes = joints_to_axes(robot.robot, every.q)
    inside = (axes >= robot.robot.axis_lower) & (axes <= robot.robot.axis_upper)
    np.testing.assert_array_equal(every.within, inside.all(axis=2))
    assert 0.1 < every.within[every.reached].mean() < 0.9


def test_the_nearest_solution_is_the_seed_or_the_wrist_says_that_it_is_near_singular(
    robot: IdentifiedKinematics,
) -> None:
    q = random_angles(robot, 2000, seed=2)
    solved = robot.nearest(robot.forward(q), q + 0.05)
    assert (solved.reached | solved.singular).all()
    plain = solved.reached & ~solved.singular
    assert (np.abs(solved.q - q)[plain].max(axis=1) < 1e-5).mean() > 0.998
    assert plain.mean() > 0.85
    assert solved.within[plain].mean() > 0.99
    stretched = q[:1].copy()
    stretched[0, 4] = 1e-4
    (singular,) = robot.nearest(robot.forward(stretched), stretched).singular
    assert singular


def test_an_axis_keeps_its_turn_unless_that_leaves_its_range(robot: IdentifiedKinematics) -> None:
    q = random_angles(robot, 1)
    q[0, 4:] = 0.7, np.deg2rad(300.0)
    (same,) = robot.nearest(robot.forward(q), q).q
    assert same[5] == pytest.approx(q[0, 5], abs=1e-6)
    beyond = q + 2.0 * np.pi * np.eye(6)[5]
    np.testing.assert_allclose(turned_near(robot.robot, q, beyond), q, rtol=0.0, atol=1e-12)
    below = q - 2.0 * np.pi * np.eye(6)[5]
    np.testing.assert_allclose(turned_near(robot.robot, q, below), below, rtol=0.0, atol=1e-12)


def test_a_pose_out_of_reach_is_said_to_be(robot: IdentifiedKinematics) -> None:
    far = robot.forward(random_angles(robot, 3))
    far[:, 0, 3] += 5.0
    assert not robot.inverse(far).reached.any()
    assert not robot.nearest(far, random_angles(robot, 3)).reached.any()


def test_the_jacobian_is_the_difference_quotient_of_the_poses(
    cell: Cell, nominal: Geometry, robot: IdentifiedKinematics
) -> None:
    """Exact to rounding for geometry; ripple of gears adds half a percent (order by amplitude)."""
    tool = np.eye(4)
    tool[:3, 3] = [0.1, 0.2, 0.3]
    rigid = kinematics(IdentifiedRobot(cell, nominal), nominal.robot, tool=tool)
    for own, tolerance in ((rigid, 1e-8), (robot, 1e-2)):
        q, step = random_angles(own, 30), 1e-6
        jacobian = own.jacobian(q)
        for j in range(6):
            change = step * np.eye(6)[j]
            after, before = own.forward(q + change), own.forward(q - change)
            turned = after[:, :3, :3] @ before[:, :3, :3].transpose(0, 2, 1)
            shift = after[:, :3, 3] - before[:, :3, 3]
            turn = rotvec_from_matrix(turned.transpose(1, 2, 0)).T
            quotient = np.hstack((shift, turn)) / (2.0 * step)
            np.testing.assert_allclose(jacobian[:, :, j], quotient, rtol=0.0, atol=tolerance)


def drawn_covariance(cell: Cell, nominal: Geometry, seed: int) -> ToolCovariance:
    """All parameters of the robot, its gears and two directions of masses, all correlated."""
    rng = np.random.default_rng(seed)
    names = [p.name for p in nominal.table.parameters if p.side == "robot"]
    gears = joint_compliance(cell.robot).coefficients
    size = np.array([1e-5] * len(names) + [0.02 * c.mean for c in gears] + [1.0, 1.0])
    root = 0.3 * rng.standard_normal((size.size, size.size)) + np.eye(size.size)
    masses = 2e-3 * rng.standard_normal((2, 28))
    values = (root @ root.T) * np.outer(size, size)
    return ToolCovariance((*names, *(c.name for c in gears)), masses, values)


class Aligned:
    """Robots that differ by a change of the unknowns, bases aligned over the accuracy grid."""

    def __init__(self, cell: Cell, nominal: Geometry) -> None:
        made = joint_compliance(cell.robot)
        values = np.array([c.mean for c in made.coefficients])
        self.nominal, self.covariance = nominal, drawn_covariance(cell, nominal, 4)
        self.robot = IdentifiedRobot(
            cell,
            nominal,
            (made,),
            values,
            ranges=np.tile([-4.0, 4.0], (6, 1)),
            stated=self.covariance,
        )
        self.tool = np.eye(4)
        self.tool[:3, 3] = [0.1, -0.2, 0.3]
        self.service = kinematics(self.robot, nominal.robot, tool=self.tool)
        self.q = random_angles(self.service, 4, seed=7)
        self.grid = accuracy_grid(cell.robot)
        self.here, self.there = (self.service.forward(a)[:, :3, 3] for a in (self.grid, self.q))

    def errors(self, x: Array) -> tuple[Array, Array]:
        """(4, 3) [m] at the poses for a change x of the unknowns, and without scale."""
        gears, names, nominal = 6, self.covariance.names, self.nominal
        parameters = [n for n in names if n in nominal.table.index]
        moved = kinematics(
            replace(
                self.robot,
                description=with_deviations(self.robot.cell, x[-2:] @ self.covariance.masses),
                geometry=nominal.replaced(
                    {n: nominal[n] + v for n, v in zip(parameters, x, strict=False)}
                ),
                values=self.robot.values + x[-2 - gears : -2],
            ),
            nominal.robot,
            tool=self.tool,
        )
        centre, there = self.here.mean(axis=0), moved.forward(self.grid)[:, :3, 3]
        u, s, vt = np.linalg.svd((self.here - centre).T @ (there - there.mean(axis=0)))
        back = (moved.forward(self.q)[:, :3, 3] - there.mean(axis=0)) @ (u @ vt).T
        factor = s.sum() / ((self.here - centre) ** 2).sum()
        return back + centre - self.there, back / factor + centre - self.there


def test_the_uncertainty_is_that_of_robots_one_standard_deviation_off_with_their_bases_aligned(
    cell: Cell, nominal: Geometry
) -> None:
    """Each column of the covariance's root as a robot of its own, by central differences.

    The product of a link's heavier mass and its moved centre is left out: 0.2 % of either.
    """
    robots = Aligned(cell, nominal)
    stated = robots.service.uncertainty(robots.q)
    sums = np.zeros((2, 4, 3, 3))
    for column in 0.1 * robots.covariance.root.T:
        up, down = (np.stack(robots.errors(sign * column)) for sign in (1.0, -1.0))
        field = (up - down) / 0.2
        sums += field[..., :, None] * field[..., None, :]
    np.testing.assert_allclose(stated.covariance, sums[0], rtol=0.0, atol=1e-3 * sums.max())
    assert stated.covariance_without_scale is not None
    np.testing.assert_allclose(
        stated.covariance_without_scale, sums[1], rtol=0.0, atol=1e-3 * sums.max()
    )


@pytest.mark.long
def test_the_uncertainty_is_the_spread_of_drawn_robots(cell: Cell, nominal: Geometry) -> None:
    """From 400 robots a variance is known to 7 %, that of three directions together to 6 %."""
    robots, rng = Aligned(cell, nominal), np.random.default_rng(9)
    stated = robots.service.uncertainty(robots.q)
    root = robots.covariance.root
    drawn = np.stack([robots.errors(root @ rng.standard_normal(len(root))) for _ in range(400)])
    sigma = np.sqrt((drawn**2).sum(axis=3).mean(axis=0))
    assert stated.covariance_without_scale is not None
    without = np.sqrt(np.trace(stated.covariance_without_scale, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma[0] / stated.sigma, 1.0, atol=0.1)
    np.testing.assert_allclose(sigma[1] / without, 1.0, atol=0.1)


def test_a_covariance_survives_the_file_bit_by_bit(cell: Cell, nominal: Geometry) -> None:
    covariance = drawn_covariance(cell, nominal, 5)
    back = covariance_entry(covariance).covariance
    assert back.names == covariance.names
    np.testing.assert_array_equal(np.tril(back.values), np.tril(covariance.values))
    np.testing.assert_array_equal(back.masses, covariance.masses)


def test_outside_the_fitted_range_the_uncertainty_says_so(cell: Cell, nominal: Geometry) -> None:
    covariance = ToolCovariance(("ra2",), np.zeros((0, 28)), np.array([[1e-10]]))
    ranges = np.tile([-0.5, 0.5], (6, 1))
    robot = IdentifiedRobot(cell, nominal, ranges=ranges, stated=covariance)
    service = kinematics(robot, nominal.robot)
    q = np.full((2, 6), 0.2)
    assert service.uncertainty(q).covered.all()
    q[1, 2] = 0.6
    with pytest.warns(UserWarning, match=r"outside the fitted range of axis 3 \(-28.6 to 28.6 deg"):
        assert service.uncertainty(q).covered.tolist() == [True, False]
    assert np.isfinite(robot.sigma(q)).all(), "of recordings it is the model's"
    assert np.isfinite(robot.tool(q)).all(), "without a warning"


def test_a_calibration_without_covariance_states_no_uncertainty(
    robot: IdentifiedKinematics,
) -> None:
    with pytest.raises(InputError, match="states neither covariance nor fitted ranges"):
        robot.uncertainty(np.zeros((1, 6)))


def test_a_calibration_of_still_poses_serves_likewise(tmp_path: Path) -> None:
    loaded = load(write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=2))
    robot, arm = loaded.kinematics("frame"), loaded.identified_robot("frame")
    q = np.random.default_rng(3).uniform(-1.5, 1.5, (20, 6))
    poses = robot.forward(q)
    np.testing.assert_allclose(poses[:, :3, 3], arm.tool(q), rtol=0.0, atol=1e-12)
    solved = robot.nearest(poses, q + 0.02)
    assert (solved.reached | solved.singular).all()
    assert np.abs(solved.q - q)[~solved.singular].max() < 1e-6
    across = robot.nearest(poses[:5], np.zeros(6))
    assert across.reached.all(), "from far away the configurations are searched"
    every = robot.inverse(poses[:5])
    assert (np.nanmin(np.abs(every.q - q[:5]).max(axis=2), axis=0) < 1e-6).all()
    assert np.isfinite(robot.uncertainty(q).sigma).all()
    with pytest.warns(UserWarning, match="outside the fitted range of axis 2"):
        outside = robot.uncertainty(q + np.array([0.0, RANGE + 1.0, 0.0, 0.0, 0.0, 0.0]))
    assert np.isinf(outside.sigma[~outside.covered]).all()


@pytest.mark.parametrize("name", ["ur10", "kr10_r1100"])
def test_no_solution_farther_than_that_of_steps_from_the_given_angles_is_called_the_nearest(
    tmp_path: Path, name: str
) -> None:
    """Regression: what the search had, which misses postures, replaced what the steps reached."""
    loaded = load(write_pose_result(tmp_path / "calibration.yaml", name, seed=2))
    solver, rng = loaded.kinematics("frame"), np.random.default_rng(5)
    q = rng.uniform(-1.5, 1.5, (300, 6))
    previous = q + rng.uniform(-0.6, 0.6, q.shape)
    solved = solver.nearest(solver.forward(q), previous)
    farther = ((solved.q - previous) ** 2).sum(axis=1) > ((q - previous) ** 2).sum(axis=1) + 1e-6
    axes = joints_to_axes(solver.robot, q)
    inside = ((axes >= solver.robot.axis_lower) & (axes <= solver.robot.axis_upper)).all(axis=1)
    assert inside.sum() > 100
    assert farther[inside].mean() <= 0.01, "8 and 9 of 300 before"
    every = solver.inverse(solver.forward(q))
    off = np.abs(np.angle(np.exp(1j * (every.q - q)))).max(axis=2)
    assert np.nanmin(off, axis=0).max() < 1e-4, "13 and 11 of 300 were missed"


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["irb4600", *(pytest.param(name, marks=pytest.mark.long) for name in ("nj220", "ur10"))]
)
def test_the_posture_next_to_the_given_angles_is_kept(tmp_path: Path, name: str) -> None:
    """Regression: 80 of 50 000 postures turned into others, with good flags, where the nominal arm
    has none, and others left the axis ranges."""
    loaded = load(write_pose_result(tmp_path / "calibration.yaml", name, seed=2))
    solver = loaded.kinematics("frame")
    own, rng = solver.robot, np.random.default_rng(5)
    axes = rng.uniform(own.axis_lower, own.axis_upper, (20_000, own.joints))
    q = controller_to_joints(own, axes)
    plain = dexterity(solver.identified.chain, solver.identified.joints(q)) > 0.02
    solved = solver.nearest(solver.forward(q), q)
    turned = np.abs(joints_to_axes(own, solved.q) - axes).max(axis=1)
    assert (solved.reached & solved.within)[plain].all()
    assert turned[plain].max() < np.radians(1.0)


def test_rounded_poses_are_taken_as_the_rotations_that_they_are_of(
    robot: IdentifiedKinematics,
) -> None:
    """Regression: in single precision they were out of reach."""
    q = random_angles(robot, 50)
    poses = robot.forward(q)
    for rounded in (poses.astype(np.float32), np.round(poses, 5), poses.tolist()):
        solved = robot.nearest(rounded, q)
        assert solved.reached.mean() > 0.95
        assert robot.inverse(rounded).reached.any(axis=0).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros(6), r"of shape \(6,\). Give an array \(N, 6\) \[rad\]"),
        (np.full((2, 6), np.nan), "row 0 of 2"),
        (np.zeros((2, 5)), r"of shape \(2, 5\)"),
        (np.zeros((2, 6)) + 1j, "no real numbers"),
        ([["a"] * 6], "no real numbers"),
    ],
)
def test_what_are_no_joint_angles_is_refused(
    robot: IdentifiedKinematics, given: ArrayLike, message: str
) -> None:
    for method in (robot.forward, robot.jacobian, robot.uncertainty, robot.corrected):
        with pytest.raises(InputError, match=message):
            method(given)


@pytest.mark.parametrize(
    "spoilt",
    [(0, 0, 1.01), (3, 0, 5.0), (2, 2, -1.0), (0, 3, np.inf)],
    ids=["scaled", "last row", "mirrored", "infinite"],
)
def test_what_is_no_pose_is_refused(
    robot: IdentifiedKinematics, spoilt: tuple[int, int, float]
) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, spoilt[0], spoilt[1]] = spoilt[2]
    for solve in (robot.inverse, partial(robot.nearest, q=np.zeros(6))):
        with pytest.raises(InputError, match="row 1 of 3"):
            solve(poses)


def test_no_poses_and_whole_numbers_are_arrays_too(robot: IdentifiedKinematics) -> None:
    none = np.empty((0, 6))
    assert robot.forward(none).shape == (0, 4, 4)
    assert robot.corrected(none).q.shape == (0, 6)
    assert robot.nearest(np.empty((0, 4, 4)), np.zeros(6, dtype=int)).q.shape == (0, 6)
    with pytest.raises(InputError, match="3 joint angles for 2 poses"):
        robot.nearest(np.tile(np.eye(4), (2, 1, 1)), np.zeros((3, 6)))


def test_a_corrected_target_leads_the_identified_robot_to_the_nominal_pose(
    calibration: Calibration,
) -> None:
    robot = calibration.kinematics(payload=Payload(10.0, np.array([0.0, 0.0, 0.1])))
    q = random_angles(robot, 40)
    q = q[~robot.nearest(robot.forward(q), q).singular]
    done = robot.corrected(q)
    settled = done.position_after < 1e-6
    wanted = robot_frames(calibration.nominal, q).poses()
    assert np.abs(robot.forward(done.q) - wanted)[settled].max() < 2e-6
    assert settled.mean() > 0.9
    lighter = calibration.kinematics().corrected(q)
    assert np.abs(lighter.q - done.q).max() > 1e-5, "the payload counts"


def test_the_example_serves_a_result_to_a_plain_program(
    result: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["serve_kinematics.py", str(result.parent)])
    runpy.run_path(str(ROOT / "examples/serve_kinematics.py"), run_name="__main__")
    said = capsys.readouterr().out
    assert "reached True" in said
    assert "configurations within the axis ranges: 2" in said

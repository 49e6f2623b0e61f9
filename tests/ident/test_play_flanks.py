"""Simulated SO-101: the poses tell on which flank of its play each gear lies.

Where they do not, the stated deviation of the zero says so.
"""

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import import_poses
from ballbar.cell.arrays import Array
from ballbar.ident.estimates import result_at_rest
from ballbar.ident.play_flanks import on_flanks_of_poses
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_fit import fit_table
from ballbar.run import simulate
from ballbar.sim.truth import PoseTruth, load_truth
from tests.helpers.pictures import position_errors

JOINTS = (2, 3, 4)  # whose zeros pictures tell


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("so101")


def estimated(
    folder: Path, seed: int, order: Array | None = None
) -> tuple[TableEstimate, PoseTruth]:
    """Estimate from pictures, in another order of the poses where `order` (40,) is given."""
    made = folder / f"{seed}_{order is None}"
    simulate("so101_phone", made, overrides=[f"seed={seed}"])
    if order is not None:
        head, *rows = (made / "poses.csv").read_text().splitlines()
        (made / "poses.csv").write_text("\n".join([head, *(rows[i] for i in order)]) + "\n")
    truth = load_truth(made.with_name(f"{made.name}.truth.yaml"))
    assert isinstance(truth, PoseTruth)
    return fit_table(import_poses(made).table), truth


def zeros(estimate: TableEstimate, truth: PoseTruth) -> tuple[Array, Array]:
    """[deg] errors of the zeros, and what is stated of them."""
    names, sigma = estimate.fit.model.unknowns.names, np.sqrt(np.diag(estimate.fit.covariance))
    places = [names.index(f"rtheta{j}") for j in JOINTS]
    true = np.array(truth.dh.theta)[[j - 1 for j in JOINTS]]
    return np.rad2deg(estimate.fit.x[places] - true), np.rad2deg(sigma[places])


def play(estimate: TableEstimate, truth: PoseTruth) -> Array:
    """(5,) [rad] errors of half the play."""
    first = estimate.fit.model.unknowns.names.index("backlash1")
    return np.asarray(estimate.fit.x[first : first + 5] - truth.gear_backlash_half_width_rad)


def test_a_pose_on_another_flank_than_friction_says_makes_no_sure_zero(folder: Path) -> None:
    """The weight presses the gear of joint 3 to one flank in all poses; friction, as far as it is
    known, would put one of them on the other, and with it the zero 0.4 deg off.
    """
    estimate, truth = estimated(folder, 2)
    error, stated = zeros(estimate, truth)
    assert (np.abs(error) < 2.0 * stated).all()
    assert stated[0] < 0.1
    assert (stated[1:] > 0.3).all()  # half the play
    (warning,) = (w for w in result_at_rest(estimate).verdict.warnings if "no pose tells" in w)
    assert "rtheta3 (0.44 deg), rtheta4 (0.44 deg)" in warning
    assert "rtheta2" not in warning


def test_poses_tell_the_flanks_of_a_gear_that_friction_leaves_open(folder: Path) -> None:
    estimate, truth = estimated(folder, 10)
    error, stated = zeros(estimate, truth)
    assert (np.abs(error[:2]) < 0.15).all()
    assert (stated[:2] < 0.1).all()
    assert (np.abs(play(estimate, truth)[:3]) < 1e-3).all()


def test_the_order_of_the_poses_need_not_be_known(folder: Path) -> None:
    """Gears that nothing presses to a flank, of the first and the last joint, lie where the poses
    tell, not where the joint came from."""
    order = np.random.default_rng(2).permutation(40)
    estimate, truth = estimated(folder, 2, order)
    assert (np.abs(play(estimate, truth)[[0, 4]]) < 1e-3).all()
    error, stated = zeros(estimate, truth)
    assert (np.abs(error) < 2.0 * stated + 0.05).all()


def test_the_tool_s_uncertainty_has_the_play_that_friction_decides(folder: Path) -> None:
    """The first joint's weight never decides: the tool may be half its play beside."""
    estimate, truth = estimated(folder, 7)
    robot = estimate.identified_robot()
    q, half = robot.workspace(), np.array(truth.gear_backlash_half_width_rad)
    arm, point = truth.arm(estimate.table.robot), truth.targets[estimate.target].position
    side = np.zeros((len(q), 5))
    side[:, [0, 4]] = np.random.default_rng(1).choice([-1.0, 1.0], (len(q), 2))
    true = arm.target(q + side * half, point)
    error = position_errors(robot.tool(q), true)
    stated = np.sqrt((robot.sigma(q) ** 2).mean())
    assert 0.4 < np.sqrt((error**2).mean()) / stated < 1.2
    levelled = np.linalg.norm(arm.target(q, point)[:, :2], axis=1) * half[0]
    assert (robot.sigma(q) > 0.8 * levelled).all()


def test_settled_flanks_stay_as_they_are(folder: Path) -> None:
    estimate, _ = estimated(folder, 11)
    model = estimate.fit.model
    assert on_flanks_of_poses(estimate.fit).model.poses is model.poses

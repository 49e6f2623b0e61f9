"""The uncertainty budget adds up, and its rows are what their sources do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.ident.estimates import result_at_rest
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.variance_parts import noise_sources, variance_parts
from ballbar.ident.estimator.whitening import covariance
from ballbar.ident.identify import kinematic_result
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import fit_recording
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import accuracy_grid, rigid_basis
from ballbar.ident.robot.budget import LEFT_OUT, UNMODELLED, Budget, BudgetRow, welch_satterthwaite
from ballbar.ident.robot.coverage import coverage_factor, exact_squares, is_in_doubt
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.ident.table_fit import fit_table
from tests.helpers.minute_logs import minute_logs
from tests.helpers.still_poses import table_of, true_robot
from tests.helpers.synthetic_recording import CELL

OPTIONS = FitOptions(model="dh", samples=60)


def budget_of(result: Identification) -> Budget:
    assert result.budget is not None
    return result.budget


@pytest.fixture(scope="module")
def kinematic() -> Identification:
    return kinematic_result(CELL, fit_recording(CELL, minute_logs(), OPTIONS), OPTIONS)


@pytest.fixture(scope="module")
def at_rest() -> Identification:
    return result_at_rest(fit_table(table_of(true_robot("ur5"), count=60)))


def check_sum(result: Identification) -> None:
    """Rows add up to the stated uncertainty, and the fit's noise and priors to its covariance."""
    made, sigma = budget_of(result), result.robot.tcp.sigma
    squares = sum(np.sign(row.contribution) * row.contribution**2 for row in made.rows)
    assert squares == pytest.approx((sigma**2).mean(), rel=1e-9)
    assert sum(row.share for row in made.rows) == pytest.approx(1.0, rel=1e-9)
    assert made.combined == pytest.approx(np.sqrt(squares), rel=1e-9)
    assert (made.mean, made.worst) == (sigma.mean(), sigma.max())
    fit = result.solved
    assert fit is not None
    rows = np.arange(fit.model.unknowns.count)
    parts = variance_parts(fit, rows, str)
    whole = inverse(fit.linear.normal)
    scale = np.sqrt(np.outer(np.diag(whole), np.diag(whole)))
    added = sum(part.covariance for part in parts)
    # the weights are those of the last iteration
    assert np.abs((added - whole) / scale).max() < 1e-4


def test_rows_add_up_of_a_recording(kinematic: Identification) -> None:
    check_sum(kinematic)
    names = {row.name for row in budget_of(kinematic).rows}
    assert {"plate", "axes", "joint_log", "bar_log", UNMODELLED} <= names


def test_rows_add_up_of_still_poses(at_rest: Identification) -> None:
    check_sum(at_rest)
    names = {row.name for row in budget_of(at_rest).rows}
    assert {"instrument", "robot", "position", LEFT_OUT, UNMODELLED} <= names


@pytest.mark.slow
def test_rows_add_up_of_corrections_masses_and_points(
    drawn_alone: Identification, drawn_mixed: Identification
) -> None:
    results = drawn_alone, drawn_mixed
    for result in results:
        check_sum(result)
    alone, both = ({row.name: row for row in budget_of(r).rows} for r in results)
    assert {"masses", "joint_compliance", "plate", "axes"} <= alone.keys()
    assert "instrument" in both
    assert both["plate"].contribution < alone["plate"].contribution  # points show the scale


def test_sources_by_themselves_are_the_noise_of_all(
    kinematic: Identification, at_rest: Identification
) -> None:
    for fit in (kinematic.solved, at_rest.solved):
        assert fit is not None
        (point,) = fit.linear.evaluations
        excess = replace(fit.excess, gear=2e-5, wrist=1e-5, rotation=1e-4)
        uncertain = np.full((6, point.samples.size), 3e-5)
        together = covariance(point.noise_columns(excess, uncertain))
        added = np.zeros_like(together)
        for _, columns, _ in noise_sources(point, excess, uncertain):
            added += np.einsum("kin,kjn->ijn", columns, columns)
        assert added == pytest.approx(together, rel=1e-9, abs=1e-20)


def test_the_row_of_the_plate_is_what_another_plate_does(kinematic: Identification) -> None:
    """The fit with a plate one standard uncertainty longer: exact, of another path through it."""
    row = next(row for row in budget_of(kinematic).rows if row.name == "plate")
    longer = replace(
        CELL, plate=replace(CELL.plate, length=CELL.plate.length + row.standard_uncertainty)
    )
    other = kinematic_result(longer, fit_recording(longer, minute_logs(), OPTIONS), OPTIONS)
    grid = accuracy_grid(CELL.robot)
    here = kinematic.robot.identified.tool(grid)
    moved = (other.robot.identified.tool(grid) - here).ravel()
    basis = rigid_basis(here)
    moved -= basis @ (basis.T @ moved)
    size = np.sqrt((moved**2).sum() / len(grid))
    assert row.standard_uncertainty == pytest.approx(CELL.plate.length_sigma, rel=1e-3)
    assert row.contribution == pytest.approx(size, rel=0.02)
    assert row.sensitivity[0] * row.standard_uncertainty == pytest.approx(row.contribution)


def row(share: float, freedom: float | None) -> BudgetRow:
    return BudgetRow("", "", "A", "normal", 1.0, "m", 0.0, 0.0, share, freedom)


def test_effective_degrees_of_freedom_of_the_gum_s_end_gauge() -> None:
    """JCGM 100:2008, H.1.6: 16.7 of a combined uncertainty of 32 nm."""
    parts = [(25.0, 18.0), (9.7, 25.6), (2.9, 50.0), (16.6, 2.0)]
    rows = [row(u**2 / 1002.0, freedom) for u, freedom in parts]
    assert welch_satterthwaite(rows) == pytest.approx(16.7, abs=0.05)
    assert welch_satterthwaite([row(1.0, None)]) is None
    assert welch_satterthwaite([row(1.0, None), row(1e-9, 5.0)]) is None  # no file holds 5e18


def test_k_is_that_of_the_normal_and_of_student_s_distribution() -> None:
    rng = np.random.default_rng(5)
    one = rng.normal(size=(4000, 40)) ** 2
    three = (rng.normal(size=(4000, 40, 3)) ** 2).sum(axis=2) / 3.0
    assert coverage_factor(one, None, rng) == pytest.approx(1.960, abs=0.01)
    assert coverage_factor(three, None, rng) == pytest.approx(np.sqrt(7.815 / 3.0), abs=0.01)
    assert coverage_factor(one, 10.0, rng) == pytest.approx(2.228, abs=0.05)


def test_angles_that_are_hardly_known_pass_the_exact_kinematics(at_rest: Identification) -> None:
    """The tool swings about one axis: it is off by a chord, where the linear law states an arc."""
    robot, angle = at_rest.robot.identified, 0.3  # [rad] standard uncertainty
    stated = robot.stated
    assert isinstance(stated, PoseCovariance)
    k = [robot.geometry.table.names[i] for i in stated.parameters].index("rtheta2")
    values = np.zeros_like(stated.values)
    values[k, k] = angle**2
    framed = replace(stated, values=values, discrepancy=0.0)
    wide = replace(robot, stated=framed)
    assert not budget_of(at_rest).exact
    assert is_in_doubt(wide, 1e-3)
    chords = np.sqrt(exact_squares(wide, np.random.default_rng(1)))
    assert np.ptp(chords, axis=1).max() < 1e-6  # whatever the lever
    arcs = 2.0 * np.arcsin(0.5 * angle * chords[:, 0]) / angle
    assert (chords[:, 0] <= arcs).all()
    assert 0.6 < (arcs**2).mean() < 1.5  # 60 draws

"""Robots with known errors are identified from still poses, and what is wrong is said."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.load import load_robot
from ballbar.cell.poses import PoseTable
from ballbar.ident.corrections.unit_weights import PRIOR as SAG_PRIOR
from ballbar.ident.cross_validation import PLACES, cross_validated, places_of, with_folds
from ballbar.ident.estimator.observations import rounding
from ballbar.ident.estimator.robust_fit import GROSS, HUBER, fit_robustly, robust_weights
from ballbar.ident.evidence import Evidence
from ballbar.ident.findings import findings_of, lengths_of
from ballbar.ident.held_out import PoseHeldOut, held_out_poses
from ballbar.ident.options import FitOptions, JointErrors
from ballbar.ident.robot.accuracy import position_error
from ballbar.ident.robot.identified import range_sentence
from ballbar.ident.start.placements import PoseStartError, start_of_poses
from ballbar.ident.table_estimate import TableEstimate, position_errors
from ballbar.ident.table_fit import fit_table, linearised, sag
from ballbar.ident.table_remarks import table_remarks
from ballbar.ident.verdict import Status
from tests.helpers.still_poses import (
    SEAT,
    TARGET,
    TrueRobot,
    angles,
    group,
    socket_table,
    table_of,
    true_robot,
    verdict_of,
    with_group,
)

PLAIN = FitOptions(joint_errors="none")


def tcp_error(result: TableEstimate, true: TrueRobot, seed: int = 9) -> float:
    """[m] mean error of the target over new poses within the fitted ranges, base aligned."""
    arm, q = result.identified_robot(), angles(true.name, 300, seed)
    q = q[arm.covered(q)]
    return position_error(arm.tool(q), true.positions(q)).mean


@pytest.mark.parametrize(
    ("name", "measured", "limit"),
    [  # [m] with 20 um of noise and 200 poses; measured 4 to 14 um
        ("ur5", "point", 1.5e-5),
        ("ur10", "pose", 1.5e-5),
        ("panda", "point", 2e-5),
        ("irb2400", "length", 3e-5),
    ],
)
def test_a_robot_is_identified_to_its_truth(name: str, measured: str, limit: float) -> None:
    true = true_robot(name)
    result = fit_table(table_of(true, measured), PLAIN)  # type: ignore[arg-type]
    assert verdict_of(result).status is Status.GOOD
    assert tcp_error(result, true) < limit
    assert result.residual_nominal.mean() > 10.0 * result.residual.mean()


def test_a_seven_axis_robot_is_identified_from_sockets_alone() -> None:
    true = true_robot("panda", sag=0.0)
    result = fit_table(socket_table(true, count=12), PLAIN)
    assert verdict_of(result).acceptable
    before = position_error(
        result.nominal.model.at_rest(result.nominal.x)[0].target_closure.robot.tip.T,
        true.positions(result.table.groups[0].q),
    ).mean
    assert result.cross_validation.mean < 0.3 * result.residual_nominal.mean()
    assert before > 0.0


def test_joint_errors_are_found_without_being_told() -> None:
    """Two orders of 200 urad are found, first of all, and lower the error of new poses."""
    true = true_robot("ur5", orders=[(1, 17), (2, 9)])
    table = table_of(true, count=400)
    result = fit_table(table)
    assert result.search is not None
    assert set(result.search.pairs[:2]) == {(1, 17), (2, 9)}
    assert tcp_error(result, true) < 0.2 * tcp_error(fit_table(table, PLAIN), true)


def test_white_noise_has_no_orders() -> None:
    for seed in range(3):
        result = fit_table(table_of(true_robot("ur5", seed=seed), count=300, seed=seed))
        assert result.search is not None
        assert result.search.orders == ()


def test_candidates_of_a_coupled_robot_move_what_their_correction_moves() -> None:
    """Gear 2 of an IRB 2400 turns joint 3 too (parallel rod)."""
    table = table_of(true_robot("irb2400"), count=60)
    learned = JointErrors(((1, 3),), (0.0, 0.0))
    fit = fit_table(table, replace(PLAIN, joint_errors=learned)).fit
    model = linearised(fit)
    column = model.jacobian[fit.model.unknowns.names.index("joint2_3_cos")]
    expected = model.joints[1] * np.cos(3.0 * model.angles[1])
    assert column == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_joint_errors_learned_on_one_table_are_kept_on_another() -> None:
    true = true_robot("ur5", orders=[(1, 17)])
    taught = fit_table(table_of(true, count=400))
    layout = taught.fit.model.unknowns
    names = [layout.names.index(f"joint2_17_{wave}") for wave in ("cos", "sin")]
    learned = JointErrors(((1, 17),), tuple(float(taught.fit.x[k]) for k in names))
    few = table_of(true, count=40, seed=3)
    with_it = fit_table(few, FitOptions(joint_errors=learned))
    assert tcp_error(with_it, true) < 0.5 * tcp_error(fit_table(few, PLAIN), true)


def test_stated_regions_hold_as_often_as_they_say() -> None:
    """New poses of ten robots; a model error that nobody declared is in the data."""
    inside = []
    for seed in range(10):
        true = true_robot("ur5", seed=seed, orders=[(0, 23), (1, 31), (2, 29)], amplitude=6e-5)
        result = fit_table(table_of(true, count=100, seed=seed), PLAIN)
        inside.append(result.within(table_of(true, count=200, seed=seed + 50)).mean())
        validation = cross_validated(result.fit)
        assert validation.sigma == result.cross_validation.sigma
    assert 0.92 < np.mean(inside) < 0.99


def test_outliers_are_named_and_do_not_spoil_the_robot() -> None:
    true = true_robot("ur5")
    table = table_of(true, count=200)
    values = table.groups[0].values.copy()
    values[[5, 50, 120]] += [[2e-3, 0.0, 0.0], [0.0, 5e-3, 0.0], [0.0, 0.0, 0.2]]
    result = fit_table(with_group(table, values=values), PLAIN)
    assert result.findings.outliers.tolist() == [5, 50, 120]
    remark = next(table_remarks(Evidence(table=result)))
    assert "3 poses far from the model" in remark
    assert "table.csv:7" in remark
    assert verdict_of(result).warnings[0] == remark
    assert ", 3 of them too far off to count: mean error" in result.sentence
    assert tcp_error(result, true) < 1.5e-5
    weights = robust_weights(result.fit.linear)[0]
    far = lengths_of(result.fit)
    assert (weights[far > 1.2 * GROSS] == 0.0).all()
    assert (weights[far < 0.8 * HUBER] == 1.0).all()


def test_poses_read_before_the_robot_stood_still_are_left_out() -> None:
    true = true_robot("ur5")
    q = angles("ur5", 200, 0)
    table = table_of(true, q=q)
    early = np.array([20, 60, 61, 130])
    read = q.copy()
    read[early] -= 2e-3 * (q[early] - q[early - 1])  # the last 0.2 % of the move were missing
    result = fit_table(with_group(table, q=read), PLAIN)
    assert set(early) <= set(result.findings.unsettled.tolist())
    assert any("before the robot stood still" in w for w in verdict_of(result).warnings)
    assert tcp_error(result, true) < 1.5e-5


def test_angles_that_are_all_read_too_early_are_reported() -> None:
    """0.05 % of every move is missing: no pose stands out, all of them together do."""
    true = true_robot("ur5")
    q = angles("ur5", 200, 0)
    table = table_of(true, q=q)
    assert fit_table(table, PLAIN).findings.unfinished == 0.0
    read = q.copy()
    read[1:] -= 5e-4 * np.diff(q, axis=0)
    result = fit_table(with_group(table, q=read), PLAIN)
    assert abs(result.findings.unfinished) == pytest.approx(5e-4, rel=0.3)
    assert any("of the last move missing" in warning for warning in verdict_of(result).warnings)


def test_a_drifting_base_is_reported() -> None:
    true = true_robot("ur5")
    table = table_of(true, count=300)
    time = np.linspace(0.0, 3600.0, 300)
    assert fit_table(with_group(table, time=time), PLAIN).findings.drifts == ()
    moved = table.groups[0].values + np.outer(time / 3600.0, [1e-4, 0.0, 0.0])
    result = fit_table(with_group(table, time=time, values=moved), PLAIN)
    (found,) = result.findings.drifts
    assert found.shift == pytest.approx(1e-4, rel=0.2)
    assert any("drifts against the robot by 0.1" in w for w in verdict_of(result).warnings)


def test_rounded_angles_are_seen_in_their_digits() -> None:
    q = angles("ur5", 200)
    assert not rounding(q).any()
    tenths = np.deg2rad(np.round(np.rad2deg(q), 1))
    assert np.rad2deg(rounding(tenths)) == pytest.approx(0.1)
    assert not rounding(np.deg2rad(np.round(np.rad2deg(q)))).any()  # whole degrees: commanded
    true = true_robot("ur5")
    table = table_of(true, q=q)
    result = fit_table(with_group(table, q=tenths), PLAIN)
    assert any("rounded to 0.1 deg" in w for w in verdict_of(result).warnings)
    assert tcp_error(result, true) < 2e-4


def test_a_zero_that_was_lost_is_found_and_named() -> None:
    """30 mrad, fifteen prior deviations: the prior's tails let it go."""
    true = true_robot("ur5")
    theta = true.chain.theta.copy()
    theta[2] += 0.03
    lost = replace(true, chain=replace(true.chain, theta=theta))
    result = fit_table(table_of(lost, count=60), PLAIN)
    assert tcp_error(result, lost) < 4e-5
    (far,) = [w for w in verdict_of(result).warnings if w.startswith("far from the catalogue")]
    assert re.search(r"rtheta3 \+(29|30)", far)


def test_sag_far_beyond_its_prior_is_identified() -> None:
    """Twenty prior deviations, as under a heavy tool, from 60 poses; measured 14 um."""
    true = true_robot("irb120", sag=20.0 * SAG_PRIOR)
    assert tcp_error(fit_table(table_of(true, count=60), PLAIN), true) < 4e-5


def test_a_scale_of_the_measured_values_is_named() -> None:
    """One per cent: the links would take it up, all in one proportion."""
    table = table_of(true_robot("ur5"), count=60)
    assert fit_table(table, PLAIN).scale_pull is None
    result = fit_table(with_group(table, values=1.01 * table.groups[0].values), PLAIN)
    assert result.scale_pull is not None
    assert result.scale_pull[0] == pytest.approx(0.01, abs=0.003)
    assert any("all in one proportion" in warning for warning in verdict_of(result).warnings)


def test_a_program_that_is_repeated_does_not_pass_for_many_poses() -> None:
    """15 poses, 8 times each, the servos 0.1 mrad off: no orders, and honest errors."""
    true = true_robot("ur5", orders=[(1, 6)])
    q = np.tile(angles("ur5", 15, 2), (8, 1))
    q = q + np.random.default_rng(1).normal(0.0, 1e-4, q.shape)
    result = fit_table(table_of(true, q=q))
    assert result.search is not None
    assert result.search.orders == ()
    assert any("120 rows are 15 poses" in warning for warning in verdict_of(result).warnings)
    assert result.cross_validation.mean > 0.7 * tcp_error(result, true)


def test_a_robot_that_came_out_worse_than_nominal_is_not_acceptable() -> None:
    """Ten poses, eight of them with an instrument that had been moved."""
    table = table_of(true_robot("ur5"), count=40)
    values = table.groups[0].values + np.where(np.arange(40) % 3 == 0, 8e-3, 0.0)[:, None]
    assert not verdict_of(fit_table(with_group(table, values=values), PLAIN)).acceptable


def test_another_robot_and_exchanged_joint_columns_are_not_the_declared_robot() -> None:
    other = replace(table_of(true_robot("ur10"), count=100), robot=load_robot("ur5"))
    table = table_of(true_robot("ur5"), count=100)
    swapped = with_group(table, q=table.groups[0].q[:, [0, 2, 1, 3, 4, 5]])
    for wrong in (other, swapped):
        verdict = verdict_of(fit_table(wrong, PLAIN))
        assert verdict.status is Status.IMPLAUSIBLE
        assert "Not the declared robot" in verdict.sentence


def test_too_few_poses_are_refused_with_the_number_that_is_needed() -> None:
    needed = r"6 poses give 18 equations for 27 unknowns .* at least 9 poses"
    with pytest.raises(InputError, match=needed):
        fit_table(table_of(true_robot("ur5"), count=6))


def test_a_joint_that_hardly_moved_is_named_with_its_range() -> None:
    true = true_robot("ur5")
    q = angles("ur5", 100)
    q[:, 2] = 0.7 + np.deg2rad(2.0) * np.linspace(0.0, 1.0, len(q))
    warnings = verdict_of(fit_table(table_of(true, q=q), PLAIN)).warnings
    (narrow,) = [warning for warning in warnings if "hardly moved" in warning]
    assert "joints that hardly moved: 3 (2.0 deg); their" in narrow


def test_gears_sag_by_their_load_only_where_masses_and_stiffness_are_both_stated() -> None:
    stated = load_robot("irb2400")
    for robot, names in (
        (stated, ["unit_weights", "joint_compliance"]),
        (replace(stated, gears=None), ["unit_weights"]),
        (replace(stated, links=None), ["unit_weights"]),
    ):
        assert [correction.name for correction in sag(robot)] == names


def test_the_gain_of_information_is_the_share_of_the_prior_variance_that_is_gone() -> None:
    result = fit_table(table_of(true_robot("ur5"), count=60), PLAIN)
    layout = result.fit.model.unknowns
    left = np.diag(result.fit.covariance) / layout.sigma**2
    assert result.information_gain == pytest.approx(np.maximum(0.0, 1.0 - left), abs=1e-12)
    assert result.information_gain.max() > 0.99  # 60 poses tell a length of 0.3 mm


def test_a_mirrored_frame_is_refused() -> None:
    table = table_of(true_robot("ur5"), count=50)
    group = table.groups[0]
    mirrored = replace(group, values=group.values * [1.0, -1.0, 1.0])
    with pytest.raises(PoseStartError, match="mirror image"):
        fit_table(replace(table, groups=(mirrored,)))


@pytest.mark.parametrize("measured", ["point", "length"])
def test_the_start_finds_seats_and_targets_by_the_nominal_robot(measured: str) -> None:
    true = true_robot("ur5")
    table = table_of(true, measured)  # type: ignore[arg-type]
    start = start_of_poses(table, nominal_chain(table.robot))
    assert np.linalg.norm(start.targets["ball"].origin - TARGET.origin) < 3e-3
    if measured == "point":
        seat = start.seats["tracker"]
        assert np.linalg.norm(seat.origin - SEAT.origin) < 5e-3
        assert np.abs(seat.rotation - SEAT.rotation).max() < 5e-3


def test_held_out_poses_are_explained_and_those_of_another_robot_are_not() -> None:
    true = true_robot("ur5")
    result = fit_table(table_of(true), PLAIN)
    held = replace(table_of(true, count=40, seed=8), name="later")
    outcome = held_out_poses(result, held)
    assert outcome.acceptable
    assert outcome.sentence.startswith("Held out later: 40 poses to 0.0")
    other = held_out_poses(result, table_of(true_robot("ur5", seed=77), count=40))
    assert not other.acceptable
    assert "does not explain these poses" in other.sentence


def test_outside_the_fitted_range_nothing_is_claimed() -> None:
    true = true_robot("ur5")
    q = angles("ur5", 400)
    result = fit_table(table_of(true, q=q[q[:, 0] < 0.0]), PLAIN)
    arm, beyond = result.identified_robot(), q[q[:, 0] > 0.2]
    assert np.isinf(arm.sigma(beyond)).all()
    assert np.isfinite(arm.sigma(q[q[:, 0] < 0.0])).all()
    assert 1 in arm.out_of_range(beyond)
    assert "outside the fitted range of axis 1 (" in range_sentence(arm.out_of_range(beyond))


def test_what_the_arm_states_of_a_pose_is_what_new_poses_show() -> None:
    """Root mean square error over stated sigma, in the frame of the instrument."""
    true = true_robot("ur5", orders=[(0, 23), (1, 31), (2, 29)], amplitude=6e-5)
    result = fit_table(table_of(true, count=100), PLAIN)
    judged = table_of(true, count=300, seed=4)
    error = np.linalg.norm(result.deviations(judged), axis=1)
    stated = result.identified_robot().sigma(judged.q)
    inside = np.isfinite(stated)
    assert 0.7 < np.sqrt((error[inside] ** 2).mean() / (stated[inside] ** 2).mean()) < 1.2
    assert result.identified_robot().within(judged.q, result.deviations(judged)).mean() > 0.9


def test_several_seats_and_targets_share_one_robot() -> None:
    """Two reflectors seen from two places of the tracker: better than either half alone."""
    true = true_robot("ur5")
    first = table_of(true, count=60, noise=1e-4)
    second = table_of(true, count=60, noise=1e-4, seed=6)
    moved = replace(second.groups[0], seat="second place", values=second.groups[0].values + 0.1)
    both: PoseTable = replace(first, groups=(*first.groups, moved))
    result = fit_table(both, PLAIN)
    assert set(result.fit.model.unknowns.seats) == {"tracker", "second place"}
    assert tcp_error(result, true) < tcp_error(fit_table(first, PLAIN), true)


def test_the_linearised_model_is_that_of_the_fit() -> None:
    result = fit_table(table_of(true_robot("ur5"), count=60), PLAIN)
    model = linearised(result.fit)
    gram = model.jacobian.reshape(len(model.jacobian), -1)
    normal = result.fit.linear.normal  # to rounding at its size
    off = np.abs(gram @ gram.T + model.prior_normal - normal).max()
    assert off < 1e-12 * np.abs(normal).max()
    gradient = gram @ model.residual.reshape(-1) + model.prior_gradient
    assert np.allclose(gradient, result.fit.linear.gradient)
    again = fit_robustly(result.fit.model, result.fit.x, result.fit.excess)
    assert np.allclose(position_errors(again), result.residual, atol=2e-6)
    assert findings_of(again).outliers.size == 0


def test_only_what_lies_beyond_the_fitted_range_is_said_to() -> None:
    error = np.full(5, 1e-4)
    inside = PoseHeldOut("later", error, 10.0 * error, 1e-4, {})
    assert inside.sentence.endswith("predicted 0.100 mm.")
    beyond = replace(inside, out_of_range={2: (-1.0, 0.5)})
    assert (
        "; some poses are outside the fitted range of axis 2 (-57.3 to 28.6 deg)" in beyond.sentence
    )


def test_what_was_measured_at_one_place_is_good_after_another_place_alone() -> None:
    """Sockets of one site stated 0.19 mm and a good fit where the next site shows 0.55."""
    table = socket_table(true_robot("panda"), count=40)
    sites = [
        replace(
            table,
            groups=tuple(g for g in table.groups if g.seat.startswith(site)),
            distances=tuple(d for d in table.distances if d.seats[0].startswith(site)),
        )
        for site in "012"
    ]
    result = fit_table(sites[0], FitOptions(joint_errors="none"))
    assert verdict_of(result).status is Status.SUSPECT
    assert "measured at one place, and the statement holds there" in verdict_of(result).sentence
    same, other = (held_out_poses(result, held) for held in sites[:2])
    assert not same.elsewhere
    assert other.elsewhere
    assert verdict_of(result, elsewhere=True).status is Status.GOOD
    two = replace(
        table,
        groups=sites[0].groups + sites[1].groups,
        distances=sites[0].distances + sites[1].distances,
    )
    assert verdict_of(fit_table(two, FitOptions(joint_errors="none"))).status is Status.GOOD


def test_a_place_left_out_is_predicted_as_by_a_fit_without_it() -> None:
    table = socket_table(true_robot("panda"), count=40)
    groups = tuple(  # the robot errs at site 2 in a way that the model has not
        replace(g, q=g.q + 2e-4 * np.sin(5.0 * g.q)) if g.seat.startswith("2") else g
        for g in table.groups
    )
    table = replace(table, groups=groups)
    result = fit_table(table, PLAIN)
    places = places_of(result.fit)
    assert len(set(places.values())) == 3
    fold = np.concatenate([np.full(g.size, places[g.seat]) for g in table.groups])
    validation = with_folds(result.fit, PLACES, fold)
    assert result.cross_validation.sigma >= validation.sigma
    for place in range(3):
        left = {g.seat for g in table.part(fold != place).groups}
        distances = tuple(d for d in table.distances if d.seats[0] in left)
        without = fit_table(replace(table.part(fold != place), distances=distances), PLAIN)
        outcome = held_out_poses(without, replace(table.part(fold == place), distances=()))
        assert validation.error[fold == place].mean() == pytest.approx(
            outcome.error.mean(), rel=0.3
        )


def test_the_figure_at_the_poses_and_the_extrapolated_one() -> None:
    """9.58 mm over ranges that a few poses opened, 0.26 at the poses of a UR10."""
    q = angles("ur5", 150, 0)
    clustered = np.where(np.arange(150)[:, None] < 140, q[0] + 0.15 * (q - q[0]), q)
    result = fit_table(table_of(true_robot("ur5"), q=clustered), PLAIN)
    assert result.sigma_at_poses.shape == (150,)
    assert result.sigma_at_poses.mean() < 0.95 * result.tcp_sigma.mean()


def test_a_pose_seen_from_three_seats_is_not_measured_repeatedly() -> None:
    lengths = table_of(true_robot("ur5"), "length", count=120)
    again = replace(lengths, groups=lengths.groups[:1] * 2)
    warnings = [verdict_of(fit_table(table, PLAIN)).warnings for table in (lengths, again)]
    said = [any("measured repeatedly" in warning for warning in each) for each in warnings]
    assert said == [False, True]


def test_a_table_without_noise_has_the_least_discrepancy_there_is() -> None:
    """0.1 um: with none at all the weights of other values would grow without limit."""
    true, q = true_robot("ur5", seed=1), angles("ur5", 60, 1)
    values = true.positions(q) - SEAT.origin
    part = group("point", "hall", q, values, np.full(values.shape, 5e-5))
    excess = fit_table(PoseTable("t", true.robot, (part,)), PLAIN).fit.excess
    assert excess.position == pytest.approx(1e-7, rel=1e-9)
    assert excess.rotation == 0.0


def test_the_discrepancy_of_poses_is_what_their_stated_noise_leaves_over() -> None:
    rng = np.random.default_rng(5)
    table = table_of(true_robot("ur5", seed=1), "pose", count=150, seed=1)
    (part,) = table.groups
    off = rng.standard_normal(part.values.shape) * [*[1e-4] * 3, *[3e-4] * 3]
    noisy = replace(part, values=part.values + off)
    excess = fit_table(replace(table, groups=(noisy,)), PLAIN).fit.excess
    # [m], [rad] 450 values of each tell 4 %; a sum of rotation vectors bends the turns a little
    assert excess.position == pytest.approx(1e-4, rel=0.15)
    assert excess.rotation == pytest.approx(3e-4, rel=0.25)

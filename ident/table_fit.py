"""From a table of still poses to the robot's parameters, joint errors and their uncertainty.

Start by the nominal robot -> geometry and sag -> search for joint errors by evidence -> everything
once more together -> cross-validation by regions of joint space. Where a seat or target moved
within the table, once more with two in its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain, robot_geometry
from ballbar.cell.poses import PoseTable
from ballbar.ident.corrections.base import Coefficient, Correction
from ballbar.ident.corrections.gear_backlash import gear_backlash
from ballbar.ident.corrections.gear_ripple import gear_ripple
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.corrections.joint_harmonics import PRIOR, joint_harmonics
from ballbar.ident.corrections.joint_lag import JOINT_LAG, joint_lag
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.cross_validation import cross_validated
from ballbar.ident.estimator.block_covariance import robust_covariance
from ballbar.ident.estimator.build_unknowns import still_unknowns
from ballbar.ident.estimator.common_scale import common_scale
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.model import Model, still_model
from ballbar.ident.estimator.observations import rounding_noise
from ballbar.ident.estimator.order_search import search_orders
from ballbar.ident.estimator.regions import pose_regions, poses_of
from ballbar.ident.estimator.robust_fit import fit_robustly, stacked
from ballbar.ident.estimator.unknowns import HELD, PlacedPoses, Unknowns
from ballbar.ident.findings import Findings, findings_of
from ballbar.ident.moved_seats import MOST, confirms, step_of
from ballbar.ident.options import DEFAULTS, SILENT, FitOptions, JointErrors, Listener
from ballbar.ident.play_flanks import on_flanks_of_poses
from ballbar.ident.start.placements import retimed, start_of_poses
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_steps import Step, refuse_large, refuse_merged, sized, split

SEEN = 4.0  # standard deviations from which the lag of a joint is seen
# [rad] backlash from which still poses show it; gears of industrial robots have less
PLAY = 3e-3
ZERO_BY_EYE = 0.1  # [rad] prior sigma of a zero of an arm with so much play
SEARCHED = 4000  # poses, evenly taken, that a search for joint errors needs at most


def fit_table(
    table: PoseTable, options: FitOptions = DEFAULTS, listener: Listener = SILENT
) -> TableEstimate:
    """A robot from still poses; a seat or target that moved has two names in the fit.

    Raises InputError where the table holds fewer equations than the robot has parameters, or where
    two seats or targets go by one name, and PoseStartError where measurements and robot cannot be
    brought together.
    """
    refuse_merged(table)
    listener.progress("finding seats and targets")
    start = start_of_poses(table, nominal_chain(table.robot))
    result = first = _estimated(start, options, listener)
    steps: tuple[Step, ...] = ()
    while len(steps) < MOST and (step := step_of(result.fit)) is not None:
        listener.progress(f"{step.kind} {step.name} moved: fitting once more")
        trial = _estimated(split(result.fit, step), options, listener)
        after = sized(trial.fit, (*steps, step))
        if not confirms(result.fit, trial.fit, step, after[-1]):
            break
        refuse_large(table, after[-1])
        result, steps = trial, after
    if not steps or result.cross_validation.strange:
        return first
    return replace(result, findings=replace(result.findings, steps=sized(result.fit, steps)))


def added_table(fit: Fit, covariance: Array) -> TableEstimate | None:
    """The still poses of a fit of recordings; None where there are none.

    covariance : (P, P) stated, of the unknowns.
    """
    if fit.model.table is None:
        return None
    fit = replace(fit, covariance=covariance)
    layout, table = fit.model.unknowns, fit.model.poses
    seats = {name: layout.seat(fit.x, name) for name in layout.seats}
    targets = {name: layout.target(fit.x, name) for name in layout.targets}
    nominal = _nominal(PlacedPoses(table, seats, targets))
    return TableEstimate(fit, nominal, cross_validated(fit), findings_of(fit))


def _nominal(still: PlacedPoses) -> Fit:
    """Seats and targets fitted to the robot as its file has it."""
    table, noise = still.table, rounding_noise(still.table.q)
    layout = still_unknowns(robot_geometry(table.robot), still, ()).held()
    return fit_robustly(still_model(table, layout, (), noise), layout.mean.copy())


def _estimated(still: PlacedPoses, options: FitOptions, listener: Listener) -> TableEstimate:
    """A robot from a table whose seats and targets stay where they are."""
    table = still.table
    noise = rounding_noise(table.q)
    learned = options.joint_errors
    fixed = [*_expected(table), *(_held(learned) if isinstance(learned, JointErrors) else [])]
    layout = still_unknowns(robot_geometry(table.robot), still, fixed)
    layout = _with_zeros_by_eye(table.robot, layout)
    _check_enough(table, layout)
    model = still_model(table, layout, fixed, noise)
    nominal = fit_robustly(replace(model, unknowns=layout.held()), layout.mean.copy())
    model = replace(model, table=retimed(nominal))
    listener.progress("fitting geometry and sag")
    fit = _without_unseen_lags(model, fit_robustly(model, nominal.x, nominal.excess))
    fit, findings = _without_unsettled(on_flanks_of_poses(fit))
    search = None
    if options.joint_errors == "auto":
        listener.progress("searching joint errors")
        search = search_orders(linearised(fit), PRIOR)
        if search.orders:
            listener.progress("fitting everything together")
            fit = _again(fit, (*fit.model.corrections, joint_harmonics(search.pairs)))
            fit, findings = _without_unsettled(fit)
    listener.progress("cross-validating")
    fit = _with_common_scales(fit, findings.unsettled)
    return TableEstimate(fit, nominal, cross_validated(fit), findings, search)


def _expected(table: PoseTable) -> list[Correction]:
    """Sag, and of a robot that moved what its gears and its controller's filters do besides, as far
    as its file states gears and masses.
    """
    robot, out = table.robot, sag(table.robot)
    if not table.moving.any():
        return [*out, *([gear_backlash(robot)] if _has_play(robot) else [])]
    out.append(joint_lag(robot))
    if robot.gears is not None:
        out += [gear_ripple(robot), *([] if robot.links is None else [gear_backlash(robot)])]
    return out


def _has_play(robot: Robot) -> bool:
    """Whether the gears have so much play that still poses show it, as hobby servos have."""
    stated = robot.gears is not None and robot.links is not None
    return stated and float(robot.required("gears").lost_motion.max()) > PLAY


def _with_zeros_by_eye(robot: Robot, layout: Unknowns) -> Unknowns:
    """The unknowns with wide priors of the zeros of an arm of servos, which are set by eye.

    A narrow one would have play take the place of a zero where a gear lies on one flank.
    """
    if not _has_play(robot):
        return layout
    zeros = np.array([name.startswith("rtheta") for name in layout.names])
    return replace(layout, sigma=np.where(zeros, ZERO_BY_EYE, layout.sigma))


def _without_unseen_lags(model: Model, fit: Fit) -> Fit:
    """The fit without lags of single joints where none of them is seen: few controllers have them,
    and what they leave open is much of a slow path.

    model : that was fitted, its priors as declared.
    """
    layout = model.unknowns
    others = tuple(c for c in model.corrections if c.name != JOINT_LAG)
    lags = {k.name for c in model.corrections if c not in others for k in c.coefficients}
    if not lags:
        return fit
    own = np.array([name in lags for name in layout.names])
    sigma = np.sqrt(np.diag(robust_covariance(fit)))
    if (np.abs(fit.x[own]) > SEEN * sigma[own]).any():
        return fit
    layout, x = layout.with_coefficients([k for c in others for k in c.coefficients], fit.x)
    model = replace(model, unknowns=layout, corrections=others)
    return fit_robustly(model, x, fit.excess)


def sag(robot: Robot) -> list[Correction]:
    """Unit weights at the frames' origins; elastic gears too where masses and gears are stated."""
    stated = robot.links is not None and robot.gears is not None
    return [unit_weights(robot), *([joint_compliance(robot)] if stated else [])]


def linearised(fit: Fit) -> LinearModel:
    """A fit at its estimate, as the search for joint errors takes it."""
    equations, model, robot = fit.linear, fit.model, fit.model.poses.robot
    joints = [
        weights(np.einsum("gj,jcn->gcn", robot.gear_to_joint, point.target_closure.joint_columns))
        * robust
        for point, weights, robust in zip(
            equations.evaluations, equations.weights, equations.robust, strict=True
        )
    ]
    layout = model.unknowns
    prior = np.diag(layout.sigma**-2.0)
    step = -(-model.poses.size // SEARCHED)
    return LinearModel(
        jacobian=stacked(fit.jacobians)[..., ::step],
        residual=stacked(equations.residuals)[..., ::step],
        joints=stacked(joints)[..., ::step],
        angles=(model.poses.q @ robot.joint_to_gear).T[:, ::step],
        prior_gradient=(equations.x - layout.mean) / layout.sigma**2,
        prior_normal=prior,
        regions=pose_regions(model.poses)[::step],
        groups=poses_of(model.poses)[::step],
    )


def _held(learned: JointErrors) -> list[Correction]:
    """Joint errors learned elsewhere, as a correction whose coefficients are held."""
    correction = joint_harmonics(learned.orders)
    held = tuple(
        Coefficient(c.name, c.unit, value, c.sigma * HELD, c.channel)
        for c, value in zip(correction.coefficients, learned.values, strict=True)
    )
    return [replace(correction, name="learned_harmonics", coefficients=held)]


def _again(
    fit: Fit, corrections: Sequence[Correction], left_out: NDArray[np.intp] | None = None
) -> Fit:
    """Everything once more, from there, with other corrections and all priors as declared.

    left_out : as of `fit_robustly`.
    """
    before, model = fit.model.unknowns, fit.model
    still = PlacedPoses(model.poses, before.placed.seat_starts, before.placed.target_starts)
    layout = still_unknowns(before.fixed, still, corrections)
    layout = _with_zeros_by_eye(model.poses.robot, layout)
    known = dict(zip(before.names, fit.x.tolist(), strict=True))
    x = [known.get(name, mean) for name, mean in zip(layout.names, layout.mean, strict=True)]
    model = replace(model, unknowns=layout, corrections=tuple(corrections))
    return fit_robustly(model, np.array(x), fit.excess, left_out=left_out)


def _with_common_scales(fit: Fit, left_out: NDArray[np.intp]) -> Fit:
    """The fit with the scales of priors that it tells, and its covariance as stated.

    left_out : as of `fit_robustly`.
    """
    names, corrections, doubts = fit.model.unknowns.names, list[Correction](), []
    for correction in fit.model.corrections:
        coefficients = correction.coefficients
        if correction.one_scale:
            chosen = np.array([names.index(c.name) for c in coefficients], dtype=np.intp)
            scaled = common_scale(fit, chosen, np.array([c.sigma for c in coefficients]))
            coefficients = tuple(replace(c, sigma=scaled.scale * c.sigma) for c in coefficients)
            doubts.append(scaled.doubt)
        corrections.append(replace(correction, coefficients=coefficients))
    if not doubts:
        return replace(fit, covariance=robust_covariance(fit))
    fit = _again(fit, corrections, left_out)
    return replace(fit, covariance=robust_covariance(fit) + sum(doubts))


def _without_unsettled(fit: Fit) -> tuple[Fit, Findings]:
    """The fit without the poses that were read before the robot stood still; and what it shows."""
    findings = findings_of(fit)
    if not findings.unsettled.size:
        return fit, findings
    left_out: NDArray[np.intp] = findings.unsettled
    again = fit_robustly(fit.model, fit.x, fit.excess, left_out=left_out)
    after = findings_of(again)
    outliers = np.setdiff1d(after.outliers, left_out)
    return again, replace(after, outliers=outliers, unsettled=left_out)


def _check_enough(table: PoseTable, layout: Unknowns) -> None:
    equations = sum(group.kind.equations * group.size for group in table.groups)
    known = (layout.coefficients, *layout.placed.common.values())  # by their priors
    unknowns = layout.count - sum(part.stop - part.start for part in known)
    if equations < unknowns:
        raise InputError(
            f"{table.name}: {table.size} poses give {equations} equations for {unknowns} unknowns "
            f"(seats, targets and the robot's parameters). Measure at least "
            f"{-(-unknowns * table.size // max(1, equations))} poses; three times as many make a "
            "good result."
        )

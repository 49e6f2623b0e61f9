"""The result of a fit of recordings: the robot, what each recording has of its own, the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.cell.statistics import rms
from ballbar.ident.causes import beside_fit
from ballbar.ident.consistency import AGREED, consistency
from ballbar.ident.corrections import SUBSTITUTES, corrections_without_data
from ballbar.ident.estimator.fit import Fit, moved
from ballbar.ident.estimator.order_search import JointOrder
from ballbar.ident.estimator.priors import PULL, beyond_priors
from ballbar.ident.estimator.step_faults import as_logged, step_faults_in_logs
from ballbar.ident.estimator.uncertainty import Uncertainty, uncertainty
from ballbar.ident.evidence import ClosureEvidence, Evidence
from ballbar.ident.fitted_robot import (
    MOSTLY_PRIOR,
    deviated_masses,
    robot_at_rest,
    robot_estimate,
    softer_gears,
    with_doubt_of_masses,
)
from ballbar.ident.loads.payload import PayloadEstimate
from ballbar.ident.model_choice import NEGATIVE, negative_coefficients
from ballbar.ident.options import FitOptions
from ballbar.ident.physical_bounds import impossible
from ballbar.ident.recording_fit import RecordingFit, nominal_robot_fit
from ballbar.ident.remarks import (
    change_remarks,
    growth_of_links,
    joint_error_remark,
    lag_remark,
    loaded_otherwise,
    log_remarks,
    offset_remark,
    payload_remark,
    wrong_ratios,
)
from ballbar.ident.result import (
    FitStatistics,
    Identification,
    RecordingEstimate,
    Residuals,
    RobotEstimate,
)
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.rules import judge, masses_in_doubt
from ballbar.ident.signals.steps import StepFault
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_fit import added_table
from ballbar.ident.tracker import check_tracker
from ballbar.ident.verdict import Status

if TYPE_CHECKING:
    from ballbar.cell.processes import Begin

# Of a complete fit, whose residual may show a cause
UNEXPLAINED_FIT = (Status.MISFIT, Status.SUSPECT)
# Unexplained part of still poses, in units of what is stated of instrument or tool, that is named
APART = 3.0


def result_of(
    cell: Cell,
    single: Sequence[RecordingFit],
    fit: Fit,
    options: FitOptions,
    orders: Sequence[JointOrder] = (),
    payload: PayloadEstimate | None = None,
    begin: Begin = partial,
) -> Identification:
    """The result of a fit of one or several recordings.

    single : the dh fit of each. orders : of joint errors that were found by evidence. begin : as of
    Listener.
    """
    first, deviated = single[0], deviated_masses(cell, fit, payload)
    complete, layout = fit is not first.fit, fit.model.unknowns
    agreed = begin(consistency, fit) if complete else lambda: AGREED  # kinematics lack too much
    stated = uncertainty(fit, deviated, begin)
    best = moved(fit, stated.step)  # the rules ask what the fit itself had to do
    known = stated.information_gain > MOSTLY_PRIOR
    robot = replace(robot_estimate(cell, first, best, stated, known, deviated), payload=payload)
    agreement = agreed()
    softer = 1.0 if payload else softer_gears(fit)
    if masses_in_doubt(softer):
        robot = with_doubt_of_masses(robot, softer)
    stating = stated, known, options, rms(robot.tcp_sigma)
    estimates = tuple(
        _recording(cell, r, best, k if complete else 0, *stating) for k, r in enumerate(single)
    )
    statistics = FitStatistics(
        converged=fit.converged,
        iterations=first.iterations + (fit.iterations if complete else 0),
        unknowns=layout.count,
        chi2_per_dof=fit.chi2_per_dof,
        autocorrelation=stated.autocorrelation,
        coloured=stated.coloured,
        excess=fit.excess,
        rank=first.subset.rank,
        condition=first.subset.condition,
    )
    closure = ClosureEvidence(
        robot,
        statistics,
        complete,
        pulled=pulled(fit),
        unphysical=unphysical(best, stated.covariance, payload),
        impossible=impossible(fit) if fit.converged else (),
        disagreement=loaded_otherwise(payload) or agreement.sentence,
        ratios=wrong_ratios(best, np.sqrt(np.diag(stated.covariance))),
        softer=softer,
        nominal_error=_nominal_error(robot),
        accuracy=options.accuracy,
        blocks=stated.blocks,
        lengths_apart=stated.lengths.apart,
        lengths_off=stated.lengths.off,
        lengths_named=stated.lengths.named,
        given_up=fit.given_up,
    )
    pairs = zip(single, estimates, strict=True)
    remarks = [log_remarks(r.samples, e.step_faults) for r, e in pairs]
    held_out = agreement.held_out or [None] * len(single)
    parts = [
        Evidence(closure, estimate, remarks=on_logs, held_out=ratio)
        for estimate, on_logs, ratio in zip(estimates, remarks, held_out, strict=True)
    ]
    poses = added_table(best, stated.covariance)
    verdict = judge(parts if poses is None else [*parts, Evidence(table=poses, elsewhere=True)])
    tested = verdict.status in UNEXPLAINED_FIT and not fit.given_up  # it is beside a fit
    if complete and tested and cell.ballbar.stroke is None:
        names, contested = [e.name for e in estimates], bool(closure.disagreement)
        named = payload is not None and payload.undeclared
        if cause := "" if named else beside_fit(cell, fit, names, contested=contested):
            verdict = replace(verdict, status=Status.MISFIT).with_cause(cause)
    for remark in _remarks(cell, best, options, robot, stated, orders, complete=complete):
        verdict = verdict.with_warning(remark)
    if poses:
        undoubted = robot_estimate(cell, first, best, stated.undoubted(), known, deviated)
        if contradiction := _contradiction(poses, rms(undoubted.tcp_sigma)):
            verdict = verdict.with_warning(contradiction)
    return Identification(robot, estimates, statistics, verdict, poses, solved=fit, stated=stated)


def result_at_rest(poses: TableEstimate, *, elsewhere: bool = False) -> Identification:
    """The result of a fit of still poses alone.

    elsewhere : whether held-out poses of another place are predicted as stated.
    """
    fit = poses.fit
    statistics = FitStatistics(
        fit.converged, fit.iterations, fit.model.unknowns.count, fit.chi2_per_dof, fit.excess
    )
    verdict = judge([Evidence(table=poses, elsewhere=elsewhere)])
    return Identification(robot_at_rest(poses), (), statistics, verdict, poses, solved=fit)


def _remarks(
    cell: Cell,
    fit: Fit,
    options: FitOptions,
    robot: RobotEstimate,
    stated: Uncertainty,
    orders: Sequence[JointOrder],
    *,
    complete: bool,
) -> Iterator[str]:
    """Warnings about a result that its verdict does not depend on."""
    if options.rod_sigma is not None and not complete:
        yield (
            "the measured rod length was not used: the dh model explains the recording and finds "
            "the rod by itself; --model complete uses it"
        )
    if complete and options.model != "dh" and options.corrections is None:
        without = corrections_without_data(cell.robot)
        if without:
            keys = dict.fromkeys(f"`{key}`" for lacking in without.values() for key in lacking)
            yield (
                f"{', '.join(without)} were not fitted: the file of robot {cell.robot.name} "
                f"has no {', '.join(keys)}{_substituted(robot)}. Add them to the file"
            )
    remarks = [
        payload_remark(robot.payload),
        offset_remark(robot.payload),
        lag_remark(fit, np.sqrt(np.diag(stated.covariance))),
        *change_remarks(fit, stated.covariance),
        joint_error_remark(orders, robot.corrections) if orders else "",
    ]
    yield from filter(None, remarks)


def _contradiction(poses: TableEstimate, tcp_sigma: float) -> str:
    """A warning where still poses deviate by more than noise and stated uncertainty; else empty."""
    if poses.unexplained <= APART * max(poses.declared, tcp_sigma):
        return ""
    return (
        f"the still poses of {poses.table.name} lie {poses.unexplained * 1e3:.3f} mm along each "
        "axis from where the recordings' robot puts them, beyond all noise: another robot, tool or "
        "payload, or an instrument that moved. Identify both by themselves and compare them"
    )


def _substituted(robot: RobotEstimate) -> str:
    """End of a sentence that names substitutes of corrections that were not fitted."""
    names = [c.name for c in robot.corrections if c.name in SUBSTITUTES]
    return "".join(f"; {name} stands for {SUBSTITUTES[name]}" for name in names)


def _recording(
    cell: Cell,
    single: RecordingFit,
    fit: Fit,
    k: int,
    stated: Uncertainty,
    known: NDArray[np.bool_],
    options: FitOptions,
    tcp_sigma: float,
) -> RecordingEstimate:
    samples, own = single.samples, fit.model.unknowns.own[k]
    geometry = _wrapped(fit.geometry(k))
    deviations = np.sqrt(np.diag(stated.covariance))
    positions = np.r_[own.geometry]
    clock = None if own.clock is None else fit.clock(k)
    loaded = fit.model.masses is not None
    source = single.logs.force_source(options.force, cell.robot) if loaded else ""
    nominal, tracker = nominal_robot_fit(single, fit.model.recordings[k]), None
    if single.logs.tracker is not None:
        both = fit.linear.evaluations[k], nominal.linear.evaluations[0]
        log, name = single.logs.tracker, single.logs.name
        tracker = check_tracker(log, *both, tcp_sigma=tcp_sigma, name=name)
    return RecordingEstimate(
        name=single.logs.name,
        encoders=samples.encoders,
        directions=single.start.chosen.hypothesis.directions,
        geometry=geometry,
        nominal=single.nominal.replaced({name: geometry[name] for name in ("ox", "oy", "oz")}),
        sigma={
            geometry.table.names[i]: float(deviations[p])
            for i, p in zip(own.parameters, positions, strict=True)
            if known[p]
        },
        clock=clock,
        clock_sigma=(0.0, 0.0)
        if own.clock is None
        else (float(deviations[own.clock.start]), float(deviations[own.clock.start + 1])),
        noise=samples.log_noise,
        before=_residuals(nominal, 0),
        after=_residuals(fit, k),
        whitened=fit.linear.residuals[k],
        start=single.start,
        step_faults=_step_faults(cell, single, fit, k),
        tension=fit.model.tension(fit.x, k) if source else None,
        tension_source=source,
        tracker=tracker,
        growth=growth_of_links(fit, stated.covariance, k),
    )


def _step_faults(cell: Cell, single: RecordingFit, fit: Fit, k: int) -> tuple[StepFault, ...]:
    """Step faults as sized by the complete fit; without one, those that the logs show."""
    if fit is not single.fit:
        return tuple(fault for fault in fit.step_faults if fault.recording == k)
    lines, ballbar = cell.ballbar.encoder_lines, single.samples.ballbar
    faults = step_faults_in_logs(single.samples, single.clock)
    return tuple(as_logged(fault, ballbar, lines) for fault in faults)


def pulled(fit: Fit) -> tuple[str, ...]:
    """Shared unknowns further from their priors than chance explains, the furthest first."""
    layout = fit.model.unknowns
    out = [layout.names[i] for i in beyond_priors(layout, fit.x)]
    gain = layout.gain
    if gain is not None and abs(force_gain(fit)) > PULL * layout.sigma[gain]:
        out.append("force_gain")
    return tuple(out)


def _nominal_error(robot: RobotEstimate) -> float:
    """[m] mean distance over the workspace of the nominal tool from the identified one."""
    grid = accuracy_grid(robot.cell.robot)
    nominal = IdentifiedRobot(robot.cell, robot.nominal)
    return position_error(nominal.tool(grid), robot.identified.tool(grid)).mean


def unphysical(fit: Fit, covariance: Array, payload: PayloadEstimate | None) -> tuple[str, ...]:
    """Compliances, plays and masses that are negative beyond their uncertainty."""
    out = [*negative_coefficients(fit, np.sqrt(np.diag(covariance)))]
    if payload is not None and payload.payload.mass < -NEGATIVE * payload.mass_sigma:
        out.append("the tool's mass")
    return tuple(out)


def force_gain(fit: Fit) -> float:
    """How much more tension the geometry shows than what was measured; 0 where nothing was.

    Of both over time, since the gain of the fit shares its work with the knots.
    """
    if fit.model.unknowns.gain is None:
        return 0.0
    samples = fit.model.recordings
    shown = np.concatenate([fit.model.tension(fit.x, k) for k in range(len(samples))])
    measured = np.concatenate([s.tension for s in samples])
    return float(np.cov(shown, measured)[0, 1] / max(measured.var(ddof=1), 1e-12)) - 1.0


def _residuals(fit: Fit, k: int) -> Residuals:
    error = fit.linear.evaluations[k].closure.error
    return Residuals(fit.model.recordings[k].times, error[:3].T, error[3:].T)


def _wrapped(geometry: Geometry) -> Geometry:
    """The geometry with encoder offsets within half a turn."""
    offsets = {name: geometry[name] for name in geometry.table.names if name.startswith("btheta")}
    return geometry.replaced(
        {name: float(np.arctan2(np.sin(x), np.cos(x))) for name, x in offsets.items()}
    )

"""The result of a fit of recordings: the robot, what each recording has of its own, the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry, parameter_named
from cell.payload import TOOL, deviations_between
from cell.placement import Placement
from cell.statistics import rms
from ident.causes import beside_fit
from ident.consistency import AGREED, consistency
from ident.corrections import SUBSTITUTES, corrections_without_data
from ident.estimator.considered import held_shifts
from ident.estimator.fit import Fit
from ident.estimator.identifiability import DroppedParameter
from ident.estimator.noise import log_noise
from ident.estimator.order_search import JointOrder
from ident.estimator.step_faults import as_logged, step_faults_in_logs
from ident.estimator.uncertainty import Uncertainty, uncertainty
from ident.estimator.unknowns import GAIN_PRIOR, fixed_names, held_names, priors, taken_as_exact
from ident.least_sizes import LITTLE_SHIFT, LITTLE_TURN
from ident.loads.mass_uncertainty import deviated_cells, stated_covariance
from ident.loads.payload import PayloadEstimate
from ident.model_choice import NEGATIVE, coefficients_of, lasting, negative_coefficients
from ident.options import FitOptions
from ident.physical_bounds import impossible
from ident.recording_fit import RecordingFit, nominal_robot_fit
from ident.remarks import (
    joint_error_remark,
    lag_remark,
    log_remarks,
    payload_remark,
    recording_remarks,
    unlike_tools,
    wrong_ratios,
)
from ident.result import (
    CoefficientEstimate,
    CorrectionEstimate,
    FitStatistics,
    Identification,
    NamedCovariance,
    PlacementEstimate,
    RecordingEstimate,
    Residuals,
    RobotEstimate,
    TableEstimate,
)
from ident.robot.accuracy import accuracy_grid, position_error
from ident.robot.tcp_uncertainty import MASSES, TcpUncertainty, parts_without_scale, tcp_uncertainty
from ident.robot.tool_covariance import ToolCovariance
from ident.robot.unloaded_robot import UnloadedRobot
from ident.signals.step_fault import StepFault
from ident.tracker import check_tracker
from ident.verdict import PULL, Evidence, RecordingEvidence, Status, judge, masses_in_doubt

# Unexplained part of still poses, in units of what is stated of instrument or tool, that is named
APART = 3.0
MASSES_IN_DOUBT = 0.5  # standard deviation, of the sag between the two ways to read soft gears
MOSTLY_PRIOR = 0.5  # information gain below which an unknown is said to stand at its prior


def result_of(
    cell: Cell,
    single: Sequence[RecordingFit],
    fit: Fit,
    options: FitOptions,
    orders: Sequence[JointOrder] = (),
    payload: PayloadEstimate | None = None,
) -> Identification:
    """The result of a fit of one or several recordings.

    single : the dh fit of each. orders : of joint errors that were found by evidence.
    """
    deviated = _deviated(cell, fit, payload)
    stated, layout = uncertainty(fit, deviated), fit.model.unknowns
    complete = fit is not single[0].fit
    known = stated.information_gain > MOSTLY_PRIOR
    robot = replace(_robot(cell, single[0], fit, stated, known, deviated), payload=payload)
    agreement = consistency(fit) if complete else AGREED  # kinematics alone lack too much
    softer = 1.0 if payload else _softer(fit)
    if masses_in_doubt(softer):
        robot = _with_doubt_of_masses(robot, softer)
    estimates = tuple(
        _recording(cell, r, fit, k if complete else 0, stated, known, options, rms(robot.tcp_sigma))
        for k, r in enumerate(single)
    )
    first = single[0]
    statistics = FitStatistics(
        converged=fit.converged,
        iterations=first.iterations + (fit.iterations if complete else 0),
        unknowns=layout.count,
        chi2_per_dof=fit.chi2_per_dof,
        autocorrelation=stated.autocorrelation,
        excess=fit.excess,
        rank=first.subset.rank,
        condition=first.subset.condition,
    )
    evidence = Evidence(
        converged=fit.converged,
        iterations=statistics.iterations,
        chi2_per_dof=fit.chi2_per_dof,
        autocorrelation=stated.autocorrelation,
        geometry=robot.geometry,
        identified=tuple(robot.sigma),
        complete=complete,
        blocks=stated.blocks,
        pulled=pulled(fit),
        lengths_apart=stated.lengths.apart,
        lengths_off=stated.lengths.off,
        rod_sigma=robot.sigma.get("bd3", 0.0),
        unphysical=unphysical(fit, stated.covariance, payload),
        impossible=impossible(fit) if fit.converged else (),
        disagreement=unlike_tools(payload) or agreement.sentence,
        ratios=wrong_ratios(fit, np.sqrt(np.diag(stated.covariance))),
        softer=softer,
        tcp_sigma=rms(robot.tcp_sigma),
        nominal_error=_nominal_error(robot),
        accuracy=options.accuracy,
    )
    each = [
        RecordingEvidence(
            name=estimate.name,
            start=estimate.start,
            encoders=estimate.encoders,
            samples=estimate.samples,
            clock_sigma=estimate.clock_sigma[0],
            held_out=agreement.held_out[k] if agreement.held_out else None,
            remarks=log_remarks(r.samples, estimate.step_faults),
        )
        for k, (r, estimate) in enumerate(zip(single, estimates, strict=True))
    ]
    verdict = judge(evidence, each, cell, robot.nominal)
    if complete and verdict.status is Status.MISFIT and cell.ballbar.stroke is None:
        names = [estimate.name for estimate in estimates]
        if cause := beside_fit(cell, fit, names):
            verdict = verdict.with_cause(cause)
    if options.rod_sigma is not None and not complete:
        verdict = verdict.with_warning(
            "the measured rod length was not used: the dh model explains the recording and finds "
            "the rod by itself; --model complete uses it"
        )
    if complete and options.model != "dh" and options.corrections is None:
        without = corrections_without_data(cell.robot)
        if without:
            keys = dict.fromkeys(f"`{key}`" for lacking in without.values() for key in lacking)
            verdict = verdict.with_warning(
                f"{', '.join(without)} were not fitted: the file of robot {cell.robot.name} "
                f"has no {', '.join(keys)}{_substituted(robot)}. Add them to the file"
            )
    lags = lag_remark(fit, np.sqrt(np.diag(stated.covariance)))
    for remark in (payload_remark(payload), lags, *recording_remarks(fit, stated.covariance)):
        verdict = verdict.with_warning(remark) if remark else verdict
    if orders and (remark := joint_error_remark(orders, robot.corrections)):
        verdict = verdict.with_warning(remark)
    poses = _poses(fit, stated)
    if poses is not None and (remark := _contradiction(poses, rms(robot.tcp_sigma))):
        verdict = verdict.with_warning(remark)
    return Identification(robot, estimates, statistics, verdict, poses)


def _poses(fit: Fit, stated: Uncertainty) -> TableEstimate | None:
    """What still poses among the parts of a fit have of their own."""
    layout, count = fit.model.unknowns, len(fit.model.recordings)
    if fit.model.table is None:
        return None
    sigma = np.sqrt(np.diag(stated.covariance))

    def placed(
        place: Callable[[Array, str], Placement], parts: dict[str, slice]
    ) -> dict[str, PlacementEstimate]:
        return {
            name: PlacementEstimate(place(fit.x, name), sigma[part][:3], name in layout.framed)
            for name, part in parts.items()
        }

    points = fit.linear.evaluations[count:]
    return TableEstimate(
        table=fit.model.table,
        seats=placed(layout.seat, layout.seats),
        targets=placed(layout.target, layout.targets),
        errors=tuple(np.linalg.norm(point.closure.error[:3], axis=0) for point in points),
        ignored=sum(int((weight == 0.0).sum()) for weight in fit.linear.robust[count:]),
        unexplained=fit.excess.position,
        declared=float(np.median(np.concatenate([p.position_sigma.ravel() for p in points]))),
    )


def _contradiction(poses: TableEstimate, tcp_sigma: float) -> str:
    """What is left of still poses beyond what noise and stated uncertainty explain, if anything."""
    if poses.unexplained <= APART * max(poses.declared, tcp_sigma):
        return ""
    return (
        f"the still poses of {poses.table.name} lie {poses.unexplained * 1e3:.3f} mm along each "
        "axis from where the recordings' robot puts them, beyond all noise: another robot, tool or "
        "payload, or an instrument that moved. Identify both by themselves and compare them"
    )


def _substituted(robot: RobotEstimate) -> str:
    """What stands for corrections that were not fitted, as the end of a sentence."""
    names = [c.name for c in robot.corrections if c.name in SUBSTITUTES]
    return "".join(f"; {name} stands for {SUBSTITUTES[name]}" for name in names)


def _robot(
    cell: Cell,
    first: RecordingFit,
    fit: Fit,
    stated: Uncertainty,
    known: NDArray[np.bool_],
    deviated: Sequence[Cell],
) -> RobotEstimate:
    layout, x = fit.model.unknowns, fit.x
    shared = np.arange(layout.shared.size)
    geometry = first.nominal.values.copy()
    geometry[layout.shared] = x[shared]
    deviations = np.sqrt(np.diag(stated.covariance))
    corrections = lasting(fit)
    positions = [np.r_[coefficients_of(fit, c)] for c in corrections]
    machine = np.concatenate((shared, *positions)).astype(np.intp)
    at_prior = [layout.names[i] for i in shared if not known[i]]
    whole = _stated_covariance(cell, fit, stated, deviated)
    tcp, white, widened = _tcp_uncertainty(cell, fit, stated, whole, deviated)
    angles = np.concatenate([e.samples.joint_angles(e.robot_time) for e in fit.linear.evaluations])
    return RobotEstimate(
        cell=cell,
        encoders=first.samples.encoders,
        nominal=first.nominal,
        geometry=first.nominal.with_values(geometry),
        sigma={layout.names[i]: float(deviations[i]) for i in shared if known[i]},
        covariance=NamedCovariance(
            tuple(layout.names[i] for i in machine),
            stated.covariance[np.ix_(machine, machine)],
            fit.covariance[np.ix_(machine, machine)],
        ),
        corrections=tuple(
            CorrectionEstimate(
                c.name,
                c.sentence,
                tuple(
                    CoefficientEstimate(
                        name=coefficient.name,
                        unit=coefficient.unit,
                        value=float(x[i]),
                        sigma=float(deviations[i]),
                        prior=float(layout.mean[i]),
                        prior_sigma=float(layout.sigma[i]),
                        information_gain=float(stated.information_gain[i]),
                    )
                    for coefficient, i in zip(c.coefficients, position, strict=True)
                ),
            )
            for c, position in zip(corrections, positions, strict=True)
        ),
        tcp=tcp,
        tcp_white=white,
        tcp_widened=widened,
        dropped=_dropped(cell, first, fit, at_prior),
        tool=_tool_covariance(cell, machine, fit, whole, deviated),
        lower=angles.min(axis=0),
        upper=angles.max(axis=0),
    )


def _tool_covariance(
    cell: Cell,
    machine: NDArray[np.intp],
    fit: Fit,
    whole: _StatedCovariance,
    deviated: Sequence[Cell],
) -> ToolCovariance:
    """Of the unknowns `machine`, of what the fit took as exact, and of the masses."""
    layout = fit.model.unknowns
    beside = np.arange(layout.machine.size, len(whole.names))
    places = np.concatenate((machine, beside))
    return ToolCovariance(
        names=tuple(layout.names[i] for i in machine),
        held=tuple(layout.fixed.table.names[i] for i in whole.held),
        masses=np.reshape(
            [deviations_between(cell, other) for other in deviated],
            (len(deviated), TOOL + 4 * cell.robot.joints),
        ),
        values=whole.values[np.ix_(places, places)],
    )


def _dropped(
    cell: Cell, first: RecordingFit, fit: Fit, at_prior: Sequence[str]
) -> tuple[DroppedParameter, ...]:
    """The parameters left at nominal, and those that stand at their priors."""
    reasons = {d.name: d for d in first.subset.dropped}
    if fit is first.fit:
        fitted = {first.nominal.table.names[i] for i in first.subset.weak}
        fixed = [d for d in first.subset.dropped if d.name not in fitted]
    else:
        never = fixed_names(first.nominal.table, held_names(cell))
        fixed = [d for d in first.subset.dropped if d.name in never]
    return (*fixed, *(reasons.get(n, DroppedParameter(n, "prior", ())) for n in at_prior))


def _deviated(cell: Cell, fit: Fit, payload: PayloadEstimate | None) -> tuple[Cell, ...]:
    """Cells that deviate by what is not known of the masses that a fit took as given."""
    if fit.model.masses is None:
        return ()
    known = stated_covariance(cell) if payload is None else payload.covariance
    return deviated_cells(cell, known)


@dataclass(frozen=True, eq=False)
class _StatedCovariance:
    """Covariance of all that may move the unloaded tool: the fit's unknowns of the machine, then
    what it took as exact, then directions of the masses.
    """

    names: list[str]
    values: Array
    held: NDArray[np.intp]  # indices into the table of what was taken as exact


def _stated_covariance(
    cell: Cell, fit: Fit, stated: Uncertainty, deviated: Sequence[Cell]
) -> _StatedCovariance:
    """Masses, and lengths and angles of the instrument that the fit took as exact, move the tool
    directly and by what they made of the unknowns, so all stand in one covariance.
    """
    layout = fit.model.unknowns
    machine, table = layout.machine, layout.fixed.table
    names = [layout.names[i] for i in machine]
    covariance = stated.covariance[np.ix_(machine, machine)]
    if (held := taken_as_exact(cell, layout)).size:
        root, shifts = held_shifts(fit, held, priors(cell, table, held))
        shifts = shifts[machine]
        covariance += shifts @ shifts.T
        covariance = _bordered(covariance, shifts @ root.T, root @ root.T)
        names += [table.names[i] for i in held]
    if deviated:
        apart = np.zeros((len(names) - machine.size, len(deviated)))
        cross = np.concatenate((stated.considered[machine], apart))
        covariance = _bordered(covariance, cross, np.eye(len(deviated)))
        names += [f"{MASSES}{k}" for k in range(1, len(deviated) + 1)]
    return _StatedCovariance(names, covariance, held)


def _tcp_uncertainty(
    cell: Cell, fit: Fit, stated: Uncertainty, whole: _StatedCovariance, deviated: Sequence[Cell]
) -> tuple[TcpUncertainty, float, float]:
    """Of the unloaded robot's tool over the accuracy grid, and the parts by the data."""
    layout, grid = fit.model.unknowns, accuracy_grid(cell.robot)
    corrections, values = fit.model.corrections, fit.x[layout.coefficients]
    robot = UnloadedRobot(cell, fit.geometry(), corrections, values)
    moves = own = robot.jacobian(grid, layout.shared)
    if whole.held.size:
        rigid = UnloadedRobot(cell, fit.geometry())
        moves = np.concatenate((moves, rigid.jacobian(robot.joints(grid), whole.held)))
    if deviated:
        moves = np.concatenate((moves, robot.moved_by_masses(deviated, grid)))
    tool, machine = robot.tool(grid), np.ix_(layout.machine, layout.machine)
    white, widened = parts_without_scale(tool, own, stated.white[machine], stated.widened[machine])
    return tcp_uncertainty(tool, moves, whole.values, whole.names), white, widened


def _bordered(covariance: Array, cross: Array, own: Array) -> Array:
    """Covariance (P, P) with K more variables; cross : (P, K) with the others. own : (K, K)."""
    return np.block([[covariance, cross], [cross.T, own]])


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
        tracker = check_tracker(single.logs.tracker, *both, tcp_sigma=tcp_sigma)
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
        noise=log_noise(samples.robot, samples.ballbar, samples.encoders),
        before=_residuals(nominal, 0),
        after=_residuals(fit, k),
        whitened=fit.linear.residuals[k],
        start=single.start,
        step_faults=_step_faults(cell, single, fit, k),
        tension=fit.model.tension(fit.x, k) if source else None,
        tension_source=source,
        tracker=tracker,
    )


def _step_faults(cell: Cell, single: RecordingFit, fit: Fit, k: int) -> tuple[StepFault, ...]:
    """Those that the complete fit sized, or those that the log showed by itself."""
    if fit is not single.fit:
        return tuple(fault for fault in fit.step_faults if fault.recording == k)
    lines, ballbar = cell.ballbar.encoder_lines, single.samples.ballbar
    faults = step_faults_in_logs(single.samples, single.clock)
    return tuple(as_logged(fault, ballbar, lines) for fault in faults)


def pulled(fit: Fit) -> tuple[str, ...]:
    """Shared unknowns further from their priors than chance explains, the furthest first."""
    layout = fit.model.unknowns
    machine = layout.machine
    off = np.abs(fit.x[machine] - layout.mean[machine])
    far = off / layout.sigma[machine]
    little = np.zeros(machine.size)  # a prior of a coefficient is of a size that matters
    for i in range(layout.shared.size):
        length = parameter_named(layout.names[i]).is_length
        little[i] = LITTLE_SHIFT if length else LITTLE_TURN
    out = [
        layout.names[machine[k]] for k in np.argsort(-far) if far[k] > PULL and off[k] > little[k]
    ]
    return (*out, "force_gain") if abs(force_gain(fit)) > PULL * GAIN_PRIOR else tuple(out)


def _nominal_error(robot: RobotEstimate) -> float:
    """[m] mean distance over the workspace of the nominal tool from the identified one."""
    grid = accuracy_grid(robot.cell.robot)
    nominal = UnloadedRobot(robot.cell, robot.nominal)
    return position_error(nominal.tool(grid), robot.unloaded().tool(grid)).mean


def _with_doubt_of_masses(robot: RobotEstimate, softer: float) -> RobotEstimate:
    """The robot with the sag that wrong masses would give it in its stated TCP uncertainty.

    Where all gears are softer by one factor, masses that are larger by it explain a recording as
    well; between the two lies how far the unloaded robot sags.
    """
    stiffer = tuple(
        replace(
            correction,
            coefficients=tuple(replace(c, value=c.value / softer) for c in correction.coefficients),
        )
        if correction.name == "joint_compliance"
        else correction
        for correction in robot.corrections
    )
    grid = accuracy_grid(robot.cell.robot)
    other = replace(robot, corrections=stiffer).unloaded()
    doubt = position_error(other.tool(grid), robot.unloaded().tool(grid))
    change = {
        after.name: MASSES_IN_DOUBT * (after.value - before.value)
        for old, new in zip(robot.corrections, stiffer, strict=True)
        for before, after in zip(old.coefficients, new.coefficients, strict=True)
    }
    direction = np.zeros(len(robot.tool.values))
    direction[: len(robot.tool.names)] = [change.get(name, 0.0) for name in robot.tool.names]
    doubted = replace(robot.tool, values=robot.tool.values + np.outer(direction, direction))
    return replace(robot, tool=doubted, tcp=robot.tcp.with_doubt(doubt, MASSES_IN_DOUBT))


def _softer(fit: Fit) -> float:
    """Geometric mean over the gears of compliance over the catalogue's; 1 where none was fitted."""
    for correction in fit.model.corrections:
        if correction.name == "joint_compliance":
            mean = np.array([c.mean for c in correction.coefficients])
            ratio = fit.x[coefficients_of(fit, correction)] / mean
            return float(np.exp(np.log(np.maximum(ratio, 1e-3)).mean()))
    return 1.0


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

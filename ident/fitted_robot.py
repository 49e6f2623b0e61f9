"""The robot of a fit: its parameters, corrections and their covariance, masses included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.payload import TOOL, deviations_between
from ballbar.ident.corrections.base import Coefficient, Correction
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.identifiability import DroppedParameter
from ballbar.ident.estimator.priors import fixed_names, held_names, priors, taken_as_exact
from ballbar.ident.estimator.uncertainty import Uncertainty, held_shifts
from ballbar.ident.loads.mass_uncertainty import deviated_cells, stated_covariance
from ballbar.ident.loads.payload import PayloadEstimate
from ballbar.ident.model_choice import coefficients_of, lasting
from ballbar.ident.recording_fit import RecordingFit
from ballbar.ident.result import (
    CoefficientEstimate,
    CorrectionEstimate,
    NamedCovariance,
    RobotEstimate,
    identified_robot,
)
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tcp_uncertainty import (
    MASSES,
    TcpUncertainty,
    parts_without_scale,
    tcp_uncertainty,
)
from ballbar.ident.robot.tool_covariance import ToolCovariance
from ballbar.ident.table_estimate import TableEstimate

MOSTLY_PRIOR = 0.5  # information gain below which an unknown is said to stand at its prior
MASSES_IN_DOUBT = 0.5  # standard deviation, of the sag between the two ways to read soft gears


def robot_estimate(
    cell: Cell,
    first: RecordingFit,
    fit: Fit,
    stated: Uncertainty,
    known: NDArray[np.bool_],
    deviated: Sequence[Cell],
) -> RobotEstimate:
    """The identified robot with its stated covariance.

    first : the dh fit of the first recording. known : (P,) unknowns that the data tell more of than
    their priors. deviated : cells, as `deviated_masses` gives them.
    """
    layout, x = fit.model.unknowns, fit.x
    shared = np.arange(layout.shared.size)
    geometry = first.nominal.values.copy()
    geometry[layout.shared] = x[shared]
    deviations = np.sqrt(np.diag(stated.covariance))
    positions = [np.r_[coefficients_of(fit, c)] for c in lasting(fit)]
    machine = np.concatenate((shared, *positions)).astype(np.intp)
    at_prior = [layout.names[i] for i in shared if not known[i]]
    whole = _stated_covariance(cell, fit, stated, deviated)
    tcp, white, widened = _tcp_uncertainty(cell, fit, stated, whole, deviated)
    angles = np.concatenate([e.samples.joint_angles(e.robot_time) for e in fit.linear.evaluations])
    corrections = correction_estimates(
        fit, lasting(fit), stated.covariance, stated.information_gain
    )
    robot = identified_robot(
        cell, first.nominal.with_values(geometry), first.samples.encoders, corrections
    )
    return RobotEstimate(
        identified=replace(
            robot,
            ranges=np.stack((angles.min(axis=0), angles.max(axis=0)), axis=1),
            stated=replace(
                _tool_covariance(cell, machine, fit, whole, deviated),
                repeated=np.sqrt(np.diag(stated.white + stated.widened)[machine]),
            ),
        ),
        encoders=first.samples.encoders,
        nominal=first.nominal,
        sigma={layout.names[i]: float(deviations[i]) for i in shared if known[i]},
        covariance=NamedCovariance(
            tuple(layout.names[i] for i in machine),
            stated.covariance[np.ix_(machine, machine)],
            fit.covariance[np.ix_(machine, machine)],
        ),
        corrections=corrections,
        tcp=tcp,
        tcp_white=white,
        tcp_widened=widened,
        dropped=_dropped(cell, first, fit, at_prior),
    )


def robot_at_rest(poses: TableEstimate) -> RobotEstimate:
    """The robot that was identified from still poses alone."""
    fit, layout = poses.fit, poses.fit.model.unknowns
    gain, deviations = poses.information_gain, np.sqrt(np.diag(fit.covariance))
    known = gain[: layout.shared.size] > MOSTLY_PRIOR
    machine = np.ix_(layout.machine, layout.machine)
    return RobotEstimate(
        identified=poses.identified_robot(),
        nominal=layout.fixed,
        sigma={layout.names[i]: float(deviations[i]) for i in np.flatnonzero(known)},
        covariance=NamedCovariance(
            tuple(layout.names[i] for i in layout.machine),
            fit.covariance[machine],
            inverse(fit.linear.normal)[machine],
        ),
        corrections=correction_estimates(fit, fit.model.corrections, fit.covariance, gain),
        dropped=tuple(
            DroppedParameter(layout.names[i], "prior", ()) for i in np.flatnonzero(~known)
        ),
        # the scale of the instrument is in neither
        tcp=TcpUncertainty(poses.tcp_sigma, poses.tcp_sigma, ()),
    )


def correction_estimates(
    fit: Fit, corrections: Sequence[Correction], covariance: Array, gain: Array
) -> tuple[CorrectionEstimate, ...]:
    """Corrections of a fit with their coefficients.

    covariance : (P, P) stated, of the unknowns. gain : (P,) their information gain.
    """
    x, layout = fit.x, fit.model.unknowns

    def estimate(coefficient: Coefficient, i: int) -> CoefficientEstimate:
        return CoefficientEstimate(
            name=coefficient.name,
            unit=coefficient.unit,
            value=float(x[i]),
            sigma=float(np.sqrt(covariance[i, i])),
            prior=float(layout.mean[i]),
            prior_sigma=float(layout.sigma[i]),
            information_gain=float(gain[i]),
        )

    return tuple(
        CorrectionEstimate(
            c.name,
            c.sentence,
            tuple(
                map(estimate, c.coefficients, range(coefficients_of(fit, c).start, layout.count))
            ),
        )
        for c in corrections
    )


def _tool_covariance(
    cell: Cell,
    machine: NDArray[np.intp],
    fit: Fit,
    whole: _StatedCovariance,
    deviated: Sequence[Cell],
) -> ToolCovariance:
    """Covariance of the unknowns `machine`, what the fit took as exact, and the masses."""
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


def deviated_masses(cell: Cell, fit: Fit, payload: PayloadEstimate | None) -> tuple[Cell, ...]:
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
    """Uncertainty of the unloaded robot's tool over the accuracy grid, and the parts by data."""
    layout, grid = fit.model.unknowns, accuracy_grid(cell.robot)
    corrections, values = fit.model.corrections, fit.x[layout.coefficients]
    robot = IdentifiedRobot(cell, fit.geometry(), corrections, values)
    moves = own = robot.jacobian(grid, layout.shared)
    if whole.held.size:
        moves = np.concatenate((moves, robot.rigid().jacobian(robot.joints(grid), whole.held)))
    if deviated:
        moves = np.concatenate((moves, robot.moved_by_masses(deviated, grid)))
    tool, machine = robot.tool(grid), np.ix_(layout.machine, layout.machine)
    white, widened = parts_without_scale(tool, own, stated.white[machine], stated.widened[machine])
    return tcp_uncertainty(tool, moves, whole.values, whole.names), white, widened


def _bordered(covariance: Array, cross: Array, own: Array) -> Array:
    """Covariance (P, P) with K more variables; cross : (P, K) with the others. own : (K, K)."""
    return np.block([[covariance, cross], [cross.T, own]])


def with_doubt_of_masses(robot: RobotEstimate, softer: float) -> RobotEstimate:
    """The robot with the sag that wrong masses would give it in its stated TCP uncertainty.

    Where all gears are softer by one factor, masses that are larger by it explain a recording as
    well; between the two lies how far the unloaded robot sags.
    """
    values, change = robot.identified.values.copy(), dict[str, float]()
    every = [(c, e.name) for e in robot.corrections for c in e.coefficients]
    for k, (coefficient, correction) in enumerate(every):
        if correction == "joint_compliance":
            values[k] = coefficient.value / softer
            change[coefficient.name] = MASSES_IN_DOUBT * (values[k] - coefficient.value)
    grid, other = accuracy_grid(robot.robot), replace(robot.identified, values=values)
    doubt = position_error(other.tool(grid), robot.identified.tool(grid))
    direction = np.zeros(len(robot.tool.values))
    direction[: len(robot.tool.names)] = [change.get(name, 0.0) for name in robot.tool.names]
    doubted = replace(robot.tool, values=robot.tool.values + np.outer(direction, direction))
    identified = replace(robot.identified, stated=doubted)
    return replace(robot, identified=identified, tcp=robot.tcp.with_doubt(doubt, MASSES_IN_DOUBT))


def softer_gears(fit: Fit) -> float:
    """Geometric mean over the gears of compliance over the catalogue's; 1 where none was fitted."""
    for correction in fit.model.corrections:
        if correction.name == "joint_compliance":
            mean = np.array([c.mean for c in correction.coefficients])
            ratio = fit.x[coefficients_of(fit, correction)] / mean
            return float(np.exp(np.log(np.maximum(ratio, 1e-3)).mean()))
    return 1.0

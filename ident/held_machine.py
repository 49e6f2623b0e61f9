"""Today's measurement, fitted to a machine that is held.

Fitted is only what belongs to today: of a recording encoder offsets, base pose of the ball-bar,
clock, tension of the rod and step faults, of still poses the seats and targets that the
identification did not see. Robot, ball-bar and corrections keep their values: priors so narrow that
no data could move them. The noise of a recording is that of the identification, so a ratio above 1
is what the machine leaves unexplained. Some of that is expected: with C the stated covariance of
the machine and S the information that this recording holds on it, its own unknowns fitted,
chi-square is larger by trace(C S) on average. What exceeds that is a misfit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.number_text import significant_text
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.ident.causes import Causes
from ballbar.ident.complete_fit import (
    Pose,
    clock_steps_of,
    continued,
    fit_pose,
    gain_sigma,
    needs_loads,
    searches_tension,
    start_of,
    with_likely_tension,
    with_tension,
)
from ballbar.ident.estimator.build_unknowns import complete_unknowns, still_unknowns
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.model import Model, gearing, still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.robust_fit import fit_robustly
from ballbar.ident.estimator.step_faults import encoder_slips
from ballbar.ident.estimator.unknowns import PlacedPoses, Unknowns
from ballbar.ident.loads.gear_loads import mass_model
from ballbar.ident.options import SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import Logs, RecordingFit, fit_recording
from ballbar.ident.result import Machine
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.signals.steps import StepFault
from ballbar.ident.start.automatic import StartError
from ballbar.ident.start.placements import start_of_poses

HELD = 1e-6  # of a prior's sigma: below any length or angle that data could tell


@dataclass(frozen=True)
class LoopClosure:
    """How far robot and ball-bar disagree about the tool."""

    position_rms: float  # [m] of the norm
    position_max: float  # [m]
    angle_rms: float  # [rad] of the norm
    ratio: float  # residual over what noise explains

    @property
    def sentence(self) -> str:
        """Its sizes with their units."""
        position, largest, angle = (
            significant_text(v * 1e3, 2)
            for v in (self.position_rms, self.position_max, self.angle_rms)
        )
        return f"{position} mm rms (largest {largest}), {angle} mrad"


def recording_alone(
    cell: Cell, logs: Logs, options: FitOptions, listener: Listener = SILENT
) -> RecordingFit:
    """The `dh` fit of a recording, from which its own unknowns start.

    Raises StartError when the logs cannot be brought together, with the cause
    (ballbar.ident.causes).
    """
    try:
        return fit_recording(cell, logs, options, listener)
    except StartError as error:
        raise StartError(Causes.of(cell, [logs]).before(error)) from None


def closed_loop(
    robot: IdentifiedRobot,
    recording: RecordingFit,
    options: FitOptions,
    faults: Sequence[StepFault],
    excess: ExcessNoise,
    listener: Listener,
) -> Fit:
    """The recording's own unknowns fitted to a given robot, ball-bar and coefficients."""
    cell, source = robot.cell, recording.logs.force_source(options.force, robot.cell.robot)
    loaded = needs_loads(robot.corrections)
    steps = clock_steps_of(faults, 0)
    samples = with_tension(cell, recording, source, steps, loaded=loaded)
    slips = encoder_slips(faults)
    corrections = robot.corrections if slips is None else (*robot.corrections, slips)
    layout, _ = complete_unknowns(
        cell,
        robot.geometry,
        [start_of(recording, samples, source, robot.corrections)],
        corrections,
        gain_sigma=gain_sigma([source]) if loaded else None,
        rod_sigma=None,
    )
    layout = _held(layout, robot)
    masses = mass_model(cell) if loaded else None
    model = Model(gearing(cell.robot), masses, corrections, layout, (samples,))
    ballbar = samples.ballbar_angles(recording.geometry, recording.clock)
    pose = Pose(model, layout.mean.copy(), [ballbar])
    if searches_tension(robot.corrections, [source]):
        pose = continued(pose, listener)
    result = fit_pose(pose, excess)
    if not loaded:
        return result
    return fit_pose(Pose(with_likely_tension(result), result.x, result.ballbars), excess)


def freed(closed: Fit, machine: Machine, exchangeable: Mapping[str, float]) -> Fit:
    """The fit of `closed_loop` gone on with the machine as an unknown about where it was held.

    Free is what the machine's covariance names, each with the prior of an identification.
    exchangeable : priors [m] of parameters that an identification takes as exact, free as well.
    """
    layout, x, table = closed.model.unknowns, closed.x, machine.robot.geometry.table
    known = np.isin(layout.names, machine.names)
    layout = replace(layout, sigma=np.where(known, layout.sigma / HELD, layout.sigma))
    added = sorted(set(exchangeable) - set(layout.names), key=table.index.__getitem__)
    if added:
        layout, x = layout.with_shared(np.array([table.index[name] for name in added]), x)
        sigma = layout.sigma.copy()
        sigma[[layout.names.index(name) for name in added]] = [exchangeable[n] for n in added]
        layout = replace(layout, sigma=sigma)
    model = replace(closed.model, unknowns=layout)
    return fit_pose(Pose(model, x, closed.ballbars), closed.excess)


def _held(layout: Unknowns, robot: IdentifiedRobot) -> Unknowns:
    """The layout with geometry and coefficients held where they are."""
    count, geometry = _machine_count(layout, robot), layout.shared.size
    mean, sigma = layout.mean.copy(), layout.sigma.copy()
    mean[:geometry] = robot.geometry.values[layout.shared]
    mean[geometry:count] = robot.values
    sigma[:count] *= HELD
    return replace(layout, mean=mean, sigma=sigma)


def _machine_count(layout: Unknowns, robot: IdentifiedRobot) -> int:
    """How many unknowns, the first ones, are the machine's: geometry, then coefficients."""
    return layout.shared.size + robot.values.size


def normalised_innovation(closed: Fit, machine: Machine) -> float:
    """Residual of a machine that was held over what noise and its stated uncertainty explain."""
    layout = closed.model.unknowns
    held = np.arange(layout.count) < _machine_count(layout, machine.robot)
    data: Array = closed.linear.normal - np.diag(np.where(held, layout.sigma**-2.0, 0.0))
    mixed, own = data[np.ix_(held, ~held)], data[np.ix_(~held, ~held)]
    information = data[np.ix_(held, held)] - mixed @ np.linalg.solve(own, mixed.T)
    known = [k for k, name in enumerate(machine.names) if name in layout.names]
    at = [layout.names.index(machine.names[k]) for k in known]
    # trace(C S): chi-square that the machine's uncertainty adds on average
    added = np.trace(machine.covariance[np.ix_(known, known)] @ information[np.ix_(at, at)])
    return float(np.sqrt(closed.chi2_per_dof * closed.degrees / (closed.degrees + added)))


def loop_closure(fit: Fit) -> LoopClosure:
    """How far the loop of a fit of one recording is from closed."""
    (point,) = fit.linear.evaluations
    error = point.closure.error
    position, angle = (np.linalg.norm(part, axis=0) for part in (error[:3], error[3:]))
    return LoopClosure(
        position_rms=float(np.sqrt((position**2).mean())),
        position_max=float(position.max()),
        angle_rms=float(np.sqrt((angle**2).mean())),
        ratio=float(np.sqrt(fit.chi2_per_dof)),
    )


def placed(robot: IdentifiedRobot, table: PoseTable, known: dict[str, Placement]) -> Fit:
    """Seats of a table, and targets that are not known, fitted to a robot that is held."""
    layout = held_layout(robot, start_of_poses(table, robot.chain), known)
    noise = np.zeros(table.robot.joints)
    return fit_robustly(still_model(table, layout, robot.corrections, noise), layout.mean.copy())


def held_layout(
    robot: IdentifiedRobot, start: PlacedPoses, known: dict[str, Placement]
) -> Unknowns:
    """Unknowns of a table with the robot and the known targets held, seats free from `start`."""
    targets = {name: known.get(name, place) for name, place in start.targets.items()}
    layout = still_unknowns(robot.geometry, replace(start, targets=targets), robot.corrections)
    mean = layout.mean.copy()
    mean[layout.coefficients] = robot.values
    return replace(layout, mean=mean).held(name for name in targets if name in known)

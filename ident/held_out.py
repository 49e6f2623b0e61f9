"""Held-out validation: does an identified machine explain a recording it was not identified from?

Fitted is only what belongs to that recording itself: encoder offsets, base pose of the ball-bar,
clock, tension of the rod, step faults. Robot, ball-bar and corrections keep their values: priors so
narrow that no data could move them. The noise is that of the identification and not of this
recording, so a ratio above 1 is what the machine leaves unexplained. Some of that is expected: with
C the stated covariance of the machine and S the information that this recording holds on it, its
own unknowns fitted, chi-square is larger by trace(C S) on average. What exceeds that is a misfit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.number_text import significant_text
from ident.causes import Causes
from ident.complete_fit import (
    MEASURED,
    Pose,
    clock_steps_of,
    continued,
    fit_pose,
    needs_loads,
    start_of,
    with_likely_tension,
    with_tension,
)
from ident.estimator.build_unknowns import complete_unknowns
from ident.estimator.fit import Fit
from ident.estimator.model import Model, gearing
from ident.estimator.noise import ExcessNoise
from ident.estimator.step_faults import (
    MAX_FOUND,
    encoder_slips,
    find_step_fault,
    sized,
    step_faults_in_logs,
)
from ident.estimator.unknowns import Unknowns
from ident.loads.gear_loads import mass_model
from ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ident.recording_fit import Logs, RecordingFit, fit_recording
from ident.result import Identification, Machine
from ident.robot.identified import IdentifiedRobot
from ident.signals.steps import StepFault
from ident.start.automatic import StartError
from ident.tracker import TrackerCheck, check_tracker
from ident.verdict import MISFIT

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


@dataclass(frozen=True)
class HeldOut:
    """One recording that took no part in the identification."""

    name: str
    identified: LoopClosure
    normalised_innovation: float  # residual over what noise and the stated uncertainty explain
    nominal: LoopClosure  # of the catalogue's robot and ball-bar, the recording's own part fitted
    samples: int
    ambiguous: bool  # whether its logs can be aligned in more than one way
    step_faults: tuple[StepFault, ...]
    causes: Causes | None = None  # what may be wrong with its logs, where it is not acceptable
    tracker: TrackerCheck | None = None  # None without a tracker, or where it cannot be compared

    @property
    def acceptable(self) -> bool:
        return self.normalised_innovation**2 <= MISFIT and not self.ambiguous

    @property
    def sentence(self) -> str:
        """How well the machine explains the recording."""
        sizes = (self.nominal.position_rms * 1e3, self.identified.ratio, self.normalised_innovation)
        nominal, ratio, innovation = (significant_text(v, 2) for v in sizes)
        closure = (
            f"Held out {self.name}: the loop closes to {self.identified.sentence}; nominal robot "
            f"{nominal} mm. {ratio} times what noise explains, {innovation} with the stated "
            "uncertainty"
        )
        if self.ambiguous:
            doubt = "its logs can be aligned in more than one way, so this proves nothing"
            return f"{closure}; but {doubt}.{self._cause}"
        if self.acceptable:
            return f"{closure}."
        return (
            f"{closure}: a misfit. The machine as identified does not explain this "
            f"recording.{self._cause}"
        )

    @property
    def _cause(self) -> str:
        return f" Perhaps {self.causes}" if self.causes else ""


def held_out(
    result: Identification,
    logs: Logs,
    *,
    options: FitOptions = DEFAULTS,
    listener: Listener = SILENT,
) -> HeldOut:
    """How well an identified machine closes the loop of a recording it was not identified from.

    logs : of the same robot, ball-bar and plate. options : its samples and the source of its force.

    Raises StartError when the logs cannot be brought together, with the cause (ident.causes).
    """
    machine = result.machine
    cell, robot, excess = machine.robot.cell, machine.robot, machine.excess
    recording = recording_alone(cell, logs, options, listener)
    bare = robot.rigid(machine.nominal)
    listener.progress(f"closing the loop of {logs.name}")
    faults = step_faults_in_logs(recording.samples, recording.clock)
    # what a poor model leaves over passes for steps, so only the complete one looks for more
    most = len(faults) + MAX_FOUND if result.model == "complete" else 0
    closed = closed_loop(robot, recording, options, faults, excess, listener)
    while len(faults) < most and (fault := find_step_fault(closed)) is not None:
        faults = (*faults, fault)
        closed = closed_loop(robot, recording, options, faults, excess, listener)
    nominal = closed_loop(bare, recording, options, faults, excess, listener)
    tracker = None
    if logs.tracker is not None:
        both = closed.linear.evaluations[0], nominal.linear.evaluations[0]
        tracker = check_tracker(logs.tracker, *both, tcp_sigma=machine.tcp_sigma)
    outcome = HeldOut(
        name=logs.name,
        identified=loop_closure(closed),
        normalised_innovation=normalised_innovation(closed, machine),
        nominal=loop_closure(nominal),
        samples=closed.model.recordings[0].times.size,
        ambiguous=recording.start.ambiguous,
        step_faults=sized(closed, faults, cell.ballbar.encoder_lines),
        tracker=tracker,
    )
    return outcome if outcome.acceptable else replace(outcome, causes=Causes.of(cell, [logs]))


def recording_alone(
    cell: Cell, logs: Logs, options: FitOptions, listener: Listener = SILENT
) -> RecordingFit:
    """The `dh` fit of a recording, from which its own unknowns start.

    Raises StartError when the logs cannot be brought together, with the cause (ident.causes).
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
        [start_of(recording, samples, source)],
        corrections,
        measured_force=loaded and source in MEASURED,
        rod_sigma=None,
    )
    layout = _held(layout, robot)
    masses = mass_model(cell) if loaded else None
    model = Model(gearing(cell.robot), masses, corrections, layout, (samples,))
    ballbar = samples.ballbar_angles(recording.geometry, recording.clock)
    pose = Pose(model, layout.mean.copy(), [ballbar])
    if loaded and source == "none":
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
    added = _expected(closed, machine)
    return float(np.sqrt(closed.chi2_per_dof * closed.degrees / (closed.degrees + added)))


def _expected(fit: Fit, machine: Machine) -> float:
    """trace(C S): chi-square that the machine's uncertainty adds on average."""
    layout = fit.model.unknowns
    held = np.arange(layout.count) < _machine_count(layout, machine.robot)
    data: Array = fit.linear.normal - np.diag(np.where(held, layout.sigma**-2.0, 0.0))
    mixed, own = data[np.ix_(held, ~held)], data[np.ix_(~held, ~held)]
    information = data[np.ix_(held, held)] - mixed @ np.linalg.solve(own, mixed.T)
    known = [k for k, name in enumerate(machine.names) if name in layout.names]
    at = [layout.names.index(machine.names[k]) for k in known]
    return float(np.trace(machine.covariance[np.ix_(known, known)] @ information[np.ix_(at, at)]))


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

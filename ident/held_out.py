"""Held-out validation: does an identified machine explain a recording that it was not identified from?

Fitted is only what belongs to that recording itself: encoder zeros, where the ball-bar stands and leans, the clock, the rod's
tension, jumps. Robot, ball-bar and corrections keep their values: priors so narrow that no data could move them. The noise is
that of the identification and not of this recording, so a ratio above 1 is what the machine leaves unexplained. Some of that
is to be expected: with C the stated covariance of the machine and S the information that this recording holds on it, its own
unknowns fitted, chi-square is larger by trace(C S) on average. What is left over beyond that is a misfit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cell.geometry import nominal_geometry
from cell.logs import segment_starts
from ident.estimator.events import MAX_EVENTS, find_step_fault, jumps, sized, step_faults_in_logs
from ident.estimator.joint_fit import ExcessNoise, JointFit, Model, minimise
from ident.estimator.machine import (
    DEVIATION,
    NEEDS_LOADS,
    ForceSource,
    Prepared,
    continued,
    track,
    with_likely_tension,
)
from ident.estimator.problem import Clock
from ident.estimator.unknowns import RecordingShape, Unknowns, unknowns
from ident.identify import (
    DEFAULT_SAMPLES,
    WIDEST_KNOT_SPACING,
    Identification,
    Logs,
    MachineCovariance,
    identify,
)
from ident.loads.gear_loads import mass_model
from ident.robot.unloaded_robot import UnloadedRobot
from ident.signals.smooth_log import smooth_log
from ident.signals.step_fault import StepFault
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
    def in_words(self) -> str:
        position, largest, angle = (
            _two_digits(v * 1e3) for v in (self.position_rms, self.position_max, self.angle_rms)
        )
        return f"{position} mm rms (largest {largest}), {angle} mrad"


@dataclass(frozen=True)
class HeldOut:
    """One recording that took no part in the identification."""

    name: str
    identified: LoopClosure
    normalised_innovation: float  # residual of the identified machine over what noise and the machine's stated uncertainty explain
    nominal: LoopClosure  # the catalogue's robot and ball-bar, with the recording's own unknowns fitted to them likewise
    samples: int
    ambiguous: bool  # whether its logs can be aligned in more than one way
    events: tuple[StepFault, ...]

    @property
    def acceptable(self) -> bool:
        return self.normalised_innovation**2 <= MISFIT and not self.ambiguous

    @property
    def sentence(self) -> str:
        """In words."""
        nominal, ratio, normalised_innovation = (
            _two_digits(v)
            for v in (
                self.nominal.position_rms * 1e3,
                self.identified.ratio,
                self.normalised_innovation,
            )
        )
        told = (
            f"Held out {self.name}: the loop closes to {self.identified.in_words}; nominal robot {nominal} mm. "
            f"{ratio} times what noise explains, {normalised_innovation} with the stated uncertainty"
        )
        if self.ambiguous:
            return (
                f"{told}; but its logs can be aligned in more than one way, so this proves nothing."
            )
        return (
            f"{told}."
            if self.acceptable
            else f"{told}: a misfit. The machine as identified does not explain this recording."
        )


def _two_digits(value: float) -> str:
    decimals = 1 - math.floor(math.log10(value)) if value > 0.0 else 1
    return f"{value:.{max(0, decimals)}f}"


def held_out(
    machine: Identification,
    logs: Logs,
    *,
    name: str,
    force: ForceSource = "auto",
    samples: int = DEFAULT_SAMPLES,
    progress: Callable[[str], None] = lambda _: None,
) -> HeldOut:
    """How well an identified machine closes the loop of a recording that it was not identified from.

    logs : of the same robot, ball-bar and plate. name : of the recording. force : where the rod's tension comes from.

    Raises StartError when the logs cannot be brought together.
    """
    alone = identify(
        machine.cell,
        logs.robot,
        logs.ballbar,
        logs.force,
        model="dh",
        samples=samples,
        progress=progress,
    )
    recording = _prepared(alone, logs)
    robot, bare = (
        machine.unloaded_robot(),
        UnloadedRobot(machine.cell, nominal_geometry(machine.cell, np.zeros(3))),
    )
    progress(f"closing the loop of {name}")
    events = step_faults_in_logs(
        recording.robot, recording.bar, recording.joints, recording.signs, recording.clock
    )
    most = (
        len(events) + MAX_EVENTS if machine.model == "complete" else 0
    )  # what a poor model leaves over passes for jumps
    fit = _fit(robot, recording, force, events, machine.excess, progress)
    while len(events) < most and (event := find_step_fault(fit)) is not None:
        events = (*events, event)
        fit = _fit(robot, recording, force, events, machine.excess, progress)
    nominal = _fit(bare, recording, force, events, machine.excess, progress)
    return HeldOut(
        name,
        _closure(fit),
        float(
            np.sqrt(
                fit.chi2_per_dof
                * fit.degrees
                / (fit.degrees + _expected(fit, machine.machine, robot))
            )
        ),
        _closure(nominal),
        recording.times.size,
        alone.start.ambiguous,
        sized(fit, events, machine.cell.ballbar.encoder_lines),
    )


def _prepared(alone: Identification, logs: Logs) -> Prepared:
    """The recording, started from its own dh fit."""
    robot = smooth_log(
        logs.robot.t,
        logs.robot.q,
        widest_knot_spacing=WIDEST_KNOT_SPACING,
        starts=segment_starts(logs.robot.segment),
        checked=logs.robot.flags is not None,
    )
    bar = None
    if logs.ballbar is not None:
        starts = segment_starts(logs.ballbar.segment)
        bar = smooth_log(
            logs.ballbar.t,
            logs.ballbar.angles,
            widest_knot_spacing=WIDEST_KNOT_SPACING,
            starts=starts,
            checked=logs.ballbar.flags is not None,
        )
    signs, clock = np.array(alone.signs, dtype=float), alone.clock or Clock(0.0, 0.0)
    return Prepared(
        robot,
        bar,
        alone.joints,
        signs,
        alone.geometry,
        clock,
        alone.after.t,
        logs.robot,
        logs.force,
    )


def _fit(
    robot: UnloadedRobot,
    recording: Prepared,
    force: ForceSource,
    events: tuple[StepFault, ...],
    excess: ExcessNoise,
    progress: Callable[[str], None],
) -> JointFit:
    """The recording's own unknowns fitted to a given robot, ball-bar and coefficients of the corrections."""
    cell, source = robot.cell, recording.source(force)
    loaded = bool(NEEDS_LOADS & {c.name for c in robot.corrections})
    steps = tuple(e.time for e in events if e.kind == "clock")
    samples = replace(track(cell, recording, source if loaded else None), clock_steps=steps)
    shape = RecordingShape(
        recording.joints,
        recording.geometry,
        recording.clock if recording.has_clock else None,
        samples.knots.shape[0],
        DEVIATION[source],
        len(steps),
    )
    repaired = jumps(events)
    corrections = robot.corrections if repaired is None else (*robot.corrections, repaired)
    layout, _ = unknowns(
        cell,
        robot.geometry,
        [shape],
        corrections,
        measured_force=loaded and source != "none",
        rod_sigma=None,
    )
    layout = _held(layout, robot)
    model = Model(cell, mass_model(cell) if loaded else None, corrections, layout, (samples,))
    x, bars = layout.mean.copy(), [recording.angles(recording.times)[3]]
    if loaded and source == "none":
        x, bars = continued(model, x, bars, progress)
    fit = minimise(model, x, bars, excess)
    return (
        minimise(with_likely_tension(fit), fit.x, [p.bar for p in fit.linear.points], excess)
        if loaded
        else fit
    )


def _held(layout: Unknowns, robot: UnloadedRobot) -> Unknowns:
    """The layout with geometry and coefficients where they are."""
    count = _held_count(layout, robot)
    mean, sigma = layout.mean.copy(), layout.sigma.copy()
    mean[: layout.shared.size] = robot.geometry.values[layout.shared]
    if robot.values is not None:
        mean[layout.shared.size : count] = robot.values
    sigma[:count] *= HELD
    return replace(layout, mean=mean, sigma=sigma)


def _held_count(layout: Unknowns, robot: UnloadedRobot) -> int:
    """How many unknowns, the first ones, are the machine's; coefficients stand right behind the geometry."""
    return layout.shared.size + (0 if robot.values is None else robot.values.size)


def _expected(fit: JointFit, machine: MachineCovariance, robot: UnloadedRobot) -> float:
    """trace(C S): chi-square that the machine's uncertainty adds on average."""
    layout = fit.model.unknowns
    held = np.arange(layout.count) < _held_count(layout, robot)
    data = fit.linear.normal - np.diag(np.where(held, layout.sigma**-2.0, 0.0))
    mixed, own = data[np.ix_(held, ~held)], data[np.ix_(~held, ~held)]
    information = data[np.ix_(held, held)] - mixed @ np.linalg.solve(own, mixed.T)
    known = [k for k, name in enumerate(machine.names) if name in layout.names]
    at = [layout.names.index(machine.names[k]) for k in known]
    return float(np.trace(machine.values[np.ix_(known, known)] @ information[np.ix_(at, at)]))


def _closure(fit: JointFit) -> LoopClosure:
    (point,) = fit.linear.points
    position, angle = (
        np.linalg.norm(part, axis=0) for part in (point.closure.error[:3], point.closure.error[3:])
    )
    rms = float(np.sqrt((position**2).mean())), float(np.sqrt((angle**2).mean()))
    return LoopClosure(rms[0], float(position.max()), rms[1], float(np.sqrt(fit.chi2_per_dof)))

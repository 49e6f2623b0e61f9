"""The complete model: one machine from one or several recordings, with all supported corrections.

`dh` fit of each recording (ident.recording_fit) -> tension of the rod from what was logged, or from
geometry alone -> joint fit, noise levels, joint fit -> step faults -> corrections that the data do
not support dropped. Structure and measured guidance: notes/identification secs. 4 to 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from ident.corrections import belongs_to_machine, correction_named
from ident.corrections.base import Correction
from ident.corrections.joint_harmonics import JOINT_HARMONICS, joint_harmonics
from ident.estimator.fit import Fit, fit, thinned
from ident.estimator.model import Model, gearing
from ident.estimator.noise import ExcessNoise
from ident.estimator.samples import Samples, samples_of
from ident.estimator.step_faults import (
    MAX_FOUND,
    encoder_slips,
    find_step_fault,
    sized,
    step_faults_in_logs,
    with_exact_periods,
)
from ident.estimator.uncertainty import uncertainty
from ident.estimator.unknowns import TENSION_PRIOR, RecordingStart, Unknowns, complete_unknowns
from ident.estimator.variance_components import excess_noise
from ident.loads.gear_loads import mass_model
from ident.loads.instrument_force import FORCE_PRIOR, instrument_forces
from ident.loads.logged_tension import sensor_tension, tension_splines, torque_tension
from ident.options import SILENT, FitOptions, Listener
from ident.recording_fit import RecordingFit
from ident.signals.step_fault import StepFault

# [N] prior of a knot on top of what was measured (notes/identification secs. 4, 5)
DEVIATION = {"none": TENSION_PRIOR, "torque": 12.0, "sensor": 2.0, "instrument": FORCE_PRIOR}
MEASURED = ("torque", "sensor")
# Noise and width of backlash, times, without a measured tension (notes/identification sec. 4)
CONTINUATION = (20.0, 6.0, 2.0)
CONTINUED_ITERATIONS = 8
FIRST_EXCESS = ExcessNoise(5e-6, 1e-5, 1e-5, 1e-6)  # what the first fit finds on the full scenarios
NOISE_PASSES = 2  # fits with the noise levels of the one before
HELPS = 0.98  # of chi-square: what a step fault must bring it down to
NEEDS_LOADS = {"joint_compliance", "gear_backlash", "rod_strain", "plate_bending"}
# A correction stays whose coefficients' chi-square exceeds its count k by SUPPORT sqrt(2 k): four
# standard deviations of what chance gives.
SUPPORT = 4.0
MAX_ITERATIONS = 40
# A fit of so many of each recording comes first, where there are so many times more.
COARSE_SAMPLES, COARSE_SHARE = 1500, 3
PER_UNKNOWN = (
    1e-4  # predicted decrease for each unknown that ends a fit, as `fit.NEGLIGIBLE` for one
)


Orders = Sequence[tuple[int, float]]


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a fit begins."""

    model: Model
    x: Array  # (P,)
    ballbars: list[Array]  # (N, 5) [rad] of each recording


def fit_complete(
    cell: Cell,
    recordings: Sequence[RecordingFit],
    corrections: Sequence[str],
    options: FitOptions,
    listener: Listener = SILENT,
    *,
    orders: Orders = (),
) -> Fit:
    """The joint fit of all recordings with the named corrections, step faults repaired.

    orders : joint, from 0, and cycles a turn of periodic joint errors that were found.
    Corrections that the data do not support are left out, unless the options name them.
    """
    run = _Run(cell, recordings, options, listener, orders)
    lines, names = cell.ballbar.encoder_lines, list(corrections)
    names += [JOINT_HARMONICS] if orders else []
    faults = tuple(
        fault
        for k, r in enumerate(recordings)
        for fault in step_faults_in_logs(r.samples, r.clock, k)
    )
    most = len(faults) + MAX_FOUND
    result = run.first(names, faults)
    while len(faults) < most and (fault := find_step_fault(result)) is not None:
        listener.progress(f"a step fault at t = {fault.time:.1f} s: fitting again with it")
        tried = run.first(names, (*faults, fault))  # before it can pass for noise
        if tried.chi2_per_dof > HELPS * result.chi2_per_dof:  # whatever is wrong, it is no step
            break
        faults, result = (*faults, fault), tried
    result = run.with_noise(result)
    while len(faults) < most and (fault := find_step_fault(result)) is not None:
        listener.progress(f"a step fault at t = {fault.time:.1f} s: fitting again with it")
        faults = (*faults, fault)  # it shows only once the noise is known
        result = run.with_noise(run.first(names, faults))
    exact = with_exact_periods(result, faults, lines)
    idle = unsupported(result) if options.corrections is None else set()
    if idle or exact != faults:
        without = f"without {', '.join(sorted(idle))}" if idle else "with whole signal periods"
        listener.progress(f"fitting again {without}")
        names, faults = [name for name in names if name not in idle], exact
        result = run.with_noise(run.first(names, faults))
    return replace(result, step_faults=sized(result, faults, lines))


@dataclass(frozen=True, eq=False)
class _Run:
    """The stages of one complete fit."""

    cell: Cell
    recordings: Sequence[RecordingFit]
    options: FitOptions
    listener: Listener
    orders: Orders

    def first(self, names: Sequence[str], faults: tuple[StepFault, ...]) -> Fit:
        """A fit with the first guess of the noise."""
        self.listener.progress("preparing the complete model")
        pose = posed(self.cell, self.recordings, names, self.options, faults, self.orders)
        sources = [
            r.logs.force_source(self.options.force, self.cell.robot) for r in self.recordings
        ]
        if pose.model.masses is not None and "none" in sources:
            pose = continued(pose, self.listener)
        self.listener.progress(f"fitting {pose.model.unknowns.count} unknowns")
        return fit_pose(approached(pose, FIRST_EXCESS), FIRST_EXCESS, self.listener)

    def with_noise(self, result: Fit) -> Fit:
        """Further fits, each with the noise that the one before left unexplained."""
        for k in range(1, NOISE_PASSES + 1):
            begin = Pose(with_likely_tension(result), result.x, result.ballbars)
            excess, iterations = excess_noise(result), result.iterations
            del result  # large with many samples
            self.listener.progress(
                f"fitting {begin.x.size} unknowns with estimated noise, {k} of {NOISE_PASSES}"
            )
            result = fit_pose(begin, excess, self.listener)
            result = replace(result, iterations=iterations + result.iterations)
        return result


def fit_pose(
    pose: Pose,
    excess: ExcessNoise,
    listener: Listener = SILENT,
    *,
    per_unknown: float = PER_UNKNOWN,
    max_iterations: int = MAX_ITERATIONS,
) -> Fit:
    """The fit of a complete model from a pose; per_unknown : as `PER_UNKNOWN`."""
    return fit(
        pose.model,
        pose.x,
        pose.ballbars,
        excess,
        negligible=per_unknown * pose.x.size,
        max_iterations=max_iterations,
        on_iteration=listener.on_iteration,
    )


def approached(pose: Pose, excess: ExcessNoise) -> Pose:
    """The pose after a fit of a few of very many samples."""
    thin = thinned(pose.model, pose.ballbars, samples=COARSE_SAMPLES, times=COARSE_SHARE)
    if thin is None:
        return pose
    return replace(pose, x=fit_pose(Pose(thin[0], pose.x, thin[1]), excess, per_unknown=1e-2).x)


def posed(
    cell: Cell,
    recordings: Sequence[RecordingFit],
    corrections: Sequence[str],
    options: FitOptions,
    faults: tuple[StepFault, ...] = (),
    orders: Orders = (),
) -> Pose:
    """The complete model of some recordings, and where its fit starts.

    orders : joint, from 0, and cycles a turn of the joint errors, if they are a correction.
    """
    encoders = recordings[0].samples.encoders
    chosen = [
        joint_harmonics(orders)
        if name == JOINT_HARMONICS
        else correction_named(name, cell, encoders)
        for name in corrections
    ]
    slips = encoder_slips(faults)
    chosen += [] if slips is None else [slips]
    loaded = bool(NEEDS_LOADS & set(corrections))
    sources = [r.logs.force_source(options.force, cell.robot) for r in recordings]
    every = [
        with_tension(cell, r, source, clock_steps_of(faults, k), loaded=loaded)
        for k, (r, source) in enumerate(zip(recordings, sources, strict=True))
    ]
    starts = [
        start_of(r, samples, source)
        for r, samples, source in zip(recordings, every, sources, strict=True)
    ]
    layout, x = complete_unknowns(
        cell,
        recordings[0].nominal,
        starts,
        chosen,
        measured_force=loaded and any(source in MEASURED for source in sources),
        rod_sigma=options.rod_sigma,
    )
    masses = mass_model(cell) if loaded else None
    model = Model(gearing(cell), masses, tuple(chosen), layout, tuple(every))
    ballbars = [r.samples.ballbar_angles(r.geometry, r.clock) for r in recordings]
    return Pose(model, x, ballbars)


def clock_steps_of(faults: Sequence[StepFault], recording: int) -> tuple[float, ...]:
    """[s] instants at which a clock of one recording was set."""
    return tuple(f.time for f in faults if f.kind == "clock" and f.recording == recording)


def start_of(recording: RecordingFit, samples: Samples, source: str) -> RecordingStart:
    """Where one recording's own unknowns start; source : of the rod's tension."""
    return RecordingStart(
        encoders=samples.encoders,
        geometry=recording.geometry,
        clock=recording.clock if samples.has_clock else None,
        knots=samples.splines.shape[0],
        tension_sigma=DEVIATION[source],
        clock_steps=len(samples.clock_steps),
    )


def with_tension(
    cell: Cell,
    recording: RecordingFit,
    source: str,
    clock_steps: tuple[float, ...],
    *,
    loaded: bool,
) -> Samples:
    """The samples of a recording with the rod's measured tension and the splines of the rest.

    loaded : whether any correction needs loads. source : as of Logs.force_source.
    """
    old, logs = recording.samples, recording.logs
    new = samples_of(old.robot, old.ballbar, old.encoders, old.directions, old.times)
    new = replace(new, clock_steps=clock_steps)
    if not loaded:
        return new
    if source == "instrument" and cell.ballbar.stroke is not None:
        return replace(new, splines=instrument_forces(new, cell.ballbar.stroke))
    tension = np.zeros(old.times.size)
    geometry, clock = recording.geometry, recording.clock
    if source == "torque":
        log = logs.robot
        tension = torque_tension(cell, old, geometry, clock, log.t, log.torque)
    elif source == "sensor":
        tension = sensor_tension(cell, old, geometry, clock, logs.force)
    return replace(new, tension=tension, splines=tension_splines(old.times))


def continued(pose: Pose, listener: Listener = SILENT) -> Pose:
    """From nominal to where plain steps converge: much noise and wide backlash first, then less."""
    model, e = pose.model, FIRST_EXCESS
    for times in CONTINUATION:
        listener.progress(f"finding the force in the rod from geometry ({times:g} times the noise)")
        blurred = ExcessNoise(e.gear * times, e.wrist * times, e.bar * times, e.rod * times)
        softened = replace(pose, model=replace(model, sharpness=1.0 / times))
        result = fit_pose(softened, blurred, listener, max_iterations=CONTINUED_ITERATIONS)
        pose = Pose(model, result.x, result.ballbars)
    return pose


def with_likely_tension(result: Fit) -> Model:
    """The model with priors of the tension's knots as wide as they turned out (one EM step)."""
    layout: Unknowns = result.model.unknowns
    sigma = layout.sigma.copy()
    for own in layout.own:
        if own.knots is not None:
            variance = np.diag(result.covariance)[own.knots]
            sigma[own.knots] = np.sqrt(np.mean(result.x[own.knots] ** 2 + variance))
    return replace(result.model, unknowns=replace(layout, sigma=sigma))


def unsupported(result: Fit) -> set[str]:
    """Names of corrections whose coefficients are all zero as far as the data can tell."""
    stated, out = uncertainty(result), set()
    for correction in lasting(result):
        position = coefficients_of(result, correction)
        values = result.x[position]
        spread = stated.covariance[position, position]
        chi2 = float(values @ np.linalg.solve(spread, values))
        if chi2 < values.size + SUPPORT * np.sqrt(2.0 * values.size):
            out.add(correction.name)
    return out


def lasting(result: Fit) -> list[Correction]:
    """The corrections that belong to the machine: encoder slips belong to a recording."""
    return [c for c in result.model.corrections if belongs_to_machine(c)]


def coefficients_of(result: Fit, correction: Correction) -> slice:
    """Where a correction's coefficients stand in x. Raises KeyError if the fit has no such one."""
    first = result.model.unknowns.coefficients.start
    for other in result.model.corrections:
        count = len(other.coefficients)
        if other.name == correction.name:
            return slice(first, first + count)
        first += count
    raise KeyError(correction.name)

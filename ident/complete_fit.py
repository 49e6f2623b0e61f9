"""The complete model: one machine from one or several recordings, with all supported corrections.

`dh` fit of each recording (ballbar.ident.recording_fit) -> tension of the rod from what was logged,
or from geometry alone -> joint fit, noise levels, joint fit -> step faults -> corrections that the
data do not support dropped. Structure and measured guidance: notes/identification secs. 4 to 6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections import belongs_to_machine, correction_named, corrections_on_evidence
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.rod_elongation import ROD_ELONGATION
from ballbar.ident.estimator.build_unknowns import TENSION_PRIOR, RecordingStart, complete_unknowns
from ballbar.ident.estimator.fit import Fit, fit, thinned
from ballbar.ident.estimator.model import Evaluation, Model, gearing
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import NormalEquations
from ballbar.ident.estimator.observations import rounding_noise
from ballbar.ident.estimator.priors import declared_sigma, robot_unknowns, with_tails
from ballbar.ident.estimator.robust_fit import robust_weights
from ballbar.ident.estimator.sample_times import close_times
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.estimator.step_faults import (
    ENCODER_JUMPS,
    MAX_FOUND,
    encoder_slips,
    find_step_fault,
    sized,
    step_faults_in_logs,
    with_exact_periods,
)
from ballbar.ident.estimator.uncertainty import autocorrelation
from ballbar.ident.estimator.unknowns import PlacedPoses, Unknowns
from ballbar.ident.estimator.variance_components import excess_noise
from ballbar.ident.loads.gear_loads import mass_model
from ballbar.ident.loads.logged_tension import (
    FORCE_PRIOR,
    SPACING,
    instrument_forces,
    sensor_tension,
    tension_splines,
    torque_tension,
)
from ballbar.ident.model_choice import candidates_left_out, needed_corrections, present, unsupported
from ballbar.ident.options import SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import RecordingFit
from ballbar.ident.signals.steps import StepFault

# [N] prior of a knot on top of what was measured (notes/identification secs. 4, 5)
DEVIATION = {"none": TENSION_PRIOR, "torque": 12.0, "sensor": 2.0, "instrument": FORCE_PRIOR}
# Of the gain of a measured force: two gains of 2 % (notes/identification sec. 1); of a sensor six
# of 1 % and the weight of the tool, by which it was right to 0.5 %.
GAINS = {"torque": 0.03, "sensor": 0.01}
# Noise and width of backlash, times, without a measured tension (notes/identification sec. 4)
CONTINUATION = (20.0, 6.0, 2.0)
CONTINUED_ITERATIONS = 8
WANDERING = 100.0  # [N] prior of a knot of a force that the rod's length alone shows
FIRST_EXCESS = ExcessNoise(5e-6, 1e-5, 1e-5, 1e-6)  # what the first fit finds on the full scenarios
# Ripple, play and friction of typical gears: where the first guess leaves LEFT times chi-square
# because no file describes them, it has overpowered the priors, and the fit of a soft arm has ended
# in another minimum, 10 prior deviations off.
UNKNOWN_GEARS, LEFT = ExcessNoise(5e-5, 1e-4, 1e-5, 1e-6), 9.0
NOISE_PASSES = 2  # fits with the noise levels of the one before
HELPS = 0.98  # of chi-square: what a step fault must bring it down to
MAX_ITERATIONS = 100
# A first fit ends where after so many iterations it leaves this chi-square per degree of freedom,
# and neighbours in the residual are so correlated: no noise and no correction explains that. Sound
# machines are at 3 by then, another robot at 80 to 300, an encoder that is 10 ms late at 1400. The
# noise of what is left then takes so many iterations a pass.
PATIENCE, BEYOND, CORRELATED, ROUGH = 12, 50.0, 0.5, 4
# Iterations with new weights. After six, some fits went on to a minimum that their weights, up to
# 50 % off there, were not made for: all gears 2 % too soft at a stated 0.4 %; after 25, one of
# seven drawn robots of benchmarks.everything_on did not end.
NEW_WEIGHTS = 12
# A fit of so many of each recording comes first, where there are so many times more.
COARSE_SAMPLES, COARSE_SHARE = 1500, 3
# predicted decrease for each unknown that ends a fit, as `fit.NEGLIGIBLE` for one
PER_UNKNOWN = 1e-4


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a fit begins."""

    model: Model
    x: Array  # (P,)
    ballbars: list[Array]  # (N, 5) [rad] of each recording
    robust: tuple[Array, ...] = ()  # as of NormalEquations
    previous: tuple[Evaluation, ...] = ()  # evaluations near x


def fit_complete(
    cell: Cell,
    recordings: Sequence[RecordingFit],
    corrections: Sequence[str],
    options: FitOptions,
    listener: Listener = SILENT,
    extras: Sequence[Correction] = (),
    still: PlacedPoses | None = None,
) -> Fit:
    """The joint fit of all recordings with the named corrections, step faults repaired.

    extras : further corrections, formed by what the data have shown. still : poses of the same
    robot that are fitted together with the recordings.
    Corrections that the data do not support are left out, unless the options name them.
    """
    run, lines = _Run(cell, recordings, options, listener, still), cell.ballbar.encoder_lines
    chosen = [*run.formed(corrections), *extras]
    automatic = options.corrections is None
    tried = []
    if automatic and corrections:
        tried = run.formed(corrections_on_evidence(cell.robot, len(recordings)))
    faults = tuple(
        fault
        for k, r in enumerate(recordings)
        for fault in step_faults_in_logs(r.samples, r.clock, k)
    )
    most = len(faults) + MAX_FOUND
    result = run.first([*chosen, *tried], faults)
    while len(faults) < most and (fault := run.step_fault(result, faults)) is not None:
        listener.progress(f"a step fault at t = {fault.time:.1f} s: fitting again with it")
        # before it can pass for noise
        repaired = run.first([*chosen, *tried], (*faults, fault))
        if repaired.chi2_per_dof > HELPS * result.chi2_per_dof:  # whatever is wrong, it is no step
            break
        faults, result = (*faults, fault), repaired
    if result.given_up:
        listener.progress("no model explains the recordings: looking for the cause")
        rough = with_noise(result, listener, max_iterations=ROUGH)
        return replace(rough, step_faults=sized(result, faults, lines), given_up=result.given_up)
    needed = needed_corrections(result, tried) if tried else []
    chosen += needed
    pose = recast(result, chosen) if tried else None
    result = with_noise(result, listener, pose, passes=1)
    while len(faults) < most and (fault := run.step_fault(result, faults)) is not None:
        listener.progress(f"a step fault at t = {fault.time:.1f} s: fitting again with it")
        faults = (*faults, fault)  # it shows only once the noise is known
        result = with_noise(run.first(chosen, faults), listener, passes=1)
    exact = with_exact_periods(result, faults, lines)
    idle = unsupported(result) if automatic else set()
    while idle or exact != faults:
        without = f"without {', '.join(sorted(idle))}" if idle else "with whole signal periods"
        listener.progress(f"fitting again {without}")
        chosen = [c for c in chosen if c.name not in idle]
        left_out = candidates_left_out(result, idle)
        if exact == faults:
            result = with_noise(result, listener, recast(result, chosen), passes=1)
        else:
            faults = exact
            result = with_noise(run.first(chosen, faults), listener, passes=1)
        result = replace(result, left_out=left_out)
        idle = unsupported(result) if automatic else set()
    final = replace(with_noise(result, listener, passes=1), left_out=result.left_out)
    return replace(final, step_faults=sized(final, faults, lines))


@dataclass(frozen=True, eq=False)
class _Run:
    """The stages of one complete fit."""

    cell: Cell
    recordings: Sequence[RecordingFit]
    options: FitOptions
    listener: Listener
    still: PlacedPoses | None
    # recordings that by themselves show no step beyond some faults: number, and how many faults
    steady: set[tuple[int, int]] = field(default_factory=set)

    def formed(self, names: Sequence[str]) -> list[Correction]:
        """The corrections of these names."""
        encoders, count = self.recordings[0].samples.encoders, len(self.recordings)
        return [correction_named(name, self.cell, encoders, count) for name in names]

    def first(self, chosen: Sequence[Correction], faults: tuple[StepFault, ...]) -> Fit:
        """A fit with the first guess of the noise, or with that of gears that no file describes."""
        self.listener.progress("preparing the complete model")
        pose = posed(self.cell, self.recordings, chosen, self.options, faults, self.still)
        every = [r.logs.force_source(self.options.force, self.cell.robot) for r in self.recordings]
        for guess in (FIRST_EXCESS, UNKNOWN_GEARS):
            begin = pose
            if searches_tension(chosen, every):
                begin = continued(pose, self.listener, guess)
            self.listener.progress(f"fitting {pose.model.unknowns.count} unknowns")
            give_up = partial(_explains_nothing, pose.model)
            result = fit_pose(approached(begin, guess), guess, give_up=give_up)
            if result.chi2_per_dof < LEFT or not self.cell.robot.lacks("gears"):
                break
        return result

    def step_fault(self, result: Fit, faults: tuple[StepFault, ...]) -> StepFault | None:
        """The surest step fault that a fit shows, if its recording shows one by itself, too.

        What shows only beside the others is no step: they are of another machine. faults : those
        that are in the fit.
        """
        fault = find_step_fault(result)
        if fault is None or len(self.recordings) == 1:
            return fault
        k = fault.recording
        own = tuple(replace(other, recording=0) for other in faults if other.recording == k)
        if (k, len(own)) not in self.steady:
            alone = replace(self, recordings=[self.recordings[k]], still=None)
            by_itself = alone.first([c for c in present(result) if belongs_to_machine(c)], own)
            if find_step_fault(by_itself) is not None:
                return fault
            self.steady.add((k, len(own)))
        return None


def refit(result: Fit, extras: Sequence[Correction], listener: Listener = SILENT) -> Fit:
    """The fit begun again where it ended, with corrections that its residual has shown.

    extras : they replace those of the same names.
    """
    names = {correction.name for correction in extras}
    chosen = [c for c in present(result) if c.name not in names]
    pose = recast(result, [*chosen, *extras])
    refitted = with_noise(result, listener, pose)
    return replace(refitted, step_faults=result.step_faults, left_out=result.left_out)


def settled(result: Fit, listener: Listener = SILENT) -> Fit:
    """The fit without what it no longer needs, since it has more to explain the data with."""
    while idle := unsupported(result):
        listener.progress(f"fitting again without {', '.join(sorted(idle))}")
        pose = recast(result, [c for c in present(result) if c.name not in idle])
        left_out = candidates_left_out(result, idle)
        refitted = with_noise(result, listener, pose)
        result = replace(refitted, step_faults=result.step_faults, left_out=left_out)
    return result


def recast(result: Fit, chosen: Sequence[Correction]) -> Pose:
    """The model of a fit with other corrections, at what the fit has found.

    Encoder slips stay, and the tension is as likely as it turned out.
    """
    model = with_likely_priors(result)
    slips = [c for c in result.model.corrections if c.name == ENCODER_JUMPS]
    corrections = (*chosen, *slips)
    coefficients = [c for correction in corrections for c in correction.coefficients]
    layout, x = model.unknowns.with_coefficients(coefficients, result.x)
    model = replace(model, corrections=corrections, unknowns=layout)
    previous = tuple(replace(at, regressors_at=None) for at in result.linear.evaluations)
    return Pose(model, x, result.ballbars, previous=previous)


def with_likely_priors(result: Fit) -> Model:
    """`with_likely_tension`, and the tails of the priors of the robot's parameters."""
    model = with_likely_tension(result)
    layout = model.unknowns
    sigma, robot = declared_sigma(layout), robot_unknowns(layout)
    sigma[robot] = with_tails(sigma[robot], (result.x - layout.mean)[robot])
    return replace(model, unknowns=replace(layout, sigma=sigma))


def _explains_nothing(model: Model, equations: NormalEquations, iterations: int) -> bool:
    """Whether a first fit leaves so much, and so systematically, that nothing will come of it."""
    if iterations < PATIENCE or equations.data_cost < BEYOND * equations.equations:
        return False
    residuals = zip(model.recordings, equations.residuals, strict=False)
    return max(autocorrelation(r, s.times, s.smoothing) for s, r in residuals) > CORRELATED


def with_noise(
    result: Fit,
    listener: Listener = SILENT,
    pose: Pose | None = None,
    *,
    passes: int = NOISE_PASSES,
    max_iterations: int = MAX_ITERATIONS,
) -> Fit:
    """Further fits, each with the noise that the one before left unexplained.

    pose : where the first begins, if not at the result. passes : so many. max_iterations : of each.
    """
    for _ in range(passes):
        begin = pose or Pose(
            with_likely_priors(result),
            result.x,
            result.ballbars,
            previous=result.linear.evaluations,
        )
        begin, pose = replace(begin, robust=_robust(result)), None
        excess, iterations = excess_noise(result), result.iterations
        del result  # large with many samples
        listener.progress(f"fitting {begin.x.size} unknowns with estimated noise")
        result = fit_pose(begin, excess, max_iterations=max_iterations)
        result = replace(result, iterations=iterations + result.iterations)
    return result


def _robust(result: Fit) -> tuple[Array, ...]:
    """Square root of robust weights: of still poses Huber's, of recordings all one."""
    if result.model.table is None:
        return ()
    count = len(result.model.recordings)
    full = [np.ones(point.samples.size) for point, _, _ in result.recorded]
    return (*full, *robust_weights(result.linear, first=count))


def fit_pose(
    pose: Pose,
    excess: ExcessNoise,
    *,
    per_unknown: float = PER_UNKNOWN,
    max_iterations: int = MAX_ITERATIONS,
    give_up: Callable[[NormalEquations, int], bool] = lambda *_: False,
) -> Fit:
    """The fit of a complete model from a pose; per_unknown : as `PER_UNKNOWN`."""
    return fit(
        pose.model,
        pose.x,
        pose.ballbars,
        excess,
        negligible=per_unknown * pose.x.size,
        max_iterations=max_iterations,
        freeze_after=NEW_WEIGHTS,
        robust=pose.robust,
        previous=pose.previous,
        give_up=give_up,
    )


def approached(pose: Pose, excess: ExcessNoise) -> Pose:
    """The pose after a fit of a few of very many samples."""
    thin = thinned(pose.model, pose.ballbars, samples=COARSE_SAMPLES, times=COARSE_SHARE)
    if thin is None:
        return pose
    model, ballbars = thin
    count = len(model.recordings)
    robust = (*(np.ones(r.size) for r in model.recordings), *pose.robust[count:])
    coarse = Pose(model, pose.x, ballbars, robust if pose.robust else ())
    return replace(pose, x=fit_pose(coarse, excess, per_unknown=1e-2).x)


def posed(
    cell: Cell,
    recordings: Sequence[RecordingFit],
    corrections: Sequence[Correction],
    options: FitOptions,
    faults: tuple[StepFault, ...] = (),
    still: PlacedPoses | None = None,
) -> Pose:
    """The complete model of recordings and still poses, and where its fit starts."""
    slips = encoder_slips(faults)
    chosen = [*corrections] if slips is None else [*corrections, slips]
    loaded = needs_loads(chosen)
    sources = [r.logs.force_source(options.force, cell.robot) for r in recordings]
    every = [
        with_tension(cell, r, source, clock_steps_of(faults, k), loaded=loaded)
        for k, (r, source) in enumerate(zip(recordings, sources, strict=True))
    ]
    starts = [
        start_of(r, samples, source, chosen)
        for r, samples, source in zip(recordings, every, sources, strict=True)
    ]
    layout, x = complete_unknowns(
        cell,
        recordings[0].nominal,
        starts,
        chosen,
        gain_sigma=gain_sigma(sources) if loaded else None,
        rod_sigma=options.rod_sigma,
        still=still,
    )
    masses = mass_model(cell) if loaded else None
    model = Model(gearing(cell.robot), masses, tuple(chosen), layout, tuple(every))
    ballbars = [
        samples.ballbar_angles(r.geometry, r.clock)
        for r, samples in zip(recordings, every, strict=True)
    ]
    if still is None:
        return Pose(model, x, ballbars)
    model = replace(model, table=still.table, angle_noise=rounding_noise(still.table.q))
    ballbars += [np.zeros((group.size, 0)) for group in still.table.groups]
    return Pose(model, x, ballbars, (*(np.ones(s.size) for s in every), *still.robust))


def needs_loads(corrections: Sequence[Correction]) -> bool:
    """Whether any of them depends on loads."""
    return any(correction.slopes is not None for correction in corrections)


def wanders(corrections: Sequence[Correction]) -> bool:
    """Whether the tension enters by a rod that wanders, and by nothing else.

    Its prior then stays wide: it follows from the path, as errors of the geometry do, and a prior
    as narrow as it turns out would take their part for sure.
    """
    return [c.name for c in corrections if c.slopes is not None] == [ROD_ELONGATION]


def searches_tension(corrections: Sequence[Correction], sources: Sequence[str]) -> bool:
    """Whether geometry alone has to tell a tension on which more than the rod's length depends."""
    return needs_loads(corrections) and not wanders(corrections) and "none" in sources


def clock_steps_of(faults: Sequence[StepFault], recording: int) -> tuple[float, ...]:
    """[s] instants at which a clock of one recording was set."""
    return tuple(f.time for f in faults if f.kind == "clock" and f.recording == recording)


def gain_sigma(sources: Iterable[str]) -> float | None:
    """Prior of the gain of the rod's tension from these sources; None where nothing measured it."""
    return max((GAINS[source] for source in sources if source in GAINS), default=None)


def start_of(
    recording: RecordingFit, samples: Samples, source: str, corrections: Sequence[Correction]
) -> RecordingStart:
    """Where one recording's own unknowns start.

    source : of the rod's tension. corrections : of the fit.
    """
    return RecordingStart(
        encoders=samples.encoders,
        geometry=recording.geometry,
        clock=recording.clock if samples.has_clock else None,
        knots=samples.splines.shape[0],
        tension_sigma=WANDERING if wanders(corrections) else DEVIATION[source],
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
    geometry, clock = recording.as_built, recording.clock
    times = close_times(old, clock, SPACING) if loaded else old.times
    new = samples_of(old.robot, old.ballbar, old.encoders, old.directions, times)
    new = replace(new, clock_steps=clock_steps)
    if not loaded:
        return new
    if source == "instrument" and cell.ballbar.stroke is not None:
        return replace(new, splines=instrument_forces(new, cell.ballbar.stroke))
    tension = np.zeros(times.size)
    if source == "torque":
        tension = torque_tension(cell, new, geometry, clock, logs.robot)
    elif source == "sensor":
        tension = sensor_tension(cell, new, geometry, clock, logs.force)
    return replace(new, tension=tension, splines=tension_splines(times))


def continued(pose: Pose, listener: Listener = SILENT, e: ExcessNoise = FIRST_EXCESS) -> Pose:
    """From nominal to where plain steps converge: much noise and wide backlash first, then less.

    e : noise of the fit that follows.
    """
    model = pose.model
    for times in CONTINUATION:
        listener.progress(f"finding the force in the rod from geometry ({times:g} times the noise)")
        blurred = ExcessNoise(e.gear * times, e.wrist * times, e.bar * times, e.rod * times)
        softened = replace(pose, model=replace(model, sharpness=1.0 / times))
        result = fit_pose(softened, blurred, max_iterations=CONTINUED_ITERATIONS)
        pose = Pose(model, result.x, result.ballbars)
    return pose


def with_likely_tension(result: Fit) -> Model:
    """The model with priors of the tension's knots as wide as they turned out (one EM step)."""
    layout: Unknowns = result.model.unknowns
    if wanders(result.model.corrections):
        return result.model
    sigma = layout.sigma.copy()
    for own in layout.own:
        if own.knots is not None:
            variance = np.diag(result.covariance)[own.knots]
            sigma[own.knots] = np.sqrt(np.mean(result.x[own.knots] ** 2 + variance))
    return replace(result.model, unknowns=replace(layout, sigma=sigma))

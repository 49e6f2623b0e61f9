"""From logs to the robot's parameters, with their uncertainty and a verdict in words.

Each recording: smooth -> automatic start -> identifiable subset -> whitened fit of the `dh` model with the clock as parameter.
Where that leaves something systematic, or several recordings are given: the complete model of all recordings together
(ident.estimator.machine).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from cell.descriptions import Cell
from cell.geometry import INDEX, NAMES, PARAMETERS, Geometry, nominal_geometry
from cell.logs import BallBarLog, ForceLog, RobotLog, segment_starts
from ident.corrections import CORRECTIONS
from ident.estimator.events import as_logged, step_faults_in_logs
from ident.estimator.identifiability import Dependency, Identifiability, candidates, identifiable
from ident.estimator.iteration import IterationCallback
from ident.estimator.joint_fit import ExcessNoise, JointFit, tension_at
from ident.estimator.machine import ForceSource, Prepared, coefficients_of, fit_machine
from ident.estimator.noise import noise_from_logs, rod_deviation, row_noise
from ident.estimator.problem import Clock, Estimate, NoiseModel, Problem
from ident.estimator.sampling import sample_times
from ident.estimator.solver import Fit, solve
from ident.estimator.uncertainty import Uncertainty, autocorrelation, block_widening, uncertainty
from ident.estimator.unknowns import FIXED, PLACE
from ident.remarks import log_remarks
from ident.robot.accuracy import accuracy_grid, position_sigma, tcp_sigma
from ident.robot.unloaded_robot import UnloadedRobot
from ident.signals.smooth_log import SmoothLog, smooth_log, smoothing
from ident.signals.step_fault import StepFault
from ident.start.automatic import Start, automatic_start, fitted
from ident.verdict import STRAINED, Evidence, Verdict, judge

WIDEST_KNOT_SPACING = 0.08  # [s] a robot's motion below 3 Hz; finer where the residual asks for it (ident.signals.smooth_log)
ROD_SIGMA_START = 2e-6  # [m] 55 N on 2.7e7 N/m, until the residuals say better
DEFAULT_SAMPLES = 1500  # thesis sec. 3.5
COMPLETE_ENCODERS = 4  # fewer cannot carry the complete model (notes/identification sec. 2)
MOSTLY_PRIOR = 0.5  # share of an unknown's knowledge below which it is said to stand at its prior

ModelName = Literal["auto", "dh", "complete"]


@dataclass(frozen=True, eq=False)
class Logs:
    """The logs of one recording, as read."""

    robot: RobotLog
    ballbar: BallBarLog | None  # None for a ball-bar without encoders
    force: ForceLog | None = None  # of a sensor at the flange


@dataclass(frozen=True, eq=False)
class Residuals:
    """Loop-closure mismatch over the run, in the direction that can be seen."""

    t: Array  # (N,) [s] on the ball-bar clock (robot clock without encoders)
    position: Array  # (N, 3) [m] robot base frame
    angle: Array  # (N, 3) [rad] robot base frame


@dataclass(frozen=True)
class CoefficientValue:
    """One coefficient of a correction, as found."""

    name: str
    unit: str
    value: float
    sigma: float
    prior: float
    prior_sigma: float
    information_gain: float  # 0 to 1: how much of the knowledge is the data's and not the prior's


@dataclass(frozen=True)
class CorrectionValue:
    """One correction, as found."""

    name: str
    sentence: str
    coefficients: tuple[CoefficientValue, ...]


@dataclass(frozen=True, eq=False)
class MachineCovariance:
    """How far the unknowns are known that belong to robot, ball-bar and corrections, and not to one recording."""

    names: tuple[
        str, ...
    ]  # of kinematic parameters, then of coefficients; what is not named was taken as exact
    values: Array  # (U, U) SI units


@dataclass(frozen=True, eq=False)
class Identification:
    """What one recording, or the first of several, says about the robot."""

    cell: Cell
    joints: tuple[int, ...]
    nominal: Geometry
    geometry: Geometry  # identified; parameters left out stay nominal
    sigma: dict[
        str, float
    ]  # [m, rad] of the identified parameters, scaled up where the fit is poor
    covariance: Array  # (P [+ 2], P [+ 2]) of `parameters`, then offset and skew; scaled likewise
    parameters: NDArray[np.intp]
    machine: MachineCovariance
    clock: Clock | None
    clock_sigma: tuple[float, float]  # [s], [1]; zero without encoders
    signs: tuple[int, ...]  # of each encoder relative to the declared sense
    noise: NoiseModel  # of the samples in the fit
    log_noise: NoiseModel  # of one row of the logs
    excess: ExcessNoise  # beyond what the logs show, found from the residual
    autocorrelation: float  # of neighbours in the whitened residual, mean over the equations
    chi2_per_dof: float
    converged: bool
    start: Start
    iterations: int  # of the chosen hypothesis and the final fits together
    identifiability: Identifiability
    before: Residuals  # nominal robot, ball-bar placed and clock set as well as it can be
    after: Residuals
    whitened: Array  # (6 - m, N) residuals of the final fit in units of their standard deviation
    tcp_sigma: Array  # (G,) [m] stated TCP uncertainty over the accuracy grid
    verdict: Verdict
    corrections: tuple[CorrectionValue, ...] = ()
    tension: Array = field(
        default_factory=lambda: np.zeros(0)
    )  # (N,) [N] of the rod at the samples, complete model only
    tension_source: str = ""  # "sensor", "torque" or "none"
    events: tuple[StepFault, ...] = ()

    @property
    def model(self) -> Literal["dh", "complete"]:
        return "complete" if self.corrections else "dh"

    def unloaded_robot(self) -> UnloadedRobot:
        """The robot as identified, without ball-bar."""
        return unloaded_robot(self.cell, self.geometry, self.joints, self.corrections)


def unloaded_robot(
    cell: Cell, geometry: Geometry, joints: tuple[int, ...], corrections: Sequence[CorrectionValue]
) -> UnloadedRobot:
    """A robot with the corrections that were found; joints : encoders of the ball-bar that found them."""
    made = tuple(CORRECTIONS[c.name](cell, joints) for c in corrections)
    values = np.array([c.value for one in corrections for c in one.coefficients])
    return UnloadedRobot(cell, geometry, made, values)


@dataclass(frozen=True, eq=False)
class Alone:
    """One recording fitted with the dh model."""

    problem: Problem
    nominal: Geometry
    start: Start
    subset: Identifiability
    fit: Fit
    iterations: int
    logs: Logs

    @property
    def estimate(self) -> Estimate:
        return self.fit.estimate

    def prepared(self) -> Prepared:
        """For the complete model."""
        p = self.problem
        here, logs = self.estimate, self.logs
        return Prepared(
            p.robot,
            p.bar,
            p.joints,
            p.signs,
            here.geometry,
            here.clock,
            p.times,
            logs.robot,
            logs.force,
        )


def identify(
    cell: Cell,
    robot_log: RobotLog,
    ballbar_log: BallBarLog | None,
    force_log: ForceLog | None = None,
    *,
    model: ModelName = "auto",
    corrections: Sequence[str] | None = None,
    force: ForceSource = "auto",
    rod_sigma: float | None = None,
    samples: int = DEFAULT_SAMPLES,
    progress: Callable[[str], None] = lambda _: None,
    on_iteration: IterationCallback | None = None,
) -> Identification:
    """Identify robot, ball-bar position, encoder zeros and clock from one recording.

    ballbar_log : None for a ball-bar without encoders. force_log : of a sensor at the flange.
    model : `dh`, the parameters of thesis Table 3.1; `complete`, with corrections; `auto`, complete where dh leaves something.
    corrections : names of ident.corrections; None for those that the data support.
    force : where the rod's force comes from; `auto` takes the best signal that was logged.
    rod_sigma : [m] of a measured rod length (the ball-bar's bd3 is then that length); None for the catalogue's tolerance.
    progress : called with a short sentence at each stage. on_iteration : called with each iteration of the chosen start and of the fits.

    Raises StartError when the logs cannot be brought together; ValueError for an unknown correction.
    """
    logs = [Logs(robot_log, ballbar_log, force_log)]
    return identify_together(
        cell,
        logs,
        model=model,
        corrections=corrections,
        force=force,
        rod_sigma=rod_sigma,
        samples=samples,
        progress=progress,
        on_iteration=on_iteration,
    )[0]


def identify_together(
    cell: Cell,
    recordings: Sequence[Logs],
    *,
    model: ModelName = "auto",
    corrections: Sequence[str] | None = None,
    force: ForceSource = "auto",
    rod_sigma: float | None = None,
    samples: int = DEFAULT_SAMPLES,
    progress: Callable[[str], None] = lambda _: None,
    on_iteration: IterationCallback | None = None,
) -> list[Identification]:
    """One robot from several recordings: an Identification each, with the robot in common.

    Each recording has its own clock, encoder zeros and ball-bar place; options as in `identify`. Raises as `identify` does.
    """
    for name in corrections or ():
        if name not in CORRECTIONS:
            raise ValueError(f"unknown correction {name!r}; there are {', '.join(CORRECTIONS)}")
    alone = [
        fit_alone(cell, logs, samples, progress, None if k else on_iteration)
        for k, logs in enumerate(recordings)
    ]
    if len(alone) == 1:
        simple = _outcome(cell, alone[0])
        if model == "dh" or (model == "auto" and corrections is None and not _wants_more(simple)):
            return [simple]
    elif model == "dh":
        raise ValueError("model: dh fits one recording; several together need the complete model")
    asked = list(CORRECTIONS) if corrections is None else list(corrections)
    if (
        model == "auto"
        and corrections is None
        and len(alone) == 1
        and len(alone[0].problem.joints) < COMPLETE_ENCODERS
    ):
        asked = []  # jumps can be sized all the same
    prepared = [one.prepared() for one in alone]
    fit = fit_machine(
        cell,
        alone[0].nominal,
        prepared,
        asked,
        force=force,
        rod_sigma=rod_sigma,
        prune=corrections is None,
        progress=progress,
        on_iteration=on_iteration,
    )
    trust = uncertainty(fit)
    sources = [one.source(force) for one in prepared]
    return [_of_machine(cell, alone, fit, trust, k, sources[k]) for k in range(len(alone))]


def _wants_more(simple: Identification) -> bool:
    """Whether the dh model leaves something that the complete one could explain, or a jump to be sized."""
    left = (
        simple.verdict.status in ("suspect", "misfit") and len(simple.joints) >= COMPLETE_ENCODERS
    )
    return left or bool(simple.events)


def fit_alone(
    cell: Cell,
    logs: Logs,
    samples: int = DEFAULT_SAMPLES,
    progress: Callable[[str], None] = lambda _: None,
    on_iteration: IterationCallback | None = None,
) -> Alone:
    """The dh fit of one recording, from its logs. Raises StartError when they cannot be brought together."""
    progress("smoothing both logs")
    robot, bar, joints = _smoothed(logs.robot, logs.ballbar)
    spacing = (robot.end - robot.start) / samples
    noise = noise_from_logs(robot, bar, joints, spacing=spacing, rod=ROD_SIGMA_START)
    nominal = nominal_geometry(cell, np.zeros(3))
    progress("aligning the logs and finding the ball-bar")
    start = automatic_start(robot, bar, joints, nominal, noise)
    chosen = start.chosen
    if on_iteration:
        fitted(
            chosen.hypothesis, robot, bar, joints, noise, on_iteration
        )  # once more, to be watched alone among its rivals
    progress("fitting")
    times = sample_times(robot, bar, chosen.fit.estimate.clock, samples)
    noise = noise_from_logs(
        robot, bar, joints, spacing=float(times[1] - times[0]), rod=ROD_SIGMA_START
    )
    problem = Problem(
        robot, bar, joints, np.array(chosen.hypothesis.signs, dtype=float), times, noise
    )
    here = problem.start(chosen.fit.estimate.geometry, chosen.fit.estimate.clock)
    subset = identifiable(problem, here, nominal, candidates(joints))
    first = solve(
        problem,
        _on_nominal(problem, here, nominal, subset.parameters),
        subset.parameters,
        on_iteration=on_iteration,
    )
    problem = replace(
        problem,
        noise=replace(
            noise,
            rod=rod_deviation(replace(problem, noise=replace(noise, rod=0.0)), first.estimate),
        ),
    )
    fit = solve(problem, first.estimate, subset.parameters, on_iteration=on_iteration)
    return Alone(
        problem,
        nominal,
        start,
        subset,
        fit,
        chosen.fit.iterations + first.iterations + fit.iterations,
        logs,
    )


def _smoothed(
    robot_log: RobotLog, ballbar_log: BallBarLog | None
) -> tuple[SmoothLog, SmoothLog | None, tuple[int, ...]]:
    robot = smooth_log(
        robot_log.t,
        robot_log.q,
        widest_knot_spacing=WIDEST_KNOT_SPACING,
        starts=segment_starts(robot_log.segment),
        checked=robot_log.flags is not None,
    )
    if ballbar_log is None:
        return robot, None, ()
    starts = segment_starts(ballbar_log.segment)
    bar = smooth_log(
        ballbar_log.t,
        ballbar_log.angles,
        widest_knot_spacing=WIDEST_KNOT_SPACING,
        starts=starts,
        checked=ballbar_log.flags is not None,
    )
    return robot, bar, ballbar_log.joints


def _on_nominal(
    problem: Problem, estimate: Estimate, nominal: Geometry, parameters: NDArray[np.intp]
) -> Estimate:
    """The estimate with every parameter that is not to be identified back at its catalogue value."""
    values = nominal.values.copy()
    values[parameters] = estimate.geometry.values[parameters]
    origin = [INDEX[name] for name in ("ox", "oy", "oz")]
    values[origin] = estimate.geometry.values[origin]
    return problem.start(Geometry(values), estimate.clock)


def _outcome(cell: Cell, alone: Alone) -> Identification:
    """The dh model's result."""
    problem, fit, start = alone.problem, alone.fit, alone.start
    whitened = fit.final.residual.reshape(-1, problem.times.size)
    inflation = max(1.0, fit.chi2_per_dof)  # a misfit widens the intervals; it never narrows them
    widening = block_widening(fit.covariance, _scores(fit), problem.times)
    covariance = fit.covariance * inflation * np.outer(widening, widening)
    deviations = np.sqrt(np.diag(covariance))
    geometry = _wrapped(fit.estimate.geometry)
    clock = fit.estimate.clock if problem.has_clock else None
    identified = tuple(NAMES[i] for i in fit.parameters)
    found = step_faults_in_logs(
        problem.robot, problem.bar, problem.joints, problem.signs, fit.estimate.clock
    )
    events = tuple(as_logged(event, problem.bar, cell.ballbar.encoder_lines) for event in found)
    evidence = Evidence(
        fit.converged,
        fit.iterations,
        fit.chi2_per_dof,
        autocorrelation(whitened, problem.times, smoothing(problem.robot, problem.bar)),
        fit.estimate.geometry,
        identified,
        problem.times.size,
        False,
        log_remarks(problem.robot, problem.bar, problem.joints, events),
    )
    return Identification(
        cell=cell,
        joints=problem.joints,
        nominal=_placed(alone.nominal, geometry),
        geometry=geometry,
        sigma={NAMES[i]: float(s) for i, s in zip(fit.parameters, deviations, strict=False)},
        covariance=covariance,
        parameters=fit.parameters,
        machine=_machine_part(fit.parameters, covariance),
        clock=clock,
        clock_sigma=(float(deviations[-2]), float(deviations[-1])) if clock else (0.0, 0.0),
        signs=start.chosen.hypothesis.signs,
        noise=problem.noise,
        log_noise=row_noise(problem.robot, problem.bar, problem.joints, rod=problem.noise.rod),
        excess=ExcessNoise(rod=problem.noise.rod),
        autocorrelation=evidence.autocorrelation,
        chi2_per_dof=fit.chi2_per_dof,
        converged=fit.converged,
        start=start,
        iterations=alone.iterations,
        identifiability=alone.subset,
        before=_residuals(problem, _nominal_robot_fit(problem, fit.estimate, alone.nominal)),
        after=_residuals(problem, fit.estimate),
        whitened=whitened,
        tcp_sigma=tcp_sigma(geometry, accuracy_grid(cell.robot), fit.parameters, covariance),
        verdict=judge(evidence, start, cell, alone.nominal, problem.joints),
        events=events,
    )


def _scores(fit: Fit) -> Array:
    """(P, N) gradient of half the cost that each sample contributes."""
    final, n = fit.final, fit.final.closure.error.shape[1]
    return np.asarray(
        (final.jacobian * final.residual).reshape(final.jacobian.shape[0], -1, n).sum(axis=1)
    )


def _of_machine(
    cell: Cell, alone: Sequence[Alone], fit: JointFit, trust: Uncertainty, k: int, source: str
) -> Identification:
    """The complete model's result for recording k."""
    layout, one = fit.model.unknowns, alone[k]
    problem = one.problem
    geometry = _wrapped(layout.geometry(fit.x, k))
    place, clock = layout.own[k].place, layout.own[k].clock
    unknowns = np.concatenate(
        (np.arange(layout.shared.size), _indices(layout.own[k].zeros), _indices(place))
    )
    parameters = np.concatenate(
        (layout.shared, layout.zero_parameters[k], [INDEX[n] for n in PLACE])
    ).astype(np.intp)
    information_gain = trust.information_gain[unknowns] > MOSTLY_PRIOR
    told = (
        unknowns[information_gain]
        if clock is None
        else np.concatenate((unknowns[information_gain], _indices(clock)))
    )
    covariance = trust.covariance[np.ix_(told, told)]
    deviations = np.sqrt(np.diag(covariance))
    parameters = parameters[information_gain]
    point = fit.linear.points[k]
    events = tuple(event for event in fit.events if event.recording == k)
    corrections = _correction_values(fit, trust)
    machine = _machine_unknowns(fit)
    at_prior = [NAMES[i] for i in layout.shared if i not in parameters]
    evidence = Evidence(
        fit.converged,
        fit.iterations,
        fit.chi2_per_dof,
        trust.autocorrelation,
        geometry,
        tuple(NAMES[i] for i in parameters),
        problem.times.size,
        True,
        log_remarks(problem.robot, problem.bar, problem.joints, events),
        strained(fit),
    )
    error = point.closure.error
    found = layout.clock(fit.x, k)
    return Identification(
        cell=cell,
        joints=problem.joints,
        nominal=_placed(one.nominal, geometry),
        geometry=geometry,
        sigma={NAMES[i]: float(s) for i, s in zip(parameters, deviations, strict=False)},
        covariance=covariance,
        parameters=parameters,
        machine=MachineCovariance(
            tuple(layout.names[i] for i in machine), trust.covariance[np.ix_(machine, machine)]
        ),
        clock=None if clock is None else found,
        clock_sigma=(0.0, 0.0) if clock is None else (float(deviations[-2]), float(deviations[-1])),
        signs=one.start.chosen.hypothesis.signs,
        noise=replace(problem.noise, rod=fit.excess.rod),
        log_noise=row_noise(problem.robot, problem.bar, problem.joints, rod=fit.excess.rod),
        excess=fit.excess,
        autocorrelation=trust.autocorrelation,
        chi2_per_dof=fit.chi2_per_dof,
        converged=fit.converged,
        start=one.start,
        iterations=one.iterations + fit.iterations,
        identifiability=replace(
            one.subset, parameters=parameters, dropped=_left(one.subset, at_prior)
        ),
        before=_residuals(problem, _nominal_robot_fit(problem, one.estimate, one.nominal)),
        after=Residuals(problem.times, error[:3].T, error[3:].T),
        whitened=fit.linear.residuals[k],
        tcp_sigma=_machine_tcp_sigma(cell, fit, trust, k),
        verdict=judge(evidence, one.start, cell, one.nominal, problem.joints),
        corrections=corrections,
        tension=tension_at(fit.model, fit.x, k),
        tension_source=source,
        events=events,
    )


def _left(subset: Identifiability, at_prior: Sequence[str]) -> tuple[Dependency, ...]:
    known = {d.name: d for d in subset.dropped}
    fixed = [d for d in subset.dropped if d.name in FIXED]
    return (
        *fixed,
        *(known.get(name, Dependency(name, "prior", ())) for name in at_prior if name not in FIXED),
    )


def strained(fit: JointFit) -> tuple[str, ...]:
    """Shared unknowns of a fit that lie further from their priors than chance explains."""
    layout, count = fit.model.unknowns, fit.model.unknowns.coefficients.stop
    far = np.abs(fit.x[:count] - layout.mean[:count]) / layout.sigma[:count]
    return tuple(layout.names[i] for i in np.argsort(-far) if far[i] > STRAINED)


def _correction_values(fit: JointFit, trust: Uncertainty) -> tuple[CorrectionValue, ...]:
    layout, deviations = fit.model.unknowns, np.sqrt(np.diag(trust.covariance))
    out = []
    for correction in fit.model.corrections:
        if (
            correction.name not in CORRECTIONS
        ):  # jumps of encoders belong to a recording, not to the machine
            continue
        where = _indices(coefficients_of(fit, correction))
        rows = [
            CoefficientValue(
                c.name,
                c.unit,
                *(
                    float(v[i])
                    for v in (fit.x, deviations, layout.mean, layout.sigma, trust.information_gain)
                ),
            )
            for c, i in zip(correction.coefficients, where, strict=True)
        ]
        out.append(CorrectionValue(correction.name, correction.sentence, tuple(rows)))
    return tuple(out)


def _machine_unknowns(fit: JointFit) -> NDArray[np.intp]:
    """Where geometry and coefficients stand in x; jumps of encoders belong to a recording, not to the machine."""
    layout = fit.model.unknowns
    lasting = [
        _indices(coefficients_of(fit, c)) for c in fit.model.corrections if c.name in CORRECTIONS
    ]
    return np.concatenate((np.arange(layout.shared.size), *lasting))


def _machine_part(parameters: NDArray[np.intp], covariance: Array) -> MachineCovariance:
    """That of the dh model: its parameters less encoder zeros and place."""
    lasting = [
        k for k, i in enumerate(parameters) if PARAMETERS[i].side == "robot" or NAMES[i] == "bd3"
    ]
    return MachineCovariance(
        tuple(NAMES[parameters[k]] for k in lasting), covariance[np.ix_(lasting, lasting)]
    )


def _machine_tcp_sigma(cell: Cell, fit: JointFit, trust: Uncertainty, k: int) -> Array:
    layout, grid = fit.model.unknowns, accuracy_grid(cell.robot)
    robot = UnloadedRobot(
        cell, layout.geometry(fit.x, k), fit.model.corrections, fit.x[layout.coefficients]
    )
    unknowns = np.concatenate((np.arange(layout.shared.size), _indices(layout.coefficients)))
    return position_sigma(
        robot.tool(grid),
        robot.jacobian(grid, layout.shared),
        trust.covariance[np.ix_(unknowns, unknowns)],
    )


def _indices(where: slice) -> NDArray[np.intp]:
    return np.arange(where.start, where.stop)


def _placed(nominal: Geometry, geometry: Geometry) -> Geometry:
    return nominal.replaced({name: geometry[name] for name in ("ox", "oy", "oz")})


def _nominal_robot_fit(problem: Problem, estimate: Estimate, nominal: Geometry) -> Estimate:
    """The nominal robot with zeros, ball-bar position and clock fitted to it: what an uncalibrated user would see."""
    placing = candidates(problem.joints)[: len(problem.joints) + 3]
    return solve(
        problem, _on_nominal(problem, estimate, nominal, placing), placing, negligible=1e-2
    ).estimate


def _residuals(problem: Problem, estimate: Estimate) -> Residuals:
    error = problem.closure(problem.settle(estimate)).error
    return Residuals(problem.times, error[:3].T, error[3:].T)


def _wrapped(geometry: Geometry) -> Geometry:
    """Encoder zeros within half a turn."""
    zeros = [i for i, p in enumerate(PARAMETERS) if p.side == "bar" and p.kind == "theta"]
    values = geometry.values.copy()
    values[zeros] = np.arctan2(np.sin(values[zeros]), np.cos(values[zeros]))
    return Geometry(values)

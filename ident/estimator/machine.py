"""The complete model: one machine from one or several recordings, with every correction that the data support.

start and dh fit of each recording (ident.identify) -> tension of the rod from what was logged, or from geometry alone ->
joint fit, noise levels, joint fit -> events -> corrections that the data do not support dropped -> honest covariance.
Structure and measured guidance: notes/identification.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_array

from cell.chain import Array
from cell.descriptions import Cell
from cell.geometry import Geometry
from cell.logs import ForceLog, RobotLog
from ident.corrections import CORRECTIONS
from ident.corrections.base import Correction
from ident.estimator.closure import complete_bar_angles
from ident.estimator.events import (
    MAX_EVENTS,
    find_step_fault,
    jumps,
    sized,
    step_faults_in_logs,
    with_exact_periods,
)
from ident.estimator.excess import estimate_excess
from ident.estimator.iteration import IterationCallback
from ident.estimator.joint_fit import ExcessNoise, JointFit, Model, Track, approach, minimise
from ident.estimator.noise import noise_from_logs
from ident.estimator.problem import Clock
from ident.estimator.uncertainty import uncertainty
from ident.estimator.unknowns import TENSION_PRIOR, RecordingShape, unknowns
from ident.loads.gear_loads import loads, mass_model
from ident.loads.rod_tension import Tension, from_force_sensor, from_motor_torque
from ident.signals.smooth_log import SmoothLog
from ident.signals.step_fault import StepFault

ForceSource = Literal["auto", "none", "torque", "sensor"]
KNOTS_PER_SECOND = 1.25  # 150 in 120 s; 60 are too few (notes/identification sec. 4)
DEVIATION = {
    "none": TENSION_PRIOR,
    "torque": 12.0,
    "sensor": 2.0,
}  # [N] prior of a knot on top of what was measured
CONTINUATION = (
    20.0,
    6.0,
    2.0,
)  # noise and width of play, times; without a measured tension (notes/identification sec. 4)
CONTINUED_ITERATIONS = 8
FIRST_EXCESS = ExcessNoise(5e-6, 1e-5, 1e-5, 1e-6)
NOISE_PASSES = 2  # fits with the noise levels of the one before
HELPS = 0.98  # of chi-square: what a jump must bring it down to
ROWS_AVERAGED = 0.08  # [s] of torque rows behind one value: friction and noise average out, the motion hardly changes
NEEDS_LOADS = {"joint_compliance", "gear_backlash", "rod_strain", "plate_bending"}
SUPPORT = (
    4.0  # a correction stays whose coefficients are that many deviations from nothing, all together
)
SENSOR_LAG = 2.0  # [s] the sensor's log may begin that much before or after the robot's
LAG_STEP = 0.05  # [s]


@dataclass(frozen=True, eq=False)
class Prepared:
    """One recording after its own dh fit."""

    robot: SmoothLog
    bar: SmoothLog | None
    joints: tuple[int, ...]
    signs: Array  # (E,)
    geometry: Geometry  # of the dh fit: zeros and place are the start
    clock: Clock
    times: Array  # (N,) [s]
    robot_log: RobotLog
    force_log: ForceLog | None = None

    @property
    def has_clock(self) -> bool:
        return self.bar is not None

    def source(self, asked: ForceSource) -> str:
        """What gives the tension: `sensor`, `torque` or `none`."""
        if asked in ("auto", "sensor") and self.force_log is not None:
            return "sensor"
        if asked in ("auto", "torque") and self.robot_log.torque is not None:
            return "torque"
        return "none"

    def angles(self, t: Array) -> tuple[Array, Array, Array, Array, Array]:
        """q, speed, acceleration (N, 6), ball-bar angles (N, 5) and robot times (N,) at ball-bar times t (N,)."""
        at = np.clip(self.clock.robot_time(t), self.robot.start, self.robot.end)
        q = np.asarray(self.robot.spline(at))
        measured = (
            np.zeros((t.size, 0))
            if self.bar is None
            else np.asarray(self.bar.spline(t)) * self.signs
        )
        b = complete_bar_angles(self.geometry, q, measured, self.joints)
        return q, np.asarray(self.robot.speed(at)), np.asarray(self.robot.arm(at, 2)), b, at


def fit_machine(
    cell: Cell,
    nominal: Geometry,
    recordings: Sequence[Prepared],
    corrections: Sequence[str],
    *,
    force: ForceSource,
    rod_sigma: float | None,
    prune: bool = False,
    progress: Callable[[str], None] = lambda _: None,
    on_iteration: IterationCallback | None = None,
) -> JointFit:
    """The joint fit of all recordings with the named corrections, jumps of encoders and clocks repaired.

    rod_sigma : [m] of a measured rod length (then the ball-bar file's bd3 is that length); None for the catalogue's tolerance.
    prune : leaves out the corrections that the data do not support.
    """
    names: list[str] = list(corrections)

    def first_pass(events: tuple[StepFault, ...]) -> JointFit:
        return _first_pass(
            cell, nominal, recordings, names, events, force, rod_sigma, progress, on_iteration
        )

    events = tuple(
        event
        for k, r in enumerate(recordings)
        for event in step_faults_in_logs(r.robot, r.bar, r.joints, r.signs, r.clock, k)
    )
    most = len(events) + MAX_EVENTS
    fit = first_pass(events)
    while (
        len(events) < most and (event := find_step_fault(fit)) is not None
    ):  # before it can pass for noise
        progress(f"a jump at t = {event.time:.1f} s: fitting again with it")
        trial = first_pass((*events, event))
        if trial.chi2_per_dof > HELPS * fit.chi2_per_dof:  # whatever is wrong, it is no jump
            break
        events, fit = (*events, event), trial
    begin = _next_pass(fit)
    del fit  # large with many samples
    fit = noise_passes(begin, progress, on_iteration)
    while (
        len(events) < most and (event := find_step_fault(fit)) is not None
    ):  # what shows only once the noise is known
        progress(f"a jump at t = {event.time:.1f} s: fitting again with it")
        events = (*events, event)
        fit = noise_passes(_next_pass(first_pass(events)), progress, on_iteration)
    exact = with_exact_periods(fit, events, cell.ballbar.encoder_lines)
    idle = unsupported(fit) if prune else set()
    if idle or exact != events:
        progress(
            f"fitting again without {', '.join(sorted(idle))}"
            if idle
            else "fitting again with whole signal periods"
        )
        names, events = [name for name in names if name not in idle], exact
        fit = noise_passes(_next_pass(first_pass(events)), progress, on_iteration)
    return replace(fit, events=sized(fit, events, cell.ballbar.encoder_lines))


def unsupported(fit: JointFit) -> set[str]:
    """Corrections whose coefficients are all zero as far as the data can tell."""
    trust, out = uncertainty(fit), set()
    for correction in fit.model.corrections:
        if correction.name not in CORRECTIONS:
            continue
        where = coefficients_of(fit, correction)
        values, spread = fit.x[where], trust.covariance[where, where]
        found, count = float(values @ np.linalg.solve(spread, values)), values.size
        if found < count + SUPPORT * np.sqrt(2.0 * count):
            out.add(correction.name)
    return out


def _first_pass(
    cell: Cell,
    nominal: Geometry,
    recordings: Sequence[Prepared],
    corrections: Sequence[str],
    events: tuple[StepFault, ...],
    force: ForceSource,
    rod_sigma: float | None,
    progress: Callable[[str], None],
    on_iteration: IterationCallback | None,
) -> JointFit:
    progress("preparing the complete model")
    model, x, bars = posed(
        cell, nominal, recordings, corrections, force, rod_sigma=rod_sigma, events=events
    )
    if model.masses is not None and "none" in [r.source(force) for r in recordings]:
        x, bars = continued(model, x, bars, progress, on_iteration)
    progress(f"fitting {model.unknowns.count} unknowns")
    return minimise(
        model, approach(model, x, bars, FIRST_EXCESS), bars, FIRST_EXCESS, on_iteration=on_iteration
    )


def posed(
    cell: Cell,
    nominal: Geometry,
    recordings: Sequence[Prepared],
    corrections: Sequence[str],
    force: ForceSource,
    *,
    rod_sigma: float | None = None,
    events: tuple[StepFault, ...] = (),
) -> tuple[Model, Array, list[Array]]:
    """What is to be fitted, and where the fit starts: the model, the unknowns, the ball-bar angles (N, 5) [rad] of each recording."""
    chosen = tuple(CORRECTIONS[name](cell, recordings[0].joints) for name in corrections)
    if (repaired := jumps(events)) is not None:
        chosen = (*chosen, repaired)
    loaded = bool(NEEDS_LOADS & set(corrections))
    sources = [r.source(force) for r in recordings]
    tracks = tuple(
        replace(
            track(cell, r, s if loaded else None),
            clock_steps=tuple(e.time for e in events if e.kind == "clock" and e.recording == k),
        )
        for k, (r, s) in enumerate(zip(recordings, sources, strict=True))
    )
    shapes = [
        RecordingShape(
            r.joints,
            r.geometry,
            r.clock if r.has_clock else None,
            t.knots.shape[0],
            DEVIATION[s],
            len(t.clock_steps),
        )
        for r, t, s in zip(recordings, tracks, sources, strict=True)
    ]
    measured = loaded and any(s != "none" for s in sources)
    layout, x = unknowns(
        cell, nominal, shapes, chosen, measured_force=measured, rod_sigma=rod_sigma
    )
    model = Model(cell, mass_model(cell) if loaded else None, chosen, layout, tracks)
    return model, x, [r.angles(r.times)[3] for r in recordings]


def continued(
    model: Model,
    x: Array,
    bars: list[Array],
    progress: Callable[[str], None],
    on_iteration: IterationCallback | None = None,
) -> tuple[Array, list[Array]]:
    """From nominal to where plain steps converge: much noise and wide play first, then less."""
    for times in CONTINUATION:
        progress(f"finding the force in the rod from geometry ({times:g} times the noise)")
        e = FIRST_EXCESS
        blurred = ExcessNoise(e.gear * times, e.wrist * times, e.bar * times, e.rod * times)
        fit = minimise(
            replace(model, sharpness=1.0 / times),
            x,
            bars,
            blurred,
            max_iterations=CONTINUED_ITERATIONS,
            on_iteration=on_iteration,
        )
        x, bars = fit.x, [p.bar for p in fit.linear.points]
    return x, bars


@dataclass(frozen=True, eq=False)
class Pass:
    """Where a fit begins that knows the noise of the one before."""

    model: Model
    x: Array  # (P,)
    bars: list[Array]  # (N, 5) [rad] of each recording
    excess: ExcessNoise
    iterations: int  # so far


def _next_pass(fit: JointFit) -> Pass:
    """With the noise that a fit left unexplained and the logs do not show."""
    return Pass(
        with_likely_tension(fit),
        fit.x,
        [p.bar for p in fit.linear.points],
        estimate_excess(fit),
        fit.iterations,
    )


def noise_passes(
    begin: Pass, progress: Callable[[str], None], on_iteration: IterationCallback | None = None
) -> JointFit:
    """Further fits, each with the noise found by the one before."""
    for k in range(1, NOISE_PASSES + 1):
        progress(
            f"fitting {begin.model.unknowns.count} unknowns with estimated noise, {k} of {NOISE_PASSES}"
        )
        fit = minimise(begin.model, begin.x, begin.bars, begin.excess, on_iteration=on_iteration)
        fit = replace(fit, iterations=begin.iterations + fit.iterations)
        if k < NOISE_PASSES:
            begin = _next_pass(fit)
            del fit
    return fit


def with_likely_tension(fit: JointFit) -> Model:
    """The model with the prior of each recording's tension knots as wide as they turned out (one step of the EM algorithm)."""
    layout = fit.model.unknowns
    sigma = layout.sigma.copy()
    for own in layout.own:
        if own.knots is not None:
            sigma[own.knots] = np.sqrt(
                np.mean(fit.x[own.knots] ** 2 + np.diag(fit.covariance)[own.knots])
            )
    return replace(fit.model, unknowns=replace(layout, sigma=sigma))


def track(cell: Cell, recording: Prepared, source: str | None) -> Track:
    """The recording at its samples; source of the tension, None where no correction needs loads."""
    times = recording.times
    spacing = float(np.median(np.diff(times)))
    noise = noise_from_logs(
        recording.robot, recording.bar, recording.joints, spacing=spacing, rod=0.0
    )
    knots = csr_array((0, times.size)) if source is None else tension_splines(times)
    tension = np.zeros(times.size)
    if source == "torque":
        tension = _torque_tension(cell, recording)
    elif source == "sensor":
        tension = _sensor_tension(cell, recording)
    return Track(
        recording.robot,
        recording.bar,
        recording.joints,
        recording.signs,
        times,
        knots,
        tension,
        noise.joint[:, None],
        noise.encoder,
    )


def tension_splines(times: Array) -> csr_array:
    """(K, N) cubic B-splines on uniform knots over the samples."""
    count = max(8, int(KNOTS_PER_SECOND * (times[-1] - times[0])))
    inner = np.linspace(times[0], times[-1], count - 2)
    knots = np.concatenate((np.repeat(inner[0], 3), inner, np.repeat(inner[-1], 3)))
    return csr_array(BSpline.design_matrix(np.clip(times, inner[0], inner[-1]), knots, 3).T)


def _torque_tension(cell: Cell, recording: Prepared) -> Array:
    """(N,) [N] at the samples, from blocks of torque rows."""
    log = recording.robot_log
    assert log.torque is not None
    rows = max(1, round(ROWS_AVERAGED / float(np.median(np.diff(log.t)))))
    blocks = log.t.size // rows
    middle = recording.robot.stamps[: blocks * rows].reshape(blocks, rows).mean(axis=1)
    torque = log.torque[: blocks * rows].reshape(blocks, rows, 6).mean(axis=1)
    t = recording.clock.ballbar_time(middle)
    inside = (t > recording.times[0] - 1.0) & (t < recording.times[-1] + 1.0)
    if recording.bar is not None:
        inside &= (t > recording.bar.start) & (t < recording.bar.end)
    t, torque = t[inside], torque[inside]
    q, speed, acceleration, b, _ = recording.angles(t)
    carried = loads(mass_model(cell), recording.geometry, q, b, speed, acceleration)
    to_gear = cell.robot.joint_to_gear
    found = from_motor_torque(
        cell, torque.T, carried, (speed @ to_gear).T, (acceleration @ to_gear).T
    )
    return np.interp(recording.times, t, found.force)


def _sensor_tension(cell: Cell, recording: Prepared) -> Array:
    """(N,) [N] at the samples, the sensor's clock aligned to the robot's by what it should feel."""
    log = recording.force_log
    assert log is not None
    rows = max(1, round(ROWS_AVERAGED / float(np.median(np.diff(log.t)))))
    blocks = log.t.size // rows
    middle = log.t[: blocks * rows].reshape(blocks, rows).mean(axis=1)
    wrench = log.wrench[: blocks * rows].reshape(blocks, rows, 6).mean(axis=1)
    q, _, _, b, at = recording.angles(recording.times)

    def found(lag: float) -> tuple[Tension, float]:
        felt = np.stack([np.interp(at - lag, middle, column) for column in wrench.T])
        return from_force_sensor(cell, recording.geometry, felt, q, b)

    lags = np.arange(-SENSOR_LAG, SENSOR_LAG + 0.5 * LAG_STEP, LAG_STEP)
    best = float(lags[int(np.argmin([found(float(lag))[1] for lag in lags]))])
    near = minimize_scalar(
        lambda lag: found(float(lag))[1],
        bounds=(best - LAG_STEP, best + LAG_STEP),
        method="bounded",
    )
    return found(float(near.x))[0].force


def coefficient(fit: JointFit, name: str) -> tuple[float, float]:
    """Value and white standard deviation of one unknown; KeyError if there is none of that name."""
    i = fit.model.unknowns.names.index(name)
    return float(fit.x[i]), float(np.sqrt(fit.covariance[i, i]))


def coefficients_of(fit: JointFit, correction: Correction) -> slice:
    """Where a correction's coefficients stand in x."""
    first = fit.model.unknowns.coefficients.start
    for one in fit.model.corrections:
        if one.name == correction.name:
            return slice(first, first + len(one.coefficients))
        first += len(one.coefficients)
    raise KeyError(correction.name)

"""From two logs to the robot's parameters, with their uncertainty and a verdict in words.

smooth -> automatic start -> identifiable subset -> whitened fit with the clock as parameter -> variance of the rod -> fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from cell.descriptions import Cell
from cell.geometry import INDEX, NAMES, PARAMETERS, Geometry, nominal_geometry
from cell.logs import BallBarLog, RobotLog
from ident.accuracy import accuracy_grid, tcp_sigma
from ident.identifiability import Identifiability, candidates, identifiable
from ident.noise import noise_from_logs, rod_deviation, row_noise
from ident.problem import Clock, Estimate, NoiseModel, Problem
from ident.sampling import sample_times
from ident.signals import SmoothLog, smooth_log
from ident.solver import Fit, solve
from ident.start import Start, automatic_start
from ident.verdict import Verdict, judge

WIDEST_KNOT_SPACING = 0.08  # [s] a robot's motion below 3 Hz; finer where the residual asks for it (ident.signals)
ROD_SIGMA_START = 2e-6  # [m] 55 N on 2.7e7 N/m, until the residuals say better
DEFAULT_SAMPLES = 1500  # thesis sec. 3.5


@dataclass(frozen=True, eq=False)
class Residuals:
    """Loop-closure mismatch over the run, in the direction that can be seen."""

    t: Array  # (N,) [s] on the ball-bar clock (robot clock without encoders)
    position: Array  # (N, 3) [m] robot base frame
    angle: Array  # (N, 3) [rad] robot base frame


@dataclass(frozen=True, eq=False)
class Identification:
    """What one recording says about the robot."""

    cell: Cell
    joints: tuple[int, ...]
    nominal: Geometry
    geometry: Geometry  # identified; parameters left out stay nominal
    sigma: dict[str, float]  # [m, rad] of the identified parameters, scaled up where the fit is poor
    covariance: Array  # (P [+ 2], P [+ 2]) of `parameters`, then offset and skew; scaled likewise
    parameters: NDArray[np.intp]
    clock: Clock | None
    clock_sigma: tuple[float, float]  # [s], [1]; zero without encoders
    signs: tuple[int, ...]  # of each encoder relative to the declared sense
    noise: NoiseModel  # of the samples in the fit
    log_noise: NoiseModel  # of one row of the logs
    autocorrelation: float  # of the whitened residual, one sample apart, mean over the equations
    fit: Fit
    start: Start
    iterations: int  # of the chosen hypothesis and the final fits together
    identifiability: Identifiability
    before: Residuals  # nominal robot, ball-bar placed and clock set as well as it can be
    after: Residuals
    whitened: Array  # (6 - m, N) residuals of the final fit in units of their standard deviation
    tcp_sigma: Array  # (G,) [m] stated TCP uncertainty over the accuracy grid
    verdict: Verdict


def identify(
    cell: Cell,
    robot_log: RobotLog,
    ballbar_log: BallBarLog | None,
    *,
    samples: int = DEFAULT_SAMPLES,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify robot, ball-bar position, encoder zeros and clock from one recording.

    ballbar_log : None for a ball-bar without encoders.
    progress : called with a short sentence at each stage.

    Raises StartError when the logs cannot be brought together.
    """
    progress("smoothing both logs")
    robot, bar, joints = _smoothed(robot_log, ballbar_log)
    spacing = (robot.end - robot.start) / samples
    noise = noise_from_logs(robot, bar, joints, spacing=spacing, rod=ROD_SIGMA_START)
    nominal = nominal_geometry(cell, np.zeros(3))
    progress("aligning the logs and finding the ball-bar")
    start = automatic_start(robot, bar, joints, nominal, noise)
    progress("fitting")
    chosen = start.chosen
    times = sample_times(robot, bar, chosen.fit.estimate.clock, samples)
    noise = noise_from_logs(robot, bar, joints, spacing=float(times[1] - times[0]), rod=ROD_SIGMA_START)
    problem = Problem(robot, bar, joints, np.array(chosen.hypothesis.signs, dtype=float), times, noise)
    here = problem.start(chosen.fit.estimate.geometry, chosen.fit.estimate.clock)
    subset = identifiable(problem, here, nominal, candidates(joints))
    first = solve(problem, _on_nominal(problem, here, nominal, subset.parameters), subset.parameters)
    problem = replace(problem, noise=replace(noise, rod=rod_deviation(replace(problem, noise=replace(noise, rod=0.0)), first.estimate)))
    fit = solve(problem, first.estimate, subset.parameters)
    return _outcome(cell, problem, nominal, start, subset, fit, chosen.fit.iterations + first.iterations + fit.iterations)


def _smoothed(robot_log: RobotLog, ballbar_log: BallBarLog | None) -> tuple[SmoothLog, SmoothLog | None, tuple[int, ...]]:
    robot = smooth_log(robot_log.t, robot_log.q, widest_knot_spacing=WIDEST_KNOT_SPACING)
    if ballbar_log is None:
        return robot, None, ()
    return robot, smooth_log(ballbar_log.t, ballbar_log.angles, widest_knot_spacing=WIDEST_KNOT_SPACING), ballbar_log.joints


def _on_nominal(problem: Problem, estimate: Estimate, nominal: Geometry, parameters: NDArray[np.intp]) -> Estimate:
    """The estimate with every parameter that is not to be identified back at its catalogue value."""
    values = nominal.values.copy()
    values[parameters] = estimate.geometry.values[parameters]
    origin = [INDEX[name] for name in ("ox", "oy", "oz")]
    values[origin] = estimate.geometry.values[origin]
    return problem.start(Geometry(values), estimate.clock)


def _outcome(
    cell: Cell, problem: Problem, nominal: Geometry, start: Start, subset: Identifiability, fit: Fit, iterations: int
) -> Identification:
    whitened = fit.final.residual.reshape(-1, problem.times.size)
    inflation = max(1.0, fit.chi2_per_dof)  # a misfit widens the intervals; it never narrows them
    covariance = fit.covariance * inflation
    deviations = np.sqrt(np.diag(covariance))
    geometry = _wrapped(fit.estimate.geometry)
    origin = {name: geometry[name] for name in ("ox", "oy", "oz")}
    clock = fit.estimate.clock if problem.has_clock else None
    return Identification(
        cell=cell,
        joints=problem.joints,
        nominal=nominal.replaced(origin),
        geometry=geometry,
        sigma={NAMES[i]: float(s) for i, s in zip(fit.parameters, deviations, strict=False)},
        covariance=covariance,
        parameters=fit.parameters,
        clock=clock,
        clock_sigma=(float(deviations[-2]), float(deviations[-1])) if clock else (0.0, 0.0),
        signs=start.chosen.hypothesis.signs,
        noise=problem.noise,
        log_noise=row_noise(problem.robot, problem.bar, problem.joints, rod=problem.noise.rod),
        autocorrelation=_lag_one(whitened),
        fit=fit,
        start=start,
        iterations=iterations,
        identifiability=subset,
        before=_residuals(problem, _nominal_robot_fit(problem, fit.estimate, nominal)),
        after=_residuals(problem, fit.estimate),
        whitened=whitened,
        tcp_sigma=tcp_sigma(geometry, accuracy_grid(cell.robot), fit.parameters, covariance),
        verdict=judge(fit, start, problem, cell, nominal, _lag_one(whitened)),
    )


def _nominal_robot_fit(problem: Problem, estimate: Estimate, nominal: Geometry) -> Estimate:
    """The nominal robot with zeros, ball-bar position and clock fitted to it: what an uncalibrated user would see."""
    placing = candidates(problem.joints)[: len(problem.joints) + 3]
    return solve(problem, _on_nominal(problem, estimate, nominal, placing), placing, negligible=1e-2).estimate


def _residuals(problem: Problem, estimate: Estimate) -> Residuals:
    error = problem.closure(problem.settle(estimate)).error
    return Residuals(problem.times, error[:3].T, error[3:].T)


def _lag_one(whitened: Array) -> float:
    return float(((whitened[:, 1:] * whitened[:, :-1]).sum(axis=1) / (whitened * whitened).sum(axis=1)).mean())


def _wrapped(geometry: Geometry) -> Geometry:
    """Encoder zeros within half a turn."""
    zeros = [i for i, p in enumerate(PARAMETERS) if p.side == "bar" and p.kind == "theta"]
    values = geometry.values.copy()
    values[zeros] = np.arctan2(np.sin(values[zeros]), np.cos(values[zeros]))
    return Geometry(values)

"""The whitened fit over samples that are already paired: no logs to align, but the clocks are parameters all the same.

Both sides become splines through the samples, so that a clock error of less than a few samples can be followed; nothing is smoothed,
there are no rows between. Noise is estimated per channel from sixth differences over neighbouring samples, which leave nothing of a
motion that takes many samples to change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from cell.chain import Array
from cell.geometry import BAR_ROWS, Geometry
from cell.splines import DEGREE
from ident.estimator.identifiability import candidates, identifiable
from ident.estimator.noise import rod_deviation
from ident.estimator.problem import Clock, NoiseModel, Problem
from ident.estimator.sampling import MARGIN
from ident.estimator.solver import Fit, solve
from ident.signals.smooth_log import Outliers, SmoothLog

ROD_SIGMA_START = 2e-6  # [m] as for recordings (ident.identify)
DIFFERENCES = 6
NOISE_FLOOR = 1e-9  # [rad] so that exact samples have a weight at all
_NORMAL_QUARTILE = 0.6744897501960817  # median of |z|, z standard normal


@dataclass(frozen=True, eq=False)
class SampleFit:
    """What paired samples say about geometry and clock."""

    geometry: Geometry
    clock: Clock  # what is left of it
    fit: Fit
    iterations: int


def fit_samples(
    t: Array,
    q: Array,
    b: Array,
    joints: tuple[int, ...],
    start: Geometry,
    parameters: NDArray[np.intp] | None = None,
) -> SampleFit:
    """Fit geometry and clock to paired samples by the whitened loop closure.

    t : (N,) [s] even; q : (N, 6) [rad] robot angles; b : (N, 5) [rad] ball-bar angles, of which those of the fitted `joints` are used.
    start : nominal geometry with the ball-bar where it is believed to be. parameters : what to identify; by default what the samples
    determine (ident.estimator.identifiability).
    """
    robot = through_samples(t, q)
    bar = through_samples(t, b[:, [j - 1 for j in joints]]) if joints else None
    encoder = np.zeros(BAR_ROWS)
    if bar is not None:
        encoder[[j - 1 for j in joints]] = bar.noise
    inside = t[(t >= t[0] + MARGIN) & (t <= t[-1] - MARGIN)]
    problem = Problem(
        robot,
        bar,
        joints,
        np.ones(len(joints)),
        inside,
        NoiseModel(robot.noise, encoder, ROD_SIGMA_START),
    )
    here = problem.start(start, Clock(0.0, 0.0))
    chosen = (
        identifiable(problem, here, start, candidates(joints)).parameters
        if parameters is None
        else parameters
    )
    first = solve(problem, here, chosen)
    rigid = replace(problem, noise=replace(problem.noise, rod=0.0))
    problem = replace(
        problem, noise=replace(problem.noise, rod=rod_deviation(rigid, first.estimate))
    )
    fit = solve(problem, first.estimate, chosen)
    return SampleFit(
        fit.estimate.geometry, fit.estimate.clock, fit, first.iterations + fit.iterations
    )


def through_samples(t: Array, angles: Array) -> SmoothLog:
    """The spline through angles (N, K) [rad] at even times t (N,) [s], with its noise. Raises ValueError for too few samples."""
    if t.size <= 2 * DIFFERENCES:
        raise ValueError(f"{t.size} samples are too few; at least {2 * DIFFERENCES + 1} are needed")
    spline = make_interp_spline(t, angles, k=DEGREE)
    period, nothing = (
        float(t[1] - t[0]),
        Outliers(np.empty(0), np.empty(0, dtype=np.intp), 0, t.size),
    )
    return SmoothLog(
        spline,
        spline.derivative(),
        float(t[0]),
        float(t[-1]),
        noise_of(angles),
        period,
        period,
        np.empty((0, 2)),
        t,
        nothing,
        (),
    )


def noise_of(angles: Array) -> Array:
    """(K,) [rad] standard deviation of white noise on smooth angles (N, K): median of their sixth differences."""
    spread = np.median(np.abs(np.diff(angles, DIFFERENCES, axis=0)), axis=0) / _NORMAL_QUARTILE
    return np.asarray(np.maximum(spread / np.sqrt(comb(2 * DIFFERENCES, DIFFERENCES)), NOISE_FLOOR))

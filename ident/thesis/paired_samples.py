"""The whitened fit over samples already paired: no logs to align, but the clocks are unknowns.

Both sides become splines through the samples, so that a clock error of less than a few samples can
be followed; nothing is smoothed, there are no rows between. Noise is estimated per channel from
sixth differences over neighbouring samples, which leave nothing of a motion that takes many samples
to change.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.sample_times import MARGIN
from ballbar.ident.estimator.samples import samples_of
from ballbar.ident.estimator.variance_components import rod_deviation
from ballbar.ident.recording_fit import ROD_SIGMA_START, identifiable_parameters
from ballbar.ident.signals.smooth_log import SmoothLog, interpolating_log

DIFFERENCES = 6
NOISE_FLOOR = 1e-9  # [rad] so that exact samples have a weight at all
_NORMAL_QUARTILE = 0.6744897501960817  # median of |z|, z standard normal


@dataclass(frozen=True, eq=False)
class SampleFit:
    """Geometry and clock as paired samples give them."""

    fit: Fit
    iterations: int

    @property
    def parameters(self) -> NDArray[np.intp]:
        """(P,) indices into the table of the fitted ones, encoder offsets and base pose last."""
        layout = self.fit.model.unknowns
        return np.concatenate((layout.shared, layout.own[0].parameters))


def fit_samples(
    t: Array,
    q: Array,
    b: Array,
    encoders: tuple[int, ...],
    start: Geometry,
    parameters: NDArray[np.intp] | None = None,
) -> SampleFit:
    """Fit geometry and clock to paired samples by the whitened loop closure.

    t : (N,) [s] even; q : (N, J) [rad] robot angles; b : (N, 5) [rad] ball-bar angles, of which
    those of the fitted `encoders` are used. start : nominal geometry with the ball-bar where it is
    believed to be. parameters : indices into the table of what to identify; by default what the
    samples determine (ballbar.ident.estimator.identifiability).
    """
    robot = through_samples(t, q)
    ballbar = through_samples(t, b[:, [j - 1 for j in encoders]]) if encoders else None
    inside = t[(t >= t[0] + MARGIN) & (t <= t[-1] - MARGIN)]
    spacing = robot.row_period  # of rows: the noise of one row is that of one sample
    samples = samples_of(robot, ballbar, encoders, np.ones(len(encoders)), inside, spacing=spacing)
    clock, excess = Clock(0.0, 0.0), ExcessNoise(rod=ROD_SIGMA_START)
    if parameters is None:
        parameters = identifiable_parameters(samples, start, clock, excess, start).parameters
    first = fit_kinematics(samples, start, clock, parameters, excess)
    rod = ExcessNoise(rod=rod_deviation(first))
    fit = fit_kinematics(samples, first.geometry(), first.clock(), parameters, rod)
    return SampleFit(fit, first.iterations + fit.iterations)


def through_samples(t: Array, angles: Array) -> SmoothLog:
    """The spline through angles (N, K) [rad] at even times t (N,) [s], with its noise.

    Raises ValueError for too few samples.
    """
    if t.size <= 2 * DIFFERENCES:
        raise ValueError(f"{t.size} samples are too few; at least {2 * DIFFERENCES + 1} are needed")
    return interpolating_log(t, angles, noise_of(angles))


def noise_of(angles: Array) -> Array:
    """(K,) [rad] sigma of white noise on smooth angles (N, K) [rad], from sixth differences."""
    spread = np.median(np.abs(np.diff(angles, DIFFERENCES, axis=0)), axis=0) / _NORMAL_QUARTILE
    return np.asarray(np.maximum(spread / np.sqrt(comb(2 * DIFFERENCES, DIFFERENCES)), NOISE_FLOOR))

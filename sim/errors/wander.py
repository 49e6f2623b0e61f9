"""Slow wander of either clock about `t_robot = offset + (1 + skew) * t_ballbar`.

The rate does a random walk and decays from power-on; its integral is the deviation in time. The
least-squares line through the deviation over the log is removed, so that clock offset and skew
remain those of a straight line fitted to both clocks.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.schema import Strict
from sim.errors.clock_errors import ClockWander

KNOT = 1.0  # [s] largest distance of knots: the rate changes over minutes, so any second will do


class WanderCurve(Strict):
    """Deviation of one clock, linear between knots: later true time at a stamp."""

    t_clock_s: tuple[float, ...]
    deviation_s: tuple[float, ...]

    def at(self, t_clock: Array) -> Array:
        """(N,) [s] deviation at times (N,) [s] of the clock from its first row."""
        return np.interp(t_clock, self.t_clock_s, self.deviation_s)


def wander_curve(wander: ClockWander, length: float, rng: np.random.Generator) -> WanderCurve:
    """The wander over a log of `length` seconds."""
    t: Array = np.linspace(0.0, length, int(np.ceil(length / KNOT)) + 1)
    step, middle = t[1], 0.5 * (t[1:] + t[:-1])
    walk = wander.rate_rms_ppm * 1e-6 * _unit_walk(middle.size, rng)
    rate = walk + wander.warm_up_ppm * 1e-6 * np.exp(-middle / wander.warm_up_time_s)
    deviation = np.concatenate(([0.0], np.cumsum(rate * step)))
    line = np.polynomial.Polynomial.fit(t, deviation, 1)
    return WanderCurve(
        t_clock_s=tuple(t.tolist()), deviation_s=tuple((deviation - line(t)).tolist())
    )


def _unit_walk(steps: int, rng: np.random.Generator) -> Array:
    """(steps,) random walk with mean 0 and RMS 1."""
    walk = np.cumsum(rng.standard_normal(steps))
    walk -= walk.mean()
    return np.asarray(walk / np.sqrt(np.mean(walk**2)))

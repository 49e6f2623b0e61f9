"""The robot's log as the motion of its joints, for an instrument that follows its target."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.signals.smooth_log import SmoothLog


@dataclass(frozen=True, eq=False)
class MotionByLog:
    """Angles, speeds and noise by a robot's log, and the clock of what followed it.

    It is a ballbar.cell.poses.JointMotion.
    """

    name: str  # of the recording
    log: SmoothLog
    clock: Clock  # of the instrument, about
    loads: BSpline | None = None  # (J + 6,) [N m] as of `carried`, where a ball-bar holds the tool

    def angles(self, at: Array) -> Array:
        """(N, J) [rad] at robot times (N,) [s]."""
        return np.asarray(self.log.spline(at))

    def speed(self, at: Array) -> Array:
        """(N, J) [rad/s] derivative of `angles`."""
        return np.asarray(self.log.speed(at))

    def arm(self, at: Array) -> tuple[Array, Array]:
        """(N, J) [rad/s] and (N, J) [rad/s^2] speed and acceleration of the arm as a rigid body."""
        return np.asarray(self.log.arm(at, 1)), np.asarray(self.log.arm(at, 2))

    def carried(self, at: Array) -> Array | None:
        """(J + 6, N) [N m] loads of gears and bearings; None where nothing holds the tool."""
        return None if self.loads is None else np.asarray(self.loads(at)).T

    def within(self, at: Array) -> Array:
        """(N,) [s] the times, kept inside the log."""
        return np.clip(at, self.log.start, self.log.end)

    def noise(self, spacing: float) -> tuple[Array, float]:
        """(J,) [rad] of the angles and [s] of the stamps, of rows `spacing` [s] apart."""
        return self.log.sample_sigma(spacing), self.log.sample_stamp_sigma(spacing)

    def by(self, clock: Clock) -> MotionByLog:
        """The motion with another clock of the instrument."""
        return replace(self, clock=clock)

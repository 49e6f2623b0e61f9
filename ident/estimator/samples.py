"""Samples of a recording: instants at which both logs are smooth functions.

They are spread evenly over the part where both logs exist and the robot moves. They are times of
the ball-bar's clock, or of the robot's where the ball-bar has no encoders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import BAR_ROWS, Geometry
from ballbar.cell.robot_angles import by_axis
from ballbar.cell.statistics import rms
from ballbar.ident.corrections.base import BAR, GEAR, PLATE, ROD
from ballbar.ident.estimator.closure import (
    Closure,
    beside_rod,
    close_loop,
    complete_bar_angles,
    pointing_bar,
)
from ballbar.ident.estimator.noise import ExcessNoise, LogNoise
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.signals.smooth_log import SmoothLog, smoothing

if TYPE_CHECKING:
    from ballbar.ident.estimator.model import Evaluation
    from ballbar.ident.estimator.whitening import Whitening


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """Motion of the robot's joints at N instants."""

    q: Array  # (N, J) [rad]
    logged_speed: Array  # (N, J) [rad/s] of the log
    speed: Array  # (N, J) [rad/s] of the arm as a rigid body
    acceleration: Array  # (N, J) [rad/s^2] of the arm as a rigid body


@dataclass(frozen=True, eq=False)
class Samples:
    """One recording of a ball-bar."""

    robot: SmoothLog
    # Encoder angles, or of a bar without encoders the sensed length; None where nothing is sensed
    ballbar: SmoothLog | None
    encoders: tuple[int, ...]  # joints 1..5 of the ball-bar that are measured
    directions: Array  # (E,) +1 or -1, of each encoder against its declared direction
    times: Array  # (N,) [s]
    joint_noise: Array  # (J,) [rad] standard deviation of the robot's angles at an instant
    encoder_noise: Array  # (5,) [rad] of the ball-bar's; 0 where unmeasured
    tension: Array = field(default_factory=lambda: np.zeros(0))  # (N,) [N] measured; else zeros
    splines: csr_array = field(default_factory=lambda: csr_array((0, 0)))  # (K, N) of the tension
    clock_steps: tuple[float, ...] = ()  # [s] instants at which one of the clocks was set
    length_noise: float = 0.0  # [m] of the sensed length; 0 where none is
    stamp_noise: float = 0.0  # [s] of the instants, by the stamps of both logs
    held: Array | None = None  # (N,) [s] robot times at which the noise of the robot's log is held

    @property
    def size(self) -> int:
        return int(self.times.size)

    @property
    def has_clock(self) -> bool:
        return self.ballbar is not None

    def mechanism(self, layout: Unknowns, x: Array, k: int) -> tuple[Geometry, Clock, Array]:
        """Robot, plate and ball-bar, the clock, and (N,) [s] the robot's time, steps included.

        k : number of the recording.
        """
        clock, steps = layout.clock(x, k), layout.own[k].steps
        t = clock.robot_time(self.times)
        if steps is not None:
            t = t + x[steps] @ self.after_clock_steps()
        return layout.geometry(x, k), clock, np.clip(t, self.robot.start, self.robot.end)

    def arm_motion(self, at: Array) -> ArmMotion:
        """Angles and speed of the log, and speed and acceleration of the arm, smoothed further."""
        log = self.robot
        splines = (log.spline(at), log.speed(at), log.arm(at, 1), log.arm(at, 2))
        return ArmMotion(*(np.asarray(values) for values in splines))

    def own_geometry(self, layout: Unknowns, k: int) -> tuple[NDArray[np.intp], slice]:
        """Encoder offsets and base pose of the ball-bar."""
        return layout.own[k].parameters, layout.own[k].geometry

    def own_columns(
        self, layout: Unknowns, x: Array, k: int, point: Evaluation, weights: Whitening
    ) -> list[tuple[slice, Array]]:
        """Clock and clock steps, and (p, E, N) the weighted error's change per unit of each."""
        del x
        out, own = list[tuple[slice, Array]](), layout.own[k]
        if own.clock is not None:
            shift = weights(point.time_column)
            out.append((own.clock, np.stack((shift, shift * self.times))))
            if own.steps is not None:
                out.append((own.steps, shift * self.after_clock_steps()[:, None]))
        return out

    @property
    def solved_joints(self) -> bool:
        """Whether joints without encoder are solved for.

        A bar that points at the tool leaves its joints nothing to absorb.
        """
        return bool(self.unmeasured) and not self.measures_length

    def bar_angles(self, geometry: Geometry, q: Array, ballbar: Array) -> Array:
        """The given angles, or with a measured length those of a bar that points at the tool."""
        return pointing_bar(geometry, q, self.extension) if self.measures_length else ballbar

    def close(
        self, layout: Unknowns, x: Array, geometry: Geometry, q: Array, bar: Array
    ) -> Closure:
        """Loop closure of robot and ball-bar."""
        del layout, x
        if self.measures_length:
            bar = pointing_bar(geometry, q, self.extension)
        return close_loop(geometry, q, bar)

    def free_columns(self, point: Evaluation) -> Array:
        """(m, 6, N) change of the error per radian of each unmeasured joint.

        Where the length is measured: per metre or radian of what the joints can move together.
        """
        if self.measures_length:
            return beside_rod(point.bar_closure)
        return np.asarray(point.columns[BAR:ROD][self.unmeasured])

    def noise_columns(
        self, point: Evaluation, excess: ExcessNoise, uncertain: Array | float = 0.0
    ) -> Array:
        """(J + 7, 6, N) of the error channels; uncertain : (J, N) [rad] of the gears besides.

        The last one is of the stamps, which displace all channels of a log at once.
        """
        columns, logged = point.columns, self.joint_noise[:, None]
        beyond = by_axis(len(logged), main=excess.gear, wrist=excess.wrist)[:, None]
        robot = np.sqrt(logged**2 + beyond**2 + np.square(uncertain))
        measured = np.array([j + 1 in self.encoders for j in range(BAR_ROWS)])
        ballbar = np.where(measured, np.hypot(self.encoder_noise, excess.bar), 0.0)
        out = np.empty_like(columns)
        np.multiply(columns[GEAR:BAR], robot[:, None, :], out=out[GEAR:BAR])
        np.multiply(columns[BAR:ROD], ballbar[:, None, None], out=out[BAR:ROD])
        np.multiply(columns[ROD], np.hypot(excess.rod, self.length_noise), out=out[ROD])
        np.multiply(point.time_column, self.stamp_noise, out=out[PLATE])
        return out

    @property
    def silent(self) -> Samples:
        """The same without noise."""
        return replace(
            self,
            joint_noise=np.zeros_like(self.joint_noise),
            encoder_noise=np.zeros(BAR_ROWS),
            length_noise=0.0,
            stamp_noise=0.0,
        )

    @property
    def noise_sources(self) -> list[tuple[str, Samples, float]]:
        """Name and standard deviation [m, rad, s] of each noise of the logs, the others off."""
        silent, sensed = self.silent, self.encoder_noise[[j - 1 for j in self.encoders]]
        return [
            ("joint_log", replace(silent, joint_noise=self.joint_noise), rms(self.joint_noise)),
            ("bar_log", replace(silent, encoder_noise=self.encoder_noise), rms(sensed)),
            ("length_log", replace(silent, length_noise=self.length_noise), self.length_noise),
            ("stamps", replace(silent, stamp_noise=self.stamp_noise), self.stamp_noise),
        ]

    @property
    def measures_length(self) -> bool:
        """Whether the second log is of the rod's length, not of angles."""
        return self.ballbar is not None and not self.encoders

    @cached_property
    def extension(self) -> Array:
        """(N,) [m] sensed length of the rod beyond its nominal one, at the instants."""
        return self._sensed(self.times)[:, 0]

    @property
    def extension_rate(self) -> Array:
        """(N,) [m/s] speed at which the sensed length grows, at the instants."""
        assert self.ballbar is not None  # the caller's condition
        return np.asarray(self.ballbar.speed(self.times))[:, 0]

    def _sensed(self, t: Array) -> Array:
        """(N, C) [rad, m] what the second log holds at instants t (N,) [s]."""
        return np.zeros((t.size, 0)) if self.ballbar is None else np.asarray(self.ballbar.spline(t))

    @property
    def unmeasured(self) -> list[int]:
        """Columns of the ball-bar joints without encoder, from 0."""
        return [j for j in range(BAR_ROWS) if j + 1 not in self.encoders]

    @property
    def log_noise(self) -> LogNoise:
        """Noise of one row of each log, as its smoothing found it."""
        if self.ballbar is None:
            return LogNoise(self.robot.noise, np.zeros(BAR_ROWS))
        if self.measures_length:
            length = float(self.ballbar.noise[0])
            return LogNoise(self.robot.noise, np.zeros(BAR_ROWS), length)
        return LogNoise(self.robot.noise, _of_joints(self.ballbar.noise, self.encoders))

    @property
    def smoothing(self) -> float:
        """[s] over which the logs were smoothed."""
        return smoothing(self.robot, self.ballbar)

    @property
    def spacing(self) -> float:
        """[s] between neighbouring instants."""
        return float(np.median(np.diff(self.times)))

    def joint_angles(self, at: Array) -> Array:
        """(N, J) [rad] of the robot's log at the samples, at robot times (N,) [s].

        Where noise is held, a change of the clock moves the motion, not the noise.
        """
        log, held = self.robot, self.held
        moved = log.spline(at) if held is None else log.spline(held) + log.arm(at) - log.arm(held)
        return np.asarray(moved)

    def joint_speed(self, at: Array) -> Array:
        """(N, J) [rad/s] derivative of `joint_angles`."""
        log = self.robot
        return np.asarray((log.speed if self.held is None else log.arm.derivative())(at))

    def with_noise_held(self, clock: Clock) -> Samples:
        """The samples with the noise of the robot's log held at the times of a clock.

        A length changes by millimetres, so slowly that the noise in the robot's speed would pass
        for knowledge of the clock: its column of the Jacobian would hold
        the noise as well (errors in variables).
        """
        return replace(self, held=self.robot_time(clock, self.times))

    def robot_time(self, clock: Clock, t: Array) -> Array:
        """(N,) [s] on the robot's clock of instants t (N,) [s], kept inside the robot's log."""
        return np.clip(clock.robot_time(t), self.robot.start, self.robot.end)

    def ballbar_angles(self, geometry: Geometry, clock: Clock, t: Array | None = None) -> Array:
        """(N, 5) [rad] at instants t (N,) [s]: measured, or from the robot's pose where unmeasured.

        Where the length is measured: (N, 6), the last column the extension [m].

        t : the instants of the samples where it is not given.
        """
        t = self.times if t is None else t
        q = np.asarray(self.robot.spline(self.robot_time(clock, t)))
        if self.measures_length:
            return pointing_bar(geometry, q, self._sensed(t)[:, 0])
        return complete_bar_angles(geometry, q, self._sensed(t) * self.directions, self.encoders)

    def after_clock_steps(self) -> Array:
        """(S, N) 1 from each clock step on, 0 before it."""
        return (self.times >= np.array(self.clock_steps)[:, None]).astype(float)

    def thinned(self, step: int) -> Samples:
        """Every `step`-th sample."""
        return replace(
            self,
            times=self.times[::step],
            held=None if self.held is None else self.held[::step],
            tension=self.tension[::step],
            splines=self.splines[:, ::step],
        )


def samples_of(
    robot: SmoothLog,
    ballbar: SmoothLog | None,
    encoders: tuple[int, ...],
    directions: Sequence[float] | Array,
    times: Array,
    *,
    spacing: float | None = None,
) -> Samples:
    """Samples at times (N,) [s] with the noise that the smoothing left; arguments as in Samples.

    spacing : [s] between independent samples; that of the times where it is not given.
    """
    spacing = float(np.median(np.diff(times))) if spacing is None else spacing
    encoder_noise, length_noise = np.zeros(BAR_ROWS), 0.0
    if ballbar is not None and encoders:
        encoder_noise = _of_joints(ballbar.sample_sigma(spacing), encoders)
    elif ballbar is not None:
        length_noise = float(ballbar.sample_sigma(spacing)[0])
    return Samples(
        robot=robot,
        ballbar=ballbar,
        encoders=encoders,
        directions=np.array(directions, dtype=float),
        times=times,
        joint_noise=robot.sample_sigma(spacing),
        encoder_noise=encoder_noise,
        tension=np.zeros(times.size),
        splines=csr_array((0, times.size)),
        length_noise=length_noise,
        stamp_noise=float(
            np.hypot(
                robot.sample_stamp_sigma(spacing),
                ballbar.sample_stamp_sigma(spacing) if ballbar else 0.0,
            )
        ),
    )


def _of_joints(sigma: Array, encoders: tuple[int, ...]) -> Array:
    """(5,) [rad] deviations of the encoders (E,), by joint of the ball-bar; 0 of the others."""
    out = np.zeros(BAR_ROWS)
    out[[j - 1 for j in encoders]] = sigma
    return out

"""The least-squares problem of one recording: which samples, which noise, and how the residual depends on the unknowns.

The unknowns are any subset of the geometry (cell.geometry.PARAMETERS) and the clock, `t_robot = offset + (1 + skew) t_bar`.
A time shift moves the robot side along its own velocity, so the clock's columns are `(de/dq) qdot` and `t_bar` times it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array, joint_screws
from cell.clock import Clock as Clock  # noqa: PLC0414  the estimator imports it from here
from cell.geometry import BAR_ROWS, PARAMETERS, Geometry
from ident.estimator.closure import (
    Closure,
    Whitening,
    bar_joint_jacobian,
    close_loop,
    complete_bar_angles,
    covariance,
    whitening,
)
from ident.signals.smooth_log import SmoothLog

FREE_JOINT_STEPS = 2  # Gauss-Newton steps for the joints without encoder at each linearisation; they converge quadratically


@dataclass(frozen=True, eq=False)
class Estimate:
    """A point in the space of unknowns."""

    geometry: Geometry
    clock: Clock
    bar: Array  # (N, 5) [rad] encoder angles at the samples; joints without encoder as far as they are known


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Standard deviations that whiten the residual."""

    joint: Array  # (6,) [rad]
    encoder: Array  # (5,) [rad]; 0 where none is fitted
    rod: float  # [m] deviation of the rod from a constant length


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples of one recording, ready to be compared with a mechanism."""

    robot: SmoothLog
    bar: SmoothLog | None  # None for a ball-bar without encoders
    joints: tuple[int, ...]  # encoders fitted, 1..5
    signs: Array  # (E,) factor on each encoder angle
    times: Array  # (N,) [s] on the ball-bar clock (on the robot clock if there are no encoders)
    noise: NoiseModel

    @property
    def has_clock(self) -> bool:
        return self.bar is not None

    @property
    def free_joints(self) -> list[int]:
        return [j for j in range(BAR_ROWS) if j + 1 not in self.joints]

    def measured(self) -> Array:
        """(N, E) [rad] encoder angles at the samples."""
        if self.bar is None:
            return np.zeros((self.times.size, 0))
        return np.asarray(self.bar.spline(self.times)) * self.signs

    def robot_angles(self, clock: Clock) -> Array:
        """(N, 6) [rad] robot joint angles at the samples."""
        return np.asarray(self.robot.spline(self._robot_times(clock)))

    def robot_speeds(self, clock: Clock) -> Array:
        """(N, 6) [rad/s]"""
        return np.asarray(self.robot.speed(self._robot_times(clock)))

    def _robot_times(self, clock: Clock) -> Array:
        return np.clip(clock.robot_time(self.times), self.robot.start, self.robot.end)

    def start(self, geometry: Geometry, clock: Clock) -> Estimate:
        """An estimate whose unmeasured ball-bar joints follow the robot."""
        bar = complete_bar_angles(geometry, self.robot_angles(clock), self.measured(), self.joints)
        return Estimate(geometry, clock, bar)

    def closure(self, estimate: Estimate) -> Closure:
        return close_loop(estimate.geometry, self.robot_angles(estimate.clock), estimate.bar)

    def whitening(self, closure: Closure) -> Whitening:
        spread = covariance(closure, self.noise.joint, self.noise.encoder, self.noise.rod)
        return whitening(spread, bar_joint_jacobian(closure)[self.free_joints])

    def thinned(self, step: int) -> Problem:
        """Every `step`-th sample."""
        return replace(self, times=self.times[::step])

    def settle(self, estimate: Estimate) -> Estimate:
        """The same estimate with the joints without encoder where they absorb most of the mismatch."""
        if not self.free_joints:
            return estimate
        for _ in range(FREE_JOINT_STEPS):
            closure = self.closure(estimate)
            bar = estimate.bar.copy()
            bar[:, self.free_joints] += np.clip(
                self.whitening(closure).free_step(closure.error), -0.5, 0.5
            ).T
            estimate = replace(estimate, bar=bar)
        return estimate


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Whitened residual and Jacobian at one estimate; weights and null space stay frozen with it."""

    estimate: Estimate
    closure: Closure
    weights: Whitening
    residual: Array  # (M,)
    jacobian: Array  # (P, M) rows are parameters: contiguous for the normal equations

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)


def linearise(problem: Problem, estimate: Estimate, parameters: NDArray[np.intp]) -> Linearisation:
    """Residual and Jacobian with respect to geometry parameters (indices into PARAMETERS), then offset and skew."""
    estimate = problem.settle(estimate)
    closure = problem.closure(estimate)
    weights = problem.whitening(closure)
    columns = weights.jacobian(closure, [PARAMETERS[i] for i in parameters])
    if problem.has_clock:
        speeds = problem.robot_speeds(estimate.clock)
        motion = np.einsum("jcn,nj->cn", joint_screws(closure.robot), speeds)
        offset = np.einsum("ecn,cn->en", weights.of_robot(closure), motion)
        columns = np.concatenate((columns, offset[None], (offset * problem.times)[None]))
    residual = weights(closure.error).reshape(-1)
    return Linearisation(
        estimate, closure, weights, residual, columns.reshape(columns.shape[0], -1)
    )


def moved(problem: Problem, estimate: Estimate, here: Linearisation) -> Linearisation:
    """Residual of an estimate close by, under the weights and with the Jacobian of another one."""
    closure = problem.closure(estimate)
    return replace(
        here, estimate=estimate, closure=closure, residual=here.weights(closure.error).reshape(-1)
    )


def stepped(
    estimate: Estimate, parameters: NDArray[np.intp], step: Array, *, has_clock: bool
) -> Estimate:
    """The estimate moved by `step` (geometry parameters, then offset and skew)."""
    values = estimate.geometry.values.copy()
    values[parameters] += step[: parameters.size]
    clock = estimate.clock
    if has_clock:
        shift = float(np.clip(step[-2], -MAX_OFFSET_STEP, MAX_OFFSET_STEP))
        clock = Clock(
            clock.offset + shift, float(np.clip(clock.skew + step[-1], -MAX_SKEW, MAX_SKEW))
        )
    return replace(estimate, geometry=Geometry(values), clock=clock)


MAX_OFFSET_STEP = 3.0  # [s] a longer step leaves the region where the splines say anything
MAX_SKEW = 2e-3  # [1] twenty times the worst free-running clock of notes/log_formats

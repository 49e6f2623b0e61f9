"""Observations as the fit takes them: samples of a recording, or still poses.

A still pose is a sample whose speed is zero, whose clock is absent and whose joint noise is the
rounding of its angles. Poses that an instrument followed have the angles, speed and noise of the
robot's log at the instants of its rows, and a clock. A recording of a ball-bar
(ballbar.ident.estimator.samples) answers to the same methods.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import BAR_ROWS, Geometry
from ballbar.cell.placement import target_frames
from ballbar.cell.poses import JointMotion, PoseGroup
from ballbar.cell.robot_angles import by_axis
from ballbar.cell.statistics import rms
from ballbar.ident.corrections.base import BAR, GEAR, State
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.target_closure import TargetClosure, close_on_target
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.loads.at_rest import state_in_motion, state_in_order
from ballbar.ident.loads.gear_loads import MassModel

if TYPE_CHECKING:
    from ballbar.ident.estimator.model import Evaluation
    from ballbar.ident.estimator.whitening import Whitening

GRIDS_DEG = (1.0, 0.5, 0.1, 0.05, 0.01)  # steps to which tables round their angles


@dataclass(frozen=True, eq=False)
class StillPoses:
    """Still poses of one seat and one target."""

    group: PoseGroup
    angle_noise: Array  # (J,) [rad] of the joint angles, by their rounding

    @property
    def size(self) -> int:
        """Number of poses N."""
        return self.group.size

    def mechanism(self, layout: Unknowns, x: Array, k: int) -> tuple[Geometry, Clock, Array]:
        """The robot up to its bare flange, no clock, and (N,) zeros for the instants."""
        del k
        return layout.bare(x), Clock(0.0, 0.0), np.zeros(self.size)

    def joint_angles(self, at: Array) -> Array:
        """(N, J) [rad] as given."""
        del at
        return self.group.q

    def joint_speed(self, at: Array) -> Array:
        """(N, J) [rad/s] zeros: the robot stands."""
        del at
        return np.zeros_like(self.group.q)

    def state(
        self, masses: MassModel | None, geometry: Geometry, to_gear: Array, width: Array
    ) -> State:
        """State of the robot for the regressors; arguments as of `state_at_rest`."""
        state = state_in_order(masses, geometry, self.group.q, to_gear, width)
        flanks = self.group.flanks
        return state if flanks is None else replace(state, flanks=flanks.T)

    def bar_angles(self, geometry: Geometry, q: Array, ballbar: Array) -> Array:
        """(N, 5) zeros: no ball-bar holds the tool."""
        del geometry, ballbar
        return np.zeros((len(q), BAR_ROWS))

    def close(
        self, layout: Unknowns, x: Array, geometry: Geometry, q: Array, bar: Array
    ) -> TargetClosure:
        """Loop closure at the target."""
        del bar
        group = self.group
        frames = target_frames(forward(geometry.robot, q), layout.target(x, group.target))
        values = group.with_common(layout.common(x, group.common))
        return close_on_target(group.kind, values, layout.seat(x, group.seat), frames)

    def free_columns(self, point: Evaluation) -> Array:
        """(m, 6, N) shifts and turns of the target that the instrument does not measure."""
        return point.target_closure.sight.free

    def noise_columns(
        self, point: Evaluation, excess: ExcessNoise, uncertain: Array | float = 0.0
    ) -> Array:
        """(K, 6, N) noise of angles and instrument, and what the model leaves unexplained.

        uncertain : (J, N) [rad] of the gears beyond log noise and excess noise.
        """
        closure = point.target_closure
        parts = [
            self.angle_noise[:, None, None] * closure.joint_columns,
            closure.sensor_columns(self.group.sigma, self.group.factor),
        ]
        if excess.gear or excess.wrist or np.ndim(uncertain):
            gears = point.columns[GEAR:BAR]
            beyond = by_axis(len(gears), main=excess.gear, wrist=excess.wrist)[:, None]
            parts.append(np.sqrt(beyond**2 + np.square(uncertain))[:, None] * gears)
        unexplained = np.repeat([excess.position, excess.rotation], 3)
        if unexplained.any():
            parts.append(np.repeat(np.diag(unexplained)[:, :, None], self.size, axis=2))
        return np.concatenate(parts)

    @property
    def silent(self) -> Self:
        """The same without noise."""
        group = replace(self.group, sigma=0.0 * self.group.sigma)
        return replace(self, group=group, angle_noise=0.0 * self.angle_noise)

    @property
    def noise_sources(self) -> list[tuple[str, StillPoses, float]]:
        """Name and standard deviation [m, rad, s] of each noise by itself, the others off."""
        silent, group = self.silent, self.group
        name = "bearings" if group.kind.units[:1] == ("rad",) else "instrument"
        return [
            ("joint_log", replace(silent, angle_noise=self.angle_noise), rms(self.angle_noise)),
            (name, replace(silent, group=group), rms(group.sigma[:, 0])),
        ]

    def own_geometry(self, layout: Unknowns, k: int) -> tuple[NDArray[np.intp], slice]:
        """No parameters of the mechanism are their own."""
        del layout, k
        return np.zeros(0, dtype=np.intp), slice(0, 0)

    def own_columns(
        self, layout: Unknowns, x: Array, k: int, point: Evaluation, weights: Whitening
    ) -> list[tuple[slice, Array]]:
        """Unknowns of seat and target, and (p, E, N) the weighted error's change per unit."""
        del k
        group, closure = self.group, point.target_closure
        seat, target = layout.seats[group.seat], layout.targets[group.target]
        columns = [
            (seat, weights(closure.seat_columns(x[seat]))),
            (target, weights(closure.target_columns(x[target]))),
        ]
        if group.common is not None and group.by_common is not None:
            moved = closure.value_columns(group.by_common)
            columns.append((layout.placed.common[group.common.name], weights(moved)))
        return columns


@dataclass(frozen=True, eq=False)
class FollowedPoses(StillPoses):
    """Poses of a robot that moved while an instrument followed its target, on a clock of its own.

    A constant latency of the instrument is a part of its clock's offset.
    """

    motion: JointMotion
    times: Array  # (N,) [s] on the instrument's clock
    stamp_noise: float  # [s] of the robot's log, at instants as far apart as these

    def mechanism(self, layout: Unknowns, x: Array, k: int) -> tuple[Geometry, Clock, Array]:
        """The robot up to its bare flange, the clock, and (N,) [s] the robot's time."""
        del k
        clock = layout.instrument_clock(x, self.motion.name)
        return layout.bare(x), clock, self.group.at(clock)

    @cached_property
    def _beyond(self) -> Array:
        """(N, J) [rad] angles as given less those of the motion by the clock that they are of."""
        return np.asarray(self.group.q - self.motion.angles(self.group.at()))

    def joint_angles(self, at: Array) -> Array:
        """(N, J) [rad] at robot times (N,) [s]."""
        return self._beyond + self.motion.angles(at)

    def joint_speed(self, at: Array) -> Array:
        """(N, J) [rad/s] at robot times (N,) [s]."""
        return self.motion.speed(at)

    def state(
        self, masses: MassModel | None, geometry: Geometry, to_gear: Array, width: Array
    ) -> State:
        """State of the robot for the regressors, by the clock from which the fit starts."""
        return state_in_motion(masses, geometry, self.group, to_gear, width)

    def noise_columns(
        self, point: Evaluation, excess: ExcessNoise, uncertain: Array | float = 0.0
    ) -> Array:
        """(K, 6, N) as of still poses, and of the stamps, which displace all joints at once."""
        parts = super().noise_columns(point, excess, uncertain)
        if not self.stamp_noise:
            return parts
        return np.concatenate((parts, self.stamp_noise * point.time_column[None]))

    @property
    def silent(self) -> Self:
        """The same without noise."""
        return replace(super().silent, stamp_noise=0.0)

    @property
    def noise_sources(self) -> list[tuple[str, StillPoses, float]]:
        """Name and standard deviation of each noise by itself, of the stamps too."""
        stamped = replace(self.silent, stamp_noise=self.stamp_noise)
        return [*super().noise_sources, ("stamps", stamped, self.stamp_noise)]

    def own_columns(
        self, layout: Unknowns, x: Array, k: int, point: Evaluation, weights: Whitening
    ) -> list[tuple[slice, Array]]:
        """Unknowns of seat, target and clock, and (p, E, N) the weighted change by each."""
        shift = weights(point.time_column)
        clock = layout.placed.clocks[self.motion.name]
        columns = np.stack((shift, shift * self.times))
        return [*super().own_columns(layout, x, k, point, weights), (clock, columns)]


def observed(group: PoseGroup, rounding: Array) -> StillPoses:
    """A group of poses as the fit takes it; rounding : (J,) [rad] of the angles of still ones."""
    motion, times = group.motion, group.time
    if motion is None or times is None:
        return StillPoses(group, rounding)
    noise, stamp_noise = motion.noise(float(np.median(np.diff(times))) if group.size > 1 else 0.0)
    return FollowedPoses(group, noise, motion, times, stamp_noise)


def rounding_noise(q: Array) -> Array:
    """(J,) [rad] standard deviation of the rounding of angles q (N, J)."""
    return np.asarray(rounding(q) / np.sqrt(12.0))


def rounding(q: Array) -> Array:
    """(J,) [rad] step to which the angles q (N, J) were rounded; 0 where none is seen."""
    degrees = np.rad2deg(q)
    out = np.zeros(q.shape[1])
    for j, angles in enumerate(degrees.T):
        if len(np.unique(angles.round(9))) < min(10, len(angles)):
            continue  # a joint that hardly moves, or a grid of poses by intention
        for step in GRIDS_DEG:
            if np.abs(angles / step - np.round(angles / step)).max() < 1e-6:
                out[j] = step
                break
    commanded = out >= 0.5  # whole and half degrees are targets of a program, not rounding
    return np.deg2rad(np.where(commanded, 0.0, out))


Observations = Samples | StillPoses

"""Observations as the fit takes them: what any instrument measured, and still poses.

A recording (ident.estimator.samples) is an observation too. A still pose is one whose speed is zero
and whose clock is absent.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import forward
from cell.clock import Clock
from cell.geometry import BAR_ROWS, Geometry
from cell.placement import target_frames
from cell.poses import PoseGroup
from cell.robot_angles import by_axis
from ident.corrections.base import BAR, GEAR
from ident.estimator.closure import Closure
from ident.estimator.noise import ExcessNoise
from ident.estimator.target_closure import TargetClosure, close_on_target
from ident.estimator.unknowns import Unknowns

if TYPE_CHECKING:
    from ident.estimator.model import Evaluation
    from ident.estimator.whitening import Whitening


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """Motion of the robot's joints at N instants."""

    q: Array  # (N, J) [rad]
    logged_speed: Array  # (N, J) [rad/s] of the log
    speed: Array  # (N, J) [rad/s] of the arm as a rigid body
    acceleration: Array  # (N, J) [rad/s^2] of the arm as a rigid body


class Observations(ABC):
    """Measurements of one instrument, ready to be compared with the model of a mechanism."""

    at_rest: ClassVar[bool] = False  # whether regressors and loads do not depend on the unknowns

    @property
    def solved_joints(self) -> bool:
        """Whether the instrument has joints without sensor whose angles are solved for."""
        return False

    @property
    def unmeasured(self) -> list[int]:
        """Columns of the ball-bar joints without encoder, from 0."""
        return []

    times: Array  # (N,) [s]

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of samples N."""

    @abstractmethod
    def geometry(self, layout: Unknowns, x: Array, k: int) -> Geometry:
        """The mechanism that was observed; k : number of a recording."""

    @abstractmethod
    def clock(self, layout: Unknowns, x: Array, k: int) -> Clock:
        """The clock against the robot's."""

    @abstractmethod
    def robot_times(self, layout: Unknowns, x: Array, k: int) -> Array:
        """(N,) [s] on the robot's clock, clock steps included."""

    @abstractmethod
    def joint_angles(self, at: Array) -> Array:
        """(N, J) [rad] as logged, at robot times (N,) [s]."""

    @abstractmethod
    def joint_speed(self, at: Array) -> Array:
        """(N, J) [rad/s] derivative of `joint_angles`."""

    @abstractmethod
    def arm_motion(self, at: Array) -> ArmMotion:
        """The motion at robot times (N,) [s], which loads depend on."""

    @abstractmethod
    def bar_angles(self, geometry: Geometry, q: Array, ballbar: Array) -> Array:
        """(N, 5) or more [rad, m] of a ball-bar's joints, those it cannot know as given."""

    @abstractmethod
    def close(
        self, layout: Unknowns, x: Array, geometry: Geometry, q: Array, bar: Array
    ) -> Closure | TargetClosure:
        """Loop closure at actual angles q (N, J), bar (N, 5) or more [rad]."""

    @abstractmethod
    def free_columns(self, closure: Closure | TargetClosure, columns: Array) -> Array:
        """(m, 6, N) changes of the error along unmeasured directions.

        columns : of the error channels.
        """

    @abstractmethod
    def noise_columns(
        self, evaluation: Evaluation, excess: ExcessNoise, uncertain: Array | float = 0.0
    ) -> Array:
        """(K, 6, N) change of the error for one standard deviation of each source of noise.

        uncertain : (J, N) [rad] of the gears beyond log noise and excess noise.
        """

    @abstractmethod
    def own_geometry(self, layout: Unknowns, k: int) -> tuple[NDArray[np.intp], slice]:
        """Kinematic parameters that are its own, indices into the table, and their unknowns."""

    @abstractmethod
    def own_columns(
        self,
        layout: Unknowns,
        x: Array,
        k: int,
        point: Evaluation,
        weights: Whitening,
        slope: Array | None,
    ) -> list[tuple[slice, Array]]:
        """Unknowns of its own besides, and (p, E, N) the weighted error's change per unit of each.

        slope : (E, N) of the weighted error per newton of a tension that is not known.
        """

    def tension_unknown(self, layout: Unknowns, k: int) -> bool:
        """Whether the tension of a rod is among the unknowns."""
        del layout, k
        return False


@dataclass(frozen=True, eq=False)
class StillPoses(Observations):
    """Still poses of one seat and one target."""

    group: PoseGroup
    angle_noise: Array  # (J,) [rad] of the joint angles, by their rounding

    at_rest: ClassVar[bool] = True

    @property
    def size(self) -> int:
        return self.group.size

    @cached_property
    def times(self) -> Array:  # type: ignore[override]
        """(N,) [s] zeros."""
        return np.zeros(self.size)

    def geometry(self, layout: Unknowns, x: Array, k: int) -> Geometry:
        """The robot up to its bare flange."""
        del k
        return layout.bare(x)

    def clock(self, layout: Unknowns, x: Array, k: int) -> Clock:
        """None is needed."""
        del layout, x, k
        return Clock(0.0, 0.0)

    def robot_times(self, layout: Unknowns, x: Array, k: int) -> Array:
        """Zeros."""
        del layout, x, k
        return np.zeros(self.size)

    def joint_angles(self, at: Array) -> Array:
        """(N, J) [rad] as given."""
        del at
        return self.group.q

    def joint_speed(self, at: Array) -> Array:
        """(N, J) zeros."""
        del at
        return np.zeros_like(self.group.q)

    def arm_motion(self, at: Array) -> ArmMotion:
        """At rest."""
        still = self.joint_speed(at)
        return ArmMotion(self.group.q, still, still, still)

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
        return close_on_target(group.kind, group.values, layout.seat(x, group.seat), frames)

    def free_columns(self, closure: Closure | TargetClosure, columns: Array) -> Array:
        """Shifts and turns of the target that the instrument does not measure."""
        del columns
        assert isinstance(closure, TargetClosure)
        return closure.sight.free

    def noise_columns(
        self, evaluation: Evaluation, excess: ExcessNoise, uncertain: Array | float = 0.0
    ) -> Array:
        """Noise of the angles and the instrument, and what the model leaves unexplained."""
        closure = evaluation.closure
        assert isinstance(closure, TargetClosure)
        parts = [
            self.angle_noise[:, None, None] * closure.joint_columns,
            closure.sensor_columns(self.group.sigma),
        ]
        if excess.gear or excess.wrist or np.ndim(uncertain):
            gears = evaluation.columns[GEAR:BAR]
            beyond = by_axis(len(gears), main=excess.gear, wrist=excess.wrist)[:, None]
            parts.append(np.sqrt(beyond**2 + np.square(uncertain))[:, None] * gears)
        unexplained = np.repeat([excess.position, excess.rotation], 3)
        if unexplained.any():
            parts.append(np.repeat(np.diag(unexplained)[:, :, None], self.size, axis=2))
        return np.concatenate(parts)

    def own_geometry(self, layout: Unknowns, k: int) -> tuple[NDArray[np.intp], slice]:
        """None."""
        del layout, k
        return np.zeros(0, dtype=np.intp), slice(0, 0)

    def own_columns(
        self,
        layout: Unknowns,
        x: Array,
        k: int,
        point: Evaluation,
        weights: Whitening,
        slope: Array | None,
    ) -> list[tuple[slice, Array]]:
        """Columns of the unknowns of seat and target."""
        del k, slope
        closure = point.closure
        assert isinstance(closure, TargetClosure)
        seat = layout.seats[self.group.seat]
        target = layout.targets[self.group.target]
        return [
            (seat, weights(closure.seat_columns(x[seat]))),
            (target, weights(closure.target_columns(x[target]))),
        ]

"""Observations as the fit takes them: samples of a recording, or still poses.

A still pose is a sample whose speed is zero, whose clock is absent and whose joint noise is the
rounding of its angles. A recording (ident.estimator.samples) answers to the same methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

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
from ident.estimator.noise import ExcessNoise
from ident.estimator.samples import Samples
from ident.estimator.target_closure import TargetClosure, close_on_target
from ident.estimator.unknowns import Unknowns

if TYPE_CHECKING:
    from ident.estimator.model import Evaluation
    from ident.estimator.whitening import Whitening

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
            closure.sensor_columns(self.group.sigma),
        ]
        if excess.gear or excess.wrist or np.ndim(uncertain):
            gears = point.columns[GEAR:BAR]
            beyond = by_axis(len(gears), main=excess.gear, wrist=excess.wrist)[:, None]
            parts.append(np.sqrt(beyond**2 + np.square(uncertain))[:, None] * gears)
        unexplained = np.repeat([excess.position, excess.rotation], 3)
        if unexplained.any():
            parts.append(np.repeat(np.diag(unexplained)[:, :, None], self.size, axis=2))
        return np.concatenate(parts)

    def own_geometry(self, layout: Unknowns, k: int) -> tuple[NDArray[np.intp], slice]:
        """No parameters of the mechanism are their own."""
        del layout, k
        return np.zeros(0, dtype=np.intp), slice(0, 0)

    def own_columns(
        self, layout: Unknowns, x: Array, k: int, point: Evaluation, weights: Whitening
    ) -> list[tuple[slice, Array]]:
        """Unknowns of seat and target, and (p, E, N) the weighted error's change per unit."""
        del k
        seat, target = layout.seats[self.group.seat], layout.targets[self.group.target]
        closure = point.target_closure
        return [
            (seat, weights(closure.seat_columns(x[seat]))),
            (target, weights(closure.target_columns(x[target]))),
        ]


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

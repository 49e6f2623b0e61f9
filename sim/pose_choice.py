"""Poses at which a robot stands before an instrument: random, within what both can reach.

Joint angles are drawn over the axis limits. A tracker sees any of them; for a rod, a wire or a
socket the target is then brought to where the instrument can measure it, with its orientation as
it happens to be. The operator who does so sees the true robot: its target is brought there, not the
nominal one's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.numerical_inverse import reach_points
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.sim.instrument_readings import stand_of
from ballbar.sim.settings import PosesSettings
from ballbar.sim.true_robot import TrueArm
from ballbar.sim.truth import TruePlace

_BATCH = 400  # poses drawn at a time
_BATCHES, _HOPELESS = 100, 5  # drawn at most; and if not one pose was found
_INSIDE = 0.05  # of the range: how far from its ends a reading is aimed at
_MARGIN = np.deg2rad(1.0)  # [rad] of the axis limits


@dataclass(frozen=True, eq=False)
class Stand:
    """N poses at which one seat measures one target, and their places in the order of time."""

    seat: str
    target: str
    q: Array  # (N, J) [rad] shown by the robot, before it logs them
    order: NDArray[np.intp]  # (N,) number of each pose in the whole measurement
    later: int  # how many targets may have been measured before, at the same pose


def choose_poses(
    settings: PosesSettings,
    instrument: Instrument,
    arm: TrueArm,
    seats: dict[str, TruePlace],
    targets: dict[str, TruePlace],
    rng: np.random.Generator,
) -> tuple[Stand, ...]:
    """Poses of every seat and target.

    Raises InputError where too few are found.
    """
    limits = _limits(settings, arm)
    names, stands, first = list(targets), list[Stand](), 0
    everywhere = not instrument.kind.local
    for seat in settings.seats:
        for group in [names] if everywhere else [[name] for name in names]:
            places = [targets[name] for name in group]
            draw = _Draw(settings, instrument, arm, limits, seats[seat.name], places)
            q = draw.poses(rng, f"seat {seat.name}, target {', '.join(group)}")
            order = first + np.arange(len(q))
            stands += [Stand(seat.name, name, q, order, names.index(name)) for name in group]
            first += len(q)
    return tuple(stands)


@dataclass(frozen=True, eq=False)
class _Draw:
    """Where to draw poses from."""

    settings: PosesSettings
    instrument: Instrument
    arm: TrueArm
    limits: tuple[Array, Array]  # (J,) [rad] of the axes
    seat: TruePlace
    targets: list[TruePlace]

    def poses(self, rng: np.random.Generator, where: str) -> Array:
        """(N, J) [rad] as many poses as the scenario wants. where : for the refusal.

        Raises InputError where too few can be measured.
        """
        count, batches, poses = self.settings.count, list[Array](), 0
        while len(batches) < (_BATCHES if poses else _HOPELESS):
            batches.append(self._batch(rng))
            poses += len(batches[-1])
            if poses >= count:
                return np.concatenate(batches)[:count]
        raise InputError(
            f"poses.count: of {_BATCH * len(batches)} random poses only {poses} can be measured "
            f"from {where}; {count} are wanted. Move the seat to where the robot reaches all "
            "round it, or widen poses.tilt_max_deg, lowest_m and the axis limits."
        )

    def _batch(self, rng: np.random.Generator) -> Array:
        """(K, J) [rad] poses that can be measured, of a batch."""
        robot = self.arm.robot
        q = controller_to_joints(robot, rng.uniform(*self.limits, (_BATCH, robot.joints)))
        shares = rng.uniform(size=_BATCH)
        if self.instrument.kind.local:
            q = self._brought(q, shares)
        return q[self._acceptable(q)]

    def _brought(self, q: Array, shares: Array) -> Array:
        """Poses with the target within the range of rod, wire or socket; shares : (N,) of it."""
        point, seat, instrument = self.targets[0].position, self.seat, self.instrument
        margin = _INSIDE * (instrument.upper - instrument.lower)
        rod = (self.arm.target(q, point) - seat.position) @ seat.rotation
        brought = instrument.kind.brought(
            rod, shares, instrument.lower + margin, instrument.upper - margin
        )
        lower, upper = self.limits
        q, reached = reach_points(
            self.arm.robot,
            self.arm.chain,
            point=point,
            q=q,
            wanted=seat.position + brought @ seat.rotation.T,
            lower=lower,
            upper=upper,
            position=lambda angles: self.arm.target(angles, point),
            tolerance=1e-6,
        )
        return q[reached]

    def _acceptable(self, q: Array) -> NDArray[np.bool_]:
        """(N,) whether a pose stands above the floor, upright enough, and can be measured."""
        settings, flange = self.settings, self.arm.flange(q)
        good = flange.origin[2:, 2].min(axis=0) > settings.lowest_m
        for target in self.targets:
            place = flange.tip.T + np.einsum("ijn,j->ni", flange.rotation(), target.position)
            good &= place[:, 2] > settings.lowest_m
            rod = place - self.seat.position
            distance = np.maximum(np.linalg.norm(rod, axis=1), 1e-9)
            if self.instrument.kind.sighted:
                good &= (distance > self.instrument.lower) & (distance < self.instrument.upper)
                good &= rod[:, 2] / distance >= np.sin(np.deg2rad(settings.elevation_min_deg))
            down = flange.tip[2] - place[:, 2]
            stylus = max(float(np.linalg.norm(target.position)), 1e-9)
            good &= down / stylus >= np.cos(np.deg2rad(settings.tilt_max_deg)) - 1e-9
            good &= self.instrument.visible(stand_of(self.arm, q, target, self.seat.still(len(q))))
        return np.asarray(good)


def _limits(settings: PosesSettings, arm: TrueArm) -> tuple[Array, Array]:
    """(J,) [rad] limits of the axes. Raises InputError where they are not those of this robot."""
    robot, limits = arm.robot, list[Array]()
    for key, stated, own, side in (
        ("axis_lower_deg", settings.axis_lower_deg, robot.axis_lower, 1.0),
        ("axis_upper_deg", settings.axis_upper_deg, robot.axis_upper, -1.0),
    ):
        if stated is not None and len(stated) != robot.joints:
            raise InputError(
                f"poses.{key}: {len(stated)} angles, but {robot.name} has {robot.joints} axes."
            )
        limit = own if stated is None else np.deg2rad(stated)
        beyond = np.flatnonzero(side * (limit - own) < -1e-9)
        if beyond.size:
            axis = int(beyond[0])
            raise InputError(
                f"poses.{key}: {np.rad2deg(limit[axis]):g} deg of axis {axis + 1} is beyond the "
                f"robot's own limit {np.rad2deg(own[axis]):g} deg."
            )
        limits.append(limit + side * _MARGIN)
    lower, upper = limits
    if (empty := np.flatnonzero(lower >= upper)).size:
        raise InputError(
            f"poses.axis_lower_deg and axis_upper_deg leave axis {empty[0] + 1} no range; "
            f"{2.0 * np.rad2deg(_MARGIN):g} deg are kept from the limits."
        )
    return lower, upper

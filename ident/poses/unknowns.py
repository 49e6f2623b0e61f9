"""The unknowns of an identification from still poses as one vector, each with a Gaussian prior.

Seats come first, then targets, the robot's DH parameters, and the coefficients of corrections.
Seats and targets start where `ident.poses.start` found them; of those that are no whole frames,
because nothing measures an orientation, only the position is unknown. The joint offset and offset
of the first row are a gauge against the seats, those of the last row against the targets, and of
two parallel axes only the sum of their offsets moves anything: these stay nominal.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from cell.arrays import Array
from cell.chain import Chain
from cell.descriptions import Robot
from cell.geometry import Parameter, parameter_table
from cell.poses import PoseTable
from cell.rotation import matrix_from_rotvec
from ident.corrections.base import Correction
from ident.poses.closure import Placement

# Of a parameter about its catalogue value. UR5, UR10 and Panda: from 60 poses on, 5 mrad and 2 mm
# predict as well; 1 mrad and 0.3 mm are too tight (docs/real_robots, priors).
ANGLE_PRIOR, LENGTH_PRIOR = 2e-3, 7e-4  # [rad], [m]
HELD = 1e-9  # of a prior's sigma: below what data could tell
PLACEMENT_PRIOR = 1.0  # [m, rad] of seats and targets about their start: keeps steps finite


def robot_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """The parameters of a robot that still poses can tell from seats and targets."""
    table = parameter_table(robot)
    of_targets = {f"r{kind}{table.joints}" for kind in ("a", "d", "theta", "alpha", "beta")}
    fixed = {*table.gauge, *of_targets}
    return tuple(p for p in table.parameters if p.side == "robot" and p.name not in fixed)


@dataclass(frozen=True, eq=False)
class PoseUnknowns:
    """Names, priors and places of the unknowns x (P,)."""

    names: tuple[str, ...]
    mean: Array  # (P,) of the prior [m, rad, unit of the coefficient]
    sigma: Array  # (P,)
    chain: Chain  # nominal
    parameters: tuple[Parameter, ...]
    seats: dict[str, slice]
    targets: dict[str, slice]
    seat_starts: dict[str, Placement]
    target_starts: dict[str, Placement]
    geometry: slice
    coefficients: slice

    @property
    def framed(self) -> set[str]:
        """Seats and targets whose orientation is unknown too."""
        places = {**self.seats, **self.targets}
        return {name for name, part in places.items() if part.stop - part.start == 6}

    @property
    def count(self) -> int:
        return len(self.names)

    @property
    def machine(self) -> slice:
        """The robot's parameters and the coefficients."""
        return slice(self.geometry.start, self.coefficients.stop)

    def held(self, targets: Iterable[str] = ()) -> PoseUnknowns:
        """The same with robot, coefficients and some targets held at their priors' means."""
        sigma = self.sigma.copy()
        for part in (self.machine, *(self.targets[name] for name in targets)):
            sigma[part] *= HELD
        return replace(self, sigma=sigma)

    def seat(self, x: Array, name: str) -> Placement:
        """A seat in the robot's base frame; turns about the base's axes."""
        return _moved(self.seat_starts[name], x[self.seats[name]], about_own_axes=False)

    def target(self, x: Array, name: str) -> Placement:
        """A target in the flange's frame; turns about its own axes."""
        return _moved(self.target_starts[name], x[self.targets[name]], about_own_axes=True)

    def robot(self, x: Array) -> Chain:
        """The robot's DH rows."""
        rows = {f.name: getattr(self.chain, f.name).copy() for f in fields(Chain)}
        for parameter, value in zip(self.parameters, x[self.geometry], strict=True):
            rows[parameter.kind][parameter.row] = value
        return Chain(**rows)


def pose_unknowns(
    table: PoseTable,
    chain: Chain,
    seats: dict[str, Placement],
    targets: dict[str, Placement],
    corrections: Sequence[Correction],
) -> PoseUnknowns:
    """Unknowns of a table. seats, targets : where they start; chain : nominal."""
    framed = {g.seat for g in table.groups if g.measured in ("point", "pose")}
    whole = {g.target for g in table.groups if g.measured == "pose"}
    parameters = robot_parameters(table.robot)
    names: list[str] = []
    mean: list[float] = []
    sigma: list[float] = []

    def block(labels: Sequence[str], means: Sequence[float], sigmas: Sequence[float]) -> slice:
        first = len(names)
        names.extend(labels)
        mean.extend(means)
        sigma.extend(sigmas)
        return slice(first, len(names))

    def placement(name: str, *, turns: bool) -> slice:
        axes = ("x", "y", "z", "rx", "ry", "rz")[: 6 if turns else 3]
        count = len(axes)
        return block([f"{name}.{c}" for c in axes], [0.0] * count, [PLACEMENT_PRIOR] * count)

    seat_parts = {s: placement(f"seat {s}", turns=s in framed) for s in table.seats}
    target_parts = {t: placement(f"target {t}", turns=t in whole) for t in table.targets}
    geometry = block(
        [p.name for p in parameters],
        [float(getattr(chain, p.kind)[p.row]) for p in parameters],
        [LENGTH_PRIOR if p.is_length else ANGLE_PRIOR for p in parameters],
    )
    each = [c for correction in corrections for c in correction.coefficients]
    coefficients = block([c.name for c in each], [c.mean for c in each], [c.sigma for c in each])
    return PoseUnknowns(
        names=tuple(names),
        mean=np.array(mean),
        sigma=np.array(sigma),
        chain=chain,
        parameters=parameters,
        seats=seat_parts,
        targets=target_parts,
        seat_starts=seats,
        target_starts=targets,
        geometry=geometry,
        coefficients=coefficients,
    )


def _moved(start: Placement, change: Array, *, about_own_axes: bool) -> Placement:
    rotation = start.rotation
    if change.size == 6:
        turn = matrix_from_rotvec(change[3:, None])[:, :, 0]
        rotation = rotation @ turn if about_own_axes else turn @ rotation
    return Placement(rotation, start.origin + change[:3])

"""Held-out validation: does an identified robot predict poses that it was not identified from?

Fitted are only the seats of the held-out table, and targets that the identification did not see.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.geometry import robot_geometry
from cell.placement import Placement
from cell.poses import PoseTable
from ident.cross_validation import LEVEL, SAME_PLACE
from ident.estimator.build_unknowns import still_unknowns
from ident.estimator.fit import Fit
from ident.estimator.model import still_model
from ident.estimator.robust_fit import fit_robustly
from ident.estimator.unknowns import PlacedPoses, Unknowns
from ident.robot.identified import IdentifiedRobot, range_sentence
from ident.start.placements import start_of_poses
from ident.table_estimate import TableEstimate, position_errors
from ident.table_steps import other_sides

WORSE = 2.0  # held-out error over that predicted by cross-validation: no longer the same robot


@dataclass(frozen=True, eq=False)
class PoseHeldOut:
    """A table of poses that took no part in the identification."""

    name: str
    error: Array  # (N,) [m] of the identified robot
    nominal: Array  # (N,) [m] of the nominal robot, seats fitted in the same way
    predicted: float  # [m] mean error that cross-validation predicts
    out_of_range: dict[int, tuple[float, float]]  # axes, from 1, beyond their fitted range [rad]
    moved: tuple[str, ...] = ()  # targets as they are called on the other side of a step
    elsewhere: bool = False  # whether it was measured at a place that was not fitted

    @property
    def acceptable(self) -> bool:
        return float(self.error.mean()) <= WORSE * self.predicted

    @property
    def sentence(self) -> str:
        """How well the robot predicts the poses."""
        mean, high = self.error.mean() * 1e3, np.quantile(self.error, LEVEL) * 1e3
        opening = (
            f"Held out {self.name}: {self.error.size} poses to {mean:.3f} mm (95 %: {high:.3f} "
            f"mm); nominal robot {self.nominal.mean() * 1e3:.3f} mm; predicted "
            f"{self.predicted * 1e3:.3f} mm"
        )
        if self.moved:
            opening += f"; its target stands as {', '.join(map(repr, self.moved))}"
        if self.out_of_range:
            opening += f"; some poses are {range_sentence(self.out_of_range)}"
        if self.acceptable:
            return f"{opening}."
        return f"{opening}: a misfit. The robot as identified does not explain these poses."


def held_out_poses(result: TableEstimate, table: PoseTable) -> PoseHeldOut:
    """How well an identified robot predicts a table that it was not identified from."""
    robot = result.identified_robot()
    identified, moved = _as_it_stood(result, robot, table)
    bare = robot.rigid(robot_geometry(table.robot))
    before = result.nominal.model.unknowns
    nominal_targets = {name: before.target(result.nominal.x, name) for name in before.targets}
    return PoseHeldOut(
        name=table.name,
        error=position_errors(identified),
        nominal=position_errors(placed(bare, table, nominal_targets)),
        predicted=result.cross_validation.mean,
        out_of_range=robot.out_of_range(table.q),
        moved=moved,
        elsewhere=_elsewhere(result, identified),
    )


def _elsewhere(result: TableEstimate, held: Fit) -> bool:
    """Whether a seat of a held-out table stands at another place than all that were fitted."""
    known, own = result.fit.model.unknowns, held.model.unknowns
    fitted = np.stack([known.seat(result.fit.x, name).origin for name in known.seats])
    return any(
        np.linalg.norm(fitted - own.seat(held.x, name).origin, axis=1).min() > SAME_PLACE
        for name in own.seats
    )


def _as_it_stood(
    result: TableEstimate, robot: IdentifiedRobot, table: PoseTable
) -> tuple[Fit, tuple[str, ...]]:
    """A table placed with each target on that side of its steps which fits better, and the names
    of the targets that are not on the side with most fitted poses.
    """
    layout, x = result.fit.model.unknowns, result.fit.x
    known = {name: layout.target(x, name) for name in layout.targets}
    best, moved = placed(robot, table, known), dict[str, str]()
    for target in table.targets:
        for name in other_sides(result.findings.steps, target):
            trial = placed(robot, table, known | {target: layout.target(x, name)})
            if position_errors(trial).mean() < position_errors(best).mean():
                best, moved[target] = trial, name
    return best, tuple(moved.values())


def placed(robot: IdentifiedRobot, table: PoseTable, known: dict[str, Placement]) -> Fit:
    """Seats of a table, and targets that are not known, fitted to a robot that is held."""
    layout = held_layout(robot, start_of_poses(table, robot.chain), known)
    noise = np.zeros(table.robot.joints)
    return fit_robustly(still_model(table, layout, robot.corrections, noise), layout.mean.copy())


def held_layout(
    robot: IdentifiedRobot, start: PlacedPoses, known: dict[str, Placement]
) -> Unknowns:
    """Unknowns of a table with the robot and the known targets held, seats free from `start`."""
    targets = {name: known.get(name, place) for name, place in start.targets.items()}
    layout = still_unknowns(robot.geometry, replace(start, targets=targets), robot.corrections)
    mean = layout.mean.copy()
    mean[layout.coefficients] = robot.values
    return replace(layout, mean=mean).held(name for name in targets if name in known)

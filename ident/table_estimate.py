"""Still poses in a fit: where their seats and targets are, and how far they are from the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.placement import Placement
from cell.poses import PoseTable
from ident.estimator.fit import Fit


@dataclass(frozen=True, eq=False)
class PlacementEstimate:
    """Where a seat stands in the robot's base frame, or a target in the flange's."""

    placement: Placement
    sigma: Array  # (3,) [m] of its position
    whole: bool  # whether its orientation was identified too


@dataclass(frozen=True, eq=False)
class TableEstimate:
    """Still poses that were fitted together with recordings."""

    table: PoseTable
    seats: dict[str, PlacementEstimate]
    targets: dict[str, PlacementEstimate]
    errors: tuple[Array, ...]  # (N,) [m] distance of each measurement from the model, by group
    ignored: int  # poses so far from the model that they do not count
    unexplained: float  # [m] along each axis, beyond the noise of instrument and joints
    declared: float  # [m] noise of the instrument along each axis, median

    @property
    def sentence(self) -> str:
        """How well the robot explains the poses."""
        error = np.concatenate(self.errors)
        mean, high = (f"{v * 1e3:.3f} mm" for v in (error.mean(), error.max()))
        lost = f", {self.ignored} of them too far off to count" * (self.ignored > 0)
        poses = f"{error.size} still poses of {self.table.name}"
        return f"{poses}{lost}: mean error {mean}, largest {high}"


def table_estimate(fit: Fit, covariance: Array) -> TableEstimate | None:
    """The still poses of a fit; None where there are none.

    covariance : (P, P) stated, of the unknowns.
    """
    layout, count = fit.model.unknowns, len(fit.model.recordings)
    if fit.model.table is None:
        return None
    sigma = np.sqrt(np.diag(covariance))

    def placed(
        place: Callable[[Array, str], Placement], parts: dict[str, slice]
    ) -> dict[str, PlacementEstimate]:
        return {
            name: PlacementEstimate(place(fit.x, name), sigma[part][:3], name in layout.framed)
            for name, part in parts.items()
        }

    points = fit.linear.evaluations[count:]
    return TableEstimate(
        table=fit.model.table,
        seats=placed(layout.seat, layout.seats),
        targets=placed(layout.target, layout.targets),
        errors=tuple(np.linalg.norm(point.closure.error[:3], axis=0) for point in points),
        ignored=sum(int((weight == 0.0).sum()) for weight in fit.linear.robust[count:]),
        unexplained=fit.excess.position,
        declared=float(np.median(np.concatenate([p.position_sigma.ravel() for p in points]))),
    )

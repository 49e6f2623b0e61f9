"""Still poses in a fit: seats and targets, errors, and how well poses left out are predicted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.cell.statistics import chi_square_quantile
from ballbar.ident.cameras import CameraEstimate, cameras_of, doubts_of
from ballbar.ident.cross_validation import (
    LEVEL,
    CrossValidation,
    at_one_place,
    mahalanobis,
    only_lengths,
    position_rows,
    spread_of,
)
from ballbar.ident.estimator.block_covariance import BLOCKS
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.order_search import OrderSearch
from ballbar.ident.findings import Findings, scale_of
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.ident.table_steps import renamed

ENOUGH = 3.0  # equations for each unknown of seats and targets: nine points of one tracker


@dataclass(frozen=True, eq=False)
class PlacementEstimate:
    """Where a seat stands in the robot's base frame, or a target in the flange's."""

    placement: Placement
    sigma: Array  # (3,) [m] of its position
    turn_sigma: (
        Array  # (3,) [rad] of its orientation, about axes of the flange or of the base; (0,)
    )
    whole: bool  # whether its orientation was identified too


@dataclass(frozen=True, eq=False)
class TableEstimate:
    """Still poses that were fitted, by themselves or together with recordings."""

    fit: Fit  # of all that was measured, its covariance as stated
    nominal: Fit  # seats and targets of the poses fitted to the robot as its file has it
    cross_validation: CrossValidation
    findings: Findings
    search: OrderSearch | None = None  # None where joint errors were not searched

    @property
    def table(self) -> PoseTable:
        return self.fit.model.poses

    @property
    def alone(self) -> bool:
        """Whether no recording was fitted together with them."""
        return not self.fit.model.recordings

    @property
    def judges(self) -> bool:
        """Whether the poses tell enough beyond their seats and targets to judge the robot.

        Of poses alone that is asked for before the fit. A few beside recordings do not predict
        one another: what is left of them hardly determines where their instrument stands.
        """
        layout = self.fit.model.unknowns
        places = sum(p.stop - p.start for p in (*layout.seats.values(), *layout.targets.values()))
        equations = sum(group.kind.equations * group.size for group in self.table.groups)
        return self.alone or equations >= ENOUGH * places

    @cached_property
    def seats(self) -> dict[str, PlacementEstimate]:
        layout = self.fit.model.unknowns
        return self._placed(layout.seat, layout.seats)

    @cached_property
    def targets(self) -> dict[str, PlacementEstimate]:
        layout = self.fit.model.unknowns
        return self._placed(layout.target, layout.targets)

    def _placed(
        self, place: Callable[[Array, str], Placement], parts: Mapping[str, slice]
    ) -> dict[str, PlacementEstimate]:
        fit, sigma = self.fit, np.sqrt(np.diag(self.fit.covariance))
        framed = fit.model.unknowns.framed
        return {
            name: PlacementEstimate(
                place(fit.x, name), sigma[part][:3], sigma[part][3:], name in framed
            )
            for name, part in parts.items()
        }

    @cached_property
    def clocks(self) -> dict[str, tuple[Clock, Array]]:
        """Clock of each instrument that followed the robot, and its sigma (2,) [s], [1]."""
        layout, sigma = self.fit.model.unknowns, np.sqrt(np.diag(self.fit.covariance))
        return {
            name: (layout.instrument_clock(self.fit.x, name), sigma[part])
            for name, part in layout.placed.clocks.items()
        }

    @property
    def errors(self) -> tuple[Array, ...]:
        """(N,) [m] distance of each measurement from the model, by group."""
        return group_errors(self.fit)

    @property
    def residual(self) -> Array:
        """(N,) [m] distance of every measurement from the model."""
        return position_errors(self.fit)

    @property
    def residual_nominal(self) -> Array:
        """(N,) [m] the same errors of the nominal robot."""
        return position_errors(self.nominal)

    @property
    def residual_means(self) -> tuple[float, float]:
        """[m] means of `residual` and `residual_nominal` over the poses that count."""
        counting = self.cross_validation.counting
        return float(self.residual[counting].mean()), float(self.residual_nominal[counting].mean())

    @property
    def ignored(self) -> int:
        """How many poses lie so far from the model that they do not count."""
        return int((~self.cross_validation.counting).sum())

    @property
    def unexplained(self) -> float:
        """[m] along each axis, beyond the noise of instrument and joints."""
        return self.fit.excess.position

    @property
    def declared(self) -> float:
        """[m] noise of the instrument along each axis, median."""
        points = self.fit.linear.evaluations[self.fit.still]
        return float(np.median(np.concatenate([p.position_sigma.ravel() for p in points])))

    @property
    def at_one_place(self) -> bool:
        """Whether nothing but poses of one place, which tell of that place alone, was measured."""
        return self.alone and at_one_place(self.fit)

    @property
    def sentence(self) -> str:
        """How well the robot explains the poses."""
        mean, high = (f"{v * 1e3:.3f} mm" for v in (self.residual.mean(), self.residual.max()))
        lost = f", {self.ignored} of them too far off to count" * (self.ignored > 0)
        poses = f"{self.residual.size} {self.table.what} of {self.table.name}"
        return f"{poses}{lost}: mean error {mean}, largest {high}"

    @property
    def predicted(self) -> str:
        """How well the robot predicts poses that were not fitted, as a part of a sentence."""
        validation, partial = self.cross_validation, only_lengths(self.table)
        what = self.table.groups[0].kind.judged if partial else "position"
        _, before = self.residual_means
        errors = (
            f"poses {validation.left_out} that were not fitted are predicted to "
            f"{validation.mean * 1e3:.3f} mm in {what} (95 %: {validation.quantile * 1e3:.3f} mm); "
            f"with the nominal robot {before * 1e3:.3f} mm"
        )
        if not (partial and self.alone):
            return errors
        tool = float(self.sigma_at_poses.mean())
        return f"{errors}; stated TCP uncertainty at the measured poses {tool * 1e3:.3f} mm"

    @cached_property
    def scale_pull(self) -> tuple[float, float] | None:
        """Scale by which all measured values differ from the catalogue's lengths, and its sigma.

        None where chance explains it, or where nothing but sockets was measured.
        """
        return scale_of(self.fit)

    @property
    def information_gain(self) -> Array:
        """(P,) information gain of each unknown: 0 where the prior alone tells it, 1 where data."""
        sigma = self.fit.model.unknowns.sigma
        return 1.0 - np.clip(np.diag(self.fit.covariance) / sigma**2, 0.0, 1.0)

    @cached_property
    def tcp_sigma(self) -> Array:
        """(G,) [m] stated uncertainty of the first target extrapolated over the fitted ranges, all
        axes.
        """
        robot = self.identified_robot()
        return robot.sigma(robot.workspace())

    @cached_property
    def sigma_at_poses(self) -> Array:
        """(N,) [m] stated uncertainty of the first target at the measured poses, all axes."""
        return self.identified_robot().sigma(self.table.q)

    def deviations(self, table: PoseTable) -> Array:
        """(N, 3) [m] measured minus predicted positions of poses of the same seats.

        Robot base frame; along the rod where lengths were measured.
        """
        points = replace(self.fit.model, table=self._renamed(table)).at_rest(self.fit.x)
        return np.concatenate([point.closure.error[:3].T for point in points])

    def within(self, table: PoseTable) -> NDArray[np.bool_]:
        """(N,) whether poses of the same seats lie in their stated 95 % regions."""
        validation = self.cross_validation
        model = replace(self.fit.model, table=self._renamed(table))
        out = []
        for k, point in enumerate(model.at_rest(self.fit.x)):
            rows = position_rows(point)
            moves = whole_jacobian(model, self.fit.x, k, point, rows)
            spread = spread_of(moves, self.fit.covariance)
            square = mahalanobis(rows(point.closure.error), spread, validation.sigma**2)
            out.append(square <= validation.factor * chi_square_quantile(LEVEL, len(rows.matrix)))
        return np.concatenate(out)

    @property
    def target(self) -> str:
        """The table's first target, that of most poses where it moved."""
        others = {step.other for step in self.findings.steps}
        return next(name for name in self.table.targets if name not in others)

    def _renamed(self, table: PoseTable) -> PoseTable:
        """A table of the same files with the names that the fit gave behind steps."""
        return renamed(table, self.findings.steps)

    def identified_robot(self, target: str | None = None) -> IdentifiedRobot:
        """The robot of still poses alone with one of its targets; by default the table's first."""
        fit, layout, validation = self.fit, self.fit.model.unknowns, self.cross_validation
        name = target or self.target
        seat, index = self.stated_of(name)
        q = self.table.q
        return IdentifiedRobot(
            self.table.robot,
            layout.bare(fit.x),
            fit.model.corrections,
            fit.x[layout.coefficients],
            target=layout.target(fit.x, name),
            ranges=np.stack((q.min(axis=0), q.max(axis=0)), axis=1),
            stated=PoseCovariance(
                seat=layout.seat(fit.x, seat),
                seat_turns=index.size == layout.machine.size + 9,
                parameters=layout.shared,
                values=fit.covariance[np.ix_(index, index)],
                discrepancy=validation.of_points,
                white=validation.white,
                factor=validation.factor_of_points,
                joint_sigma=validation.joint_sigma,
            ),
        )

    @cached_property
    def cameras(self) -> dict[str, CameraEstimate]:
        """Cameras that saw the poses."""
        return cameras_of(self.fit)

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on what pictures contradict."""
        return tuple(doubts_of(self.fit))

    @property
    def blocks(self) -> int:
        """Number of regions whose poses share what the model leaves over."""
        return min(BLOCKS, self.table.size)

    def stated_of(self, target: str) -> tuple[str, NDArray[np.intp]]:
        """Seat from which a target is seen, and the unknowns that its position depends on.

        They are the machine's, then three of the target, and six of a seat that is a frame, else
        three.
        """
        layout = self.fit.model.unknowns
        others = {step.other for step in self.findings.steps}
        at = layout.targets[target].start
        seats = [g.seat for g in self.table.groups if g.target == target]
        # a whole frame, where there is one, and of most poses where it moved
        fixed = {g.seat for g in self.table.groups if g.seat_fixed} & layout.framed
        seat = max(seats, key=lambda s: (s in fixed, s not in others))
        first = layout.seats[seat].start
        own = np.r_[layout.machine, at : at + 3, first : first + (6 if seat in fixed else 3)]
        return seat, own


def group_errors(fit: Fit) -> tuple[Array, ...]:
    """(N,) [m] distance of each still pose of a fit from its model, by group."""
    points = fit.linear.evaluations[fit.still]
    return tuple(np.linalg.norm(point.closure.error[:3], axis=0) for point in points)


def position_errors(fit: Fit) -> Array:
    """(N,) [m] distance of every still pose of a fit from its model."""
    return np.concatenate(group_errors(fit))

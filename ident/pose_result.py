"""Result of an identification from still poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.poses import PoseTable
from cell.statistics import chi_square_quantile
from ident.cross_validation import LEVEL, CrossValidation, mahalanobis, position_rows, spread_of
from ident.estimator.fit import Fit
from ident.estimator.normal_equations import whole_jacobian
from ident.estimator.order_search import OrderSearch
from ident.findings import Findings, scale_of
from ident.pose_verdict import judge_poses
from ident.robot.identified import IdentifiedRobot
from ident.robot.pose_covariance import PoseCovariance
from ident.table_estimate import TableEstimate, table_estimate
from ident.table_steps import renamed
from ident.verdict import Verdict


@dataclass(frozen=True, eq=False)
class PoseIdentification:
    """A robot identified from a table of still poses."""

    table: PoseTable
    fit: Fit
    nominal: Fit  # seats and targets fitted to the robot as its file has it
    search: OrderSearch | None  # None where joint errors were not searched
    cross_validation: CrossValidation
    findings: Findings
    elsewhere: bool = False  # whether held-out poses of another place are predicted as stated

    @cached_property
    def verdict(self) -> Verdict:
        """Status, sentence and warnings."""
        return judge_poses(self)

    @cached_property
    def poses(self) -> TableEstimate:
        """Seats, targets and errors of the poses."""
        estimate = table_estimate(self.fit, self.fit.covariance)
        assert estimate is not None  # it is of still poses
        return estimate

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of every unknown, in its unit."""
        deviations = np.sqrt(np.diag(self.fit.covariance))
        return dict(zip(self.fit.model.unknowns.names, deviations.tolist(), strict=True))

    @property
    def information_gain(self) -> dict[str, float]:
        """Information gain of each unknown: 0 where the prior alone tells it, 1 where data do."""
        layout = self.fit.model.unknowns
        gain = 1.0 - np.clip(np.diag(self.fit.covariance) / layout.sigma**2, 0.0, 1.0)
        return dict(zip(layout.names, gain.tolist(), strict=True))

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

    @cached_property
    def scale_pull(self) -> tuple[float, float] | None:
        """Scale by which all measured values differ from the catalogue's lengths, and its sigma.

        None where chance explains it, or where nothing but sockets was measured.
        """
        return scale_of(self.fit)

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

    def errors(self, table: PoseTable) -> Array:
        """(N, 3) [m] measured minus predicted positions of poses of this result's own seats.

        Robot base frame; along the rod where lengths were measured.
        """
        points = replace(self.fit.model, table=self._renamed(table)).at_rest(self.fit.x)
        return np.concatenate([point.closure.error[:3].T for point in points])

    def within(self, table: PoseTable) -> NDArray[np.bool_]:
        """(N,) whether poses of this result's own seats lie in their stated 95 % regions."""
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
        """The identified robot with one of its targets; by default the table's first."""
        fit, layout = self.fit, self.fit.model.unknowns
        name = target or self.target
        others = {step.other for step in self.findings.steps}
        at = layout.targets[name].start
        seats = [g.seat for g in self.table.groups if g.target == name]
        # a whole frame, where there is one, and of most poses where it moved
        fixed = {g.seat for g in self.table.groups if g.kind.seat_fixed} & layout.framed
        seat = max(seats, key=lambda s: (s in fixed, s not in others))
        first = layout.seats[seat].start
        index = np.r_[layout.machine, at : at + 3, first : first + (6 if seat in fixed else 3)]
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
                seat_turns=seat in fixed,
                parameters=layout.shared,
                values=fit.covariance[np.ix_(index, index)],
                discrepancy=self.cross_validation.of_points,
                factor=self.cross_validation.factor_of_points,
                joint_sigma=self.cross_validation.joint_sigma,
            ),
        )


def position_errors(fit: Fit) -> Array:
    """(N,) [m] distance of every measurement of a fit from its model."""
    return np.concatenate(
        [np.linalg.norm(point.closure.error[:3], axis=0) for point in fit.linear.evaluations]
    )

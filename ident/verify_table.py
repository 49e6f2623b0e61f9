"""A stored calibration against a few still poses of today.

Fitted are the seats, and targets that the identification did not see; the robot and its known
targets are held. Of N poses with E measured coordinates the sum of squared errors over the variance
of a pose that was not fitted (`IdentifiedRobot.discrepancy`) has as many degrees of freedom as
coordinates are left after the fit. Its distribution is a Gamma distribution of that mean. Its shape
is that of chi-square where the stated 95 % region of one pose is; where the region is wider, the
tails are heavier, and the shape is the one that has this quantile (for a single pose, exactly).
The variance is itself an estimate, which the limit allows for as Fisher's F does.

What changed is sought among single causes (ballbar.ident.verification): the zero of an axis, with
the joints that a parallel rod couples to it, a target, the scale, one pose, or another DH
parameter. The likeliest is named if the rest would pass as unchanged, or nearly so; beside it those
that explain as much: the zero of the last axis is a turn of the only target about it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.special import fdtri, gammaincinv

from ballbar.cell.arrays import Array
from ballbar.cell.chain import joint_screws
from ballbar.cell.errors import InputError
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.cell.statistics import chi_square_quantile
from ballbar.ident.cross_validation import LEVEL
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.model import Evaluation, still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import known_distance
from ballbar.ident.estimator.robust_fit import fit_unweighted
from ballbar.ident.held_machine import held_layout
from ballbar.ident.robot.identified import IdentifiedRobot, range_sentence
from ballbar.ident.single_causes import SCALE, SHIFT, TURN, ZERO, Cause, Explanation
from ballbar.ident.start.placements import start_of_poses
from ballbar.ident.verification import FALSE_ALARMS, RIVAL, Score, Verification, followed

LEAST_FREEDOM = 6  # degrees of freedom below which nothing could be stated
LEAST_SHAPE = 0.5  # of the Gamma distribution of one pose: heavier tails have no more quantile
# degrees of freedom of the variance itself, which comes from eight regions of one table: several
# hundred poses do not make a change of a few per cent significant
CERTAINTY = 150
UNSEEN = 1e-3  # [m] of the target over the workspace: a larger change has to show
NEARLY = 1.5  # of the limit, below which what a cause leaves is as of an unchanged robot
WORST = 12  # poses, those with the largest errors, each of which may be a bad one
FREE = 1e-5  # [m, rad, s] least sigma of the priors of what is not held
ENOUGH = 500  # poses of a robot that was followed, evenly taken


def verify(
    arm: IdentifiedRobot, targets: Mapping[str, Placement], mean: float, table: PoseTable
) -> Verification:
    """Whether an identified robot still explains a few poses.

    targets : those of the identification, by name; others of the table are fitted. mean : [m] error
    of poses that cross-validation predicts.

    Raises InputError where too few poses lie within the fitted ranges.
    """
    inside = arm.covered(table.q)
    beyond = arm.out_of_range(table.q)
    if not inside.any():
        raise InputError(f"{table.name}: all poses are {range_sentence(beyond)}")
    part = _evenly(table.part(inside))
    declared = max(float(group.sigma[:, :3].max()) for group in part.groups)
    start = _Held(arm, dict(targets), max(arm.discrepancy, declared), _points(part))
    if start.freedom < LEAST_FREEDOM:
        raise InputError(
            f"{table.name}: {part.size} poses within the fitted ranges give {start.coordinates} "
            f"coordinates for {start.unknowns} of the seats and new targets: at least "
            f"{start.unknowns + LEAST_FREEDOM} are needed. Measure about ten poses."
        )
    linear = start.fit.linear
    limit, ranked, single = limit_of(start.freedom, arm.factor), list[Explanation](), True
    if linear.cost > limit:
        ranked = start.score.ranked(start.causes())
        left, best, single = followed(start, ranked[0])
        single = single and best.evidence > RIVAL
        ranked[0] = replace(best, gain=linear.cost - left.fit.linear.cost)
    error, blind = np.linalg.norm(start.errors(), axis=0), start.blind()
    expected = mean * max(1.0, start.sigma / arm.discrepancy)
    expected *= float(np.sqrt(start.freedom / linear.equations))
    largest = expected * float(np.sqrt(limit / start.freedom))
    outside = int((~inside).sum())
    not_counting = f"{outside} poses do not count: they are {range_sentence(beyond)}"
    return Verification(
        name=table.name,
        error=error,
        numbers=f"{error.size} poses to {error.mean() * 1e3:.3f} mm; expected of an unchanged "
        f"robot {expected * 1e3:.3f} mm, at most {largest * 1e3:.3f} mm in 98 of 100 checks",
        figures={
            "poses": error.size,
            "poses_outside_fitted_ranges": outside,
            "mean_error_m": float(error.mean()),
            "expected_mean_error_m": expected,
            "largest_mean_error_m": largest,
            "degrees_of_freedom": start.freedom,
        },
        unchanged=linear.cost <= limit,
        explanations=tuple(ranked),
        single=single,
        tried="zero of an axis, target, scale of the measured values, one bad pose",
        square=linear.cost,
        limit=limit,
        blind=blind,
        notes=(not_counting,) if outside else (),
        holding="Holds as far as these poses tell, which is not far" if blind else "Holds",
    )


def limit_of(freedom: int, factor: float) -> float:
    """Sum of squares that an unchanged robot exceeds in FALSE_ALARMS of the checks.

    factor : squared size of the stated 95 % region of one pose, over that of chi-square.
    """
    wanted = max(1.0, factor) * chi_square_quantile(LEVEL, 3) / 3.0

    def excess(shape: float) -> float:
        return float(gammaincinv(shape, LEVEL) / shape - wanted)  # quantile of a gamma distribution

    shape = LEAST_SHAPE if excess(LEAST_SHAPE) < 0.0 else float(brentq(excess, LEAST_SHAPE, 1.5))
    own = shape / 3.0  # per coordinate; 1/2 for chi-square
    limit = float(gammaincinv(own * freedom, 1.0 - FALSE_ALARMS) / own)
    known = chi_square_quantile(1.0 - FALSE_ALARMS, freedom)
    widened = float(fdtri(freedom, CERTAINTY, 1.0 - FALSE_ALARMS))  # quantile of an F distribution
    return limit * freedom * widened / known


@dataclass(frozen=True, eq=False)
class _Held:
    """A table and a robot that is held: robot, known targets and variance as they were stored."""

    arm: IdentifiedRobot
    known: dict[str, Placement]
    sigma: float  # [m] of a pose, along each axis
    table: PoseTable  # without noise of its own, which the variance holds

    @cached_property
    def fit(self) -> Fit:
        """Seats and unknown targets, every pose counting in full."""
        layout = held_layout(self.arm, start_of_poses(self.table, self.arm.chain), self.known)
        noise = np.zeros(self.arm.robot.joints)
        model = still_model(self.table, layout, self.arm.corrections, noise)
        excess = ExcessNoise(position=self.sigma, rotation=1.0)
        return fit_unweighted(model, layout.mean.copy(), excess)

    @property
    def coordinates(self) -> int:
        """How many were measured, known distances included."""
        each = (group.kind.directions * group.size for group in self.table.groups)
        return sum(each) + len(self.table.distances)

    @property
    def unknowns(self) -> int:
        """How many belong to the seats and to new targets."""
        framed = {group.seat for group in self.table.groups if group.kind.seat_turns}
        new = set(self.table.targets) - self.known.keys()
        clocks = {group.motion.name for group in self.table.groups if group.motion is not None}
        return 3 * (len(self.table.seats) + len(framed) + len(new)) + 2 * len(clocks)

    @property
    def freedom(self) -> int:
        return self.coordinates - self.unknowns

    def errors(self) -> Array:
        """(3, N) [m] of the poses."""
        points = self.fit.linear.evaluations
        return np.concatenate([point.closure.error[:3] for point in points], axis=1)

    @cached_property
    def jacobian(self) -> Array:
        """(P, R) derivative of all whitened errors, those of known distances last."""
        fit = self.fit
        flat = [own.reshape(len(own), -1) for own in fit.jacobians]
        distances = [known_distance(fit.model, fit.x, d)[0][:, None] for d in self.table.distances]
        return np.concatenate([*flat, *distances], axis=1)

    @cached_property
    def score(self) -> Score:
        """The errors, freed of seats and unknown targets."""
        fit = self.fit
        free = fit.model.unknowns.sigma > FREE
        own, covariance = self.jacobian[free], np.linalg.inv(fit.linear.normal[np.ix_(free, free)])
        distances = [known_distance(fit.model, fit.x, d)[1] for d in self.table.distances]
        errors = np.concatenate([*(r.reshape(-1) for r in fit.linear.residuals), distances])
        return Score(-errors, lambda columns: columns - own.T @ (covariance @ (own @ columns)))

    def causes(self) -> list[Cause]:
        """The single causes that these poses may show."""
        layout, jacobian = self.fit.model.unknowns, self.jacobian.T
        causes = [self.axis(k) for k in range(1, self.arm.robot.joints + 1)]
        for name in layout.targets.keys() & self.known.keys():
            place = jacobian[:, layout.targets[name]][:, :3]
            causes.append(Cause("target", name, place, np.full(3, SHIFT)))
        if any(group.values.shape[1] for group in self.table.groups):
            causes.append(Cause("scale", "", self._columns(_scaled), np.array([SCALE])))
        for k, parameter in enumerate(layout.parameters):
            if parameter.kind != "theta":
                prior = np.array([SHIFT if parameter.is_length else TURN])
                causes.append(Cause("geometry", parameter.name, jacobian[:, [k]], prior))
        return causes + self._poses()

    def axis(self, number: int) -> Cause:
        """The zero of an axis, from 1."""
        shares = self.arm.robot.controller_to_joint[number - 1]

        def turned(point: Evaluation) -> Array:
            return np.asarray(np.einsum("j,jcn->cn", shares, point.target_closure.joint_columns))

        return Cause("axis", str(number), self._columns(turned), np.array([ZERO]))

    def _columns(self, moved: Callable[[Evaluation], Array]) -> Array:
        """(R, 1) whitened, of the change (6, N) of each group's errors."""
        linear, out = self.fit.linear, np.zeros((self.jacobian.shape[1], 1))
        pairs = zip(linear.evaluations, linear.weights, strict=True)
        flat = np.concatenate([weights(moved(p)[None]).reshape(-1) for p, weights in pairs])
        out[: flat.size, 0] = flat
        return out

    def _poses(self) -> list[Cause]:
        """The poses with the largest errors, each by itself."""
        causes, first = [], 0
        worst = np.sort(np.linalg.norm(self.errors(), axis=0))[-WORST:][0]
        for group, residual, point in zip(
            self.table.groups, self.fit.linear.residuals, self.fit.linear.evaluations, strict=True
        ):
            rows, n = residual.shape
            for i in np.flatnonzero(np.linalg.norm(point.closure.error[:3], axis=0) >= worst):
                columns = np.zeros((self.jacobian.shape[1], rows))
                columns[first + i + n * np.arange(rows), np.arange(rows)] = 1.0 / self.sigma
                name = f"{group.file}:{group.rows[i]}"
                causes.append(Cause("pose", name, columns, np.full(rows, SHIFT)))
            first += residual.size
        return causes

    def after(self, change: Explanation) -> _Held:
        """The same after a change of the robot, of a target, or of what was logged or measured."""
        cause, size = change.cause, float(change.size[0])
        if cause.kind == "target":
            known = self.known[cause.name]
            moved = Placement(known.rotation, known.origin + change.size)
            return replace(self, known={**self.known, cause.name: moved})
        if cause.kind == "geometry":
            geometry = self.arm.geometry
            bent = geometry.replaced({cause.name: geometry[cause.name] + size})
            return replace(self, arm=replace(self.arm, geometry=bent))
        groups = []
        for group in self.table.groups:
            if cause.kind == "scale":
                groups.append(replace(group, values=group.values * (1.0 + size)))
            elif cause.kind == "axis":
                shares = self.arm.robot.controller_to_joint[cause.axis - 1]
                groups.append(replace(group, q=group.q + size * shares))
            else:
                bad = np.array([f"{group.file}:{row}" == cause.name for row in group.rows])
                groups.append(replace(group, sigma=group.sigma + bad[:, None]))  # hardly counts
        return replace(self, table=replace(self.table, groups=tuple(groups)))

    def explained(self, cause: Cause) -> bool:
        """Whether the rest is about as of an unchanged robot."""
        left = self.freedom - cause.prior.size
        return left > 0 and self.fit.linear.cost <= NEARLY * limit_of(left, self.arm.factor)

    def blind(self) -> dict[int, float]:
        """Axes, from 1, and the size [rad] up to which these poses hide a change of their zero.

        Those of them that would move the target by more than UNSEEN. The first and the last axis
        are left out: seats and targets take up their zeros.
        """
        arm, out = self.arm, {}
        moved = joint_screws(arm.frames(arm.workspace()))[: arm.robot.joints, :3]
        by_axis = np.einsum("aj,jcn->acn", arm.robot.controller_to_joint, moved)
        levers = np.sqrt((by_axis**2).sum(axis=1).mean(axis=1))
        for axis in range(2, arm.robot.joints):
            size = self.score.unseen(self.axis(axis))
            if size * levers[axis - 1] > UNSEEN:
                out[axis] = size
        return out


def _evenly(table: PoseTable) -> PoseTable:
    """The table with so many poses of each followed group that their errors are their own."""
    groups = (
        g if g.motion is None else g.part(np.arange(0, g.size, -(-g.size // ENOUGH)))
        for g in table.groups
    )
    return replace(table, groups=tuple(groups))


def _scaled(point: Evaluation) -> Array:
    """(6, N) change of the errors of a group for a scale of its measured values."""
    moved = np.zeros((6, point.still.size))
    if point.still.kind.scales:
        closure = point.target_closure
        moved[:3] = closure.sight.point - closure.seat.origin[:, None]
    return moved


def _points(table: PoseTable) -> PoseTable:
    """The table with poses as points, as nothing is stated of rotations that were not fitted; and
    without noise of its own: the variance of a pose holds the instrument's.
    """
    groups = []
    for group in table.groups:
        point = group
        if group.measured == "pose":
            point = replace(
                group,
                measured="point",
                values=group.values[:, :3],
                sigma=group.sigma[:, :3],
                factor=None if group.factor is None else group.factor[:, :3, :3],
            )
        groups.append(replace(point, sigma=np.zeros_like(point.sigma)))
    return replace(table, groups=tuple(groups))

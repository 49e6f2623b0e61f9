"""Does a stored calibration still hold? A few still poses against an identified robot.

Fitted are the seats, and targets that the identification did not see; the robot and its known
targets are held. Of N poses with E measured coordinates the sum of squared errors over the variance
of a pose that was not fitted (`IdentifiedRobot.discrepancy`) has as many degrees of freedom as
coordinates are left after the fit. Its distribution is a Gamma distribution of that mean. Its shape
is that of chi-square where the stated 95 % region of one pose is; where the region is wider, the
tails are heavier, and the shape is the one that has this quantile (for a single pose, exactly).
The variance is itself an estimate, which the limit allows for as Fisher's F does.

What changed is sought among single causes: the zero of an axis, with the joints that a parallel rod
couples to it, a target, the scale, one pose, or another DH parameter. The one that explains the
errors is named if the rest would pass as unchanged, or nearly so; beside it those that do as well:
the zero of the last axis is a turn of the only target about it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import fdtri, gammaincinv

from cell.arrays import Array
from cell.chain import joint_screws
from cell.errors import InputError
from cell.geometry import parameter_named
from cell.placement import Placement
from cell.poses import PoseGroup, PoseTable
from cell.statistics import chi_square_quantile
from ident.cross_validation import LEVEL
from ident.estimator.fit import Fit
from ident.estimator.model import still_model
from ident.estimator.noise import ExcessNoise
from ident.estimator.robust_fit import fit_unweighted
from ident.estimator.unknowns import Unknowns
from ident.held_out_poses import held_layout
from ident.robot.identified import IdentifiedRobot, range_sentence
from ident.start.placements import start_of_poses

FALSE_ALARMS = 0.02  # share of checks of an unchanged robot that call it changed
LEAST_FREEDOM = 6  # degrees of freedom below which nothing could be stated
LEAST_SHAPE = 0.5  # of the Gamma distribution of one pose: heavier tails have no more quantile
# degrees of freedom of the variance itself, which comes from eight regions of one table: several
# hundred poses do not make a change of a few per cent significant
CERTAINTY = 150
SEEN = 4.0  # deviations by which a change must stand out
UNSEEN = 1e-3  # [m] of the target over the workspace: a larger change has to show
ROUNDS = 4  # of applying a cause and fitting again: a change of 0.1 rad is not linear
NEARLY = 1.5  # of the limit, below which what a cause leaves is as of an unchanged robot
RIVAL = 6.0  # sum of squares by which a cause must be better than the next one, about 2.4 sigma
# to the sum of squares, per unknown of a cause: the criterion of Akaike 1974 asks 2; a target has
# three unknowns, and among ten causes the best of many is taken
PRICE = 4.0
MANY = 3  # causes that are named together at most


@dataclass(frozen=True, eq=False)
class TableChange:
    """One change since the identification that may explain the errors."""

    kind: str  # axis, target, scale, pose or geometry
    name: str  # axis from 1, target, file and row of the pose, or parameter
    size: Array  # (K,) [rad], [m] or [1]
    sigma: Array  # (K,)
    square: float  # sum of squares that it leaves

    @property
    def sentence(self) -> str:
        """The cause and its size."""
        size, sigma = float(np.linalg.norm(self.size)), float(np.linalg.norm(self.sigma))
        if self.kind == "axis":
            value = float(self.size[0]) * 1e3
            return f"zero of axis {self.name} by {value:+.2f} mrad (sigma {sigma * 1e3:.2f} mrad)"
        if self.kind == "geometry":
            unit = "mm" if parameter_named(self.name).is_length else "mrad"
            value = float(self.size[0]) * 1e3
            return f"parameter {self.name} by {value:+.3f} {unit} (sigma {sigma * 1e3:.3f} {unit})"
        if self.kind == "target":
            return f"target {self.name} moved by {size * 1e3:.3f} mm (sigma {sigma * 1e3:.3f} mm)"
        if self.kind == "scale":
            value = float(self.size[0]) * 1e6
            return f"scale of the measured values by {value:+.0f} ppm (sigma {sigma * 1e6:.0f} ppm)"
        return f"pose {self.name} by {size * 1e3:.3f} mm"


@dataclass(frozen=True, eq=False)
class Verification:
    """A stored calibration against a few poses of today."""

    name: str
    error: Array  # (N,) [m] of the poses within the fitted ranges
    square: float  # sum of squared errors, over the variance of a pose that was not fitted
    freedom: int  # degrees of freedom
    limit: float  # of `square`, exceeded in FALSE_ALARMS of checks of an unchanged robot
    predicted: float  # [m] mean error of an unchanged robot
    causes: tuple[TableChange, ...]  # best first; empty where the calibration holds
    named: tuple[TableChange, ...]  # that explain the change clearly; several where they do equally
    blind: Mapping[int, float]  # axes, from 1, whose zero may have changed by so much [rad] unseen
    outside: int  # poses that do not count
    out_of_range: Mapping[int, tuple[float, float]]  # axes of those, and their ranges [rad]
    doubt: str = ""  # what is wrong with the stored calibration itself; empty where nothing is

    @property
    def comparable(self) -> bool:
        """Whether the stored calibration is one that poses can be held against."""
        return not self.doubt

    @property
    def holds(self) -> bool:
        return self.square <= self.limit and self.comparable

    @property
    def cause(self) -> TableChange | None:
        """The only cause that explains the change clearly."""
        return self.named[0] if len(self.named) == 1 else None

    @property
    def largest_mean(self) -> float:
        """[m] about the mean error at the limit."""
        return self.predicted * float(np.sqrt(self.limit / self.freedom))

    @property
    def sentence(self) -> str:
        """Whether it holds, and what changed."""
        numbers = (
            f"{self.error.size} poses to {self.error.mean() * 1e3:.3f} mm; expected of an "
            f"unchanged robot {self.predicted * 1e3:.3f} mm, at most "
            f"{self.largest_mean * 1e3:.3f} mm in 98 of 100 checks"
        )
        if self.doubt:
            return f"Not comparable: {self.doubt}; {numbers}."
        if self.holds and self.blind:
            return f"Holds as far as these poses tell, which is not far: {numbers}."
        if self.holds:
            return f"Holds: {numbers}."
        if self.cause is not None and self.cause.kind == "pose":
            return (
                f"One pose stands out, {self.cause.sentence}; the others agree with the "
                f"calibration. Measure it again. {numbers}."
            )
        if self.named:
            each = ", or ".join(cause.sentence for cause in self.named)
            tail = "; these poses do not tell which" if len(self.named) > 1 else ""
            return f"Changed since: {each}{tail}; {numbers}."
        return (
            f"Changed: {numbers}. No single cause (zero of an axis, target, scale of the measured "
            "values, one bad pose, another parameter) explains it clearly: identify it again."
        )

    @property
    def warnings(self) -> list[str]:
        """Poses that do not count, and changes that these poses cannot show."""
        out = []
        if self.outside:
            outside = range_sentence(dict(self.out_of_range))
            out.append(f"{self.outside} poses do not count: they are {outside}")
        if self.blind:
            each = ", ".join(f"{axis} ({size * 1e3:.1f} mrad)" for axis, size in self.blind.items())
            out.append(
                f"changes of the zeros of these axes, up to the size named, would not show: "
                f"{each}; spread the poses over the workspace"
            )
        return out


@dataclass(frozen=True, eq=False)
class _Check:
    """The stored result that is checked: robot, targets and variance are held."""

    arm: IdentifiedRobot
    known: dict[str, Placement]
    sigma: float  # [m] of a pose, along each axis

    def fit(self, table: PoseTable) -> Fit:
        """Seats and unknown targets of a table, every pose counting in full."""
        start = start_of_poses(table, self.arm.chain)
        layout = held_layout(self.arm, start, self.known)
        exact = _without_noise(table)
        model = still_model(exact, layout, self.arm.corrections, np.zeros(self.arm.robot.joints))
        excess = ExcessNoise(position=self.sigma, rotation=1.0)
        return fit_unweighted(model, layout.mean.copy(), excess)


def verify(
    arm: IdentifiedRobot, targets: Mapping[str, Placement], mean: float, table: PoseTable
) -> Verification:
    """Whether an identified robot still explains a few poses.

    targets : those of the identification, by name; others of the table are fitted. mean : [m] error
    of poses that cross-validation predicts.

    Raises InputError where too few poses lie within the fitted ranges.
    """
    inside = arm.covered(table.q)
    names = [f"{g.file}:{row}" for g in table.groups for row in g.rows]
    if not inside.any():
        raise InputError(f"{table.name}: all poses are {range_sentence(arm.out_of_range(table.q))}")
    part = _positions(table.part(inside))
    declared = max((float(g.sigma[:, :3].max()) for g in part.groups), default=0.0)
    check = _Check(arm, dict(targets), max(arm.discrepancy, declared))
    _check_enough(part, check)
    fit = check.fit(part)
    equations = fit.linear
    freedom = _freedom(part, fit.model.unknowns, check)
    limit = limit_of(freedom, arm.factor)
    square = equations.cost
    causes: tuple[TableChange, ...] = ()
    named: tuple[TableChange, ...] = ()
    if square > limit:
        counting = [name for name, counts in zip(names, inside, strict=True) if counts]
        causes = _causes(check, part, fit, counting)
        named = _clear(causes, square, freedom, arm.factor)
    blind = _blind(check, fit)
    error = np.concatenate(
        [np.linalg.norm(p.closure.error[:3], axis=0) for p in equations.evaluations]
    )
    coordinates = equations.equations
    return Verification(
        name=table.name,
        error=error,
        square=square,
        freedom=freedom,
        limit=limit,
        predicted=mean * max(1.0, check.sigma / arm.discrepancy) * np.sqrt(freedom / coordinates),
        causes=causes,
        named=named,
        blind=blind,
        outside=int((~inside).sum()),
        out_of_range=arm.out_of_range(table.q),
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


def _blind(check: _Check, fit: Fit) -> dict[int, float]:
    """Axes, from 1, and the size [rad] up to which these poses hide a change of their zero.

    Those of them that would move the target by more than UNSEEN. The first and the last axis are
    left out: seats and targets take up their zeros.
    """
    arm, out = check.arm, {}
    moved = joint_screws(arm.frames(arm.workspace()))[: arm.robot.joints, :3]
    by_axis = np.einsum("aj,jcn->acn", arm.robot.controller_to_joint, moved)
    levers = np.sqrt((by_axis**2).sum(axis=1).mean(axis=1))
    for axis in range(2, arm.robot.joints):
        cause = _linear(fit, _columns(fit, "axis", str(axis)), "axis", str(axis))
        size = np.inf if cause is None else SEEN * float(cause.sigma[0])
        if size * levers[axis - 1] > UNSEEN:
            out[axis] = size
    return out


def _causes(check: _Check, table: PoseTable, fit: Fit, names: list[str]) -> tuple[TableChange, ...]:
    """Single causes, best first, by linearised equations; then the best of each kind exactly."""
    axes = [("axis", str(j + 1)) for j in range(check.arm.robot.joints)]
    known = [("target", name) for name in table.targets if name in check.known]
    measured = any(group.values.shape[1] for group in table.groups)
    scale = [("scale", "")] if measured else []
    others = [("geometry", p.name) for p in fit.model.unknowns.parameters if p.kind != "theta"]
    causes = []
    for kind, name in (*axes, *known, *scale, *others):
        first = _linear(fit, _columns(fit, kind, name), kind, name)
        if first is not None:
            causes.append(_refined(check, table, first))
    causes += _single_poses(fit, names)
    return tuple(sorted(causes, key=_priced))


def _priced(cause: TableChange) -> float:
    """Sum of squares that a cause leaves, with the price of its unknowns."""
    return cause.square + PRICE * cause.size.size


def _refined(check: _Check, table: PoseTable, first: TableChange) -> TableChange:
    """A cause with its size from repeated fits of the table with the cause taken away."""
    cause, size = first, np.zeros(first.size.size)
    best = first.square
    for _ in range(ROUNDS):
        size = size + cause.size
        changed, again = _applied(check, table, replace(first, size=size))
        fit = again.fit(changed)
        best = fit.linear.cost
        step = _linear(fit, _columns(fit, first.kind, first.name), first.kind, first.name)
        if step is None or best - step.square < 0.01:
            break
        cause = step
    return replace(first, size=size, square=best)


def _applied(check: _Check, table: PoseTable, cause: TableChange) -> tuple[PoseTable, _Check]:
    """Table and held robot with a cause in them."""
    if cause.kind == "target":
        known = check.known[cause.name]
        moved = Placement(known.rotation, known.origin + cause.size)
        return table, replace(check, known={**check.known, cause.name: moved})
    if cause.kind == "geometry":
        geometry = check.arm.geometry
        changed = geometry.replaced({cause.name: geometry[cause.name] + float(cause.size[0])})
        bent = replace(check.arm, geometry=changed)
        return table, replace(check, arm=bent)
    groups = []
    for group in table.groups:
        if cause.kind == "scale":
            groups.append(replace(group, values=group.values * (1.0 + float(cause.size[0]))))
        else:
            shares = check.arm.robot.controller_to_joint[int(cause.name) - 1]
            groups.append(replace(group, q=group.q + float(cause.size[0]) * shares))
    return replace(table, groups=tuple(groups)), check


def _columns(fit: Fit, kind: str, name: str) -> list[Array]:
    """(K, E, N) of every group: change of the whitened residual per unit of a cause."""
    out, layout = [], fit.model.unknowns
    triples = zip(fit.linear.evaluations, fit.linear.weights, fit.jacobians, strict=True)
    for point, weights, jacobian in triples:
        group, n = point.still, point.still.size
        if kind == "axis":
            shares = fit.model.poses.robot.controller_to_joint[int(name) - 1]
            out.append(
                weights(np.einsum("j,jcn->cn", shares, point.target_closure.joint_columns)[None])
            )
        elif kind == "geometry":
            at = layout.names.index(name)
            out.append(jacobian[at : at + 1])
        elif kind == "target":
            own = jacobian[layout.targets[name]][:3]
            out.append(own if group.target == name else np.zeros((3, *own.shape[1:])))
        else:
            moved = np.zeros((1, 6, n))
            moved[0, :3] = (
                point.target_closure.sight.point - point.target_closure.seat.origin[:, None]
            )
            if not group.kind.scales:
                moved[:] = 0.0
            out.append(weights(moved))
    return out


def _linear(fit: Fit, columns: list[Array], kind: str, name: str) -> TableChange | None:
    """A cause by one step of least squares; None where the poses cannot tell it from the seats."""
    equations = fit.linear
    free = np.flatnonzero(fit.model.unknowns.sigma > 0.5)
    normal = equations.normal[np.ix_(free, free)]
    count = len(columns[0])
    cross, own = np.zeros((count, free.size)), np.zeros((count, count))
    right = np.zeros(count)
    for column, jacobian, residual in zip(columns, fit.jacobians, equations.residuals, strict=True):
        flat = column.reshape(count, -1)
        cross += flat @ jacobian[free].reshape(free.size, -1).T
        own += flat @ flat.T
        right += flat @ residual.reshape(-1)
    solved = np.linalg.solve(normal, np.column_stack((cross.T, equations.gradient[free])))
    rest = own - cross @ solved[:, :-1]
    right = right - cross @ solved[:, -1]
    if np.linalg.eigvalsh(rest)[0] <= 1e-6 * max(np.linalg.eigvalsh(own)[-1], 1e-300):
        return None
    covariance = np.linalg.inv(rest)
    size = -covariance @ right
    square = equations.cost - float(right @ covariance @ right)
    return TableChange(kind, name, size, np.sqrt(np.diag(covariance)), square)


def _single_poses(fit: Fit, names: list[str]) -> list[TableChange]:
    """Each pose by itself: what the others leave when it does not count."""
    causes, first, equations = [], 0, fit.linear
    for k, point in enumerate(equations.evaluations):
        rows = len(equations.weights[k].matrix)
        for i in range(point.still.size):
            columns = [np.zeros((rows, *residual.shape)) for residual in equations.residuals]
            columns[k][np.arange(rows), np.arange(rows), i] = 1.0
            cause = _linear(fit, columns, "pose", names[first + i])
            if cause is not None:
                length = float(np.linalg.norm(point.closure.error[:3, i]))
                causes.append(replace(cause, size=np.full(rows, length / np.sqrt(rows))))
        first += point.still.size
    return causes


def _clear(
    causes: tuple[TableChange, ...], square: float, freedom: int, factor: float
) -> tuple[TableChange, ...]:
    """The first cause, if it explains the change; beside it those that do nearly as well.

    A cause of more unknowns that leaves no more is among them, whatever its price: the first may
    be a part of it. Of more than MANY none is named.
    """
    best = causes[0]
    left = freedom - best.size.size
    if left < 1 or best.square > NEARLY * limit_of(left, factor):
        return ()
    if square - _priced(best) < RIVAL:
        return ()
    rivals = tuple(
        c for c in causes if c.square <= best.square or _priced(c) - _priced(best) < RIVAL
    )
    return rivals if len(rivals) <= MANY else ()


def _positions(table: PoseTable) -> PoseTable:
    """The table with poses as points: nothing is stated of rotations that were not fitted."""
    groups: list[PoseGroup] = []
    for group in table.groups:
        if group.measured == "pose":
            point = replace(
                group, measured="point", values=group.values[:, :3], sigma=group.sigma[:, :3]
            )
            groups.append(point)
        else:
            groups.append(group)
    return replace(table, groups=tuple(groups))


def _without_noise(table: PoseTable) -> PoseTable:
    """The table without noise of its own: the variance of a pose holds the instrument's."""
    groups = tuple(replace(g, sigma=np.zeros_like(g.sigma)) for g in table.groups)
    return replace(table, groups=groups)


def _freedom(table: PoseTable, layout: Unknowns, check: _Check) -> int:
    places = [part for name, part in layout.targets.items() if name not in check.known]
    places += list(layout.seats.values())
    unknowns = sum(int(part.stop - part.start) for part in places)
    return _coordinates(table) + len(table.distances) - unknowns


def _coordinates(table: PoseTable) -> int:
    return sum(g.kind.directions * g.size for g in table.groups)


def _check_enough(table: PoseTable, check: _Check) -> None:
    framed = {g.seat for g in table.groups if g.kind.seat_turns}
    unknowns = sum(6 if seat in framed else 3 for seat in table.seats)
    unknowns += 3 * sum(target not in check.known for target in table.targets)
    least = unknowns + LEAST_FREEDOM
    if _coordinates(table) + len(table.distances) < least:
        raise InputError(
            f"{table.name}: {table.size} poses within the fitted ranges give "
            f"{_coordinates(table)} coordinates for {unknowns} of the seats and new targets: at "
            f"least {least} are needed. Measure about ten poses."
        )

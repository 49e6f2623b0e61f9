"""A seat or a target that moved once within a table: an instrument knocked, a ball seated anew.

A step is three more unknowns, a shift of what was measured from some pose on. Where it may be
follows from the score of such a shift at every pose in the order of measurement, Schur complement
included, from running sums (sup-score test, Andrews 1993), beside a linear drift of three unknowns.
Poses far off count as Huber 1964 weighs them, but none is left out: a few rows behind a step would
be.

What a model leaves over is similar in neighbouring poses, so a large score is no evidence yet. The
poses on either side are cut into blocks. A step has to predict blocks that were left out better
than no step does, on both sides of it, and a gradual change, which is how a robot or a tracker that
warms up looks, must not explain them as well.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cell.arrays import Array
from cell.errors import InputError
from cell.placement import Placement
from cell.poses import PoseGroup, PoseTable
from ident.estimator.fit import Fit
from ident.estimator.normal_equations import NormalEquations
from ident.estimator.regions import distinct_poses
from ident.estimator.robust_fit import (
    HUBER,
    TAILS,
    determined,
    equations_at,
    median_scale,
    stacked,
    whitened_lengths,
)
from ident.estimator.unknowns import PlacedPoses

# Score that a place has to exceed to be looked at. Chance reaches 30 in none of several hundred
# clean tables, and the best place of a table without a step is of no use to the blocks anyway.
LIMIT = 30.0
LEAST = 20  # poses on either side of a step, near each other in joint space
BLOCKS = 10  # of poses on either side, left out in turn; with 5 a left-out block lies too far away
# Sum of squares that a step has to take from blocks left out, the best of them not counted since a
# stretch of bad rows is no step; in variances of what the model leaves over, times the number of
# neighbouring poses that count as one. 2 ln(1000 places) + 11 (docs/studies/table_steps.csv).
PRICE = 25.0
ALIKE = 4.0  # neighbours that count as one at most: what is beyond is the step itself, unfitted
PRIOR = 1e-3  # [m] least standard deviation of a step: a knocked instrument, a ball seated anew
RAMPS = (64, 128, 256, 512)  # poses over which a gradual change takes place
LARGEST = 5e-3  # [m] beyond which it is another seat or target by mistake, and no knock
WARMING = 1.25e-4  # [m] that bases and trackers drift within hours, and robots that warm up
LEAST_SIZE, CERTAIN_SIZE = 1.5, 4.0  # times the discrepancy along an axis: least size of a step
LOOKED_AT = 3000  # poses that are enough to judge a step by blocks
NEIGHBOURS = 4  # of a pose, whose distance in joint space is that to its own side
NEAR = 1.5  # times that distance: as near on the other side
MOST = 5  # steps of one table
LEAST_SPARE = 0.2  # of the equations, that the unknowns leave
RIDGE = 1e-9  # of a trace: what poses on one side cannot tell
REPEATED = 3  # rows of equal joint angles that tell whether they measured one thing
NAMES = (
    "Give each its name in poses.yaml: a `seat` and a `target` of its own for each table of files, "
    "or a column that names it row by row."
)
_OTHER = re.compile(r" (from|before) (.+ )?row \d+$")


@dataclass(frozen=True, eq=False)
class Step:
    """A seat or target that moved between two rows."""

    kind: str  # seat or target
    name: str  # as the table has it
    other: str  # what it is called on the side with fewer poses; the other side keeps its name
    file: str  # of the first pose behind it
    row: int  # of that pose
    before: bool  # whether the side with fewer poses is that before the step
    sides: dict[str, tuple[Array, Array]]  # of each file: its rows in order, whether on that side
    shift: Array  # (3,) [m] base frame of a seat, flange frame of a target
    score: float

    @property
    def size(self) -> float:
        """[m]"""
        return float(np.linalg.norm(self.shift))

    @property
    def sentence(self) -> str:
        """What moved, when and how far."""
        where = "before it" if self.before else "from there on"
        return (
            f"{self.kind} {self.name} moved by {self.size * 1e3:.3f} mm before {self.file}:"
            f"{self.row}; {where} it is another one to the fit, {self.other!r}: check what was "
            "knocked or seated anew there"
        )

    def on_other_side(self, group: PoseGroup) -> NDArray[np.bool_]:
        """(N,) poses of a group, of the same files, on the side with the other name."""
        if getattr(group, self.kind) != self.name or group.file not in self.sides:
            return np.zeros(group.size, dtype=bool)
        rows, other = self.sides[group.file]
        last = np.searchsorted(rows, group.rows, side="right") - 1
        return np.asarray(other[np.maximum(last, 0)])


@dataclass(frozen=True, eq=False)
class _Rows:
    """The poses of one seat or target in the order in which they were measured."""

    kind: str
    name: str
    place: NDArray[np.intp]  # (N,) in the table
    instant: NDArray[np.intp]  # (N,) number of each pose's instant, from 0
    possible: NDArray[np.bool_]  # (N,) whether a step may be right before a pose
    own: slice  # of its position among the unknowns


@dataclass(frozen=True, eq=False)
class _Place:
    """The best place of a step among the rows of a seat or target."""

    rows: _Rows
    at: int
    shift: Array  # (3,) [m]
    score: float

    @property
    def size(self) -> float:
        """[m]"""
        return float(np.linalg.norm(self.shift))


def step_of(fit: Fit) -> Step | None:
    """The clearest step of a seat or a target; None where nothing shows one."""
    bounded = _bounded(fit)
    equations = bounded.linear
    jacobian, residual = stacked(bounded.jacobians), stacked(equations.residuals)
    places = [
        place
        for rows in _candidates(fit)
        if (place := _best(fit, equations, jacobian, residual, rows)) is not None
    ]
    for place in sorted(places, key=lambda place: place.score, reverse=True):
        if _predicts(fit, equations, jacobian, residual, place):
            return _step(fit.model.poses, place)
    return None


def refuse_large(table: PoseTable, step: Step) -> None:
    """Raises InputError for a step of a size that is another seat or target, called by one name."""
    if step.size > LARGEST:
        raise InputError(
            f"{table.name}: {step.kind} {step.name} stands {step.size * 1e3:.1f} mm elsewhere from "
            f"{step.file}:{step.row} on: that is another {step.kind}, not one that was knocked. "
            f"{NAMES}"
        )


def refuse_merged(table: PoseTable) -> None:
    """Raises InputError for equal poses of one seat and target whose values lie far apart."""
    pose = distinct_poses(table.q)
    of = np.split(pose, np.cumsum([group.size for group in table.groups])[:-1])
    names = dict.fromkeys((g.seat, g.target) for g in table.groups if g.kind.columns)
    for seat, target in names:
        own = [
            (group, number)
            for group, number in zip(table.groups, of, strict=True)
            if (group.seat, group.target) == (seat, target)
        ]
        values = np.concatenate([group.values[:, :3] for group, _ in own])
        number = np.concatenate([n for _, n in own])
        order = np.argsort(number, kind="stable")
        same = np.diff(number[order]) == 0
        apart = np.linalg.norm(np.diff(values[order], axis=0)[same], axis=1)
        if apart.size >= REPEATED and (middle := float(np.median(apart))) > LARGEST:
            files = " and ".join(dict.fromkeys(group.file for group, _ in own))
            raise InputError(
                f"{files}: rows of equal joint angles lie {middle * 1e3:.1f} mm apart (median of "
                f"{apart.size}), all of seat {seat} and target {target}: these are several targets "
                f"or seats. {NAMES}"
            )


def confirms(before: Fit, after: Fit, candidate: Step, step: Step) -> bool:
    """Whether a fit with a step confirms it.

    before, after : without and with it. candidate, step : as it was found, and as it came out.
    A step is larger than what drifts anyway, as far as the model leaves less over; its size does
    not depend on what else is fitted; and the model leaves less over with it. Of one so large that
    the fit without it says little, the size is not compared.
    """
    left = after.excess.position
    if left >= before.excess.position:
        return False
    if min(candidate.size, step.size) > LARGEST:
        return True
    drifting = float(np.clip(WARMING, LEAST_SIZE * left, CERTAIN_SIZE * left))
    return (
        step.size > drifting
        and float(np.linalg.norm(step.shift - candidate.shift)) < candidate.size
    )


def split(fit: Fit, step: Step) -> PlacedPoses:
    """The table with another name behind a step, and where seats and targets are by the fit."""
    layout = fit.model.unknowns
    seats = {name: layout.seat(fit.x, name) for name in layout.seats}
    targets = {name: layout.target(fit.x, name) for name in layout.targets}
    places = seats if step.kind == "seat" else targets
    before = places[step.name]
    shift = -step.shift if step.before else step.shift
    places[step.other] = Placement(before.rotation, before.origin + shift)
    return PlacedPoses(renamed(fit.model.poses, [step]), seats, targets)


def other_sides(steps: Sequence[Step], target: str) -> list[str]:
    """What a target is called on the sides of its steps that do not keep its name."""
    others = [step.other for step in steps if step.kind == "target"]
    return [name for name in others if _OTHER.sub("", name) == target]


def renamed(table: PoseTable, steps: Sequence[Step]) -> PoseTable:
    """A table, of the same files or a part of them, with other names behind steps."""
    for step in steps:
        groups = []
        for group in table.groups:
            moved = step.on_other_side(group)
            parts = [(group.part(~moved), getattr(group, step.kind))] if not moved.all() else []
            parts += [(group.part(moved), step.other)] if moved.any() else []
            if step.before:  # in the order of the rows
                parts.reverse()
            seat = step.kind == "seat"
            groups += [replace(p, seat=n) if seat else replace(p, target=n) for p, n in parts]
        table = replace(table, groups=tuple(groups))
    return table


def sized(fit: Fit, steps: Sequence[Step]) -> tuple[Step, ...]:
    """The steps with the shifts that a fit with all of them has."""
    layout, out = fit.model.unknowns, []
    for step in steps:
        place = layout.seat if step.kind == "seat" else layout.target
        main, other = place(fit.x, step.name), place(fit.x, step.other)
        shift = other.origin - main.origin
        if step.kind == "seat" and step.other in layout.framed:
            own = [g.values[:, :3] for g in fit.model.poses.groups if g.seat == step.other]
            shift = shift + (other.rotation - main.rotation) @ np.concatenate(own).mean(axis=0)
        out.append(replace(step, shift=-shift if step.before else shift))
    return tuple(out)


def instants(table: PoseTable) -> NDArray[np.intp]:
    """(N,) number from 0 of the instant at which each pose was measured, in their order.

    By time where all rows have one. Else files follow each other as they are named, rows as they
    stand, and equal joint angles in several files, or in rows that follow each other, are one
    instant: the same pose measured at several targets.
    """
    if all(group.time is not None for group in table.groups):
        times = np.concatenate([np.asarray(group.time) for group in table.groups])
        return np.asarray(np.unique(times, return_inverse=True)[1], dtype=np.intp)
    files = list(dict.fromkeys(group.file for group in table.groups))
    file = np.concatenate([np.full(g.size, files.index(g.file)) for g in table.groups])
    rows = np.concatenate([group.rows for group in table.groups])
    pose = distinct_poses(table.q)
    place = dict[tuple[int, int], float]()  # of an instant, by pose and how often it came before
    out = np.zeros(table.size)
    for k in range(len(files)):
        own = np.flatnonzero(file == k)
        own = own[np.argsort(rows[own], kind="stable")]
        begins = np.concatenate(([True], np.diff(pose[own]) != 0))
        keys, count = list[tuple[int, int]](), dict[int, int]()
        for i in own[begins]:
            count[pose[i]] = count.get(pose[i], 0) + 1
            keys.append((pose[i], count[pose[i]]))
        known = np.array([place.get(key, np.nan) for key in keys])
        out[own] = _filled(known, 1.0 + max(place.values(), default=0.0))[np.cumsum(begins) - 1]
        place |= dict(zip(keys, out[own[begins]], strict=True))
    return np.asarray(np.unique(out, return_inverse=True)[1], dtype=np.intp)


def _filled(known: Array, end: float) -> Array:
    """(K,) places of a file's instants: where they are not known they follow the one before.

    end : the place behind all that are known so far.
    """
    unknown = np.isnan(known)
    if unknown.all():
        return np.asarray(end + np.arange(known.size))
    before = np.where(unknown, 0, np.arange(known.size))
    np.maximum.accumulate(before, out=before)
    after = np.arange(known.size) - before
    base = np.where(np.isnan(known[before]), -1.0, known[before])  # ahead of the first known one
    return np.asarray(np.where(unknown, base + after / (known.size + 1.0), known))


def _bounded(fit: Fit) -> Fit:
    """The fit with Huber's weights for all poses, none left out."""
    lengths = whitened_lengths(fit.linear)
    scale = max(1.0, median_scale(lengths))
    robust = [np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(v, 1e-9))) for v in lengths]
    return replace(fit, linear=equations_at(fit.model, fit.x, fit.excess, robust))


def _candidates(fit: Fit) -> list[_Rows]:
    """Seats and targets with enough poses, in the order of measurement.

    What moved is seen by something that stayed: a step of a seat needs a target with poses on
    either side of it, a step of a target a seat.
    """
    table, layout = fit.model.poses, fit.model.unknowns
    instant = instants(table)
    order = np.argsort(instant, kind="stable")
    names = {
        kind: np.concatenate(
            [np.full(g.size, getattr(g, kind), dtype=object) for g in table.groups]
        )[order]
        for kind in ("seat", "target")
    }
    out = []
    for kind, other, parts in (
        ("seat", "target", layout.seats),
        ("target", "seat", layout.targets),
    ):
        for name, part in parts.items():
            chosen = names[kind] == name
            place = order[chosen]
            when = instant[place]
            seen = np.zeros(place.size, dtype=np.intp)
            for witness in dict.fromkeys(names[other][chosen]):
                own = names[other][chosen] == witness
                before = np.cumsum(own) - own
                seen = np.maximum(seen, np.minimum(before, own.sum() - before))
            possible = (seen >= LEAST) & np.concatenate(([False], np.diff(when) > 0))
            if possible.any():
                own = slice(part.start, part.start + 3)
                out.append(_Rows(kind, name, place, when, possible, own))
    return out


def _best(
    fit: Fit, equations: NormalEquations, jacobian: Array, residual: Array, rows: _Rows
) -> _Place | None:
    """The place of one seat or target with the largest score, if it is worth a look.

    jacobian, residual : (P, E, N) and (E, N), whitened, of all poses.
    """
    jacobian, residual = jacobian[:, :, rows.place], residual[:, rows.place]
    columns = jacobian[rows.own]
    drift = columns * np.linspace(-1.0, 1.0, rows.place.size)
    normal, gradient = _with_columns(equations, jacobian, drift, residual)
    jacobian = np.concatenate((jacobian, drift))
    gram = _from_behind(np.einsum("pen,ken->pkn", jacobian, columns))  # of the rows from n on
    score = _from_behind(np.einsum("ken,en->kn", columns, residual))
    solved = np.linalg.solve(normal, gram.reshape(len(gram), -1)).reshape(gram.shape)
    score = score - np.einsum("pkn,p->kn", solved, gradient)
    information = gram[rows.own] - np.einsum("pkn,pln->kln", gram, solved)
    least = RIDGE * np.trace(gram[rows.own][..., 0]) * np.eye(3)
    information = information.transpose(2, 0, 1) + least
    shift = -np.linalg.solve(information, score.T[..., None])[..., 0]  # (N, 3)
    gain = np.where(rows.possible, -(shift * score.T).sum(axis=1), 0.0)
    at = int((gain - _cost_of_size(shift)).argmax())
    left = residual + np.einsum(
        "ken,k->en", columns * (np.arange(rows.place.size) >= at), shift[at]
    )
    moved = solved[:, :, at] @ shift[at] + np.linalg.solve(normal, gradient)
    left = left - np.einsum("pen,p->en", jacobian, moved)
    spare = max(left.size - determined(fit.linear, fit.model.unknowns), LEAST_SPARE * left.size)
    score_at = float(gain[at]) * spare / float((left**2).sum()) - float(_cost_of_size(shift[at]))
    return _Place(rows, at, shift[at], score_at) if score_at > LIMIT else None


def _cost_of_size(shift: Array) -> Array:
    """Twice the negative logarithm of Student's density of shifts (..., 3) [m], 0 at its top.

    Rods hardly tell a shift across them: without a prior it would be as large as it likes. What is
    larger than LARGEST is no knock, and costs no more.
    """
    square = np.minimum((shift**2).sum(axis=-1), LARGEST**2) / PRIOR**2
    return np.asarray((TAILS + 3.0) * np.log1p(square / TAILS))


def _predicts(
    fit: Fit, equations: NormalEquations, jacobian: Array, residual: Array, place: _Place
) -> bool:
    """Whether a step predicts blocks of poses that were left out, on both sides of its place."""
    rows = place.rows
    when = np.unique(rows.instant)
    thin = np.searchsorted(when, rows.instant) % -(-rows.place.size // LOOKED_AT) == 0
    chosen, instant = rows.place[thin], rows.instant[thin]
    when = np.unique(instant)
    edge = int(np.searchsorted(when, rows.instant[place.at]))
    number = np.searchsorted(when, instant)  # of each pose's instant among those of the rows
    after = number >= edge
    counting = _comparable(fit.model.poses.q[chosen], after)
    if min((counting & after).sum(), (counting & ~after).sum()) < LEAST:
        return False
    own = np.where(after, (number - edge) / (when.size - edge), number / edge)
    block = (BLOCKS * own).astype(np.intp) + BLOCKS * after
    jacobian, residual = jacobian[:, :, chosen], residual[:, chosen]
    columns = jacobian[rows.own]
    drift = columns * np.linspace(-1.0, 1.0, chosen.size)
    shapes = [np.zeros(number.size), after.astype(float)]
    shapes += [
        np.clip((number - edge + 0.5) / width + 0.5, 0.0, 1.0)
        for width in RAMPS
        if width < when.size
    ]
    left, tau = [], 1.0
    for k, shape in enumerate(shapes):
        more = np.concatenate((drift, columns * shape))
        normal, gradient = _with_columns(equations, jacobian, more, residual)
        every = np.concatenate((jacobian, more))
        if k == 1:
            rest = residual - np.einsum("pen,p->en", every, np.linalg.solve(normal, gradient))
            tau = _correlation_time(rest)
        normal[-3:, -3:] += max(PRIOR, place.size) ** -2.0 * np.eye(3)
        left.append(_left_out(normal, gradient, every, residual, block, counting))
    spare = max(
        counting.sum() * len(residual) - determined(fit.linear, fit.model.unknowns),
        LEAST_SPARE * residual.size,
    )
    none, step, *ramps = np.array(left) / (np.sum(left[1]) / spare)  # (2 BLOCKS,) each
    gain = none - step
    return bool(
        gain.sum() - gain.max() > PRICE * tau
        and min(gain[:BLOCKS].sum(), gain[BLOCKS:].sum()) > 0.0
        and all(step.sum() < ramp.sum() for ramp in ramps)
    )


def _correlation_time(residual: Array) -> float:
    """Number of neighbouring poses whose residuals (E, N) count as one: 1 for white noise.

    Integrated autocorrelation, cut where it is no longer seen (Sokal 1997); at most ALIKE.
    """
    total, n = float((residual**2).sum()), residual.shape[1]
    tau, seen = 1.0, 2.0 / np.sqrt(residual.size)
    for lag in range(1, n // 4):
        share = float((residual[:, lag:] * residual[:, :-lag]).sum()) / total
        if share < seen or tau > ALIKE:
            break
        tau += 2.0 * share
    return min(tau, ALIKE)


def _comparable(q: Array, after: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) poses that have as near a neighbour on the other side of a step as on their own.

    q : (N, J) [rad]. What a model leaves over elsewhere in joint space looks like a step where the
    robot went elsewhere.
    """
    trees = [cKDTree(q[~after]), cKDTree(q[after])]
    out = np.zeros(len(q), dtype=bool)
    for side, own in enumerate((~after, after)):
        own_distance = np.atleast_2d(trees[side].query(q[own], k=NEIGHBOURS)[0])[:, -1]
        other = np.asarray(trees[1 - side].query(q[own])[0])
        out[own] = other <= NEAR * own_distance
    return out


def _left_out(
    normal: Array,
    gradient: Array,
    jacobian: Array,
    residual: Array,
    block: NDArray[np.intp],
    counting: NDArray[np.bool_],
) -> Array:
    """(2 BLOCKS,) sum of squares of each block's residual (E, N) by a fit without it.

    block : (N,) number of each pose's block. counting : (N,) poses whose residuals are summed.
    """
    out = np.zeros(2 * BLOCKS)
    for k in range(out.size):
        left = block == k
        part, rest = jacobian[:, :, left].reshape(len(normal), -1), residual[:, left].reshape(-1)
        step = np.linalg.solve(normal - part @ part.T, gradient - part @ rest)
        predicted = (rest - step @ part).reshape(len(residual), -1)
        out[k] = float((predicted[:, counting[left]] ** 2).sum())
    return out


def _step(table: PoseTable, place: _Place) -> Step:
    """The step at a place, with the rows on either side of it."""
    rows = place.rows
    of = np.concatenate([np.full(g.size, g.file, dtype=object) for g in table.groups])
    number = np.concatenate([group.rows for group in table.groups])
    instant = instants(table)
    first = rows.instant[place.at]
    before = 2 * place.at < rows.place.size
    sides = {}
    for file in dict.fromkeys(of):
        own = np.flatnonzero(of == file)
        own = own[np.argsort(number[own], kind="stable")]
        sides[file] = (number[own], (instant[own] >= first) != before)
    file, row = of[rows.place[place.at]], int(number[rows.place[place.at]])
    several = len({of[i] for i in rows.place}) > 1
    word = "before" if before else "from"
    other = f"{_OTHER.sub('', rows.name)} {word} {f'{file} ' if several else ''}row {row}"
    return Step(
        kind=rows.kind,
        name=rows.name,
        other=other,
        file=file,
        row=row,
        before=before,
        sides=sides,
        shift=place.shift,
        score=place.score,
    )


def _with_columns(
    equations: NormalEquations, jacobian: Array, more: Array, residual: Array
) -> tuple[Array, Array]:
    """Normal matrix and gradient with more columns (K, E, N); jacobian (P, E, N) of their rows."""
    cross = np.einsum("pen,ken->pk", jacobian, more)
    own = np.einsum("len,ken->lk", more, more)
    own = own + RIDGE * np.trace(own) * np.eye(len(own))
    gradient = np.concatenate((equations.gradient, np.einsum("ken,en->k", more, residual)))
    return np.block([[equations.normal, cross], [cross.T, own]]), gradient


def _from_behind(values: Array) -> Array:
    """(..., N) sums of the values from each place to the end."""
    return np.asarray(np.cumsum(values[..., ::-1], axis=-1)[..., ::-1])

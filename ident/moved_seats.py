"""A seat or a target that moved once within a table: an instrument knocked, a ball seated again.

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

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseTable
from ballbar.cell.statistics import correlation_time
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import NormalEquations
from ballbar.ident.estimator.priors import TAILS
from ballbar.ident.estimator.robust_fit import (
    HUBER,
    determined,
    equations_at,
    median_scale,
    stacked,
    whitened_lengths,
)
from ballbar.ident.table_steps import LARGEST, Step, first_name, instants

# Score that a place has to exceed to be looked at. Chance reaches 30 in none of several hundred
# clean tables, and the best place of a table without a step is of no use to the blocks anyway.
LIMIT = 30.0
LEAST = 20  # poses on either side of a step, near each other in joint space
BLOCKS = 10  # of poses on either side, left out in turn; with 5 a left-out block lies too far away
# Sum of squares that a step has to take from blocks left out, the best of them not counted since a
# stretch of bad rows is no step; in variances of what the model leaves over, times the number of
# neighbouring poses that count as one. 2 ln(1000 places) + 11 (docs/studies/table_steps.csv).
PRICE = 25.0
CORRELATED = 4.0  # neighbours that count as one at most: beyond is the step itself, unfitted
PRIOR = 1e-3  # [m] least standard deviation of a step: a knocked instrument, a ball seated again
RAMPS = (64, 128, 256, 512)  # poses over which a gradual change takes place
WARMING = 1.25e-4  # [m] that bases and trackers drift within hours, and robots that warm up
LEAST_SIZE, CERTAIN_SIZE = 1.5, 4.0  # times the discrepancy along an axis: least size of a step
LOOKED_AT = 3000  # poses that are enough to judge a step by blocks
NEIGHBOURS = 4  # of a pose, whose distance in joint space is that to its own side
NEAR = 1.5  # times that distance: as near on the other side
MOST = 5  # steps of one table
LEAST_SPARE = 0.2  # of the equations, that the unknowns leave
RIDGE = 1e-9  # of a trace: what poses on one side cannot tell


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
    # by the fit with Huber's weights for all poses, none left out
    lengths = whitened_lengths(fit.linear)
    scale = max(1.0, median_scale(lengths))
    robust = [np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(v, 1e-9))) for v in lengths]
    equations = equations_at(fit.model, fit.x, fit.excess, robust)
    jacobian = stacked(replace(fit, linear=equations).jacobians)
    residual = stacked(equations.residuals)
    places = [
        place
        for rows in _candidates(fit)
        if (place := _best(fit, equations, jacobian, residual, rows)) is not None
    ]
    for place in sorted(places, key=lambda place: place.score, reverse=True):
        if _predicts(fit, equations, jacobian, residual, place):
            return _step(fit.model.poses, place)
    return None


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
            tau = correlation_time(rest, most=CORRELATED)
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
    other = f"{first_name(rows.name)} {word} {f'{file} ' if several else ''}row {row}"
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

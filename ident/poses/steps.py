"""A seat or a target that moved once within a table: an instrument knocked, a ball seated anew.

For every place of the change in the order of the rows a shift of what follows is one more unknown
of three coordinates, beside a linear drift of three; its score, Schur complement included, comes
from running sums over the rows (sup-score test, Andrews 1993). Poses far off count as Huber 1964
weighs them, but none is left out: a few rows behind a step would be. The best place has to exceed a
limit twice, by the variance of what the step leaves and by that of block sums in the order of the
rows, since what a model leaves over is alike in neighbouring rows.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.poses import PoseGroup, PoseTable
from ident.poses.closure import Placement
from ident.poses.fit import (
    HUBER,
    PoseEquations,
    PoseFit,
    median_scale,
    pose_equations,
    whitened_lengths,
)
from ident.poses.start import PoseStart

# Of both scores. Chance reaches 30 in none of several hundred clean tables; what the model of a UR5
# leaves over while it warms up, 50 to 60.
LIMIT = 60.0
LEAST = 6  # poses on either side of a step
BLOCKS = 30  # of rows, whose sums are independent
MOST = 5  # steps of one table
LEAST_SPARE = 0.2  # of the equations, that the unknowns leave
RIDGE = 1e-9  # of a trace: what rows on one side cannot tell
_OTHER = re.compile(r" (from|before) (.+ )?row \d+$")


@dataclass(frozen=True, eq=False)
class Step:
    """A seat or target that moved between two rows."""

    kind: str  # seat or target
    name: str  # as the table has it
    other: str  # what it is called on the side with fewer poses; the other side keeps its name
    file: str  # of the first pose behind it
    row: int  # likewise
    before: bool  # whether the side with fewer poses is that before the step
    files: tuple[str, ...]  # that stand on this side as a whole
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
            "knocked or seated anew there, or whether the robot was warming up"
        )

    def on_other_side(self, group: PoseGroup) -> NDArray[np.bool_]:
        """(N,) poses of a group, of the same files, on the side with the other name."""
        if getattr(group, self.kind) != self.name:
            return np.zeros(group.size, dtype=bool)
        if group.file != self.file:
            return np.full(group.size, group.file in self.files)
        return np.asarray((group.rows >= self.row) != self.before)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The poses of one seat or target in the order in which they were measured."""

    kind: str
    name: str
    place: NDArray[np.intp]  # (N,) in the table
    own: slice  # of its position among the unknowns


def step_of(fit: PoseFit) -> Step | None:
    """The clearest step of a seat or a target; None where chance explains the best one."""
    equations = _bounded(fit)
    steps = [step for rows in _candidates(fit) if (step := _best(fit, equations, rows))]
    return max(steps, key=lambda step: step.score, default=None)


def split(fit: PoseFit, step: Step) -> tuple[PoseTable, PoseStart]:
    """The table with another name behind a step, and where seats and targets are by the fit."""
    layout = fit.model.unknowns
    seats = {name: layout.seat(fit.x, name) for name in layout.seats}
    targets = {name: layout.target(fit.x, name) for name in layout.targets}
    places = seats if step.kind == "seat" else targets
    before = places[step.name]
    shift = -step.shift if step.before else step.shift
    places[step.other] = Placement(before.rotation, before.origin + shift)
    return renamed(fit.model.table, [step]), PoseStart(seats, targets)


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


def sized(fit: PoseFit, steps: Sequence[Step]) -> tuple[Step, ...]:
    """The steps with the shifts that a fit with all of them has."""
    layout, out = fit.model.unknowns, []
    for step in steps:
        place = layout.seat if step.kind == "seat" else layout.target
        main, other = place(fit.x, step.name), place(fit.x, step.other)
        shift = other.origin - main.origin
        if step.kind == "seat" and step.other in layout.framed:
            own = [g.values[:, :3] for g in fit.model.table.groups if g.seat == step.other]
            shift = shift + (other.rotation - main.rotation) @ np.concatenate(own).mean(axis=0)
        out.append(replace(step, shift=-shift if step.before else shift))
    return tuple(out)


def _bounded(fit: PoseFit) -> PoseEquations:
    """The equations with Huber's weights for all poses, none left out."""
    lengths = whitened_lengths(fit.equations)
    scale = max(1.0, median_scale(lengths))
    robust = [np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(v, 1e-9))) for v in lengths]
    return pose_equations(fit.model, fit.x, fit.discrepancy, robust)


def _files(table: PoseTable) -> list[str]:
    """Files in the order in which they were measured: of time where all have it, else as named."""
    files = list(dict.fromkeys(group.file for group in table.groups))
    if all(group.time is not None for group in table.groups):
        starts = {g.file: float(np.min(g.time)) for g in table.groups if g.time is not None}
        files.sort(key=starts.__getitem__)
    return files


def _candidates(fit: PoseFit) -> list[_Rows]:
    """Seats and targets with enough poses, each in the order of files and rows."""
    table, layout = fit.model.table, fit.model.unknowns
    files = _files(table)
    order = np.lexsort(
        (
            np.concatenate([group.rows for group in table.groups]),
            np.concatenate([np.full(g.size, files.index(g.file)) for g in table.groups]),
        )
    )
    out = []
    for kind, parts in (("seat", layout.seats), ("target", layout.targets)):
        of = np.concatenate([np.full(g.size, getattr(g, kind), dtype=object) for g in table.groups])
        for name, part in parts.items():
            place = order[of[order] == name]
            if place.size >= 2 * LEAST:
                out.append(_Rows(kind, name, place, slice(part.start, part.start + 3)))
    return out


def _best(fit: PoseFit, equations: PoseEquations, rows: _Rows) -> Step | None:
    """The step of one seat or target with the largest score, if it is beyond chance."""
    jacobian, residual = _stacked(equations)
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
    gain = -(shift * score.T).sum(axis=1)
    gain[:LEAST] = gain[len(gain) - LEAST + 1 :] = 0.0
    at = int(gain.argmax())
    behind = np.arange(rows.place.size) >= at
    rest = columns * behind - np.einsum("pen,pk->ken", jacobian, solved[:, :, at])
    moved = solved[:, :, at] @ shift[at] + np.linalg.solve(normal, gradient)
    left = residual + np.einsum("ken,k->en", columns * behind, shift[at])
    left = left - np.einsum("pen,p->en", jacobian, moved)
    variance = _variance_by_blocks(np.einsum("ken,en->kn", rest, left))
    by_blocks = float(score[:, at] @ np.linalg.solve(variance, score[:, at]))
    spare = max(left.size - _determined(fit), LEAST_SPARE * left.size)
    by_model = float(gain[at]) * spare / float((left**2).sum())
    if min(by_blocks, by_model) <= LIMIT:
        return None
    return _step(fit.model.table, rows, at, shift[at], min(by_blocks, by_model))


def _step(table: PoseTable, rows: _Rows, at: int, shift: Array, score: float) -> Step:
    """A step before the pose `at` of a seat's or a target's rows."""
    of = [group.file for group in table.groups for _ in range(group.size)]
    file, files = of[rows.place[at]], _files(table)
    row = int(np.concatenate([group.rows for group in table.groups])[rows.place[at]])
    before = 2 * at < rows.place.size
    several = len({of[i] for i in rows.place}) > 1
    word, at_file = "before" if before else "from", files.index(file)
    other = f"{_OTHER.sub('', rows.name)} {word} {f'{file} ' if several else ''}row {row}"
    return Step(
        kind=rows.kind,
        name=rows.name,
        other=other,
        file=file,
        row=row,
        before=before,
        files=tuple(files[:at_file] if before else files[at_file + 1 :]),
        shift=shift,
        score=score,
    )


def _determined(fit: PoseFit) -> float:
    """How many unknowns the data determine, beside what the priors tell."""
    inner, sigma = fit.equations.normal, fit.model.unknowns.sigma
    return float(sigma.size - (np.diag(np.linalg.inv(inner)) / sigma**2).sum())


def _with_columns(
    equations: PoseEquations, jacobian: Array, more: Array, residual: Array
) -> tuple[Array, Array]:
    """Normal matrix and gradient with more columns (K, E, N); jacobian (P, E, N) of their rows."""
    cross = np.einsum("pen,ken->pk", jacobian, more)
    own = np.einsum("len,ken->lk", more, more)
    own = own + RIDGE * np.trace(own) * np.eye(len(own))
    gradient = np.concatenate((equations.gradient, np.einsum("ken,en->k", more, residual)))
    return np.block([[equations.normal, cross], [cross.T, own]]), gradient


def _variance_by_blocks(each: Array) -> Array:
    """(3, 3) variance of the sum of contributions (3, N), alike within blocks of neighbours."""
    starts = np.unique(np.linspace(0, each.shape[1], BLOCKS, endpoint=False).astype(np.intp))
    blocks = np.add.reduceat(each, starts, axis=1)
    variance = blocks @ blocks.T
    return np.asarray(variance + RIDGE * np.trace(variance) * np.eye(3))


def _stacked(equations: PoseEquations) -> tuple[Array, Array]:
    """(P, E, N) Jacobian and (E, N) residual of all groups; absent equations are zero."""
    rows = max(len(residual) for residual in equations.residuals)

    def padded(part: Array) -> Array:
        missing = [(0, 0)] * part.ndim
        missing[-2] = (0, rows - part.shape[-2])
        return np.pad(part, missing)

    return (
        np.concatenate([padded(part) for part in equations.jacobians], axis=-1),
        np.concatenate([padded(part) for part in equations.residuals], axis=-1),
    )


def _from_behind(values: Array) -> Array:
    """(..., N) sums of the values from each place to the end."""
    return np.asarray(np.cumsum(values[..., ::-1], axis=-1)[..., ::-1])

"""Steps of seats and targets within a table: names on either side, and sizes by a fit.

A step is a shift of what was measured, from some pose on. The side with fewer poses gets another
name, so that its seat or target has unknowns of its own in the fit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.regions import distinct_poses
from ballbar.ident.estimator.unknowns import PlacedPoses

LARGEST = 5e-3  # [m] beyond which it is another seat or target by mistake, and no knock
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
        """The sentence that says what moved, when and how far."""
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
    """Names of a target on the sides of its steps that do not keep its name."""
    others = [step.other for step in steps if step.kind == "target"]
    return [name for name in others if first_name(name) == target]


def first_name(name: str) -> str:
    """Name of a seat or target in the table, without what a step has added to it."""
    return _OTHER.sub("", name)


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

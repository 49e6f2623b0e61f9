"""Characteristics of repeated still poses.

Repetitions are poses of equal commanded angles. What is attained is the same under each model; a
correction moves poses and not their spread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseGroup
from ballbar.ident.performance import iso_9283 as iso
from ballbar.ident.performance.attained import NOT_CORRECTED, Attained, noise_remark
from ballbar.ident.performance.characteristics import Listing, Statement, not_stated
from ballbar.ident.performance.cube import TestCube

SAME = 1e-3  # [rad] of every axis within which two poses are of one command
LEAST_CYCLES = 3  # from which a spread is stated
LEAST_POSES = 5  # different ones from which an accuracy is stated: those of the test cube
ANGLES = ("a", "b", "c")


def repetitions(q: Array) -> list[NDArray[np.intp]]:
    """Rows of each command that occurs LEAST_CYCLES times or more, in the order of q (N, J) [rad].

    A pose belongs to the first command whose first angles are within SAME of its own.
    """
    left, rows = np.arange(len(q)), list[NDArray[np.intp]]()
    while left.size:
        same = (np.abs(q[left] - q[left[0]]) <= SAME).all(axis=1)
        rows.append(left[same])
        left = left[~same]
    return [own for own in rows if own.size >= LEAST_CYCLES]


def add_repeated(
    listing: Listing, group: PoseGroup, seen: Sequence[Attained], cube: TestCube | None
) -> None:
    """Add the rows of a group's repeated poses; seen : by the nominal and the identified robot."""
    if clusters := repetitions(group.q):
        _Still(listing, group, seen, clusters, _places(group, clusters, cube)).add()


def _places(
    group: PoseGroup, clusters: Sequence[NDArray[np.intp]], cube: TestCube | None
) -> list[str]:
    """Names of the repeated poses; those of the test cube have its own."""
    names = []
    for k, rows in enumerate(clusters, start=1):
        away = np.inf if cube is None else np.abs(cube.q - group.q[rows[0]]).max(axis=1)
        at = int(np.argmin(away))
        names.append(f"P{at + 1}" if np.min(away) <= SAME else f"pose {k}")
    return names


@dataclass(frozen=True, eq=False)
class _Still:
    """Repeated still poses of one group."""

    listing: Listing
    group: PoseGroup
    seen: Sequence[Attained]  # by the nominal and the identified robot
    clusters: Sequence[NDArray[np.intp]]
    places: Sequence[str]

    def add(self) -> None:
        """Add the rows of every pose, and of the distance between the farthest two."""
        for place, rows in zip(self.places, self.clusters, strict=True):
            self._add_accuracy(place, rows)
            self._add_repeatability(place, rows)
            self._add_variation(place, rows)
            if self.group.time is not None:
                self._add_drift(place, rows)
        if len(self.clusters) > 1:
            self._add_distance()

    def _add_accuracy(self, place: str, rows: NDArray[np.intp]) -> None:
        if (count := len(self.clusters)) < LEAST_POSES:
            few = not_stated(
                f"{count} repeated poses, which the seat's place follows; 5 are needed"
            )
            self.listing.add("AP_p", place, (few, few, few), cycles=rows.size)
            return
        stated = []
        for seen in self.seen:
            own, commanded = seen.points[rows], seen.commanded[rows].mean(axis=0)
            value = iso.pose_accuracy(own, commanded)
            stated.append(_about(value, iso.accuracy_half_width(own, commanded), least=0.0))
        remark = f"the seat is fitted to these {count} poses"
        stated[1] = replace(stated[1], reason=remark)
        self.listing.add("AP_p", place, (*stated, NOT_CORRECTED), cycles=rows.size)
        turns = [seen.turns[rows] for seen in self.seen if seen.turns is not None]
        means = [iso.orientation_accuracy(own, np.zeros(3)) for own in turns]
        for k, axis in enumerate(ANGLES if turns else ()):
            pairs = zip(means, turns, strict=True)
            each = [_about(float(mean[k]), iso.mean_half_width(own[:, k])) for mean, own in pairs]
            self.listing.add(f"AP_{axis}", place, (*each, NOT_CORRECTED), cycles=rows.size)

    def _add_repeatability(self, place: str, rows: NDArray[np.intp]) -> None:
        own = self.group.values[rows, :3]
        value = float(iso.pose_repeatability(own))
        low, high = iso.deviation_interval(rows.size)
        stated = Statement("measured", value, low * value, high * value, noise_remark(self.group))
        self.listing.add("RP_l", place, (stated,) * 3, cycles=rows.size)
        turns = self.seen[1].turns
        if turns is not None:
            for axis, size in zip(ANGLES, iso.orientation_repeatability(turns[rows]), strict=True):
                each = Statement("measured", float(size), float(low * size), float(high * size))
                self.listing.add(f"RP_{axis}", place, (each,) * 3, cycles=rows.size)

    def _add_variation(self, place: str, rows: NDArray[np.intp]) -> None:
        """The pose before a repetition is the direction from which it was approached."""
        before = np.full(self.group.size, -1)
        for k, own in enumerate(self.clusters):
            before[own] = k
        approach = before[np.maximum(rows - 1, 0)]
        ways = [own for k in np.unique(approach) if (own := rows[approach == k]).size > 1]
        if len(ways) > 1:
            means = np.stack([self.group.values[way, :3].mean(axis=0) for way in ways])
            remark = "" if len(ways) > 2 else "of two directions; the standard asks for three"
            value = iso.pose_accuracy_variation(means)
            stated = Statement("measured", value, reason=remark)
            self.listing.add("vAP_p", place, (stated,) * 3, cycles=rows.size)

    def _add_drift(self, place: str, rows: NDArray[np.intp]) -> None:
        """Change from the first cycles to the last ones, at most as many as the standard has."""
        assert self.group.time is not None  # the caller's condition
        count = min(iso.PATH_CYCLES, rows.size // 2)
        if count < LEAST_CYCLES:
            return
        ordered = rows[np.argsort(self.group.time[rows])]
        parts = ordered[:count], ordered[-count:]
        hours = float(np.ptp(self.group.time[rows])) / 3600.0
        remark = f"over {hours:.2g} h, {count} cycles at each end"
        accuracy, spread = (
            [],
            [float(iso.pose_repeatability(self.group.values[p, :3])) for p in parts],
        )
        for seen in self.seen:
            commanded = seen.commanded[rows].mean(axis=0)
            sizes = [iso.pose_accuracy(seen.points[part], commanded) for part in parts]
            accuracy.append(Statement("measured", float(iso.drift(np.array(sizes))), reason=remark))
        stated = Statement("measured", float(iso.drift(np.array(spread))), reason=remark)
        self.listing.add("dAP_p", place, (*accuracy, NOT_CORRECTED), cycles=rows.size)
        self.listing.add("dRP_l", place, (stated,) * 3, cycles=rows.size)

    def _add_distance(self) -> None:
        """AD and RD of the two poses that are farthest apart, cycle by cycle."""
        middle = np.stack([self.group.values[rows, :3].mean(axis=0) for rows in self.clusters])
        apart = np.linalg.norm(middle[:, None] - middle, axis=2)
        i, j = sorted(int(k) for k in np.unravel_index(apart.argmax(), apart.shape))
        count = min(self.clusters[i].size, self.clusters[j].size)
        rows = self.clusters[i][:count], self.clusters[j][:count]
        first, second = (self.group.values[own, :3] for own in rows)
        lengths, stated = np.linalg.norm(first - second, axis=1), []
        for seen in self.seen:
            commanded = np.stack([seen.commanded[own].mean(axis=0) for own in rows])
            value = iso.distance_accuracy(first, second, commanded)
            stated.append(_about(value, iso.mean_half_width(lengths)))
        place = f"{self.places[i]}-{self.places[j]}"
        self.listing.add("AD_p", place, (*stated, NOT_CORRECTED), cycles=count)
        value, (low, high) = (
            iso.distance_repeatability(first, second),
            iso.deviation_interval(count),
        )
        spread = Statement("measured", value, low * value, high * value)
        self.listing.add("RD", place, (spread,) * 3, cycles=count)


def _about(value: float, half_width: float, *, least: float = -np.inf) -> Statement:
    """A measured value with an interval about it."""
    return Statement("measured", value, max(least, value - half_width), value + half_width)

"""Characteristics that measurements of a robot show: repeated poses, laps of a path, circles."""

from __future__ import annotations

from collections.abc import Mapping

from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.ident.performance.attained import attained
from ballbar.ident.performance.characteristics import Listing
from ballbar.ident.performance.cube import TestCube
from ballbar.ident.performance.followed_path import (
    MeasuredCircle,
    add_circle,
    add_path,
    circle_of,
    circle_of_lengths,
)
from ballbar.ident.performance.iso_230_4 import CircularTest
from ballbar.ident.performance.predicted import Prediction
from ballbar.ident.performance.repeated_poses import add_repeated
from ballbar.ident.robot.identified import IdentifiedRobot

Circle = tuple[str, CircularTest]


def measure(
    listing: Listing,
    prediction: Prediction,
    targets: Mapping[str, Placement],
    table: PoseTable,
    cube: TestCube | None,
    *,
    radius: float | None = None,
) -> tuple[Circle, ...]:
    """Add the rows of a table's groups, and return its circles, each with its place.

    targets : those that the result knows. radius : [m] nominal length of a telescoping ball-bar.
    """
    circles = list[Circle]()
    for group in table.groups:
        place = "circle" if len(table.groups) == 1 else f"circle about {group.seat}"
        if group.kind.directions < 3:
            circle = _length_circle(prediction.nominal.identified, group, radius)
        else:
            seen = attained(prediction, group, targets.get(group.target))
            if group.motion is None:
                add_repeated(listing, group, seen, cube)
            else:
                add_path(listing, group, seen)
            circle = circle_of(seen, group)
        if circle is not None:
            add_circle(listing, place, circle)
            circles.append((place, circle.test))
    return tuple(circles)


def _length_circle(
    nominal: IdentifiedRobot, group: PoseGroup, radius: float | None
) -> MeasuredCircle | None:
    """The circular test of lengths; None of other kinds of instruments, and off a circle."""
    if group.kind.names != ("length",):
        return None
    return circle_of_lengths(nominal.ends(group.q)[:, :3, 3], group, radius)

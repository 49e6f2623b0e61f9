"""Masses beside those of the files: of the tool at the flange, and of the arm's links."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Link
from ballbar.cell.errors import InputError

FARTHEST = 5.0  # [m] of a payload's centre from the flange: longer than any tool; 10 mm exceed it
TOOL = 4  # deviations of the tool: mass [kg] and first moment [kg m] in the flange's frame


@dataclass(frozen=True, eq=False)
class LinkDeviation:
    """How one link deviates from the robot's file."""

    scale: float  # of its mass and inertia
    shift: Array  # (3,) [m] of its centre of mass, frame of the file


@dataclass(frozen=True, eq=False)
class Masses:
    """Masses of tool and arm as they are computed; that of a light tool may be below 0."""

    mass: float  # [kg]
    com: Array  # (3,) [m] centre of mass, robot flange frame
    arm: float = 1.0  # masses of all links over those of the robot's file
    links: tuple[LinkDeviation, ...] = ()  # of links 1 to J beside that; none for exact ones


@dataclass(frozen=True, eq=False)
class Payload(Masses):
    """The tool that the flange carries, plate and all, and the arm beside its file.

    Raises InputError for a mass or a centre that no tool has.
    """

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass >= 0.0):
            raise InputError(f"payload: mass {self.mass:g} kg: expected a finite mass, 0 or more")
        com = np.asarray(self.com, dtype=np.float64)
        shown = np.array2string(com, separator=", ", formatter={"float_kind": "{:g}".format})
        if com.shape != (3,) or not np.isfinite(com).all():
            raise InputError(
                f"payload: centre of mass {shown}: expected three finite numbers, x, y and z [m] "
                "in the robot's flange frame"
            )
        if (distance := float(np.linalg.norm(com))) > FARTHEST:
            raise InputError(
                f"payload: centre of mass {shown} m is {distance:g} m from the flange, expected "
                f"at most {FARTHEST:g} m. Lengths are metres: 100 mm are 0.1"
            )


def with_payload(cell: Cell, payload: Masses) -> Cell:
    """The cell with these masses; the tool keeps the inertia of the plate about its own centre."""
    body = Link(payload.mass, payload.com, cell.plate.body.inertia)
    base, *links = cell.robot.required("links")
    own = payload.links or (LinkDeviation(1.0, np.zeros(3)),) * len(links)
    changed = [
        _scaled(link, payload.arm * deviation.scale, deviation.shift)
        for link, deviation in zip(links, own, strict=True)
    ]
    robot = replace(cell.robot, links=(_scaled(base, payload.arm, np.zeros(3)), *changed))
    return replace(cell, plate=replace(cell.plate, body=body), robot=robot)


def with_deviations(cell: Cell, deviations: Array) -> Cell:
    """The cell with masses that deviate by `deviations` (TOOL + 4 J,) from its own.

    Of the tool mass [kg] and first moment [kg m], then of each link the mass relative to its own
    and the centre [m].
    """
    return with_payload(cell, payload_of(cell, deviations))


def payload_of(cell: Cell, deviations: Array, arm: float = 1.0) -> Masses:
    """The masses of a cell with such deviations, and all links times `arm` beside."""
    body, tool = cell.plate.body, deviations[:TOOL]
    mass = body.mass + float(tool[0])
    moment = body.mass * body.com + tool[1:]
    rows = deviations[TOOL:].reshape(-1, 4)
    return Masses(
        mass,
        moment / mass if mass else body.com,  # an empty flange has no moment either
        arm,
        tuple(LinkDeviation(1.0 + float(row[0]), row[1:]) for row in rows),
    )


def deviations_between(cell: Cell, other: Cell) -> Array:
    """(TOOL + 4 J,) by which another cell's masses deviate, as `with_deviations` takes it."""
    body, changed = cell.plate.body, other.plate.body
    moment = changed.mass * changed.com - body.mass * body.com
    rows = [
        [there.mass / here.mass - 1.0, *(there.com - here.com)]
        for here, there in zip(
            cell.robot.required("links")[1:], other.robot.required("links")[1:], strict=True
        )
    ]
    return np.array([changed.mass - body.mass, *moment, *np.ravel(rows)])


def _scaled(link: Link, scale: float, shift: Array) -> Link:
    return Link(scale * link.mass, link.com + shift, scale * link.inertia)

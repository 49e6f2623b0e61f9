"""Masses beside those of the files: of the tool at the flange, and of the arm's links."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell, Link

TOOL = 4  # deviations of the tool: mass [kg] and first moment [kg m] in the flange's frame


@dataclass(frozen=True, eq=False)
class LinkDeviation:
    """How one link deviates from the robot's file."""

    scale: float  # of its mass and inertia
    shift: Array  # (3,) [m] of its centre of mass, frame of the file


@dataclass(frozen=True, eq=False)
class Payload:
    """The tool that the flange carries, plate and all, and the arm beside its file."""

    mass: float  # [kg]
    com: Array  # (3,) [m] centre of mass, robot flange frame
    arm: float = 1.0  # masses of all links over those of the robot's file
    links: tuple[LinkDeviation, ...] = ()  # of links 1 to J beside that; none for exact ones


def with_payload(cell: Cell, payload: Payload) -> Cell:
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


def payload_of(cell: Cell, deviations: Array, arm: float = 1.0) -> Payload:
    """The masses of a cell with such deviations, and all links times `arm` beside."""
    body, tool = cell.plate.body, deviations[:TOOL]
    mass = body.mass + float(tool[0])
    rows = deviations[TOOL:].reshape(-1, 4)
    return Payload(
        mass,
        (body.mass * body.com + tool[1:]) / mass,
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

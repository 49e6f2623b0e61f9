"""Masses that a recording found: those of the tool at the flange, and of the arm by one factor."""

from __future__ import annotations

from dataclasses import dataclass, replace

from cell.arrays import Array
from cell.descriptions import Cell, Link


@dataclass(frozen=True, eq=False)
class Payload:
    """The tool that the flange carries, plate and all, and the arm beside its file."""

    mass: float  # [kg]
    com: Array  # (3,) [m] centre of mass, robot flange frame
    arm: float = 1.0  # masses of the arm's links over those of the robot's file


def with_payload(cell: Cell, payload: Payload) -> Cell:
    """The cell with these masses; the tool keeps the inertia of the plate about its own centre."""
    body = Link(payload.mass, payload.com, cell.plate.body.inertia)
    links = cell.robot.required("links")
    scaled = tuple(
        Link(payload.arm * link.mass, link.com, payload.arm * link.inertia) for link in links
    )
    return replace(
        cell, plate=replace(cell.plate, body=body), robot=replace(cell.robot, links=scaled)
    )

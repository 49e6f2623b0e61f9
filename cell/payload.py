"""Masses that a recording found: those of the tool at the flange, and of the arm's links."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell, Link


@dataclass(frozen=True, eq=False)
class Payload:
    """The tool that the flange carries, plate and all, and the arm beside its file."""

    mass: float  # [kg]
    com: Array  # (3,) [m] centre of mass, robot flange frame
    arm: float = 1.0  # masses of the arm's links over those of the robot's file
    # By how much each of links 1..J deviates beside that: its mass, relative, and its centre
    # x, y, z [m] in the frame of the file; none where the links are taken as the file has them
    links: tuple[tuple[float, float, float, float], ...] = ()


def with_payload(cell: Cell, payload: Payload) -> Cell:
    """The cell with these masses; the tool keeps the inertia of the plate about its own centre."""
    body = Link(payload.mass, payload.com, cell.plate.body.inertia)
    base, *links = cell.robot.required("links")
    every = payload.links or ((0.0, 0.0, 0.0, 0.0),) * len(links)
    changed = [_scaled(base, payload.arm, np.zeros(3))]
    changed += [
        _scaled(link, payload.arm + mass, np.array(centre))
        for link, (mass, *centre) in zip(links, every, strict=True)
    ]
    return replace(
        cell, plate=replace(cell.plate, body=body), robot=replace(cell.robot, links=tuple(changed))
    )


def _scaled(link: Link, factor: float, shift: Array) -> Link:
    return Link(factor * link.mass, link.com + shift, factor * link.inertia)

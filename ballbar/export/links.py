"""Rigid links joined to one body."""

from __future__ import annotations

import numpy as np

from cell.descriptions import Link


def joined_link(links: list[Link]) -> Link:
    """Several rigid links, given in one frame, as one."""
    mass = sum(link.mass for link in links)
    com = sum((link.mass * link.com for link in links), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for link in links:
        arm = link.com - com
        inertia += link.inertia + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Link(mass, com, inertia)

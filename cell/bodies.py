"""Mass properties of the links in the frames that turn with their joints, for dynamic models.

Descriptions state centres of mass and inertias in a base frame with all joint angles zero. Body i
turns with joint i, so its frame is that of DH row i-1 at zero.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.descriptions import Cell, Link, Robot
from ballbar.cell.geometry import nominal_chain


def link_bodies(robot: Robot) -> list[Link]:
    """Links 1..J of a robot, each in the frame that turns with its joint."""
    return _local(nominal_chain(robot), robot.required("links")[1:])


def carried_bodies(cell: Cell) -> list[list[Link]]:
    """Links of each robot joint, the plate with the last, in frames that turn with the joints."""
    rotation, flange = flange_on_last_link(cell)
    plate = cell.plate.body
    inertia = rotation @ plate.inertia @ rotation.T
    on_last = Link(plate.mass, flange + rotation @ plate.com, inertia)
    bodies = [[link] for link in link_bodies(cell.robot)]
    bodies[-1].append(on_last)
    return bodies


def bar_bodies(cell: Cell) -> list[Link]:
    """Links 1..5 of the ball-bar, each in the frame that turns with its joint."""
    bar = cell.ballbar
    return _local(Chain(bar.a, bar.d, bar.alpha, bar.theta, np.zeros(5)), bar.links)


def joined_link(links: list[Link]) -> Link:
    """Several rigid links, given in one frame, as one; inertias by the parallel-axis theorem."""
    mass = sum(link.mass for link in links)
    com = sum((link.mass * link.com for link in links), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for link in links:
        arm = link.com - com
        inertia += link.inertia + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Link(mass, com, 0.5 * (inertia + inertia.T))


def link_rotations(robot: Robot) -> list[Array]:
    """Rotations (3, 3) of links 1..J: columns are the axes of the frame that turns with the joint,
    in the frame of the robot's file.
    """
    frames = forward(nominal_chain(robot), np.zeros((1, robot.joints)))
    return [frames.rotation(i)[:, :, 0] for i in range(robot.joints)]


def flange_on_last_link(cell: Cell) -> tuple[Array, Array]:
    """Pose of the nominal flange in the frame that turns with the last joint.

    Returns its rotation (3, 3) and translation (3,) [m].
    """
    frames = forward(nominal_chain(cell.robot), np.zeros((1, cell.robot.joints)))
    turned = frames.rotation(-2)[:, :, 0].T
    offset = frames.origin[-1, :, 0] - frames.origin[-2, :, 0]
    return turned @ frames.rotation()[:, :, 0], turned @ offset


def _local(chain: Chain, links: tuple[Link, ...]) -> list[Link]:
    frames = forward(chain, np.zeros((1, chain.rows)))
    out = []
    for i, link in enumerate(links):
        rotation = frames.rotation(i)[:, :, 0].T
        com = rotation @ (link.com - frames.origin[i, :, 0])
        out.append(Link(link.mass, com, rotation @ link.inertia @ rotation.T))
    return out

"""Mass properties in the frames that turn with their joints: what a plant or a dynamic model needs.

Descriptions give centres of mass and inertias in a base frame with all joints at zero. Body i turns with joint i, so its
frame is that of DH row i-1 at zero.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.chain import Chain, forward
from cell.descriptions import Cell, Link


def robot_bodies(cell: Cell) -> list[Link]:
    """Links 1..6 of the robot, each in the frame that turns with its joint."""
    return _local(_robot_chain(cell), cell.robot.links[1:])


def carried_bodies(cell: Cell) -> list[list[Link]]:
    """Links 1..6 of the robot and, on the sixth, the plate; each in the frame that turns with its joint."""
    rotation, flange = flange_on_link6(cell)
    plate = cell.plate.body
    on_link6 = Link(
        plate.mass, flange + rotation @ plate.com, rotation @ plate.inertia @ rotation.T
    )
    bodies = [[link] for link in robot_bodies(cell)]
    bodies[5].append(on_link6)
    return bodies


def bar_bodies(cell: Cell) -> list[Link]:
    """Links 1..5 of the ball-bar, each in the frame that turns with its joint."""
    bar = cell.ballbar
    return _local(Chain(bar.a, bar.d, bar.alpha, bar.theta, np.zeros(5)), bar.links)


def flange_on_link6(cell: Cell) -> tuple[Array, Array]:
    """(rotation (3, 3), translation (3,) [m]) of the nominal flange in the frame that turns with joint 6."""
    frames = forward(_robot_chain(cell), np.zeros((1, 6)))
    turned = frames.rotation(5)[:, :, 0].T
    return turned @ frames.rotation(6)[:, :, 0], turned @ (
        frames.origin[6, :, 0] - frames.origin[5, :, 0]
    )


def _robot_chain(cell: Cell) -> Chain:
    robot = cell.robot
    return Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(6))


def _local(chain: Chain, links: tuple[Link, ...]) -> list[Link]:
    frames = forward(chain, np.zeros((1, chain.rows)))
    out = []
    for i, link in enumerate(links):
        rotation = frames.rotation(i)[:, :, 0].T
        out.append(
            Link(
                link.mass,
                rotation @ (link.com - frames.origin[i, :, 0]),
                rotation @ link.inertia @ rotation.T,
            )
        )
    return out

"""Mass properties in the frames where both the MuJoCo model and the statics solver need them.

Descriptions give centres of mass and inertias in a base frame with all joints at zero. Body i turns with joint i, so its
frame is that of DH row i-1 at zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.chain import Array, Chain, cross, forward
from cell.descriptions import Cell, Link


@dataclass(frozen=True, eq=False)
class MovingBodies:
    """Bodies of one chain, each in the frame that turns with its joint."""

    links: tuple[tuple[Link, ...], ...]  # one entry a joint: everything that joint carries directly


def robot_bodies(cell: Cell) -> MovingBodies:
    """Links 1..6 of the robot; the offset plate rides on link 6."""
    robot = cell.robot
    chain = Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(6))
    rows = [[link] for link in _local(chain, robot.links[1:])]
    frames = forward(chain, np.zeros((1, 6)))
    on_flange = (frames.rotation(5)[:, :, 0].T @ frames.rotation(6)[:, :, 0], frames.origin[6, :, 0] - frames.origin[5, :, 0])
    rows[5].append(_placed(cell.plate.body, on_flange[0], frames.rotation(5)[:, :, 0].T @ on_flange[1]))
    return MovingBodies(tuple(tuple(row) for row in rows))


def bar_bodies(cell: Cell) -> MovingBodies:
    """Links 1..5 of the ball-bar."""
    bar = cell.ballbar
    chain = Chain(bar.a, bar.d, bar.alpha, bar.theta, np.zeros(5))
    return MovingBodies(tuple((link,) for link in _local(chain, bar.links)))


def _local(chain: Chain, links: tuple[Link, ...]) -> list[Link]:
    frames = forward(chain, np.zeros((1, chain.rows)))
    out = []
    for i, link in enumerate(links):
        rotation = frames.rotation(i)[:, :, 0].T
        out.append(_placed(link, rotation, -rotation @ frames.origin[i, :, 0]))
    return out


def _placed(link: Link, rotation: Array, translation: Array) -> Link:
    """The link seen from a frame in which its own frame stands at (rotation, translation)."""
    return Link(link.mass, rotation @ link.com + translation, rotation @ link.inertia @ rotation.T)


def gravity_load(turning: Array, origins: Array, axes: Array, bodies: MovingBodies, gravity: Array) -> Array:
    """(J, N) [N m/rad] derivative of the potential energy with respect to the joint angles.

    turning : (J, 3, 3, N) frames that turn with each joint; origins : (J, 3, N) [m] points on the joint axes;
    axes : (J, 3, N). A joint feels all the weight behind it.
    """
    joints, _, n = origins.shape
    gradient = np.zeros((joints, n))
    for i, links in enumerate(bodies.links):
        for link in links:
            com = origins[i] + np.einsum("abn,b->an", turning[i], link.com)
            for j in range(i + 1):
                gradient[j] -= link.mass * gravity @ cross(axes[j], com - origins[j])
    return gradient

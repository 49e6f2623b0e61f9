"""How the torques at the gears change with the masses of tool, arm and links."""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.bodies import carried_bodies, flange_on_last_link, link_rotations
from cell.chain import Frames
from cell.descriptions import Cell, Link
from cell.dynamics import torques_of_each
from cell.payload import TOOL

ARM = TOOL  # row of the whole arm's factor; the links' rows follow
NEAR = 0.01  # [m] between the point masses that give a first moment


def mass_columns(
    cell: Cell,
    frames: Frames,
    q: Array,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> Array:
    """(5 + 4 J, J, N) [N m] torque at the gears' outputs of tool, arm and links.

    Per kg and kg m of the tool in the flange's frame; of the whole arm; of each link, and per metre
    of its centre.

    frames : of the robot at joint angles q (N, J) [rad]. speed, acceleration : (N, J) of the gears'
        outputs [rad/s], [rad/s^2]; none of a robot at rest.
    """
    robot = cell.robot
    last = robot.joints - 1
    rotation, flange = flange_on_last_link(cell)
    links = [bodies[0] for bodies in carried_bodies(cell)]
    bodies = list(enumerate(links))
    bodies += [(last, body) for body in _points(1.0, flange, rotation.T)]
    for joint, (link, axes) in enumerate(zip(links, link_rotations(robot), strict=True)):
        bodies += [(joint, body) for body in _points(link.mass, link.com, axes)]
    at_joints = torques_of_each(
        frames,
        bodies,
        q,
        gravity=robot.gravity,
        speed=None if speed is None else speed @ robot.gear_to_joint,
        acceleration=None if acceleration is None else acceleration @ robot.gear_to_joint,
    )
    whole, points = np.split(np.einsum("gj,bjn->bgn", robot.gear_to_joint, at_joints), [last + 1])
    here, *moved = np.moveaxis(points.reshape(-1, 4, *points.shape[1:]), 1, 0)
    moment = (np.stack(moved, axis=1) - here[:, None]) / NEAR
    of_links = np.concatenate((whole[:, None], moment[1:]), axis=1)
    return np.concatenate(
        (here[:1], moment[0], whole.sum(axis=0)[None], of_links.reshape(-1, *whole.shape[1:]))
    )


def _points(mass: float, com: Array, axes: Array) -> list[Link]:
    """A point mass, and the same a little off along each of three axes (3, 3), one a row."""
    return [Link(mass, at, np.zeros((3, 3))) for at in (com, *(com + NEAR * axes))]

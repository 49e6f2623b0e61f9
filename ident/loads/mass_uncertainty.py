"""Uncertainty of the masses that a fit takes as given, and the torques that they make.

A vector of deviations holds the tool's mass [kg] and first moment [kg m] in the flange's frame,
then of each link its relative mass and its centre [m] (cell.payload.with_deviations). Files state
links to a few percent and millimetres, tools less well; a torque log says more
(ballbar.ident.loads.payload). Of the many deviations only those matter that change a gear's load, a
third or so of them.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import carried_bodies, flange_on_last_link, link_rotations
from ballbar.cell.chain import Frames, forward
from ballbar.cell.descriptions import Cell, Link
from ballbar.cell.dynamics import torques_of_each
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.payload import TOOL, with_deviations
from ballbar.cell.robot_angles import controller_to_joints

LINK_PRIOR, CENTRE_PRIOR = 0.02, 3e-3  # of a link's mass; [m] of its centre; assumed
# The same of the tool, with the hoses, cables and adapters that no file states
TOOL_PRIOR, TOOL_CENTRE_PRIOR = 0.1, 5e-3
LEFT_OUT = 3e-3  # of the variance of the loads that directions left out may have
POSES, _SEED = 40, 7  # at which loads are compared
ARM = TOOL  # row of the whole arm's factor; the links' rows follow
NEAR = 0.01  # [m] between the point masses that give a first moment


def stated_covariance(cell: Cell) -> Array:
    """(4 + 4 J, 4 + 4 J) of the deviations of a cell's bodies from its files."""
    link = [LINK_PRIOR, *[CENTRE_PRIOR] * 3]
    factor = block_diag(stated_tool(cell), np.diag(link * cell.robot.joints))
    return np.asarray(factor @ factor.T)


def stated_tool(cell: Cell) -> Array:
    """(4, 4) [kg, kg m] independent deviations of the tool from its file, one a column."""
    body = cell.plate.body
    factor = body.mass * np.eye(4)
    factor[1:, 0] = body.mass * body.com  # a heavier tool has its moment with it
    return np.asarray(factor * np.array([TOOL_PRIOR, *[TOOL_CENTRE_PRIOR] * 3]))


def deviated_cells(cell: Cell, covariance: Array) -> tuple[Cell, ...]:
    """Cells whose masses deviate by one standard deviation in each of some directions.

    The directions are independent, and together they make up the covariance (4 + 4 J, 4 + 4 J) as
    far as the loads of the gears depend on it. None for a robot without stated masses.
    """
    if cell.robot.links is None:
        return ()
    values, vectors = np.linalg.eigh(covariance)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    robot, rng = cell.robot, np.random.default_rng(_SEED)
    axes = rng.uniform(robot.accuracy_lower, robot.accuracy_upper, (POSES, robot.joints))
    q = controller_to_joints(robot, axes)
    columns = mass_columns(cell, forward(nominal_chain(robot), q), q)
    changes = np.einsum("pjn,pd->djn", np.delete(columns, ARM, axis=0), factor)
    spread = np.sqrt((changes**2).sum(axis=(0, 2)))  # every gear that carries counts equally
    changes /= np.where(spread > 0.0, spread, 1.0)[:, None]
    turned, sizes, _ = np.linalg.svd(changes.reshape(len(changes), -1), full_matrices=False)
    beyond = 1.0 - np.cumsum(sizes**2) / (sizes**2).sum()
    count = int(np.argmax(beyond < LEFT_OUT)) + 1
    return tuple(with_deviations(cell, c) for c in (factor @ turned[:, :count]).T)


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

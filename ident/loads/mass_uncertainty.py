"""Uncertainty of the masses that a fit takes as given.

A vector of deviations holds the tool's mass [kg] and first moment [kg m] in the flange's frame,
then of each link its relative mass and its centre [m] (cell.payload.with_deviations). Files state
links to a few percent and millimetres, tools less well; a torque log says more
(ident.loads.payload). Of the many deviations only those matter that change a gear's load, a third
or so of them.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.chain import forward
from cell.descriptions import Cell
from cell.geometry import nominal_chain
from cell.payload import with_deviations
from cell.robot_angles import controller_to_joints
from ident.loads.mass_columns import ARM, mass_columns

LINK_PRIOR, CENTRE_PRIOR = 0.02, 3e-3  # of a link's mass; [m] of its centre; assumed
# The same of the tool, with the hoses, cables and adapters that no file states
TOOL_PRIOR, TOOL_CENTRE_PRIOR = 0.1, 5e-3
LEFT_OUT = 3e-3  # of the variance of the loads that directions left out may have
POSES, _SEED = 40, 7  # at which loads are compared


def stated_covariance(cell: Cell) -> Array:
    """(4 + 4 J, 4 + 4 J) of the deviations of a cell's bodies from its files."""
    body, joints = cell.plate.body, cell.robot.joints
    factor = np.eye(4 + 4 * joints)
    factor[0, 0] = body.mass
    factor[1:4, 0] = body.mass * body.com  # a heavier tool has its moment with it
    factor[1:4, 1:4] = body.mass * np.eye(3)
    link = [LINK_PRIOR, *[CENTRE_PRIOR] * 3]
    factor *= np.array([TOOL_PRIOR, *[TOOL_CENTRE_PRIOR] * 3, *link * joints])
    return factor @ factor.T


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

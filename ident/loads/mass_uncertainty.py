"""What is not known of the masses that a fit takes as given: their covariance.

A vector of deviations holds the tool's mass [kg] and first moment [kg m] in the flange's frame,
then of each link its relative mass and its centre [m] (cell.payload.with_deviations). Files state
masses to a few percent and centres to millimetres; a torque log says more (ident.loads.payload).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.payload import with_deviations

LINK_PRIOR, CENTRE_PRIOR = 0.02, 3e-3  # of a body's mass; [m] of its centre; assumed
NEGLIGIBLE = 1e-12  # of the largest variance, units as they are: rounding


@dataclass(frozen=True, eq=False)
class UncertainMasses:
    """A cell whose masses are the means, and how they may deviate."""

    cell: Cell
    covariance: Array  # (4 + 4 J, 4 + 4 J) of the deviations

    def deviated(self) -> list[Cell]:
        """Cells that deviate by one standard deviation each, in independent directions."""
        values, vectors = np.linalg.eigh(self.covariance)
        return [
            with_deviations(self.cell, np.sqrt(value) * vector)
            for value, vector in zip(values, vectors.T, strict=True)
            if value > NEGLIGIBLE * values[-1]
        ]


def stated_masses(cell: Cell) -> UncertainMasses:
    """The masses of the files, as far as files are to be trusted."""
    return UncertainMasses(cell, stated_covariance(cell))


def stated_covariance(cell: Cell) -> Array:
    """(4 + 4 J, 4 + 4 J) of the deviations of a cell's bodies from its files."""
    body, joints = cell.plate.body, cell.robot.joints
    tool = np.zeros((4, 4))  # a mass brings its moment along
    tool[0, 0] = body.mass
    tool[1:, 0] = body.mass * body.com
    tool[1:, 1:] = body.mass * np.eye(3)
    factor = np.eye(4 + 4 * joints)
    factor[:4, :4] = tool
    factor *= np.array([LINK_PRIOR, *[CENTRE_PRIOR] * 3] * (1 + joints))
    return factor @ factor.T

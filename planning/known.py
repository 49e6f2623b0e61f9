"""Information of results about a machine, from which the prediction of the next path starts.

The information of a result is the inverse of its stated covariance. It holds the priors of the
identification once; so does that of every other result of the machine, and they count once:

    N = sum_k C_k^-1 - (K - 1) P^-1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import parameter_table
from ballbar.ident.corrections import correction_of_result
from ballbar.ident.corrections.base import Correction
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.priors import priors
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.result import Machine

# Of the prior of an unknown that the results took as exact: far below what data could tell.
EXACT_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class Stated:
    """Covariance of the machine's unknowns that one result states."""

    names: tuple[str, ...]
    covariance: Array  # (U, U) [SI]


@dataclass(frozen=True, eq=False)
class Known:
    """Information of the results of one machine; passes between processes."""

    results: tuple[Stated, ...]
    corrections: dict[str, tuple[str, ...]]  # names of the coefficients of each
    excess: ExcessNoise  # of the first result

    def corrections_with(self, cell: Cell, encoders: tuple[int, ...]) -> tuple[Correction, ...]:
        """The corrections for a ball-bar with these encoders."""
        return tuple(
            correction_of_result(name, coefficients, cell, encoders)
            for name, coefficients in self.corrections.items()
        )

    def normal(self, layout: Unknowns, cell: Cell) -> Array:
        """(P, P) information about the unknowns of a prediction, with the priors of all others.

        Parameters of the robot that no result names were taken as exact, and are.
        """
        table, first = parameter_table(cell.robot), layout.shared.size
        identified = layout.sigma.copy()  # priors that the results hold already
        identified[:first] = priors(cell, table, layout.shared)
        normal = np.diag(layout.sigma**-2.0)
        named: set[str] = set()
        for k, result in enumerate(self.results):
            shared = [n for n in result.names if n in layout.names]
            rows = np.array([layout.names.index(name) for name in shared])
            stated = [result.names.index(name) for name in shared]
            information = inverse(result.covariance[np.ix_(stated, stated)])
            added = information - np.diag(identified[rows] ** -2.0)
            units = np.sqrt(np.diag(information))
            normal[np.ix_(rows, rows)] += added if k == 0 else _positive(added, units)
            named |= set(shared)
        for i in range(first):
            on_robot = table.parameters[layout.shared[i]].side == "robot"
            if on_robot and layout.names[i] not in named:
                normal[i, i] = (EXACT_SHARE * layout.sigma[i]) ** -2.0
        return normal


def _positive(information: Array, units: Array) -> Array:
    """(P, P) information without directions of which a result states less than its priors."""
    values, vectors = np.linalg.eigh(information / np.outer(units, units))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(units, units))


def known_of(machines: Sequence[Machine]) -> Known:
    """The information of some results of one robot, ball-bar and plate."""
    corrections = [c for m in machines for c in m.robot.corrections]
    return Known(
        results=tuple(Stated(m.names, m.covariance) for m in machines),
        corrections={c.name: tuple(k.name for k in c.coefficients) for c in reversed(corrections)},
        excess=machines[0].excess,
    )

"""Periodic joint errors found by evidence: so many cycles a turn of a joint.

The names of the coefficients (`joint2_17_cos`) hold the orders, so that a calibration file tells
all that is needed to form the correction again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade

# [rad] of each amplitude; 2e-4 gives the same (docs/real_robots, orders)
PRIOR = 3e-4
WAVES = {"cos": np.cos, "sin": np.sin}
JOINT_HARMONICS = "joint_harmonics"
_COEFFICIENT = re.compile(r"joint([1-9]\d*)_(\d+(?:\.\d+)?)_(?:cos|sin)")


@remade
def joint_harmonics(
    orders: Sequence[tuple[int, float]], sizes: Mapping[tuple[int, float], float] | None = None
) -> Correction:
    """Cosine and sine amplitudes [rad] of each pair of joint (from 0) and order.

    sizes : [rad] standard deviations of some, where it is known what to expect.
    """
    terms = [(joint, order, wave) for joint, order in orders for wave in WAVES]

    def regressors(state: State) -> list[Array]:
        return [WAVES[wave](order * state.gears[joint]) for joint, order, wave in terms]

    coefficients = tuple(
        Coefficient(
            f"{harmonic_name(joint, order)}_{wave}",
            "rad",
            0.0,
            (sizes or {}).get((joint, order), PRIOR),
            GEAR + joint,
        )
        for joint, order, wave in terms
    )
    return Correction(JOINT_HARMONICS, "errors of the joints", coefficients, regressors)


def harmonic_name(joint: int, order: float) -> str:
    """Common beginning of the names of both coefficients of a joint, from 0, and an order."""
    return f"joint{joint + 1}_{order:.10g}"


def orders_of(names: Iterable[str]) -> list[tuple[int, float]]:
    """Joint, from 0, and order of every pair of coefficients, by their names.

    Raises InputError for a name that is none of this correction's.
    """
    orders: list[tuple[int, float]] = []
    for name in names:
        parts = _COEFFICIENT.fullmatch(name)
        if parts is None:
            raise InputError(
                f"corrections.{JOINT_HARMONICS}.{name}: expected joint2_17_cos or similar"
            )
        pair = (int(parts[1]) - 1, float(parts[2]) if "." in parts[2] else int(parts[2]))
        if pair not in orders:
            orders.append(pair)
    return orders

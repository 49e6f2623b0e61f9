"""Columns of the masses against the weight of bodies that deviate."""

from __future__ import annotations

import numpy as np

from cell.chain import forward
from cell.geometry import nominal_chain
from cell.payload import with_deviations
from ident.loads.gear_loads import mass_model, own_weight
from ident.loads.mass_columns import ARM, mass_columns
from tests.helpers.synthetic_recording import CELL, NOMINAL, minute

Q = minute().q[::40]
STEP = 1e-4  # [kg], [kg m], [-], [m]


def test_columns_are_what_the_weight_changes_by() -> None:
    columns = mass_columns(CELL, forward(nominal_chain(CELL.robot), Q), Q)
    here = own_weight(mass_model(CELL), NOMINAL, Q).gear
    each = np.delete(columns, ARM, axis=0)
    for number, step in enumerate(STEP * np.eye(len(each))):
        there = own_weight(mass_model(with_deviations(CELL, step)), NOMINAL, Q).gear
        change = (there - here) / STEP
        np.testing.assert_allclose(each[number], change, rtol=1e-5, atol=1e-5)


def test_the_arm_is_its_links_together() -> None:
    columns = mass_columns(CELL, forward(nominal_chain(CELL.robot), Q), Q)
    np.testing.assert_allclose(columns[ARM], columns[ARM + 1 :: 4].sum(axis=0), atol=1e-9)

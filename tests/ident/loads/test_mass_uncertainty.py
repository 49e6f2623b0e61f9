"""Which masses a cell's files leave open, and how they act on the gears."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.payload import with_deviations
from ballbar.ident.loads.gear_loads import mass_model, own_weight
from ballbar.ident.loads.mass_uncertainty import (
    ARM,
    CENTRE_PRIOR,
    LINK_PRIOR,
    TOOL_CENTRE_PRIOR,
    TOOL_PRIOR,
    deviated_cells,
    mass_columns,
    stated_covariance,
)
from tests.helpers.synthetic_recording import CELL, NOMINAL, minute

Q = minute().q[::40]


def weight(cell: Cell) -> Array:
    return own_weight(mass_model(cell), NOMINAL, Q).gear


def test_a_heavier_tool_keeps_its_centre() -> None:
    body = CELL.plate.body
    cell = with_deviations(CELL, np.concatenate(([0.5, *(0.5 * body.com)], np.zeros(24))))
    assert cell.plate.body.mass == pytest.approx(body.mass + 0.5)
    assert cell.plate.body.com == pytest.approx(body.com)


def test_the_stated_covariance_is_that_of_drawn_bodies() -> None:
    """Each mass and each coordinate of a centre is drawn by itself."""
    body, rng = CELL.plate.body, np.random.default_rng(3)
    drawn = []
    for _ in range(4000):
        mass = body.mass * (1.0 + TOOL_PRIOR * rng.standard_normal())
        com = body.com + TOOL_CENTRE_PRIOR * rng.standard_normal(3)
        drawn.append([mass - body.mass, *(mass * com - body.mass * body.com)])
    covariance = stated_covariance(CELL)
    sigma = np.sqrt(np.diag(covariance)[:4])
    # a correlation of 4000 draws scatters by 1.6 %
    assert np.cov(np.transpose(drawn)) / np.outer(sigma, sigma) == pytest.approx(
        covariance[:4, :4] / np.outer(sigma, sigma), abs=0.08
    )
    links = np.diag(covariance)[4:].reshape(6, 4)
    assert np.sqrt(links) == pytest.approx(np.tile([LINK_PRIOR, *[CENTRE_PRIOR] * 3], (6, 1)))


def test_few_directions_hold_the_variance_of_the_loads() -> None:
    """At poses that the directions were not chosen by; gear 1 carries no weight."""
    factor, before = np.linalg.cholesky(stated_covariance(CELL)), weight(CELL)
    every = [weight(with_deviations(CELL, column)) - before for column in factor.T]
    directions = deviated_cells(CELL, stated_covariance(CELL))
    some = [weight(cell) - before for cell in directions]
    assert len(directions) < 14
    kept, whole = (np.square(each).sum(axis=(0, 2))[1:] for each in (some, every))
    assert kept / whole == pytest.approx(np.ones(5), abs=0.03)


def test_a_robot_without_stated_masses_has_none_to_deviate() -> None:
    bare = replace(CELL, robot=replace(CELL.robot, links=None))
    assert deviated_cells(bare, stated_covariance(CELL)) == ()


PATH = minute().q[::40]
STEP = 1e-4  # [kg], [kg m], [-], [m]


def test_columns_are_what_the_weight_changes_by() -> None:
    columns = mass_columns(CELL, forward(nominal_chain(CELL.robot), PATH), PATH)
    here = own_weight(mass_model(CELL), NOMINAL, PATH).gear
    each = np.delete(columns, ARM, axis=0)
    for number, step in enumerate(STEP * np.eye(len(each))):
        there = own_weight(mass_model(with_deviations(CELL, step)), NOMINAL, PATH).gear
        change = (there - here) / STEP
        np.testing.assert_allclose(each[number], change, rtol=1e-5, atol=1e-5)


def test_the_arm_is_its_links_together() -> None:
    columns = mass_columns(CELL, forward(nominal_chain(CELL.robot), PATH), PATH)
    np.testing.assert_allclose(columns[ARM], columns[ARM + 1 :: 4].sum(axis=0), atol=1e-9)

"""Docstrings of public array functions: enough of them state shape and unit, and we can tell."""

from __future__ import annotations

import pytest

from tests.project.array_docstrings import PACKAGES, SHAPE, SHAPE_TARGET, UNIT, UNIT_TARGET, shares


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_enough_public_array_functions_state_shape_and_unit(package: str) -> None:
    count, shape, unit = shares(package)
    assert shape >= SHAPE_TARGET, f"{shape:.0%} of {count} functions"
    assert unit >= UNIT_TARGET, f"{unit:.0%} of {count} functions"


@pytest.mark.parametrize(
    ("text", "shape", "unit"),
    [
        ("q : (N, 6) [rad] joint angles.", True, True),
        ("Returns (..., 3, N) angular velocities [rad/s].", True, True),
        ("Returns (P [+ 2], M) whitened columns, dimensionless.", True, True),
        ("Stiffness (6,) [N m/rad] and compliance (6,) [1/rad].", True, True),
        ("Mean pose error (K / STRIDE,) [m, rad].", True, True),
        ("An array (whole, or not) of values[0].", False, False),
        ("See the paper [1] and the table (a, b).", False, False),
    ],
)
def test_shapes_and_units_are_told_from_other_brackets(text: str, shape: bool, unit: bool) -> None:
    assert bool(SHAPE.search(text)) == shape
    assert bool(UNIT.search(text)) == unit

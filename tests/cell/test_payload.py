"""Masses that a user states for what the flange carries."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.load import load_cell
from ballbar.cell.payload import Payload, payload_of, with_payload


@pytest.mark.parametrize(
    ("mass", "com", "said"),
    [
        (-5.0, [0.0, 0.0, 0.1], "mass -5 kg: expected a finite mass, 0 or more"),
        (np.nan, [0.0, 0.0, 0.1], "mass nan kg: expected a finite mass"),
        (np.inf, [0.0, 0.0, 0.1], "mass inf kg: expected a finite mass"),
        (5.0, [0.0, 0.0, 100.0], r"is 100 m from the flange, .* metres: 100 mm are 0.1"),
        (5.0, [0.0, np.nan, 0.1], r"centre of mass \[0, nan, 0.1\]: expected three finite numbers"),
        (5.0, [0.0, 0.1], r"centre of mass \[0, 0.1\]: expected three finite numbers"),
    ],
)
def test_a_payload_that_no_robot_carries_is_refused(
    mass: float, com: list[float], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        Payload(mass, np.array(com))


def test_an_empty_flange_has_its_centre_where_it_was_stated() -> None:
    """The moment of no mass is none: 0 / 0 made every uncertainty NaN."""
    cell, com = load_cell("irb2400", "lund_600", "plate_250"), np.array([0.1, 0.0, 0.2])
    empty = payload_of(with_payload(cell, Payload(0.0, com)), np.zeros(28))
    assert empty.mass == 0.0
    assert np.array_equal(empty.com, com)

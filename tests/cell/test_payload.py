"""Masses that a user states for what the flange carries."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.load import load_cell
from ballbar.cell.payload import (
    TOOL,
    Payload,
    deviations_between,
    payload_of,
    with_deviations,
    with_payload,
)


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


def test_the_deviations_of_a_cell_are_those_that_it_was_made_with() -> None:
    """Mass and first moment of the tool; share of mass and centre of each moving link."""
    cell = load_cell("irb2400", "lund_600", "plate_250")
    deviations = 0.02 * np.random.default_rng(5).uniform(-1.0, 1.0, TOOL + 24)
    other = with_deviations(cell, deviations)
    assert deviations_between(cell, other) == pytest.approx(deviations, abs=1e-14)
    assert not deviations_between(cell, cell).any()
    body, changed = cell.plate.body, other.plate.body
    assert changed.mass == pytest.approx(body.mass + deviations[0])
    assert changed.mass * changed.com == pytest.approx(body.mass * body.com + deviations[1:4])
    for k, (here, there) in enumerate(
        zip(cell.robot.required("links"), other.robot.required("links"), strict=True)
    ):
        own = deviations[TOOL:].reshape(6, 4)[k - 1] if k else np.zeros(4)
        assert there.mass == pytest.approx(here.mass * (1.0 + own[0]))
        assert there.com == pytest.approx(here.com + own[1:])
        assert there.inertia == pytest.approx(here.inertia * (1.0 + own[0]))

"""Compliance and backlash of gears that no file states: their law, and priors of typical ones."""

from __future__ import annotations

import numpy as np
import pytest

from cell.load import load_cell
from cell.typical_machine import with_typical
from ident.corrections.base import BEHIND_GEARS, GEAR, State, backlash_transition
from ident.corrections.typical_gears import SPREAD, typical_backlash, typical_compliance
from ident.loads.gear_loads import BEARINGS, Loads

CELL = load_cell("ur10e", "lund_600", "plate_250")
GEARS = with_typical(CELL.robot)[0].required("gears")
N = 7


def under(load: float, per_newton: float, tension: float) -> State:
    """Six gears under one load [N m] and [m] per newton of the rod's tension [N], N times."""
    still = np.zeros((6, N))
    return State(
        t=np.arange(float(N)),
        recording=0,
        gears=still,
        bar=np.zeros((BEHIND_GEARS - 2, N)),
        loads=Loads(
            gear=np.full((6, N), load),
            gear_per_newton=np.full((6, N), per_newton),
            plate=np.zeros(N),
            plate_per_newton=np.zeros(N),
            bearing=np.zeros((BEARINGS, 2, N)),
            bearing_per_newton=np.zeros((BEARINGS, 2, N)),
        ),
        tension=np.full(N, tension),
        width=backlash_transition(CELL.robot),
        gear_speed=still,
        gear_acceleration=still,
    )


def test_the_robot_states_no_gears() -> None:
    """Or the next tests would be of gears that are known."""
    assert CELL.robot.gears is None


def test_a_gear_yields_against_its_load_the_tension_included() -> None:
    made = typical_compliance(CELL, ())
    rows = np.array(made.regressors(under(20.0, 0.4, -5.0)))
    assert rows == pytest.approx(np.full((6, N), -18.0))
    for i, c in enumerate(made.coefficients):
        assert (c.name, c.channel) == (f"typical_compliance{i + 1}", GEAR + i)
        assert c.mean == pytest.approx(1.0 / GEARS.stiffness[i])
        assert c.sigma == pytest.approx(SPREAD / GEARS.stiffness[i])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_gear_lies_on_the_flank_that_a_large_load_chooses(side: float) -> None:
    made = typical_backlash(CELL, ())
    rows = np.array(made.regressors(under(side * 1e4, 0.0, 0.0)))
    assert rows == pytest.approx(np.full((6, N), -side), abs=1e-3)
    for i, c in enumerate(made.coefficients):
        assert (c.name, c.channel) == (f"typical_backlash{i + 1}", GEAR + i)
        assert c.mean == c.sigma == pytest.approx(0.5 * GEARS.lost_motion[i])


def test_slopes_with_the_tension_are_central_differences() -> None:
    h = 1e-3
    for made in (typical_compliance(CELL, ()), typical_backlash(CELL, ())):
        assert made.slopes is not None
        ahead, behind = (
            np.array(made.regressors(under(1.0, 0.3, 2.0 + s * h))) for s in (1.0, -1.0)
        )
        slopes = np.array(made.slopes(under(1.0, 0.3, 2.0)))
        assert slopes == pytest.approx((ahead - behind) / (2.0 * h), rel=1e-5)
        assert np.abs(slopes).min() > 0.0

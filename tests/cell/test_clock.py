"""The clock's map between the two logs."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ballbar.cell.clock import Clock


@given(st.floats(-3600.0, 3600.0), st.floats(-2e-3, 2e-3), st.floats(-3600.0, 3600.0))
def test_ballbar_time_is_the_inverse_of_robot_time(offset: float, skew: float, t: float) -> None:
    clock = Clock(offset, skew)
    # rounding of a sum of two numbers of up to 3600 s
    assert abs(clock.ballbar_time(clock.robot_time(t)) - t) < 2e-12


def test_a_clock_maps_arrays_element_by_element() -> None:
    clock = Clock(0.5, 1e-4)
    t = np.array([0.0, 10.0])
    np.testing.assert_allclose(clock.robot_time(t), [0.5, 10.501], rtol=1e-15)
    np.testing.assert_array_equal(clock.ballbar_time(t), [clock.ballbar_time(v) for v in t])

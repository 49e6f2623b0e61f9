"""Single lengths that put the tool's path on a sphere."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.causes.agreement import single_lengths
from tests.helpers.synthetic_recording import NOMINAL, minute

Q = minute(0.05).q[::5]


@pytest.mark.parametrize(
    ("name", "error"), [("ra2", 0.05), ("rd4", -0.1), ("ra6", 0.03), ("rtheta3", 0.3)]
)
def test_the_length_that_is_wrong_is_the_one_that_explains_the_path(
    name: str, error: float
) -> None:
    wrong = NOMINAL.replaced({name: NOMINAL[name] + error})
    best, second, *_ = single_lengths(wrong, Q)
    assert best.name == name
    assert best.change == pytest.approx(-error, abs=1e-6)  # exact but for the last step
    assert best.radius == pytest.approx(NOMINAL["bd3"], abs=1e-6)
    assert best.rms < 1e-3 * second.rms


def test_lengths_that_the_base_of_the_ball_bar_takes_up_are_left_out() -> None:
    names = {length.name for length in single_lengths(NOMINAL, Q)}
    assert names.isdisjoint(NOMINAL.table.gauge)
    assert {"ra1", "ra6", "rd4", "rtheta2"} <= names
    assert np.isfinite([length.rms for length in single_lengths(NOMINAL, Q)]).all()

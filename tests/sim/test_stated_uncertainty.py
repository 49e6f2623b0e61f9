"""A study of drawn robots calls stated uncertainty wrong in both directions."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.stated_uncertainty import stated_uncertainty


@pytest.mark.parametrize(
    ("ratio", "covered", "error", "intervals"),
    [(0.3, 0.99, "below", "above"), (1.0, 0.95, "within", "within"), (1.5, 0.80, "above", "below")],
)
def test_uncertainty_that_is_too_large_looks_as_wrong_as_too_small(
    ratio: float, covered: float, error: str, intervals: str
) -> None:
    said = stated_uncertainty(np.full(3, ratio), {"geometry": np.full(3, covered)})
    assert said == (
        f"error over stated, rms: {ratio:.2f} ({error} 0.8..1.2); "
        f"geometry intervals: {covered:.1%} ({intervals} 93%..97%)"
    )


def test_the_error_over_stated_is_the_rms_over_robots_and_no_median() -> None:
    assert stated_uncertainty(np.array([0.1, 0.1, 3.0]), {}) == (
        "error over stated, rms: 1.73 (above 0.8..1.2)"
    )

"""Least sizes of findings: what chance explains, and what an unchanged machine shows."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.least_sizes import LITTLE_SHIFT, WANDER_LENGTH, not_by_chance


@pytest.mark.parametrize("count", [1, 5])
def test_chance_makes_few_findings_of_values_that_are_zero(count: int) -> None:
    """One of 500 where there is one value, fewer where there are more."""
    rng = np.random.default_rng(1)
    half = np.tril(rng.standard_normal((count, count))) + 2.0 * np.eye(count)
    covariance = half @ half.T
    draws = rng.standard_normal((20000, count)) @ half.T
    found = np.mean([not_by_chance(values, covariance) for values in draws])
    assert found < 0.003


def test_values_of_many_deviations_are_not_by_chance() -> None:
    assert not_by_chance(np.array([4.0]), np.eye(1))
    assert not not_by_chance(np.array([2.0]), np.eye(1))
    # each of them within its deviation, their sum known far better and off
    together = np.array([[1.0, -0.999], [-0.999, 1.0]])
    assert not_by_chance(np.array([0.5, 0.5]), together)


def test_a_shift_that_is_named_is_no_smaller_than_what_an_unchanged_machine_shows() -> None:
    assert LITTLE_SHIFT >= WANDER_LENGTH

"""Several rigid links as one."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import joined_link
from ballbar.cell.descriptions import Link


def of_points(masses: Array, at: Array) -> Link:
    """The link of point masses (N,) [kg] at (N, 3) [m], by the definition of the inertia."""
    centre = masses @ at / masses.sum()
    arms = at - centre
    squares = masses * (arms * arms).sum(axis=1)
    return Link(masses.sum(), centre, squares.sum() * np.eye(3) - (arms.T * masses) @ arms)


def test_links_joined_have_the_mass_properties_of_all_their_points() -> None:
    rng = np.random.default_rng(7)
    masses, at = rng.uniform(0.5, 2.0, 12), rng.normal(0.0, 0.4, (12, 3))
    parts = [of_points(masses[k], at[k]) for k in (slice(0, 5), slice(5, 7), slice(7, 12))]
    joined, whole = joined_link(parts), of_points(masses, at)
    assert joined.mass == pytest.approx(whole.mass)
    assert joined.com == pytest.approx(whole.com)
    assert joined.inertia == pytest.approx(whole.inertia, abs=1e-12)

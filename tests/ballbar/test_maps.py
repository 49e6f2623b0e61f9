"""Maps: every point counts once in the cell around it, and colours follow the values."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.report.drawing import linear_ticks, shade
from ballbar.report.maps import AFTER_SCALE, Sphere, cells_of, workspace_map

WIDTH = 0.13


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 300))
def test_a_point_lies_in_the_nearest_cell_and_counts_once(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    points, values = rng.normal(size=(size, 2)), rng.uniform(0.0, 2.0, size)
    cells = cells_of(points, values, WIDTH)
    away = np.linalg.norm(points[:, None] - cells.centres, axis=2)
    nearest = away.argmin(axis=1)
    assert away.min(axis=1).max() <= WIDTH / np.sqrt(3.0) + 1e-12  # a corner of the hexagon
    means = [values[nearest == k].mean() for k in range(len(cells.centres))]
    np.testing.assert_allclose(cells.values, means, rtol=1e-12)
    between = np.linalg.norm(cells.centres[:, None] - cells.centres, axis=2)
    assert (between + 10.0 * np.eye(len(between))).min() >= WIDTH - 1e-12


def test_the_reduction_sees_all_values_of_a_cell() -> None:
    points = np.array([[0.0, 0.0], [0.01, 0.0], [1.0, 0.0], [0.0, 0.01]])
    cells = cells_of(points, np.array([1.0, 5.0, 7.0, 2.0]), WIDTH, np.max)
    assert sorted(cells.values.tolist()) == [5.0, 7.0]


def test_a_map_tells_its_values_and_marks_base_and_sphere() -> None:
    rng = np.random.default_rng(1)
    position, error = rng.uniform(-1.0, 1.0, (500, 3)), np.full(500, 2e-3)
    sphere = Sphere(np.array([0.3, 0.0, 0.5]), 0.6)
    svg = workspace_map(position, error, [sphere], label="error", colours=AFTER_SCALE)
    titles = re.findall(r"<title>([^<]*)</title>", svg)
    assert len(titles) > 100
    assert set(titles) == {"2.00 mm"}
    assert svg.count("<circle") == 4, "with a halo, from the side and from above"
    assert "error [mm]" in svg
    bare = workspace_map(position, np.zeros(500), [], label="", colours=AFTER_SCALE)
    assert "<circle" not in bare


def test_shades_run_through_the_colours_and_stop_at_the_ends() -> None:
    colours = ("#000000", "#ff0000", "#ffffff")
    shares = np.array([-1.0, 0.0, 0.25, 0.5, 1.0, 9.0])
    expected = ["#000000", "#000000", "#800000", "#ff0000", "#ffffff", "#ffffff"]
    assert shade(colours, shares) == expected


@pytest.mark.parametrize("ends", [(0.0, 4.3), (-1.0, 1.0), (0.0, 3e-5)])
def test_a_scale_has_round_numbers(ends: tuple[float, float]) -> None:
    assert 3 <= len(linear_ticks(*ends, 5)) <= 7

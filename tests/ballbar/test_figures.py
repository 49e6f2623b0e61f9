"""Figures of the report: curves, cells of the workspace and the sphere, style."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.cell.arrays import Array
from ballbar.figure_style import to_hundredths
from ballbar.report.drawing import INCH, LEFT, RIGHT, WIDTH, linear_ticks, shade
from ballbar.report.line_plot import (
    COLUMN,
    Curve,
    Distribution,
    Plot,
    cumulative,
    draw,
    order_spectra,
)
from ballbar.report.maps import AFTER_SCALE, Sphere, cells_of, workspace_map

HEIGHT = 3.0 * INCH
T = np.linspace(5.0, 115.0, 5000)


class Read(NamedTuple):
    """One curve as the script reads it: in the units of its axes."""

    name: str
    x: Array
    y: Array
    half_line: float  # [units of y, or decades] of half a hundredth of a point


def numbers(text: str) -> list[float]:
    return [float(v) for v in text.split()]


def read(svg: str) -> list[Read]:
    """Curves of a figure as templates/hover.js reads them."""
    out = []
    for plot in re.findall(r'<g class="plot".*?</g>', svg, flags=re.DOTALL):
        keys = {k: re.search(rf'data-{k}="([^"]*)"', plot) for k in ("x", "y", "log", "box")}
        x, y, log, box = (numbers(m[1]) for m in keys.values() if m)
        first, last = np.log10(x) if log[0] else np.array(x)
        low, high = np.log10(y) if log[1] else np.array(y)
        for name, path in re.findall(r'<path data-name="([^"]*)" d="([^"]*)"', plot):
            corners = re.findall(r"[ML](\S+) ([\d.]+)", path)
            points = np.array([(float(a), float(b)) for a, b in corners])
            across = first + (points[:, 0] - box[0]) / box[2] * (last - first)
            values = low + (box[1] + box[3] - points[:, 1]) / box[3] * (high - low)
            size = 0.0051 / box[3] * (high - low)
            across = 10.0**across if log[0] else across
            out.append(Read(name, across, 10.0**values if log[1] else values, size))
    return out


def test_values_at_the_cursor_are_those_that_were_drawn() -> None:
    t = np.linspace(0.0, 10.0, 40)
    (curve,) = read(
        draw([Plot([Curve(t, np.sin(t), "#000", "a")], "y")], "t", height=HEIGHT, x=(0.0, 10.0))
    )
    assert curve.name == "a"
    assert curve.x == pytest.approx(t, abs=0.05 / 260.0 * 10.0)
    assert curve.y == pytest.approx(np.sin(t), abs=curve.half_line)


def test_values_on_a_logarithmic_axis_likewise() -> None:
    t = np.linspace(0.0, 10.0, 40)
    plot = Plot([Curve(t, np.exp(t - 5.0), "#000")], "y", log=True)
    (curve,) = read(draw([plot], "t", height=HEIGHT, x=(0.0, 10.0)))
    assert np.log10(curve.y) == pytest.approx((t - 5.0) / np.log(10.0), abs=curve.half_line)


@settings(max_examples=25, deadline=None)
@given(row=st.integers(1, T.size - 2), peak=st.floats(2.0, 50.0))
def test_no_peak_of_a_long_curve_is_lost(row: int, peak: float) -> None:
    values = np.sin(T)
    values[row] = peak
    (curve,) = read(
        draw([Plot([Curve(T, values, "#000")], "y")], "t", height=HEIGHT, x=(5.0, 115.0))
    )
    assert curve.y.size < 2 * (WIDTH - LEFT - RIGHT) / COLUMN + 4
    assert curve.y.max() == pytest.approx(peak, abs=curve.half_line)
    assert abs(curve.x[curve.y.argmax()] - T[row]) < 0.1


def test_what_is_not_a_number_is_a_gap() -> None:
    y = np.array([1.0, 2.0, np.nan, 2.0, 1.0])
    svg = draw([Plot([Curve(np.arange(5.0), y, "#000")], "y")], "t", height=HEIGHT, x=(0.0, 4.0))
    (path,) = re.findall(r' d="([^"]*)"', svg)
    assert re.sub(r"[\d. ]", "", path) == "MLML"


def test_an_excerpt_shows_levels_whose_corners_lie_beyond_it() -> None:
    """A dwell that filled the excerpt had no corner in it, and the figure fell over."""
    curve = Curve(np.array([0.0, 10.0, 10.0, 90.0]), np.array([0.0, 0.0, 1.0, 1.0]), "#000")
    svg = draw([Plot([curve], "y", y=(-1.2, 1.2))], "t", height=HEIGHT, x=(40.0, 60.0))
    (shown,) = read(svg)
    assert shown.x == pytest.approx([40.0, 60.0], abs=0.01)
    assert shown.y == pytest.approx([1.0, 1.0], abs=0.01)


def test_a_curve_outside_the_excerpt_is_not_drawn() -> None:
    curve = Curve(np.array([0.0, 1.0]), np.ones(2), "#000")
    assert 'd=""' in draw([Plot([curve], "y")], "t", height=HEIGHT, x=(40.0, 60.0))


def test_hostile_names_are_text() -> None:
    curve = Curve(np.arange(3.0), np.arange(3.0), "#000", '"><script>')
    svg = draw([Plot([curve], "<b>")], "</svg>", height=HEIGHT, x=(0.0, 2.0), legend=True)
    assert "<script" not in svg
    assert svg.count("</svg>") == 1
    assert "<b>" not in svg


@pytest.mark.parametrize("ends", [(0.0, 1e-9), (-3.2e5, 4.7e5), (0.99999, 1.00001)])
def test_an_axis_has_three_round_numbers_and_more(ends: tuple[float, float]) -> None:
    curve = Curve(np.array(ends), np.zeros(2), "#000")
    svg = draw([Plot([curve], "", y=(-1.0, 1.0))], "", height=HEIGHT, x=ends)
    middle = re.findall(r'text-anchor="middle"[^>]*>([^<]+)<', svg)
    ticks = [float(text.replace("\u2212", "-")) for text in middle]
    assert 3 <= len(ticks) <= 12
    assert all(ends[0] - 1e-12 <= tick <= ends[1] + 1e-12 for tick in ticks)


def test_a_cumulative_curve_rises_at_each_value_by_its_share() -> None:
    values = np.array([4e-3, 1e-3, 2e-3, 8e-3])  # [m]
    (curve,) = read(cumulative([Distribution("a", values, "#000")], label="error"))
    assert curve.x == pytest.approx(np.repeat([1.0, 2.0, 4.0, 8.0], 2), rel=1e-3)  # [mm]
    expected = [0.0, 25.0, 25.0, 50.0, 50.0, 75.0, 75.0, 100.0]
    assert curve.y == pytest.approx(expected, abs=curve.half_line)


def test_spectra_show_the_score_of_each_order() -> None:
    before, after = np.array([[1.0, 30.0, 2.0], [0.0, 0.0, 0.0]]), np.zeros((2, 3))
    curves = read(order_spectra(before, after))
    assert [curve.name for curve in curves] == ["before", "after"] * 2
    assert curves[0].y == pytest.approx(before[0], abs=curves[0].half_line)
    assert curves[0].x == pytest.approx([0.87, 1.87, 2.87], abs=0.01)


CELL = 0.13


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 300))
def test_a_point_lies_in_the_nearest_cell_and_counts_once(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    points, values = rng.normal(size=(size, 2)), rng.uniform(0.0, 2.0, size)
    cells = cells_of(points, values, CELL)
    away = np.linalg.norm(points[:, None] - cells.centres, axis=2)
    nearest = away.argmin(axis=1)
    assert away.min(axis=1).max() <= CELL / np.sqrt(3.0) + 1e-12  # a corner of the hexagon
    means = [values[nearest == k].mean() for k in range(len(cells.centres))]
    np.testing.assert_allclose(cells.values, means, rtol=1e-12)
    between = np.linalg.norm(cells.centres[:, None] - cells.centres, axis=2)
    assert (between + 10.0 * np.eye(len(between))).min() >= CELL - 1e-12


def test_the_reduction_sees_all_values_of_a_cell() -> None:
    points = np.array([[0.0, 0.0], [0.01, 0.0], [1.0, 0.0], [0.0, 0.01]])
    cells = cells_of(points, np.array([1.0, 5.0, 7.0, 2.0]), CELL, np.max)
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


def test_coordinates_are_cut_and_what_is_written_is_not() -> None:
    svg = '<path d="M 12.3456 7.8L 0.001 3"/><text x="1.23456">0.00125 of 0.001</text>'
    cut = '<path d="M 12.34 7.8L 0.00 3"/><text x="1.23">0.00125 of 0.001</text>'
    assert to_hundredths(svg) == cut

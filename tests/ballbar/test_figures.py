"""Figures of the report: curves, cells of the workspace and the sphere, style."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from types import SimpleNamespace
from typing import NamedTuple, cast
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.cell.arrays import Array
from ballbar.figure_style import AFTER, GRID, INK, QUIET, to_hundredths
from ballbar.ident.result import NamedCovariance, Residuals
from ballbar.report.drawing import (
    INCH,
    LEFT,
    RIGHT,
    ROW,
    WIDTH,
    Axis,
    ends_of,
    figure,
    legend_lines,
    legend_rows,
    linear_ticks,
    shade,
)
from ballbar.report.line_plot import (
    COLUMN,
    Curve,
    Distribution,
    Plot,
    cumulative,
    draw,
    order_spectra,
)
from ballbar.report.maps import (
    AFTER_SCALE,
    CORRELATION_SCALE,
    Sphere,
    cells_of,
    correlation_map,
    equal_area,
    sphere_map,
    workspace_map,
)

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


class Page(NamedTuple):
    """The elements of a figure [pt]."""

    width: float
    height: float
    texts: list[tuple[str, Array, str, float, bool]]  # text, place, anchor, size, turned
    lines: list[tuple[Array, Array, str]]  # ends and colour
    circles: list[tuple[Array, float, bool]]  # centre, radius, dashed
    boxes: list[tuple[Array, Array, str]]  # corner, size, colour of rectangles
    polygons: list[tuple[Array, str, str]]  # corners, colour, title

    def named(self, text: str) -> Array:
        (place,) = [t[1] for t in self.texts if t[0] == text]
        return place

    def extents(self) -> Iterator[tuple[str, float, float, float, float]]:
        """Left, right, top and bottom of each text, letters as wide as half their size."""
        for text, place, anchor, size, turned in self.texts:
            long = 0.5 * size * len(text)
            before = {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * long
            if turned:
                yield (text, place[0] - 0.7 * size, place[0], place[1] - long + before,
                       place[1] + before)  # fmt: skip
            else:
                left = place[0] - before
                yield text, left, left + long, place[1] - 0.7 * size, place[1]


def page_of(svg: str) -> Page:
    root = ElementTree.fromstring(svg)
    width, height = (float(x) for x in root.attrib["viewBox"].split()[2:])
    page = Page(width, height, [], [], [], [], [])
    for e in root.iter():
        at = {k: float(v) for k, v in e.attrib.items() if re.fullmatch(r"-?[\d.]+", v)}
        if e.tag == "text":
            turned = "transform" in e.attrib
            place = np.array([at["x"], at["y"]])
            page.texts.append(
                (e.text or "", place, e.attrib["text-anchor"], at["font-size"], turned)
            )
        elif e.tag == "line":
            ends = np.array([at["x1"], at["y1"]]), np.array([at["x2"], at["y2"]])
            page.lines.append((*ends, e.attrib["stroke"]))
        elif e.tag == "circle":
            centre = np.array([at["cx"], at["cy"]])
            page.circles.append((centre, at["r"], "stroke-dasharray" in e.attrib))
        elif e.tag == "rect":
            corner, size = (np.array([at[a], at[b]]) for a, b in (("x", "y"), ("width", "height")))
            page.boxes.append((corner, size, e.attrib["fill"]))
        elif e.tag == "path" and "data-name" not in e.attrib:
            pairs = re.findall(r"[ML](\S+) ([\d.-]+)", e.attrib["d"])
            corners = np.array([(float(a), float(b)) for a, b in pairs])
            title = "".join(child.text or "" for child in e)
            page.polygons.append((corners, e.attrib["fill"], title))
    return page


def well_set(page: Page, beyond: float = 0.6) -> None:
    """Everything lies within the page, and no text on another.

    beyond : [pt] by which the corner of a cell may pass the edge.
    """
    points = [p for a, b, _ in page.lines for p in (a, b)]
    points += [corner for corners, *_ in page.polygons for corner in corners]
    points += [end for corner, size, _ in page.boxes for end in (corner, corner + size)]
    points += [c + side * r for c, r, _ in page.circles for side in (-1, 1)]
    xy = np.array(points)
    assert xy.min() >= -0.1
    assert xy[:, 0].max() <= page.width + beyond
    assert xy[:, 1].max() <= page.height + beyond
    extents = list(page.extents())
    for text, left, right, top, bottom in extents:
        assert left >= 0.0, text
        assert right <= page.width + 2.0, text
        assert top >= 0.0, text
        assert bottom <= page.height, text
    for (one, *a), (other, *b) in combinations(extents, 2):
        apart = a[1] <= b[0] or b[1] <= a[0] or a[3] <= b[2] or b[3] <= a[2]
        assert apart, f"{one} lies on {other}"


def number(text: str) -> float | None:
    try:
        return float(text.replace("\u2212", "-"))
    except ValueError:
        return None


def ticks_of(page: Page, anchor: str, box: tuple[float, float, float, float]) -> Array:
    """(K, 2) values and places along an axis of the numbers in a box.

    box : [pt] left, right, top and bottom.
    """
    axis = 0 if anchor == "middle" else 1
    found = [
        (value, place[axis])
        for text, place, own, *_ in page.texts
        if own == anchor
        and (value := number(text)) is not None
        and box[0] <= place[0] <= box[1]
        and box[2] <= place[1] <= box[3]
    ]
    return np.array(sorted(found))


def scale_of(ticks: Array) -> tuple[float, float]:
    """[pt] a unit, and [pt] of 0, of an axis whose ticks are straight."""
    (per_unit, zero), (residual, *_) = (
        (fit := np.polynomial.polynomial.polyfit(ticks[:, 0], ticks[:, 1], 1))[::-1],
        [np.abs(np.polynomial.polynomial.polyval(ticks[:, 0], fit) - ticks[:, 1]).max()],
    )
    assert residual < 0.01
    return per_unit, zero


SPHERE = Sphere(np.array([0.3, -0.2, 0.5]), 0.6)


@pytest.fixture(scope="module")
def mapped() -> Page:
    rng = np.random.default_rng(1)
    position = rng.uniform([-0.5, -0.7, 0.1], [1.5, 0.9, 1.3], (800, 3))
    error = np.linspace(1e-3, 3e-3, 800)
    return page_of(workspace_map(position, error, [SPHERE], label="error", colours=AFTER_SCALE))


def test_both_views_of_the_workspace_have_one_scale_and_hold_what_is_drawn(mapped: Page) -> None:
    """A metre is as long across as upwards; spheres, base and cells lie where the ticks say."""
    well_set(mapped)
    half = 0.5 * mapped.width
    heads = sorted(mapped.named(name)[0] for name in ("from the side", "from above"))
    assert heads[0] < half < heads[1]
    scales = []
    for side, (low, high), column in ((0, (0.0, half + 10), 2), (1, (half + 10, 1e3), 1)):
        across = ticks_of(mapped, "middle", (low, high, 60.0, 1e3))
        per_x, x0 = scale_of(across)
        per_y, y0 = scale_of(ticks_of(mapped, "end", (low, high, 30.0, 1e3)))
        scales += [per_x, -per_y]
        own = [(c, r, d) for c, r, d in mapped.circles if low <= c[0] <= high]
        assert [dashed for *_, dashed in own] == [False, True]
        for centre, radius, _ in own:
            assert radius == pytest.approx(0.6 * per_x, abs=0.02)
            expected = x0 + 0.3 * per_x, y0 + SPHERE.centre[column] * per_y - 0.35 * 10.0
            assert centre == pytest.approx(expected, abs=0.05)
        cross = [
            (a, b) for a, b, _ in mapped.lines if np.allclose(0.5 * (a + b), own[0][0], atol=0.02)
        ]
        assert sorted((abs(b - a) / 2.0).round(2).tolist() for a, b in cross) == [[0, 4], [4, 0]]
        (base,) = [
            c for c, fill, _ in mapped.polygons if fill == INK and low <= c[:, 0].mean() <= high
        ]
        assert base.mean(axis=0) == pytest.approx((x0, y0 - 3.5), abs=0.1)
        assert np.ptp(base, axis=0) == pytest.approx((6.0, 6.0))
        cells = [
            c.mean(axis=0)
            for c, _, title in mapped.polygons
            if title and low <= c[:, 0].mean() <= high
        ]
        upwards = (0.1, 1.3) if column == 2 else (-0.7, 0.9)
        places = (np.array(cells) - (x0, y0 - 3.5)) / (per_x, per_y)
        reach = 2.0 / 15.0  # width of a cell
        assert places.min(axis=0) == pytest.approx((-0.5, upwards[0]), abs=reach)
        assert places.max(axis=0) == pytest.approx((1.5, upwards[1]), abs=reach)
        begin, end = across[:, 1].min(), across[:, 1].max()
        assert begin < heads[side] < end
    assert scales == pytest.approx([scales[0]] * 4, rel=2e-3)


def test_the_colour_scale_of_a_map_ends_where_2_percent_of_the_cells_lie_beyond(
    mapped: Page,
) -> None:
    """Sizes in millimetres, each cell coloured by its value over that end."""
    values = {title: fill for _, fill, title in mapped.polygons if title.endswith(" mm")}
    sizes = np.array([float(title.split()[0]) for _, _, title in mapped.polygons if title])
    per_mm, zero = scale_of(ticks_of(mapped, "middle", (0.0, 1e3, 0.0, 30.0)))
    right = max(corner[0] + size[0] for corner, size, _ in mapped.boxes) - 0.3
    left = min(corner[0] for corner, _, _ in mapped.boxes)
    assert left == pytest.approx(zero, abs=0.02)
    assert (right - zero) / per_mm == pytest.approx(np.quantile(sizes, 0.98), rel=2e-3)
    top = np.quantile(sizes, 0.98)
    for title, fill in list(values.items())[:20]:
        near = [shade(AFTER_SCALE, np.array([(float(title.split()[0]) + d) / top]))[0]
                for d in (-0.006, 0.0, 0.006)]  # fmt: skip
        channels = [[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in (*near, fill)]
        low, high = np.min(channels[:3], axis=0) - 1, np.max(channels[:3], axis=0) + 1
        assert ((low <= channels[3]) & (channels[3] <= high)).all()
    assert mapped.named("error [mm]")[1] < 30.0


def test_positions_on_the_sphere_keep_their_area_and_the_equator_is_dashed() -> None:
    """Unit vectors along x, y and down: at sqrt 2 to the right, above, and 2 from the middle."""
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(4000, 3))
    directions[:4] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1e-4, 0.0, -1.0]]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    places = equal_area(directions[:4])
    expected = [[np.sqrt(2.0), 0.0], [0.0, np.sqrt(2.0)], [0.0, 0.0], [2.0, 0.0]]
    np.testing.assert_allclose(places, expected, atol=1e-4)
    position = rng.normal(size=(4000, 3)) * 1e-5
    residuals = cast(Residuals, SimpleNamespace(position=position, angle=position * 2.0))
    page = page_of(sphere_map(directions, residuals, AFTER_SCALE))
    well_set(page, beyond=4.0)
    outer, equator, second, _ = page.circles
    assert [dashed for *_, dashed in page.circles] == [False, True, False, True]
    assert equator[1] == pytest.approx(outer[1] / np.sqrt(2.0), abs=0.02)
    assert outer[0][1] == second[0][1]
    gap = second[0][0] - outer[0][0] - 2.0 * outer[1]
    assert 2.0 < gap < 20.0
    cells = np.array([c.mean(axis=0) for c, _, title in page.polygons if "µm" in title])
    away = np.linalg.norm(cells - outer[0], axis=1)
    assert away.max() == pytest.approx(outer[1], rel=0.06), "the whole sphere was measured"
    assert 300 < len(cells) < 500, "cells of a 22nd of the map's width"
    for name, axis, sign in (("x", 0, 1.0), ("y", 1, -1.0)):
        for k, (text, place, *_) in enumerate(t for t in page.texts if t[0] == name):
            off = place - page.circles[2 * k][0]
            assert equator[1] < sign * off[axis] < outer[1], text
            assert abs(off[1 - axis]) < 5.0
    rms_um = np.sqrt(3.0) * 10.0
    titles = [float(title.split()[0]) for *_, title in page.polygons if "µm" in title]
    assert np.median(titles) == pytest.approx(rms_um, rel=0.1)
    double = [float(title.split()[0]) for *_, title in page.polygons if "µrad" in title]
    assert np.median(double) == pytest.approx(2.0 * rms_um, rel=0.1)
    alone = page_of(sphere_map(directions, residuals, AFTER_SCALE, angles=False))
    assert len(alone.circles) == 2
    assert not any("angle" in t[0] for t in alone.texts)


def test_correlations_stand_in_rows_and_columns_of_one_order() -> None:
    """Two parameters at +0.5 of a third, which is not shown; each is 1 with itself."""
    values = np.array([[4.0, 0.0, 3.0], [0.0, 1.0, 0.0], [3.0, 0.0, 9.0]])
    named = cast(NamedCovariance, SimpleNamespace(names=["ra1", "left", "rd1"], values=values))
    page = page_of(correlation_map(named, [["rd1"], ["ra1"]]))
    well_set(page)
    cells = {title: (corners, fill) for corners, fill, title in page.polygons if title}
    assert list(cells) == ["rd1, rd1: 1.00", "rd1, ra1: 0.50", "ra1, rd1: 0.50", "ra1, ra1: 1.00"]
    own, beside, below, last = (corners for corners, _ in cells.values())
    side = np.ptp(own, axis=0)
    assert side == pytest.approx((30.0, 30.0))
    assert beside - own == pytest.approx(np.tile((side[0], 0.0), (4, 1)))
    assert below - own == pytest.approx(np.tile((0.0, side[1]), (4, 1)))
    assert last - own == pytest.approx(np.tile(side, (4, 1)))
    colours = [fill for _, fill in cells.values()]
    assert colours[0] == colours[3] == shade(CORRELATION_SCALE, np.array([1.0]))[0]
    assert colours[1] == shade(CORRELATION_SCALE, np.array([0.75]))[0]
    for name, corners in (("rd1", own), ("ra1", below)):
        place = page.named(name)
        assert corners[0, 1] < place[1] < corners[2, 1]
        assert corners[0, 0] - 10.0 < place[0] < corners[0, 0]
    per_unit, zero = scale_of(ticks_of(page, "middle", (0.0, 1e3, 0.0, 35.0)))
    assert per_unit > 0.0
    assert zero == pytest.approx(page.named("correlation [1]")[0], abs=0.02)
    assert not correlation_map(named, [["rd1"]])


def test_names_of_many_correlations_are_small_and_more_than_forty_are_not_drawn() -> None:
    names = [f"ra{k}" for k in range(41)]
    named = cast(NamedCovariance, SimpleNamespace(names=names, values=np.eye(41)))
    page = page_of(correlation_map(named, [names[:40]]))
    well_set(page)
    sizes = [size for text, _, _, size, _ in page.texts if text.startswith("ra")]
    assert sizes == [6.25] * 40
    assert not correlation_map(named, [names])


def test_a_plot_has_its_numbers_beside_its_ticks_and_all_of_it_within_the_page() -> None:
    t = np.linspace(0.0, 10.0, 50)
    plots = [
        Plot([Curve(t, np.sin(t), "#123456", "a"), Curve(t, np.cos(t), "#654321", "b")],
             "y [mm]", y=(-1.5, 1.5), zero=True, spans=[(2.0, 4.0, "#aabbcc", 0.5)],
             lines=(5.0,), note="a note", legend=True),
        Plot([Curve(t, t, "#000000", "c")], "two\nlines", y=(0.0, 10.0)),
    ]  # fmt: skip
    page = page_of(draw(plots, "time [s]", height=2.0 * HEIGHT, x=(0.0, 10.0), title="a title"))
    well_set(page)
    per_s, zero = scale_of(ticks_of(page, "middle", (0.0, 1e3, HEIGHT, 1e4)))
    ((corner, size, _),) = page.boxes
    assert corner[0] == pytest.approx(zero + 2.0 * per_s, abs=0.02)
    assert size[0] == pytest.approx(2.0 * per_s, abs=0.02)
    dashed = [(a, b) for a, b, colour in page.lines if colour == AFTER]
    ((above, below),) = [(a, b) for a, b in dashed if abs(a[0] - b[0]) < 0.01]
    assert above[0] == pytest.approx(zero + 5.0 * per_s, abs=0.02)
    assert corner[1] == pytest.approx(above[1], abs=0.02)
    assert corner[1] + size[1] == pytest.approx(below[1], abs=0.02)
    first = ticks_of(page, "end", (0.0, 100.0, 0.0, HEIGHT))
    per_mm, middle = scale_of(first)
    across = [a[1] for a, b, colour in page.lines if colour == QUIET and abs(b[0] - a[0]) > 100.0]
    assert any(abs(y - (middle - 3.5)) < 0.02 for y in across), "a line at zero"
    assert per_mm < 0.0
    left = min(min(a[0], b[0]) for a, b, _ in page.lines)
    for _, place, anchor, _, turned in page.texts:
        if turned or anchor == "end":
            assert place[0] < left + 0.1 or place[0] > 200.0
    label = page.named("y [mm]")
    assert label[1] == pytest.approx(0.5 * (corner[1] + corner[1] + size[1]), abs=0.02)
    two, lines = page.named("two"), page.named("lines")
    assert two[1] == lines[1]
    assert lines[0] - two[0] == pytest.approx(11.5)
    note = page.named("a note")
    assert corner[1] < note[1] < corner[1] + 15.0
    grid = [a for a, b, colour in page.lines if colour == GRID and abs(a[0] - b[0]) < 0.01]
    ticks = ticks_of(page, "middle", (0.0, 1e3, HEIGHT, 1e4))[:, 1]
    assert sorted({float(a[0]) for a in grid}) == pytest.approx(sorted(ticks), abs=0.02)


def test_bars_stand_on_the_axis_and_what_is_filled_reaches_down_to_it() -> None:
    x = np.array([1.0, 2.0, 3.0])
    bars = Curve(x, np.array([1.0, 2.0, 0.5]), "#000000", "bars", bars=True)
    filled = Curve(x, np.array([1.0, 2.0, 0.5]), "#111111", "filled", filled=True)
    svg = draw([Plot([bars, filled], "y", y=(0.0, 2.5))], "x", height=HEIGHT, x=(0.0, 4.0))
    page = page_of(svg)
    per_unit, zero = scale_of(ticks_of(page, "middle", (0.0, 1e3, 0.0, 1e3)))
    y_per, y_zero = scale_of(ticks_of(page, "end", (0.0, 1e3, 0.0, 1e3)))
    bottom = y_zero - 3.5
    path = re.search(r'data-name="bars" d="([^"]*)"', svg)[1]
    pieces = re.findall(r"M(\S+) (\S+?)V([\d.]+)", path)
    for (a, b, down), place, value in zip(pieces, x, bars.y, strict=True):
        assert float(a) == pytest.approx(zero + place * per_unit, abs=0.06)
        assert float(b) == pytest.approx(bottom + value * y_per, abs=0.02)
        assert float(down) == pytest.approx(bottom, abs=0.06)
    area = re.search(r'data-name="filled" d="([^"]*)"', svg)[1]
    down, back = re.search(r"V([\d.]+)H([\d.]+)Z$", area).groups()
    assert float(down) == pytest.approx(bottom, abs=0.06)
    assert float(back) == pytest.approx(zero + per_unit, abs=0.06)


def test_the_legend_breaks_its_rows_before_the_edge() -> None:
    """Line, gap and letters of six tenths of their size; the next name begins after them."""
    curves = [Curve(T, T, "#000000", f"curve number {k}") for k in range(9)]
    rows = legend_rows(curves, 10.0, 50.0)
    wide = (3.2 + 0.6 * 14) * 10.0
    assert [len(row) for row in rows] == [int((WIDTH - 50.0) // wide)] * 4 + [1]
    unnamed = Curve(T, T, "#000000")
    assert legend_rows([unnamed, curves[0]], 10.0, 50.0) == [[curves[0]]]
    drawn = page_of(figure(list(legend_lines(rows, 20.0, 10.0, 50.0)), 200.0))
    texts = [(text, place) for text, place, *_ in drawn.texts]
    assert [text for text, _ in texts] == [c.name for c in curves]
    assert texts[0][1] == pytest.approx((70.0, 23.5))
    assert texts[1][1][0] - texts[0][1][0] == pytest.approx(wide)
    assert texts[2][1] - texts[0][1] == pytest.approx((0.0, ROW), abs=0.01)
    for (begin, end, _), (_, place) in zip(drawn.lines, texts, strict=True):
        assert (begin[0], end[0]) == pytest.approx((place[0] - 20.0, place[0] - 4.0))
        assert begin[1] == end[1] == pytest.approx(place[1] - 3.5)


@pytest.mark.parametrize(
    ("values", "log", "ends"),
    [
        ([1.0, 3.0, np.nan], False, (0.9, 3.1)),
        ([2.0, 2.0], False, (1.9, 2.1)),
        ([0.0, 0.0], False, (-1.0, 1.0)),
        ([], False, (0.0, 1.0)),
        ([], True, (0.1, 1.0)),
        ([-1.0, 1.0, 1e4], True, (10.0 ** (-0.2), 10.0**4.2)),
        ([5.0, 0.0], True, (5.0 / 1.05, 5.0 * 1.05)),
    ],
)
def test_an_axis_ends_a_twentieth_beyond_its_values(
    values: list[float], log: bool, ends: tuple[float, float]
) -> None:
    assert ends_of([np.array(values)], log=log) == pytest.approx(ends)


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (0.5, 40.0, ["0.5", "1", "2", "5", "10", "20"]),
        (1e-3, 0.5, ["0.001", "0.01", "0.1"]),
        (1.0, 100.0, ["1", "10", "100"]),
    ],
)
def test_a_logarithmic_axis_has_decades_and_between_few_of_them_2_and_5(
    low: float, high: float, labels: list[str]
) -> None:
    assert list(Axis(low, high, 0.0, 100.0, log=True).ticks(5).values()) == labels


@pytest.mark.parametrize(
    ("low", "high", "most", "labels"),
    [
        (0.0, 10.0, 5, ["0", "2", "4", "6", "8", "10"]),
        (-0.05, 0.05, 4, ["\u22120.050", "\u22120.025", "0.000"]),
        (0.0, 1.0, 2, ["0.0", "0.5", "1.0"]),
        (980.0, 1020.0, 4, ["980", "990", "1000", "1010", "1020"]),
    ],
)
def test_ticks_are_1_2_or_5_times_a_power_of_ten_with_the_digits_of_their_step(
    low: float, high: float, most: int, labels: list[str]
) -> None:
    ticks = linear_ticks(low, high, most)
    steps = np.diff(list(ticks))
    assert np.ptp(steps) < 1e-9 * steps[0]
    mantissa = steps[0] / 10.0 ** np.floor(np.log10(steps[0]) + 1e-9)
    assert min(abs(mantissa - m) for m in (1.0, 2.0, 5.0)) < 1e-6
    assert [number(text) for text in ticks.values()] == pytest.approx(list(ticks), abs=1e-9)
    if most != 4 or low > 0.0:
        assert list(ticks.values()) == labels

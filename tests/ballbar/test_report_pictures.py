"""Bodies and figures of the report on one recording: shapes, the painted cell, motion, clocks."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.load import load_robot
from ballbar.report import cell_picture, motion, recording_figures
from ballbar.report.cell_picture import _painted, _surface, _view
from ballbar.report.drawing import INCH
from ballbar.report.line_plot import Curve, Plot
from ballbar.report.motion import (
    CLOSE,
    Marks,
    _covered,
    _crossings,
    mark_sentences,
    mechanism_angles,
    on_robot_clock,
    singular_angles,
    thinning,
)
from ballbar.report.numbers import MISSING
from ballbar.report.recording import _noise_rows, _residual_rows, overview
from ballbar.report.recording_figures import (
    _log_ends,
    _longest_dwell,
    _steps,
    components_over_time,
    norms_over_time,
    tension_over_time,
    whitened_histogram,
)
from ballbar.report.shapes import Bar, _fork, bar_bodies, cell_bodies, plate_body, robot_bodies
from tests.helpers.simulated_recordings import Recorded


@pytest.fixture
def plots(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[Plot], str, dict[str, Any]]]:
    """The figures that are drawn: plots, name of the x axis, and the rest."""
    drawn = list[tuple[list[Plot], str, dict[str, Any]]]()
    monkeypatch.setattr(
        recording_figures,
        "draw",
        lambda *shown, **given: drawn.append((list(shown[0]), shown[1], given)),
    )
    return drawn


def geometry_at(origin: list[float], length: float) -> Any:
    """A ball-bar at an origin [m], all of whose parameters are one number."""
    members = {"origin": np.array(origin), "__getitem__": lambda *_: length}
    return type("Geometry", (), members)()


# --- shapes


@pytest.mark.parametrize("name", ["irb2400", "ur10e", "nj220"])
def test_the_bodies_of_a_robot_meet_from_joint_to_joint(name: str) -> None:
    """In frame i its joint's axis passes -(a, d sin alpha, d cos alpha); the link ends in 0."""
    chain = nominal_chain(load_robot(name))
    base, *links = robot_bodies(chain)
    assert len(links) == chain.rows
    assert base[0].start[2] == 0.0
    assert base[0].end == pytest.approx(base[1].start)
    widths = []
    for row, body in enumerate(links):
        sine, cosine = np.sin(chain.alpha[row]), np.cos(chain.alpha[row])
        joint = -np.array([chain.a[row], chain.d[row] * sine, chain.d[row] * cosine])
        axis = np.array([0.0, sine, cosine])
        capped = [bar for bar in body if bar.capped]
        housings = [bar for bar in body if not bar.capped]
        if row:
            (housing,) = housings
            assert 0.5 * (housing.start + housing.end) == pytest.approx(joint)
            along = (housing.end - housing.start) / housing.length
            assert along == pytest.approx(axis)
            assert housing.length == pytest.approx(2.3 * housing.radius)
            widths.append(housing.radius)
        else:
            assert not housings
        long = np.hypot(chain.a[row], chain.d[row])
        if long > 0.3:
            assert capped
        for bar in capped:
            assert bar.end == pytest.approx(0.0) or bar.end[0] == pytest.approx(-chain.a[row])
            assert bar.length > 0.2 * bar.radius / 0.8
    assert np.diff(widths).max() < 0.0, "thinner towards the flange"
    assert widths[-1] == pytest.approx(0.45 * base[1].radius / 1.6)
    own = [Bar(np.zeros(3), np.ones(3), 0.1, (1, 2, 3))]
    assert robot_bodies(chain, own)[-1] is own
    size = np.abs(chain.a).sum() + np.abs(chain.d).sum()
    assert base[1].radius == pytest.approx(1.6 * 0.042 * size)
    assert base[0].radius > base[1].radius
    assert base[1].end[2] == pytest.approx(1.1 * 0.042 * size)


def test_a_fork_has_two_cheeks_and_a_bridge_behind_the_pin() -> None:
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    left, right, bridge = _fork(x, y, gap=0.05, depth=0.06)
    assert left.start == pytest.approx((-0.05, -0.06, 0.0))
    assert left.end == pytest.approx((-0.05, 0.0, 0.0))
    assert right.start == pytest.approx((0.05, -0.06, 0.0))
    assert right.end == pytest.approx((0.05, 0.0, 0.0))
    assert bridge.start == pytest.approx(left.start)
    assert bridge.end == pytest.approx(right.start)


def test_the_bodies_of_a_ballbar_reach_from_the_floor_along_the_rod_to_the_plate(
    recorded: Recorded,
) -> None:
    """The rod's parts follow one another from its foot to the joint; a low base has a stub."""
    cell, geometry = recorded.simulation.cell, recorded.simulation.truth.geometry
    stand, yoke, hub, rod, cross, shaft = bar_bodies(cell, geometry)
    assert stand[0].start[2] == pytest.approx(min(-geometry.origin[2], -0.2))
    assert stand[0].end == pytest.approx(stand[0].start + np.array([0.0, 0.0, 0.02]))
    assert stand[1].start == pytest.approx(stand[0].start)
    assert stand[1].end[2] > stand[1].start[2]
    sections = [bar for bar in rod if not bar.capped]
    assert sections[0].start[1] == pytest.approx(0.02 - geometry["bd3"])
    assert sections[0].end == pytest.approx(sections[1].start)
    assert sections[1].length == pytest.approx(geometry["bd3"] - 0.18)
    assert sections[2].start[1] < sections[1].end[1] < sections[2].end[1] < 0.0
    for middle in (hub, cross[:1]):
        for bar in middle:
            assert 0.5 * (bar.start + bar.end) == pytest.approx(0.0)
    assert shaft[0].start[2] == pytest.approx(-0.42 * cell.plate.tool_offset)
    assert shaft[0].start[2] < shaft[0].end[2] < 0.0
    assert yoke[0].start[1] < yoke[0].end[1] < 0.0
    low = geometry_at([0.0, 0.0, 0.05], 0.6)
    assert bar_bodies(cell, low)[0][0].start[2] == -0.2


def test_plate_and_flange_meet_at_the_face_of_the_flange(recorded: Recorded) -> None:
    cell, geometry = recorded.simulation.cell, recorded.simulation.truth.geometry
    face = -np.array([cell.plate.length, 0.0, cell.plate.tool_offset])
    changer, beam, hub, tip = plate_body(cell)
    assert changer.start == pytest.approx(face)
    assert beam.start == pytest.approx((-cell.plate.length, 0.0, -0.45 * cell.plate.tool_offset))
    assert beam.end == pytest.approx((0.0, 0.0, -0.45 * cell.plate.tool_offset))
    assert changer.end == pytest.approx(beam.start + np.array([0.0, 0.0, 0.012]))
    for bar, middle in ((hub, beam.start), (tip, beam.end)):
        assert 0.5 * (bar.start + bar.end) == pytest.approx(middle)
        assert bar.length == pytest.approx(0.024)
    bodies = cell_bodies(cell, geometry)
    flange = bodies[len(nominal_chain(cell.robot).a)]
    assert flange[0].end == pytest.approx(face)
    assert flange[0].length == pytest.approx(max(cell.robot.d[-1], 0.02))
    assert len(bodies) == 1 + len(nominal_chain(cell.robot).a) + 1 + 6


# --- the painted cell


def test_the_eye_looks_down_from_the_side_and_its_axes_are_at_right_angles() -> None:
    """50 deg to the right of the robot's x axis, 20 deg up; right is level."""
    right, up, eye = view = _view()
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view) == pytest.approx(1.0)
    assert right[2] == 0.0
    assert np.rad2deg(np.arcsin(eye[2])) == pytest.approx(20.0)
    assert np.rad2deg(np.arctan2(eye[1], eye[0])) == pytest.approx(-50.0)
    assert up[2] > 0.0


@pytest.mark.parametrize("capped", [False, True])
def test_the_surface_of_a_bar_closes_round_it(capped: bool) -> None:
    """Faces look outward, and their area is that of a cylinder with ends or half spheres."""
    rng = np.random.default_rng(2)
    start, end = rng.normal(size=(2, 3))
    bar = Bar(start, end, 0.2, (1, 2, 3), capped)
    faces = _surface(bar)
    normals = 0.5 * np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    np.testing.assert_allclose(normals.sum(axis=0), 0.0, atol=1e-9)
    middle = faces.mean(axis=1)
    axis = (end - start) / bar.length
    nearest = start + np.clip((middle - start) @ axis, 0.0, bar.length)[:, None] * axis
    assert (((middle - nearest) * normals).sum(axis=1) > -1e-12).all(), "outward"
    volume = (middle * normals).sum() / 3.0
    caps = 4.0 / 3.0 * np.pi * 0.2**3 if capped else 0.0
    assert volume == pytest.approx(np.pi * 0.2**2 * bar.length + caps, rel=0.03)
    area = np.linalg.norm(normals, axis=1).sum()
    ends = 4.0 * np.pi * 0.2**2 if capped else 2.0 * np.pi * 0.2**2
    assert area == pytest.approx(2.0 * np.pi * 0.2 * bar.length + ends, rel=0.03)
    if not capped:
        pieces = np.unique(((middle - start) @ axis).round(6))
        assert np.diff(pieces).max() <= 0.08 + 1e-9


def test_faces_are_painted_from_the_back_with_the_path_over_them() -> None:
    """One scale for both axes, 4 pt of room round what is seen."""
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    quads = np.stack([np.column_stack((square, np.full(4, z))) for z in (0.5, -0.5)])
    colours = np.array([[255.0, 0.0, 0.0], [0.0, 0.0, 255.0]])
    path = np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 0.0]])
    svg = _painted(quads, colours, path)
    width, height = map(float, re.match(r'<svg viewBox="0 0 (\S+) (\S+)"', svg).groups())
    fills = re.findall(r'd="([^"]*)" fill="([^"]*)"', svg)
    assert [fill for _, fill in fills] == ["#0000ff", "#ff0000", "none"]
    (x0, y0), (x1, y1) = (map(float, p.split()) for p in fills[2][0].removeprefix("M").split("L"))
    assert (x0, x1) == pytest.approx((4.0, width - 4.0), abs=0.06)
    assert (y1, y0) == pytest.approx((4.0, height - 4.0), abs=0.06)
    assert (x1 - x0) / 4.0 == pytest.approx((y0 - y1) / 2.0, abs=0.06)
    first = fills[0][0].removeprefix("M").removesuffix("Z").split("L")
    corners = np.array([p.split() for p in first], dtype=float)
    assert np.ptp(corners, axis=0) == pytest.approx((0.5 * (x1 - x0), 0.5 * (y0 - y1)), abs=0.11)
    tall = _painted(quads[:, :, [1, 0, 2]], colours, path[:, [1, 0, 2]])
    width, height = map(float, re.match(r'<svg viewBox="0 0 (\S+) (\S+)"', tall).groups())
    assert height == pytest.approx(width)
    line = re.findall(r'd="([^"]*)" fill="none"', tall)[0].removeprefix("M").split("L")
    xs = [float(p.split()[0]) for p in line]
    assert sum(xs) / 2.0 == pytest.approx(0.5 * width, abs=0.06), "in the middle of the page"


def test_what_faces_the_light_is_brightest_and_what_turns_away_is_not_drawn(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A single ball of colour 200: 40 % of it everywhere, all of it towards the light."""
    painted = list[Any]()
    monkeypatch.setattr(cell_picture, "_painted", lambda *given: painted.append(given))
    ball = Bar(np.zeros(3), np.array([0.0, 0.0, 1e-3]), 0.2, (200, 200, 200), capped=True)
    monkeypatch.setattr(cell_picture, "cell_bodies", lambda *_: [[ball]])
    still: Any = SimpleNamespace(
        t=np.arange(3.0), tool=np.zeros((3, 3)),
        frames=[(SimpleNamespace(rotation=lambda _: np.tile(np.eye(3)[..., None], 3),
                                 origin=np.zeros((1, 3, 3))), 0)],
    )  # fmt: skip
    monkeypatch.setattr(cell_picture, "cell_motion", lambda *_: still)
    log = SimpleNamespace(t=np.arange(3.0))
    fitted: Any = SimpleNamespace(
        recording=SimpleNamespace(robot_log=log), estimate=SimpleNamespace(geometry=None)
    )
    cell_picture.cell_picture(cast(Any, None), fitted)
    ((quads, colours, path),) = painted
    assert path.shape == (3, 3)
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert (normals[:, 2] > 0.0).all()
    expected = 200.0 * (0.4 + 0.6 * np.clip(normals @ cell_picture.LIGHT, 0.0, None))
    assert np.abs(colours[:, 0] - np.minimum(expected, 200.0)).max() <= 200.0 / 32.0 + 1e-9
    assert colours.min() == pytest.approx(200.0 * 6.0 / 16.0, abs=7.0)
    assert colours.max() == pytest.approx(200.0, abs=7.0)


# --- motion


def test_logs_are_shown_at_thirty_poses_a_second_and_no_more_than_can_be_held() -> None:
    assert thinning(np.arange(0.0, 10.0, 0.004)) == 8
    assert thinning(np.arange(0.0, 10.0, 0.1)) == 1
    assert thinning(np.arange(240_001) * 0.05) == 3
    assert thinning(np.arange(240_000) * 0.05) == 2


def test_a_log_covers_the_instants_between_its_rows_but_no_gap_of_three_of_them() -> None:
    rows = np.array([0.0, 1.0, 2.0, 5.0, 6.0, 9.5, 10.0])
    at = np.array([-0.1, 0.0, 1.5, 3.0, 5.5, 7.0, 9.6, 10.0, 10.1])
    assert _covered(rows, at).tolist() == [
        False, True, True, True, True, False, True, True, False,
    ]  # fmt: skip


def an_estimate(**given: Any) -> Any:
    return SimpleNamespace(**{"clock": Clock(2.0, 0.01), "geometry": {}, "directions": ()} | given)


def test_instants_are_on_the_robots_clock_or_are_already() -> None:
    t = np.array([0.0, 10.0])
    assert on_robot_clock(an_estimate(), t) == pytest.approx((2.0, 12.1))
    assert on_robot_clock(an_estimate(clock=None), t) is t


def test_angles_of_encoders_have_direction_and_offset_and_no_whole_turns() -> None:
    log: Any = SimpleNamespace(joints=(1, 4), angles=np.array([[7.0, 1.0], [7.2, 1.2]]))
    geometry = {"btheta1": 0.1, "btheta4": -9.0}
    angles = mechanism_angles(an_estimate(geometry=geometry, directions=(1, -1)), log)
    expected = np.array([[7.1, -10.0], [7.3, -10.2]]) + 2.0 * np.pi * np.array([-1.0, 2.0])
    assert angles == pytest.approx(expected)


def test_a_mechanism_is_singular_where_its_rod_stands_and_its_joints_are_straight() -> None:
    geometry: Any = {"btheta2": 0.1, "btheta4": 0.2, "rtheta5": -0.3}
    still: Any = SimpleNamespace(b=np.zeros((2, 5)), q=np.zeros((2, 6)))
    still.b[:, 1], still.b[:, 3], still.q[:, 4] = (0.0, 3.0), (-0.2, 2.9), (0.3, 1.3)
    found = singular_angles(geometry, still)
    assert found["ball-bar: rod vertical"] == pytest.approx([0.1, np.pi - 3.1])
    assert found["ball-bar: universal joint straight"] == pytest.approx([0.0, np.pi - 3.1])
    assert found["robot: wrist straight"] == pytest.approx([0.0, 1.0])


def test_a_configuration_changes_where_the_angle_passes_zero_and_not_where_it_jumps() -> None:
    t = np.arange(6.0)
    angle = np.array([-0.2, 0.1, 0.4, -0.3, -0.6, 0.1])
    assert _crossings(t, angle).tolist() == [0.5]
    assert _crossings(t, np.array([0.3, 0.1, -0.1, -0.2, 0.2, 0.3])).tolist() == [1.5, 3.5]


def test_marks_are_said_in_seconds_with_six_instants_at_most() -> None:
    spans = np.array([[1.0, 2.5], [8.0, 8.5]])
    given = Marks(
        np.array([[0.0, 2.0], [10.0, 13.5]]),
        {"robot: wrist straight": spans, "ball-bar: rod vertical": np.zeros((0, 2))},
        {"robot: wrist straight": np.arange(7.0), "ball-bar: rod vertical": np.zeros(0)},
    )
    assert mark_sentences(given) == [
        "The robot dwells 2 times, 5.5 s in all.",
        "Robot: wrist straight: within 5 deg for 2.0 s in 2 stretches; it passes to the other "
        "configuration at 0.0, 1.0, 2.0, 3.0, 4.0, 5.0 s.",
        "Ball-bar: rod vertical: never within 5 deg.",
    ]
    assert np.rad2deg(CLOSE) == pytest.approx(5.0)
    calm = Marks(given.dwells, {"x": spans}, {"x": np.zeros(0)})
    assert mark_sentences(calm)[1] == "X: within 5 deg for 2.0 s in 2 stretches."


def test_a_length_is_shown_where_it_was_logged_and_elsewhere_as_the_robot_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The extension of the rod: sensed less the nominal length, or distance less the identified."""
    t = np.arange(0.0, 4.0, 0.1)
    q = np.zeros((t.size, 6))
    tip = np.vstack((np.full(t.size, 3.0), np.zeros((2, t.size))))
    geometry = geometry_at([2.0, 0.0, 0.0], 0.7)
    monkeypatch.setattr(motion, "robot_frames", lambda *_: SimpleNamespace(tip=tip))
    monkeypatch.setattr(motion, "pointing_bar", lambda *given: given[2])
    monkeypatch.setattr(motion, "moving_cell", lambda *given: given[3])
    length = SimpleNamespace(t=np.arange(0.0, 2.0, 0.1), length=np.full(20, 0.75))
    fitted: Any = SimpleNamespace(
        recording=SimpleNamespace(
            robot_log=SimpleNamespace(t=t, q=q), ballbar_log=None, length_log=length
        ),
        estimate=an_estimate(clock=Clock(1.0, 0.0), geometry=geometry, nominal={"bd3": 0.6}),
    )
    shown: Array = cast(Any, motion.cell_motion(fitted))
    sensed = (t >= 1.0) & (t <= 2.9)
    steps = thinning(t)
    assert shown[sensed[::steps]] == pytest.approx(0.15)
    assert shown[~sensed[::steps]] == pytest.approx(0.3)


# --- figures of a recording


def test_a_level_changes_midway_between_two_rows() -> None:
    t, level = _steps(np.array([0.0, 1.0, 2.0, 4.0]), np.array([0.0, 0.0, 1.0, 0.0]))
    assert t.tolist() == [0.0, 1.5, 1.5, 3.0, 3.0, 4.0]
    assert level.tolist() == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


def test_the_longest_dwell_is_shown_by_its_first_rows() -> None:
    t = np.arange(0.0, 40.0, 0.02)
    moving = ((t > 5.0) & (t < 20.0)) | (t > 30.0)
    angles = np.cumsum(np.where(moving, 0.01, 0.0))[:, None] * np.ones(3)
    rows = _longest_dwell(t, angles)
    assert rows is not None
    assert t[rows.start] == pytest.approx(20.0, abs=0.3)
    assert rows.stop - rows.start == 150
    assert _longest_dwell(t, t[:, None] * np.ones(3)) is None


def test_norms_are_drawn_without_zeros_on_an_axis_that_leaves_2_percent_below(plots: Any) -> None:
    before, after = np.zeros((101, 3)), np.zeros((101, 3))
    before[:, 0] = 40.0
    after[:, 1:] = np.linspace(0.0, 1.0, 101)[:, None] * [3.0, 4.0]
    t = np.linspace(2.0, 12.0, 101)
    norms_over_time(t, before, after, label="position [um]", clock="robot")
    (([plot], x, given),) = plots
    one, two = plot.curves
    assert (one.name, two.name) == ("before", "after")
    assert one.y == pytest.approx(40.0)
    assert np.isnan(two.y[0])
    assert two.y[1:] == pytest.approx(5.0 * np.linspace(0.0, 1.0, 101)[1:])
    assert plot.log
    low = float(np.quantile(two.y[1:], 0.02)) / 2.0
    assert plot.y == pytest.approx((low, 1.3 * 40.0))
    assert x == "time on the robot clock [s]"
    assert given["x"] == (2.0, 12.0)
    assert given["height"] == pytest.approx(2.9 * INCH)
    nothing = [Curve(t, np.full(101, np.nan), "#000")]
    assert _log_ends(nothing) is None
    assert _log_ends([Curve(t, np.full(101, 2.0), "#000")]) == pytest.approx((1.0, 2.6))


def test_components_have_one_scale_that_holds_the_largest(plots: Any) -> None:
    values = np.array([[1.0, -8.0, 2.0], [0.5, 3.0, -1.0]])
    components_over_time(np.array([0.0, 1.0]), values, label="r", clock="sensor's")
    components_over_time(np.array([0.0, 1.0]), np.zeros((2, 3)), label="r", clock="sensor's")
    (shown, x, given), (nothing, *_) = plots
    assert [plot.label for plot in shown] == ["x", "y", "z"]
    assert [plot.y for plot in shown] == [pytest.approx((-8.4, 8.4))] * 3
    assert [plot.curves[0].y.tolist() for plot in shown] == values.T.tolist()
    assert all(plot.zero and plot.upright for plot in shown)
    assert given["title"] == "r"
    assert x == "time on the sensor's clock [s]"
    assert nothing[0].y == (-1.0, 1.0)


def test_the_force_in_the_rod_is_drawn_with_its_sign(plots: Any) -> None:
    tension_over_time(np.array([1.0, 3.0]), np.array([-5.0, 7.0]), clock="robot")
    (([plot], _, given),) = plots
    assert plot.curves[0].y.tolist() == [-5.0, 7.0]
    assert plot.zero
    assert given["x"] == (1.0, 3.0)


def test_whitened_residuals_are_drawn_as_a_density_beside_the_unit_normal(plots: Any) -> None:
    rng = np.random.default_rng(3)
    whitened = rng.standard_normal((4, 25_000))
    whitened[0, 0] = 9.0
    whitened_histogram(whitened)
    whitened_histogram(np.concatenate((np.full(990, 0.1), np.full(10, 7.4))))
    (([plot], _, given), ([wide], *_)) = plots
    bars, normal = plot.curves
    assert bars.filled
    assert given["x"] == (-5.0, 5.0)
    assert np.trapezoid(bars.y, bars.x) == pytest.approx(1.0, abs=1e-9)
    assert len(np.unique(bars.x)) == 51
    assert normal.y == pytest.approx(np.exp(-0.5 * normal.x**2) / np.sqrt(2.0 * np.pi))
    assert np.abs(np.interp(normal.x, bars.x, bars.y) - normal.y).max() < 0.05
    assert plot.y == pytest.approx((0.0, 1.08 * max(bars.y.max(), normal.y.max())))
    assert plot.note == "1 of 100000 beyond ±5"
    assert wide.note == "0 of 1000 beyond ±8"


def test_both_logs_are_drawn_with_what_the_fit_uses_and_what_is_marked(
    recorded: Recorded, plots: Any
) -> None:
    t = np.linspace(0.0, 60.0, 1500)
    bar = SimpleNamespace(joints=(1, 2), t=t, angles=np.column_stack((t, -t)) * 1e-2)
    length = SimpleNamespace(t=t, length=0.6 + 1e-3 * t)
    estimate = an_estimate(
        after=SimpleNamespace(t=np.array([5.0, 50.0])), geometry={"btheta1": 0.0, "btheta2": 0.0},
        directions=(1, 1),
    )  # fmt: skip
    moved: Any = SimpleNamespace(t=t, q=np.tile(t[:, None], 6))
    passed = Marks(
        np.array([[1.0, 2.0]]),
        {"ball-bar: rod vertical": np.array([[3.0, 4.0]]), "robot: wrist": np.array([[5.0, 6.0]])},
        {},
    )
    fitted: Any = SimpleNamespace(
        estimate=estimate, recording=SimpleNamespace(ballbar_log=bar, length_log=length)
    )
    recording_figures.angles_with_marks(fitted, moved, passed)
    ((shown, _, given),) = plots
    robot, encoders, sensed = shown
    assert [c.name for c in robot.curves] == [f"q{j}" for j in range(1, 7)]
    assert [c.name for c in encoders.curves] == ["b1", "b2"]
    assert robot.lines == pytest.approx((5.0 * 1.01 + 2.0, 50.0 * 1.01 + 2.0))
    spans = [(a, b) for a, b, *_ in robot.spans]
    assert spans == [(1.0, 2.0), (3.0, 4.0)]
    assert encoders.curves[0].x == pytest.approx(1.01 * t[::2] + 2.0)
    assert sensed.curves[0].y == pytest.approx(600.0 + t[::2])
    assert given["x"] == (0.0, 60.0)
    assert given["height"] == pytest.approx(3 * 2.05 * INCH)


# --- the section of a recording


def test_residuals_are_listed_by_component_and_norm() -> None:
    before = np.array([[3.0, 0.0, 4.0], [3.0, 0.0, -4.0]])
    after = np.array([[0.0, 0.3, -0.4], [0.0, 0.3, 0.4]])
    rows = _residual_rows(before, after)
    assert rows == [
        ("x", "3.00", "0", "0"), ("y", "0", "0.300", "0.300"), ("z", "4.00", "0.400", "0.400"),
        ("norm", "5.00", "0.500", "0.500"),
    ]  # fmt: skip


def described(**given: Any) -> Any:
    recording = {"length_log": None, "robot_log": SimpleNamespace(t=np.array([0.0, 59.6]))}
    fitting = SimpleNamespace(lines=3600, bits=12)
    recording["description"] = SimpleNamespace(encoders={"b2": fitting, "b1": fitting})
    noise = SimpleNamespace(
        joint=np.array([1e-5, 2e-5]), encoder=np.array([3e-6, 4e-6]), length=5e-6
    )
    residual = SimpleNamespace(position=np.full((2, 3), 1e-5), angle=np.full((2, 3), 2e-5))
    estimate = an_estimate(
        noise=noise, after=residual, clock_sigma=(2e-6, 3e-8), whitened=np.full((3, 2), 1.2),
        tension=None, tension_source="", samples=300, step_faults=(1, 2),
    )  # fmt: skip
    return SimpleNamespace(recording=SimpleNamespace(**recording | given), estimate=estimate)


def test_noise_is_that_of_a_row_and_a_count_is_a_turn_over_all_of_them() -> None:
    """3600 lines of 12 bits: 0.426 urad."""
    rows = _noise_rows(described())
    assert rows == [
        ("robot joint 1", "10.0", MISSING), ("robot joint 2", "20.0", MISSING),
        ("encoder b1", "3.00", "0.426"), ("encoder b2", "4.00", "0.426"),
    ]  # fmt: skip
    assert ("length [µm]", "5.00", MISSING) in _noise_rows(described(length_log=1))


def test_key_figures_of_a_recording_have_their_units() -> None:
    facts = overview(described())
    assert facts == {
        "length": "60 s", "samples": "300", "clock offset": "2000.0000 ± 0.0020 ms",
        "clock skew": "10000.000 ± 0.030 ppm", "force in the rod": MISSING,
        "position residual, rms": "17.3 µm", "angle residual, rms": "34.6 µrad",
        "chi-square per residual": "1.4", "step faults repaired": "2",
    }  # fmt: skip
    assert overview(described(length_log=1))["angle residual, rms"] == MISSING


def test_ends_are_apart_by_the_root_mean_square_of_their_distance(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot's log is read between its rows; ends 3 and 4 m off are 3.54 m off."""
    asked = list[Array]()

    def frames(_: Any, q: Array) -> Any:
        asked.append(q)
        return SimpleNamespace(tip=np.array([[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]]))

    monkeypatch.setattr(recording_figures, "robot_frames", frames)
    log: Any = SimpleNamespace(t=np.array([0.0, 1.0]), q=np.array([[0.0, 2.0], [1.0, 4.0]]))
    end = np.array([[1.0, 2.0], [3.0, 0.0], [0.0, 4.0]])
    apart = recording_figures._rms_apart(log, np.array([0.5, 1.0]), cast(Any, None), end)
    assert apart == pytest.approx(np.sqrt(12.5))
    assert asked[0].tolist() == [[0.5, 3.0], [1.0, 4.0]]

"""Limits, checks, screening, questions and routes of a plan: each by its own law."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Link
from ballbar.cell.errors import InputError
from ballbar.cell.load import load_cell
from ballbar.planning import route
from ballbar.planning.evaluation import Evaluator, check, evaluators
from ballbar.planning.limits import (
    CATCH_UP,
    CROSSING,
    GROSS_DEG,
    LimitedValue,
    Violation,
    _crossed,
    _rates,
    _singular_angle,
    arm_margins,
    from_singular,
    leans,
    limited,
    reversal,
    reversing,
    violations,
)
from ballbar.planning.questions import Question, _with_rod, changed, check_questions, question
from ballbar.planning.request import Cup, PlanCell, PlanLimits, PlanRequest, load_request
from ballbar.planning.route import Route, route_of
from ballbar.planning.screen import UNREACHED, screen, tally
from ballbar.planning.verify import Check, _checked, _rate, violations_in

Stub = SimpleNamespace
SCENARIOS = Path(__file__).parents[2] / "scenarios"


# -- limits


def test_an_excess_is_one_where_the_violation_is_gross() -> None:
    most = limited("speed", np.array([1.0, 2.0, 4.0]), 2.0, "m/s", 2.0, "tool at {:.2f} m/s")
    np.testing.assert_allclose(most.excess, [-0.5, 0.0, 1.0])
    assert most.text(2) == "tool at 4.00 m/s, limit 2"
    least = limited("margin", np.array([30.0, 5.0]), 10.0, "deg", -GROSS_DEG, "{:.0f} deg")
    np.testing.assert_allclose(least.excess, [-20.0 / 30.0, 5.0 / 30.0])


def test_an_angle_is_as_far_from_singular_as_from_the_next_half_turn() -> None:
    angles = np.radians([0.0, 20.0, -20.0, 90.0, 170.0, 190.0, -350.0, 540.0])
    expected = np.radians([0.0, 20.0, 20.0, 90.0, 10.0, 10.0, 10.0, 0.0])
    np.testing.assert_allclose(from_singular(angles), expected, atol=1e-12)


def test_the_elbow_and_shoulder_of_a_two_link_arm_by_hand() -> None:
    """Upper arm along z from (0.1, 0, 0.5), forearm bent by 30, 90 and 180 degrees from it."""
    bend, wrists = np.radians([30.0, 90.0, 180.0]), []
    for angle in bend:
        wrists.append([0.1 + 0.7 * np.sin(angle), 0.0, 1.1 + 0.7 * np.cos(angle)])
    origin = np.zeros((6, 3, 3))
    origin[1], origin[2] = np.array([[0.1], [0.0], [0.5]]), np.array([[0.1], [0.0], [1.1]])
    origin[4] = np.array(wrists).T
    frames: Any = Stub(origin=origin)
    elbow, shoulder = arm_margins(frames)
    np.testing.assert_allclose(elbow, np.radians([30.0, 90.0, 0.0]), atol=1e-7)
    np.testing.assert_allclose(shoulder, [0.45, 0.8, 0.1])


def motion(**changes: Any) -> Any:
    """Four samples of a robot with six axes, in two runs."""
    base = {
        "t": np.array([0.0, 0.1, 0.2, 0.3]), "q": np.zeros((4, 6)), "b": np.zeros((4, 5)),
        "speed": np.zeros((4, 6)), "acceleration": np.zeros((4, 6)), "tip_speed": np.zeros(4),
        "first": np.array([0, 0, 2, 2]),
    }  # fmt: skip
    return Stub(**base | changes)


def test_a_side_must_be_kept_within_each_run() -> None:
    """The second run begins on the other side."""
    kept = _crossed("wrist", np.array([0.5, 0.1, -0.2, -0.1]), motion(), "passes")
    assert (kept.excess < 0.0).all()
    assert (kept.unit, kept.text(0)) == (CROSSING, "passes")
    left = _crossed("wrist", np.array([0.5, -0.1, -0.2, 0.3]), motion(), "passes")
    assert (left.excess > 0.0).tolist() == [False, True, False, True]


def test_a_singular_angle_has_a_margin_on_either_side() -> None:
    angle = np.radians([30.0, 5.0, -30.0, -178.0])
    away, crossed = _singular_angle("b2", angle, 10.0, "key", motion())
    np.testing.assert_allclose(away.value, [30.0, 5.0, 30.0, 2.0])
    assert (away.excess > 0.0).tolist() == [False, True, False, True]
    assert away.text(1) == "b2 5 deg from its singularity, limit 10"
    assert (crossed.excess > 0.0).tolist() == [False, False, False, False]


def test_speeds_are_shares_of_each_axis_s_own_and_accelerations_degrees() -> None:
    cell = load_cell("irb2400", "lund_600", "plate_250")
    limits = PlanLimits(axis_speed_share=0.5, axis_acceleration_deg_per_s2=90.0)
    gears = cell.robot.joint_to_axis
    top = cell.robot.axis_speed_max
    axes = np.zeros((4, 6))
    axes[1, 2], axes[3, 0] = 0.6 * top[2], 0.2 * top[0]
    bend = np.zeros((4, 6))
    bend[2, 4] = np.radians(-180.0)
    back = np.linalg.inv(gears)
    moving = motion(speed=axes @ back, acceleration=bend @ back, tip_speed=np.array([0, 0, 0, 9.0]))
    speed, acceleration, tool = _rates(cell, limits, moving)
    np.testing.assert_allclose(speed.value, [0.0, 0.6, 0.0, 0.2], atol=1e-12)
    assert speed.excess[1] == pytest.approx(0.2)
    reached, most = np.degrees([0.6 * top[2], 0.5 * top[2]])
    assert speed.text(1) == f"axis 3 at {reached:.0f} deg/s, limit {most:.0f}"
    np.testing.assert_allclose(acceleration.value, [0.0, 0.0, 180.0, 0.0], atol=1e-9)
    assert acceleration.text(2) == "axis 5 at 180 deg/s^2, limit 90"
    assert tool.excess[3] == pytest.approx((9.0 - tool.allowed) / tool.allowed)


def test_friction_adds_to_the_acceleration_after_a_gear_reverses_and_nowhere_else() -> None:
    """Gear 5 reverses a third of the way to the second sample and takes axis 6 along by its
    coupling; gear 1 only slows down; between the runs the sign changes, but nothing moved there."""
    robot = load_cell("irb2400", "lund_600", "plate_250").robot
    speed, bend = np.zeros((4, 6)), np.zeros((4, 6))
    speed[:, 4], speed[:, 0] = [1.0, -2.0, 2.0, 1.0], [3.0, 1.0, 2.0, 1.0]
    bend[:, 4], bend[:, 0] = np.radians([-18.0, -20.0, 90.0, 90.0]), np.radians(50.0)
    held = np.array([1.0, 1.0, 1.0, 1.0, 0.02, 1.0])
    limits = PlanLimits(axis_acceleration_deg_per_s2=30.0)
    moving = motion(speed=speed @ robot.gear_to_joint, acceleration=bend @ robot.gear_to_joint)
    value = reversal(robot, limits, moving, held)
    a = np.radians(18.0 + 2.0 / 3.0)
    added = np.degrees(np.sqrt(2.0 * 0.02 * a) / CATCH_UP)
    np.testing.assert_allclose(value.value, [20.0 + added, 0.0, 0.0, 0.0], atol=1e-9)
    assert value.limit == "axis_acceleration_deg_per_s2"
    assert value.excess[0] == pytest.approx((added - 10.0) / 30.0)
    assert value.text(0) == (
        f"axis 5 at {20.0 + added:.0f} deg/s^2 as friction lets go after a reversal, limit 30"
    )
    bend[1, 5] = np.radians(-40.0)
    coupled = motion(speed=speed @ robot.gear_to_joint, acceleration=bend @ robot.gear_to_joint)
    value = reversal(robot, limits, coupled, held)
    assert value.value[0] == pytest.approx(40.0 + 0.5 * (20.0 + added), rel=1e-3)
    assert value.text(0).startswith("axis 6")


def test_friction_lets_go_a_while_after_the_reversal() -> None:
    """Half way between samples 1 s apart, and 0.2 s later: 0.7 of the way."""
    robot = load_cell("irb2400", "lund_600", "plate_250").robot
    speed, bend = np.zeros((4, 6)), np.zeros((4, 6))
    speed[:2, 0], bend[:2, 0] = [1.0, -1.0], [-1.0, -2.0]
    moving = motion(
        t=np.arange(4.0), speed=speed @ robot.gear_to_joint, acceleration=bend @ robot.gear_to_joint
    )
    turned, there, later = (np.abs(a[:, 0]) for a in reversing(robot, moving))
    np.testing.assert_allclose(turned, [1.5, 0.0, 0.0, 0.0], atol=1e-12)
    assert (there[0], later[0]) == pytest.approx((1.5, 1.7))


def test_violations_come_worst_first_with_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    values = [
        limited("a", np.array([1.0, 3.0, 2.0, 0.0]), 2.0, "", 2.0, "a {:.0f}"),
        limited("b", np.array([0.0, 0.0, 9.0, 0.0]), 3.0, "", 3.0, "b {:.0f}"),
        limited("c", np.array([0.0, 0.0, 3.0, 0.0]), 3.0, "", 3.0, "c {:.0f}"),
    ]
    monkeypatch.setattr("ballbar.planning.limits.measures", lambda *_: values)
    swept = np.zeros((4, 5))
    swept[:, 3] = np.radians([-90.0, 0.0, 0.0, 345.0])
    cell: Any = Stub(ballbar=Stub(stroke=None))
    limits: Any = Stub(cable_turns=1.0)
    assert violations(cell, limits, motion(b=swept)) == [
        Violation("cable_turns", pytest.approx(2.5), "b4 sweeps 435 deg, its cable allows 360"),
        Violation("b", pytest.approx(2.0), "b 9, limit 3 (t = 0.2 s)"),
        Violation("a", pytest.approx(0.5), "a 3, limit 2 (t = 0.1 s)"),
    ]
    cell.ballbar.stroke = (0.1, 0.2)  # no cables
    assert [v.limit for v in violations(cell, limits, motion(b=swept))] == ["b", "a"]


def test_a_rod_leans_from_the_axes_of_its_cups(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rod points along (0, 0.6, 0.8); the target's frame is turned by half about x."""
    rod = np.array([[0.0], [0.6], [0.8]])
    turn = np.diag([1.0, -1.0, -1.0])[:, :, None]
    frames = Stub(z=[None, None, rod], rotation=lambda: turn)
    monkeypatch.setattr("ballbar.planning.limits.bar_frames", lambda *_: frames)
    around: Any = Stub(seat=Stub(axis=(0, 0, 2.0)), target=Stub(axis=(0, 5.0, 0)))
    (seat, _, first), (target, _, second) = leans(around, None, None)  # type: ignore[arg-type]
    assert (seat, target) == ("seat", "target")
    np.testing.assert_allclose(first, np.arccos(0.8))
    np.testing.assert_allclose(second, np.arccos(0.6))
    around = Stub(seat=None, target=None)
    assert leans(around, None, None) == []  # type: ignore[arg-type]
    assert Cup(axis=(0, 0, 1), cone_deg=30).cone_deg == 30.0


# -- checks in the plant


def test_a_check_counts_instants_and_shows_the_worst_of_what_has_a_unit() -> None:
    far = limited("force", np.array([1.0, 5.0, 2.0, 7.0]), 4.0, "N", 1.0, "")
    passed = LimitedValue("force", np.array([-1.0, 1, 1, 1]), 0.0, CROSSING, -1.0, str)
    other = limited("force", np.array([0.0, 4.5, 0.0, 0.0]), 4.0, "N", 0.1, "")
    assert _checked(far) == Check("force", 7.0, 4.0, "N", 2, 4)
    assert _checked(far, passed) == Check("force", 7.0, 4.0, "N", 3, 4)
    assert _checked(far, other).worst == 4.5  # the larger excess
    assert violations_in([_checked(far), _checked(far, passed)]) == 5


def test_rates_are_central_differences_over_a_twentieth_of_a_second() -> None:
    t = 1e-3 * np.arange(200)
    values = np.column_stack((t**2, 3.0 * t))
    rates = _rate(values, t)
    np.testing.assert_allclose(rates[25:-25, 0], 2.0 * t[25:-25], atol=1e-12)
    np.testing.assert_allclose(rates[25:-25, 1], 3.0)
    assert not rates[:25].any()
    assert not rates[-25:].any()
    np.testing.assert_allclose(_rate(values[::100], t[::100])[1:-1, 1], [])
    coarse = _rate(values[::40], t[::40])  # steps that are no shorter
    np.testing.assert_allclose(coarse[1:-1, 1], 3.0)


# -- screening


@pytest.fixture(scope="module")
def shipped() -> Evaluator:
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    assert isinstance(requested, PlanRequest)
    return next(iter(evaluators(requested).values()))


def test_what_the_screen_leaves_out_the_limits_reject_as_well(shipped: Evaluator) -> None:
    """Their samples are more, and their limits too; the screen names one that is violated."""
    genomes = np.random.default_rng(3).random((60, shipped.space.size))
    screened = screen(shipped.cell, shipped.request.cell, shipped.space, shipped.limits, genomes)
    out = screened.excess > 0.0
    assert 10 < out.sum() < 60
    assert (screened.excess[screened.reason == "out of reach"] > 0.1 * UNREACHED).all()
    assert (screened.allowed.any(axis=1) == ~out)[screened.reason != "out of reach"].all()
    for k in np.flatnonzero(out)[:25]:
        assert check(shipped, shipped.space.candidate(genomes[k])).violations
    ranges = [reason for reason in screened.reason[out].tolist() if reason.startswith("range")]
    assert {"range of axis 2", "range of axis 3"} & set(ranges)


def test_wider_margins_leave_out_more_and_by_as_much_more(shipped: Evaluator) -> None:
    genomes = np.random.default_rng(5).random((900, shipped.space.size))
    around, space = shipped.request.cell, shipped.space
    found = []
    for margin in (5.0, 15.0):
        limits = shipped.limits.model_copy(
            update={"axis_margin_deg": margin, "wrist_margin_deg": 1.0 + margin}
        )
        found.append(screen(shipped.cell, around, space, limits, genomes))
    near = found[0].excess < 0.0
    assert near.any()
    change = found[1].excess[near] - found[0].excess[near]
    kept = found[1].excess[near] < 0.0
    np.testing.assert_allclose(change[kept], np.radians(10.0), atol=1e-9)
    reached = found[0].reason != "out of reach"
    assert (found[1].excess[reached] >= found[0].excess[reached]).all()
    np.testing.assert_allclose(found[1].excess[~reached], found[0].excess[~reached])


def test_the_frequent_reasons_are_told_with_their_shares() -> None:
    assert tally(Counter()) == "nothing was tried"
    counts = Counter(a=50, b=25, c=15, d=6, e=4)
    assert tally(counts) == "a 50%, b 25%, c 15%, d 6%"


# -- questions


def test_questions_are_read_with_the_unit_of_their_property() -> None:
    assert question("encoder=5e-6,1e-5") == Question("encoder", "rad", (5e-6, 1e-5))
    assert question("encoders=54,12345") == Question("encoders", "", ((4, 5), (1, 2, 3, 4, 5)))
    assert question("duration=20") == Question("duration", "s", (20.0,))
    for text in ("encoders=1", "encoders=16", "encoders=12,"):
        with pytest.raises(InputError, match="sets of at least two encoders, such as 1245,12345"):
            question(text)
    for text in ("duration=19.9", "duration=3601"):
        with pytest.raises(InputError, match="values of duration are in s, from 20 to 3600"):
            question(text)


@pytest.mark.parametrize(("telescoping", "wrong"), [(False, "length"), (True, "encoder")])
def test_questions_of_the_other_kind_of_instrument_are_refused(
    telescoping: bool, wrong: str
) -> None:
    requested: Any = Stub(telescoping=telescoping)
    other = "length" if telescoping else "encoder"
    check_questions(requested, [Question("duration", "s", (20.0,)), Question(other, "", ())])
    with pytest.raises(InputError, match=f"--what-if {wrong}: belongs to"):
        check_questions(requested, [Question(wrong, "", ())])


def requested(**sensors: Any) -> PlanRequest:
    cell = PlanCell(robot="irb2400", ballbar="lund_600", ballbar_position_m=(0.7, 0.0, 0.54))
    return PlanRequest(schema="ballbar-plan/1", name="test", cell=cell)


def test_a_longer_plate_bends_as_a_cantilever_of_its_material() -> None:
    """Stiffness over the cube of its length, mass in proportion, the centre twice as far."""
    cell = load_cell("irb2400", "lund_600", "plate_250")
    plate = cell.plate
    _, longer = changed(requested(), cell, "plate_length", 2.0 * plate.length)
    assert longer.plate.length == 2.0 * plate.length
    assert longer.plate.tip_stiffness == pytest.approx(plate.tip_stiffness / 8.0)
    assert longer.plate.body.mass == pytest.approx(2.0 * plate.body.mass)
    np.testing.assert_allclose(longer.plate.body.com, plate.body.com * [2.0, 1.0, 1.0])
    np.testing.assert_allclose(longer.plate.body.inertia, 8.0 * plate.body.inertia)
    _, thicker = changed(requested(), cell, "plate_thickness", 0.09)  # twice 45 mm
    assert thicker.plate.length == plate.length
    assert thicker.plate.tip_stiffness == pytest.approx(8.0 * plate.tip_stiffness)
    assert thicker.plate.body.mass == pytest.approx(2.0 * plate.body.mass)
    np.testing.assert_allclose(thicker.plate.body.inertia, 2.0 * plate.body.inertia)


def test_a_longer_rod_moves_what_is_behind_it() -> None:
    bar = load_cell("irb2400", "lund_600", "plate_250").ballbar
    bar = replace(bar, stroke=(0.5, 0.7))
    longer = _with_rod(bar, bar.length + 0.3)
    assert longer.length == pytest.approx(bar.length + 0.3)
    ratio = longer.length / bar.length
    assert longer.links[:2] == bar.links[:2]
    assert longer.links[2].mass == pytest.approx(ratio * bar.links[2].mass)
    np.testing.assert_allclose(longer.links[2].com - bar.links[2].com, [0.0, 0.0, 0.15])
    np.testing.assert_allclose(longer.links[2].inertia, ratio**3 * bar.links[2].inertia)
    for after, before in zip(longer.links[3:], bar.links[3:], strict=True):
        assert isinstance(after, Link)
        np.testing.assert_allclose(after.com - before.com, [0.0, 0.0, 0.3], atol=1e-15)
        assert after.mass == before.mass
    assert longer.stroke == pytest.approx((0.8, 1.0))


def test_a_sensor_or_the_duration_is_changed_in_the_request() -> None:
    cell = load_cell("irb2400", "lund_600", "plate_250")
    after, same = changed(requested(), cell, "encoder", 3e-6)
    assert (after.sensors.encoder_sigma_rad, same) == (3e-6, cell)
    assert changed(requested(), cell, "encoders", (1, 2))[0].sensors.encoders == (1, 2)
    assert changed(requested(), cell, "duration", 77.0)[0].timing.duration_s == 77.0


# -- routes


def machine(speed: Array) -> Any:
    """A robot of two axes within one turn, before one station and a wire of 1 to 2 m."""
    instrument = Stub(measured="length", lower=1.0, upper=2.0)
    limits = Stub(clearance_m=0.1)
    return Stub(
        robot=Stub(axis_speed_max=speed, joints=2), lower=-np.ones(2), upper=np.ones(2),
        stations=[Stub(origin=np.zeros(3)), Stub(origin=np.zeros(3))], instrument=instrument,
        request=Stub(limits=limits),
    )  # fmt: skip


def test_a_move_lasts_as_long_as_its_slowest_axis() -> None:
    setup = machine(np.array([2.0, np.inf]))  # of the second none is known: 1 rad/s
    begin, end = np.array([[0.0, 0.0], [0.0, 0.0]]), np.array([[3.0, 0.5], [1.0, -0.9]])
    np.testing.assert_allclose(route._times(setup, begin, end), [1.5, 0.9])


def test_moves_are_looked_at_every_five_degrees_of_the_fastest_axis(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(route, "station_frames", lambda _setup, _station, axes: axes)
    begin = np.radians([[0.0, 0.0], [10.0, 0.0]])
    end = np.radians([[12.0, -4.0], [10.0, 0.0]])
    owner, axes = route._along(None, None, begin, end)  # type: ignore[arg-type]
    assert owner.tolist() == [0, 0, 0, 0, 1]
    expected = [[0.0, 0.0], [4.0, -4.0 / 3.0], [8.0, -8.0 / 3.0], [12.0, -4.0], [10.0, 0.0]]
    np.testing.assert_allclose(np.degrees(axes), expected, atol=1e-12)


def test_a_move_is_clear_where_no_pose_of_it_comes_too_close(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A rod counts only where the move does not leave its stroke."""
    setup = machine(np.ones(2))
    owner = np.array([0, 0, 1, 1, 2, 2])
    tip = np.zeros((3, 6))
    tip[0] = [1.5, 1.5, 1.5, 2.5, 1.5, 1.5]  # the second move leaves the stroke
    bodies, rod = np.array([9.0, 9, 9, 9, 9, 0.05]), np.array([9.0, 0.05, 0.05, 9, 9, 9])
    monkeypatch.setattr(route, "_along", lambda *_: (owner, Stub(tip=tip)))
    monkeypatch.setattr(route, "smallest_distance", lambda *_, line: rod if line else bodies)
    moves = np.zeros((3, 2))
    assert route.clear_moves(setup, 0, moves, moves).tolist() == [False, True, True]
    setup.instrument.measured = "point"
    assert route.clear_moves(setup, 0, moves, moves).tolist() == [True, True, False]


def test_a_move_that_is_blocked_is_led_over_the_shortest_clear_poses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A wall at the middle of axis 1 with a gap where axis 2 is above -0.4; all pairs are tried."""
    setup = machine(np.ones(2))

    def clear(_setup: Any, _station: int, begin: Array, end: Array) -> Array:
        share = np.linspace(0.0, 1.0, 41)[:, None, None]
        way = begin + share * (end - begin)
        return np.asarray(~((np.abs(way[..., 0]) < 0.05) & (way[..., 1] < -0.4)).any(axis=0))

    monkeypatch.setattr(route, "clear_moves", clear)
    begin, end = np.array([-0.4, -0.5]), np.array([0.4, -0.5])
    found = route._intermediate(setup, 0, begin, end, np.random.default_rng(2))
    assert found is not None
    stops = np.vstack((begin, found, end))
    assert clear(setup, 0, stops[:-1], stops[1:]).all()
    lasting = route._times(setup, stops[:-1], stops[1:]).sum()
    assert 0.8 <= lasting < 1.0  # axis 1 turns by 0.8 whatever the way
    monkeypatch.setattr(route, "clear_moves", lambda *a: np.zeros(len(a[3]), dtype=bool))
    assert route._intermediate(setup, 0, begin, end, np.random.default_rng(2)) is None


def test_a_route_adds_the_moves_of_each_station_and_names_what_is_in_the_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    setup = machine(np.ones(2))
    axes = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.4], [0.9, 0.0]])

    class Poses:
        size = 4
        station = np.array([0, 0, 0, 1])

        def part(self, _order: Array) -> Any:
            return self

    Poses.axes = axes  # type: ignore[attr-defined]
    monkeypatch.setattr(route, "_order", lambda *_: np.arange(4))
    monkeypatch.setattr(route, "_along", lambda *a: (None, a[2]))
    monkeypatch.setattr(route, "_outside", lambda *a: a[2][:, 0] > 0.3)
    monkeypatch.setattr(route, "clear_moves", lambda *a: np.array([a[2][0, 0] < 0.3]))
    middle = np.array([[0.5, 1.0], [0.6, 1.0]])
    monkeypatch.setattr(route, "_intermediate", lambda *_: middle)
    poses: Any = Poses()
    made = route_of(setup, poses, np.random.default_rng(1))
    # 0.5, then 1.0 + 0.1 + 0.6 over the intermediate poses, then 0.4 to the other station
    assert isinstance(made, Route)
    assert made.seconds == pytest.approx(0.5 + 1.0 + 0.1 + 0.6 + 0.4)
    assert (list(made.passing), made.blocked, made.released) == ([2], (), (2,))
    monkeypatch.setattr(route, "_intermediate", lambda *_: None)
    made = route_of(setup, poses, np.random.default_rng(1))
    assert (made.passing, made.blocked) == ({}, (2,))
    assert made.seconds == pytest.approx(0.5 + 0.4 + 0.4)

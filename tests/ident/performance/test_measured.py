"""Measured characteristics, from tables and paths that were made by plain arithmetic."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import geometry_of_chain, nominal_chain, parameter_table
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from ballbar.ident.performance.characteristics import Characteristic
from ballbar.ident.performance.cube import TestCube, fitting_cube
from ballbar.ident.performance.iso_230_4 import circular_test, mean_path
from ballbar.ident.performance.measured import (
    MeasuredCircle,
    _laps,
    circle_rows,
    laps_of,
    measure,
    path_rows,
)
from ballbar.ident.performance.predicted import RobotPair
from ballbar.ident.performance.repeated_poses import (
    Attained,
    _about,
    _spread,
    noise_remark,
    repetitions,
)
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import kinematics
from tests.helpers.circular_path import circle_angles
from tests.helpers.still_poses import SEAT, TARGET, angles, group, table_of, true_robot, with_group

CYCLES = 30
NOISE = 1e-6  # [m] along each axis
Rows = dict[tuple[str, str], Characteristic]


@cache
def known_robot() -> tuple[RobotPair, TestCube]:
    """The true robot as if it had been identified without error, and its test cube."""
    true = true_robot("ur5", seed=5)
    chain = nominal_chain(true.robot)
    table = parameter_table(true.robot)
    robot = IdentifiedRobot(
        true.robot, geometry_of_chain(table, true.chain), true.corrections, true.values, TARGET
    )
    nominal = kinematics(robot.rigid(geometry_of_chain(table, chain)), chain)
    cube = fitting_cube(nominal, robot)
    assert cube is not None
    return RobotPair(nominal, kinematics(robot, chain)), cube


def repeated_table(measured: str = "point", shares: Array | None = None) -> PoseTable:
    """The poses of the cube, cycle after cycle, a minute apart; each shifted by `shares` (N, 3)."""
    q = np.tile(known_robot()[1].q, (CYCLES, 1))
    table = table_of(true_robot("ur5", seed=5), measured, q=q, noise=NOISE)
    values = table.groups[0].values.copy()
    if shares is not None:
        values[:, :3] += shares @ SEAT.rotation
    return with_group(table, values=values, time=60.0 * np.arange(len(q)))


def rows_of(table: PoseTable, cube: TestCube | None = None) -> Rows:
    pair, standard = known_robot()
    rows, _ = measure(pair, {"ball": TARGET}, table, cube or standard)
    return {(row.symbol, row.place): row for row in rows}


def test_repeated_poses_of_the_cube_have_its_names_and_values() -> None:
    """AP of the nominal robot is the distance of the true robot from it, frames aligned over the
    workspace; of the identified robot, which is the true one, what noise leaves.
    """
    rows, (pair, cube) = rows_of(repeated_table()), known_robot()
    shift, turn = pair.bias(cube.q)
    for k in range(5):
        row = rows["AP_p", f"P{k + 1}"]
        nominal, identified, corrected = row.statements
        assert row.cycles == CYCLES
        assert nominal.value == pytest.approx(np.linalg.norm(shift[k]), abs=3e-6)
        assert identified.value is not None
        assert identified.value < 1e-6
        assert corrected.origin == "not stated"
    turned = rows_of(repeated_table("pose"))
    for k in range(5):
        for index, angle in zip("abc", turn[k], strict=True):
            nominal, identified, _ = turned[f"AP_{index}", f"P{k + 1}"].statements
            assert nominal.value == pytest.approx(angle, abs=1e-4)  # turns have noise of 0.1 mrad
            assert identified.value == pytest.approx(0.0, abs=1e-4)


def test_repeatabilities_are_those_of_the_values() -> None:
    """By numpy on the values of the table; noise of 0.1 mrad about each axis is 0.3 mrad of RP."""
    table = repeated_table("pose")
    rows = rows_of(table)
    own = table.groups[0].values[1::5, :3]  # P2
    away = np.sqrt(((own - own.mean(axis=0)) ** 2).sum(axis=1))
    statements = rows["RP_l", "P2"].statements
    assert statements[0].value == pytest.approx(away.mean() + 3.0 * away.std(ddof=1), rel=1e-12)
    assert statements[0] == statements[1] == statements[2]  # a correction leaves the spread
    assert "0.0036 mm would follow from the instrument" in statements[0].reason
    assert rows["RP_a", "P2"].statements[0].value == pytest.approx(3e-4, rel=0.4)
    first, second = table.groups[0].values[1::5, :3], table.groups[0].values[3::5, :3]
    lengths = np.sqrt(((first - second) ** 2).sum(axis=1))
    distance = rows["RD", "P2-P4"].statements[0].value
    assert distance == pytest.approx(3.0 * lengths.std(ddof=1), rel=1e-12)
    expected = lengths.mean() - np.linalg.norm(
        np.diff(known_robot()[1].poses[[1, 3], :3, 3], axis=0)
    )
    assert rows["AD_p", "P2-P4"].statements[0].value == pytest.approx(expected, abs=1e-6)
    assert rows["AD_p", "P2-P4"].statements[1].value == pytest.approx(0.0, abs=1e-6)


def test_a_pose_that_wanders_has_a_drift() -> None:
    """0.3 mm along z over the 149 minutes of P3, its mean in place: means of ten cycles at the ends
    are 20 of 29 intervals apart.
    """
    shares = np.zeros((5 * CYCLES, 3))
    shares[2::5, 2] = np.linspace(-1.5e-4, 1.5e-4, CYCLES)
    rows = rows_of(repeated_table(shares=shares))
    moved = 3e-4 * 20.0 / 29.0
    apart = rows["AP_p", "P3"].statements[1]
    assert apart.value is not None
    assert apart.value < 2e-6
    drift = rows["dAP_p", "P3"].statements[0].value
    shift = known_robot()[0].bias(known_robot()[1].q)[0][
        2
    ]  # AP before and after, as seen by the nominal
    assert drift is not None
    assert drift == pytest.approx(abs(shift[2]) / np.linalg.norm(shift) * moved, rel=0.03)
    assert rows["dAP_p", "P1"].statements[0].value == pytest.approx(0.0, abs=2e-6)
    assert "over 2.4 h, 10 cycles at each end" in rows["dRP_l", "P3"].statements[0].reason


def test_a_pose_that_depends_on_where_it_is_approached_from() -> None:
    """P1 is approached from P2, P3 and P4 in turn, and stands 30 um higher behind P3."""
    cube = known_robot()[1]
    order = np.tile([1, 0, 2, 0, 3, 0], 12)
    table = table_of(true_robot("ur5", seed=5), "point", q=cube.q[order], noise=NOISE)
    values = table.groups[0].values.copy()
    behind = np.flatnonzero((order == 0) & (np.roll(order, 1) == 2))
    values[behind] += 3e-5 * SEAT.rotation[2]
    rows = rows_of(with_group(table, values=values))
    assert ("vAP_a", "P1") not in rows  # a point has no orientation
    assert rows["vAP_p", "P1"].statements[0].value == pytest.approx(3e-5, abs=2e-6)
    assert rows["vAP_p", "P1"].statements[0].reason == ""
    assert ("vAP_p", "P2") not in rows  # always from P1


def test_an_orientation_that_depends_on_where_it_is_approached_from() -> None:
    """P1 is turned by 2 mrad about the seat's z behind P3: the change is 2 mrad long."""
    cube = known_robot()[1]
    order = np.tile([1, 0, 2, 0, 3, 0], 12)
    table = table_of(true_robot("ur5", seed=5), "pose", q=cube.q[order], noise=NOISE)
    values = table.groups[0].values.copy()
    behind = np.flatnonzero((order == 0) & (np.roll(order, 1) == 2))
    turn = matrix_from_rotvec(np.array([[0.0], [0.0], [2e-3]]))[..., 0]
    matrices = turn @ matrix_from_rotvec(values[behind, 3:].T).transpose(2, 0, 1)
    values[behind, 3:] = rotvec_from_matrix(matrices.transpose(1, 2, 0)).T
    rows = rows_of(with_group(table, values=values))
    sizes = np.array([rows[f"vAP_{c}", "P1"].statements[1].value for c in "abc"], dtype=float)
    # means of twelve turns with noise of 0.1 mrad
    assert sizes == pytest.approx(2e-3 * np.abs(SEAT.rotation[:, 2]), abs=2e-4)


def test_a_target_that_the_result_knows_is_held() -> None:
    """With the target 1 mm off, poses of unlike orientation lie off; one of no name is fitted."""
    q = np.tile(angles("ur5", 8), (4, 1))
    table = table_of(true_robot("ur5", seed=5), "point", q=q, noise=NOISE)
    off = replace(TARGET, origin=TARGET.origin + np.array([1e-3, 0.0, 0.0]))

    def largest(targets: dict[str, Placement]) -> float:
        rows, _ = measure(known_robot()[0], targets, table, None)
        return max(r.statements[1].value or 0.0 for r in rows if r.symbol == "AP_p")

    assert largest({"ball": off}) > 2e-4
    assert largest({}) < 3e-6


def test_few_poses_tell_no_accuracy() -> None:
    table = repeated_table()
    table = table.part(np.tile(np.arange(5) < 4, CYCLES))
    stated = rows_of(table)["AP_p", "P1"].statements[0]
    assert stated.reason == "4 repeated poses, and the seat follows them; 5 are needed"
    assert rows_of(table)["RP_l", "P1"].statements[0].value is not None


def test_repetitions_are_poses_of_equal_commands() -> None:
    """Angles 0.4 mrad apart are one command, 2 mrad apart are two; two poses do not count."""
    q = np.array([0.0, 1.0, 4e-4, 2e-3, 1.0, -3e-4, 2.1e-3, 1.9e-3])[:, None]
    assert [own.tolist() for own in repetitions(q)] == [[0, 2, 5], [3, 6, 7]]


def test_a_telescoping_ball_bar_reports_its_circular_test() -> None:
    """The ball-bar's own report by another way: it knows no angle but that of a constant feed, and
    fits radius and two eccentricities to its lengths, which vary by less than 1 mm.
    """
    true, q = true_robot("ur5", seed=5), circle_angles()
    places = true.positions(q) - np.array([-0.4502, -0.2003, 0.3])
    places[:, :2] -= true.positions(q).mean(axis=0)[:2] - np.array([-0.45, -0.2])
    length = np.linalg.norm(places[:, :2], axis=1)
    length[181:] += 5e-5  # a backlash on the way back
    length += np.random.default_rng(2).normal(0.0, 5e-7, length.size)  # data sheet of a QC20-W
    bar = group("length", "cup", q, length[:, None], np.full((length.size, 1), 5e-7))
    table = PoseTable("bar", true.robot, (bar,))
    rows, circles = measure(known_robot()[0], {}, table, None, radius=0.12)
    feed = np.linspace(0.0, 2.0 * np.pi, 181)
    angle = np.concatenate((feed, feed[::-1]))
    design = np.column_stack((np.ones(angle.size), np.cos(angle), np.sin(angle)))

    def residual(chosen: slice) -> Array:
        solution = np.linalg.lstsq(design[chosen], length[chosen], rcond=None)[0]
        return np.asarray(length[chosen] - design[chosen] @ solution)

    stated = {row.symbol: row.statements[0].value for row in rows}
    there, back, both = slice(0, 181), slice(181, None), slice(None)
    assert stated["G"] == pytest.approx(np.ptp(residual(there)), abs=2e-6)
    assert stated["G_cw"] == pytest.approx(np.ptp(residual(back)), abs=2e-6)
    assert stated["G(b)"] == pytest.approx(np.ptp(residual(both)), abs=2e-6)
    mean = float(np.linalg.lstsq(design, length, rcond=None)[0][0])
    assert stated["F_max"] == pytest.approx(residual(both).max() + mean - 0.12, abs=2e-6)
    assert stated["F_min"] == pytest.approx(residual(both).min() + mean - 0.12, abs=2e-6)
    assert stated["G"] is not None
    assert 2e-5 < stated["G"] < 1e-3
    assert len(circles) == 1
    assert rows[0].statements[1].origin == "not stated"
    assert rows[0].cycles == 2


def test_positions_on_a_circle_show_what_the_identified_robot_leaves() -> None:
    true = true_robot("ur5", seed=5)
    table = table_of(true, "point", q=circle_angles(), noise=NOISE)
    rows, _ = measure(known_robot()[0], {"ball": TARGET}, table, None)
    stated = {row.symbol: row.statements for row in rows if row.place == "circle"}
    nominal, identified, _ = stated["G"]
    points = true.positions(circle_angles()[:181])
    across = (points - points.mean(axis=0)) @ np.linalg.svd(points - points.mean(axis=0))[2][:2].T
    away = np.linalg.norm(across, axis=1)
    angle = np.arctan2(across[:, 1], across[:, 0])
    design = np.column_stack((np.ones(181), np.cos(angle), np.sin(angle)))
    residual = away - design @ np.linalg.lstsq(design, away, rcond=None)[0]
    assert nominal.value == pytest.approx(np.ptp(residual), abs=6e-6)
    assert identified.value is not None
    assert identified.value < 8e-6


@pytest.mark.parametrize("noise", [5e-6, 2e-5])
def test_intervals_of_a_circle_hold_what_noise_adds(noise: float) -> None:
    """A path with G of 67 um by two harmonics: noise of a tracker makes it larger every time, and
    the 95 % interval holds the true one in most of 20 tests.
    """
    rng, angle = np.random.default_rng(1), np.linspace(0.0, 2.0 * np.pi, 6000)
    angle = np.concatenate((angle, angle[::-1]))
    own = np.cos(2.0 * angle + 0.3) + 0.4 * np.sin(3.0 * angle)
    radius = 0.12 + 67e-6 / np.ptp(own) * own
    along = np.column_stack((np.cos(angle), np.sin(angle)))
    held = 0
    for _ in range(20):
        points = radius[:, None] * along + noise * rng.standard_normal(along.shape)
        test = circular_test(points, 0.12)
        mean = circular_test(mean_path(test), 0.12)
        left = noise * np.sqrt(mean.angle.size / angle.size)
        rows = {
            r.symbol: r.statements[0] for r in circle_rows("", MeasuredCircle(mean, None, 2, left))
        }
        stated = rows["G"]
        assert None not in (stated.value, stated.low, stated.high)
        assert stated.value > 67e-6  # type: ignore[operator]
        held += stated.low <= 67e-6 <= stated.high  # type: ignore[operator]
        assert "noise of the instrument, as stated, adds about" in stated.reason
    assert held >= 17


def test_poses_off_a_circle_and_half_a_circle_are_no_circular_test() -> None:
    true = true_robot("ur5", seed=5)
    for q in (circle_angles()[:90], table_of(true).groups[0].q):
        rows, circles = measure(known_robot()[0], {}, table_of(true, "point", q=q), None)
        assert not circles
        assert not rows


SECONDS = np.arange(0.0, 50.0, 0.01)


def angles_of(phase: Array) -> Array:
    """(N, 3) [rad] of a closed path by its phase (N,)."""
    return np.column_stack((np.sin(phase), 0.7 * np.cos(2.0 * phase), 0.3 * np.sin(phase + 1.0)))


def test_laps_are_found_by_their_angles() -> None:
    """Five laps of 8 s behind a rest of 3 s; the fastest point is passed at its first passage."""
    phase = 2.0 * np.pi * np.clip(SECONDS - 3.0, 0.0, 40.0) / 8.0
    starts, length = laps_of(SECONDS, angles_of(phase))
    assert length == pytest.approx(8.0, abs=0.03)
    assert starts.size == 4  # whole laps from that point on
    assert np.diff(starts) == pytest.approx(np.full(3, 8.0), abs=0.03)


def test_laps_of_one_direction_count_where_the_path_turns_back() -> None:
    phase = 2.0 * np.pi * (20.0 - np.abs(np.clip(SECONDS, 0.0, 40.0) - 20.0)) / 5.0
    starts, length = laps_of(SECONDS, angles_of(phase))
    assert length == pytest.approx(5.0, abs=0.03)
    assert starts.size == 3
    assert starts.max() + length < 20.03


def test_a_lap_with_a_pause_does_not_count() -> None:
    """The third of five laps of 8 s pauses for 2 s."""
    moving = SECONDS - np.clip(SECONDS - 20.0, 0.0, 2.0)
    phase = 2.0 * np.pi * np.clip(moving, 0.0, 40.0) / 8.0
    starts, length = laps_of(SECONDS, angles_of(phase))
    assert length == pytest.approx(8.0, abs=0.03)
    assert starts.size == 3
    assert not ((starts < 20.0) & (starts + length > 20.1)).any()


def test_a_quick_move_behind_the_laps_is_no_lap() -> None:
    """It is the fastest of all, at angles that no lap passes."""
    q = angles_of(2.0 * np.pi * np.clip(SECONDS, 0.0, 24.0) / 8.0)
    q[:, 0] += 3.0 * np.clip(SECONDS - 30.0, 0.0, 1.0)
    starts, length = laps_of(SECONDS, q)
    assert length == pytest.approx(8.0, abs=0.03)
    assert starts.size >= 2


def test_a_path_without_repetition_has_no_laps() -> None:
    phase = SECONDS / 4.0
    q = np.column_stack((np.sin(phase), np.sin(1.618 * phase), np.cos(2.303 * phase)))
    assert laps_of(SECONDS, q)[0].size == 0
    starts, length = laps_of(SECONDS, angles_of(SECONDS / 40.0))
    assert (starts.size, length) == (0, 0.0)


def test_path_characteristics_of_three_laps() -> None:
    """Laps 0.1, 0.2 and 0.3 mm outside a commanded circle, and late by 20 ms: the barycentre is
    0.2 mm off; distances from it 0.1, 0, 0.1: l_bar = 0.2 / 3, S = 0.1 / sqrt(3). The target is
    turned by as many mrad about z, by 3 mrad all the time about x, where S is 0.
    """
    phase = 2.0 * np.pi * np.clip(SECONDS - 1.0, 0.0, 32.0) / 8.0

    def circle(at: Array, radius: Array | float) -> Array:
        return np.column_stack((radius * np.cos(at), radius * np.sin(at), 0.0 * at))

    late = np.interp(SECONDS - 0.02, SECONDS, phase)
    starts, _ = laps_of(SECONDS, angles_of(phase))
    lap = np.clip(np.searchsorted(starts, SECONDS, side="right") - 1, 0, 2)
    seen = Attained(circle(phase, 0.2), circle(late, 0.2 + 1e-4 * (1.0 + lap)), None)
    turns = np.column_stack((np.full(lap.size, 3e-3), 0.0 * lap, 1e-3 * (1.0 + lap)))
    table = table_of(true_robot("ur5"), "point", count=SECONDS.size)
    measured = replace(table.groups[0], q=angles_of(phase), time=SECONDS)
    accuracy, repeatability = path_rows(measured, [seen, seen])
    assert accuracy.cycles == 3
    assert accuracy.statements[0].value == pytest.approx(2e-4, abs=2e-6)
    expected = 1e-4 * (2.0 / 3.0 + 3.0 / np.sqrt(3.0))
    # within a hundredth of a lap of its ends neighbours are mixed
    assert repeatability.statements[0].value == pytest.approx(expected, rel=0.02)
    turned = replace(seen, turns=turns)
    rows = {row.symbol: row.statements[1].value for row in path_rows(measured, [turned, turned])}
    assert rows["AT_p"] == accuracy.statements[1].value
    assert [rows[f"AT_{c}"] for c in "abc"] == pytest.approx([3e-3, 0.0, 2e-3], abs=2e-5)
    expected = 3.0 * 1e-3
    assert [rows[f"RT_{c}"] for c in "abc"] == pytest.approx([0.0, 0.0, expected], abs=6e-5)


def test_an_interval_lies_about_a_mean_and_is_skewed_about_a_spread() -> None:
    """The deviation of ten values is known to 0.69 and 1.83 times it (chi-square of nine)."""
    about = _about(2.0, 0.5)
    assert (about.value, about.low, about.high) == (2.0, 1.5, 2.5)
    spread = _spread(1e-3, 10, "so")
    assert spread.low == pytest.approx(0.6878e-3, rel=1e-3)
    assert spread.high == pytest.approx(1.8256e-3, rel=1e-3)
    assert (spread.value, spread.reason) == (1e-3, "so")


def test_the_noise_of_an_instrument_makes_a_repeatability_of_its_own() -> None:
    """Distances of 1 mm noise in each direction from their mean: 1.596 and three times 0.673."""
    (drawn,) = repeated_table().groups
    (one,) = with_group(repeated_table(), sigma=np.full(drawn.sigma.shape, 1e-3)).groups
    assert noise_remark(one).startswith("3.6 mm would follow")


def test_points_of_a_lap_are_those_between_its_start_and_the_next() -> None:
    """A path that drifts from lap to lap: what a lap attained is not taken from its neighbours."""
    time = np.arange(0.0, 40.0, 0.01)
    turn = 2.0 * np.pi * time / 10.0
    way = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    out = way * (1.0 + 1e-3 * np.floor((time - 2.5) / 10.0 + 1e-9))[:, None]
    attained, commanded = _laps(time, Attained(way, out, None), np.array([2.5, 12.5, 22.5]), 10.0)
    assert attained.shape[0] == 3
    assert attained.shape[1] > 0.9 * len(commanded) > 50
    inner = attained[:, 5:-5]
    radius = np.linalg.norm(inner, axis=2)
    for lap in range(3):
        np.testing.assert_allclose(radius[lap], 1.0 + 1e-3 * lap, atol=2e-5)

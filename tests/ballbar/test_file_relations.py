"""Whether two files of still poses share seat and target, over drawn robots, seats and targets."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.acquisition.faults.nominal_robot import reach
from ballbar.cell.poses import PoseTable
from ballbar.recordings.file_relations import (
    FilePair,
    MeasuredFile,
    PairFit,
    Relation,
    _equal_angles,
    _length,
    relation,
)
from tests.helpers.drawn_pose_tables import (
    SEAT,
    SEAT_TURN,
    TARGET,
    DrawnRobot,
    drawn_robot,
    length_table,
    point_table,
)
from tests.helpers.still_poses import group

WAYS = list(product((True, False), repeat=2))


def measured(name: str, table: PoseTable) -> MeasuredFile:
    return MeasuredFile(name, table.groups[0], table.robot)


@pytest.mark.long
@pytest.mark.parametrize("robot", ["ur5", "panda", "irb2400"])
@pytest.mark.parametrize("again", [True, False], ids=["equal poses", "other poses"])
def test_what_two_files_share_is_seen_over_drawn_robots(robot: str, again: bool) -> None:
    """Seats move by 0.3 m, targets by 40 mm, in drawn directions; 40 poses and a tenth bad rows."""
    rng = np.random.default_rng(7)
    seen = []
    for seat, target in 4 * WAYS:
        drawn = drawn_robot(robot, rng)
        q = drawn.angles(40, rng)
        first = point_table(drawn, q, 2e-5, rng)
        q = q[rng.permutation(40)] if again else drawn.angles(40, rng)
        away, beside = rng.standard_normal((2, 3))
        second = point_table(
            drawn,
            q,
            2e-5,
            rng,
            seat=SEAT if seat else SEAT + 0.3 * away / np.linalg.norm(away),
            target=TARGET if target else TARGET + 0.04 * beside / np.linalg.norm(beside),
        )
        bad = second.groups[0].values.copy()
        bad[:4] += 2e-3 * rng.standard_normal((4, 3))
        second = replace(second, groups=(replace(second.groups[0], values=bad, q=np.round(q, 3)),))
        seen.append(relation(measured("a", first), measured("b", second)).shared)
    assert seen == 4 * WAYS


BESIDE, AWAY = np.array([0.0, 0.04, 0.0]), np.array([0.18, 0.0, -0.24])  # [m] 40 mm, 300 mm
MOVED = SEAT + AWAY


@pytest.fixture(scope="module")
def ur5() -> DrawnRobot:
    return drawn_robot("ur5", np.random.default_rng(7))


def two_files(
    drawn: DrawnRobot, *, seat: bool, target: bool, again: bool, count: int = 20
) -> tuple[MeasuredFile, MeasuredFile]:
    rng = np.random.default_rng(3)
    q = drawn.angles(count, rng)
    first = point_table(drawn, q, 2e-5, rng)
    other = q[::-1] if again else drawn.angles(count, rng)
    place = SEAT if seat else MOVED
    on_flange = TARGET if target else TARGET + BESIDE
    second = point_table(drawn, other, 2e-5, rng, seat=place, target=on_flange)
    return measured("a", first), measured("b", second)


@pytest.mark.parametrize(("seat", "target"), WAYS)
@pytest.mark.parametrize("again", [True, False], ids=["equal poses", "other poses"])
def test_what_two_files_share_is_told_with_how_far_the_rest_is_apart(
    ur5: DrawnRobot, seat: bool, target: bool, again: bool
) -> None:
    """Differences at equal angles tell it to a tenth of a millimetre, the robot to some."""
    told = relation(*two_files(ur5, seat=seat, target=target, again=again))
    assert told.shared == (seat, target)
    near = 1.0 if again else 3.0  # [mm]
    if seat != target:
        (apart,) = re.findall(
            r"([\d.]+) mm(?: and [\d.]+ deg)? ?(?:apart|beside|as a)", told.reason
        )
        assert float(apart) == pytest.approx(300.0 if target else 40.0, abs=near)
    assert told.reason.startswith("at equal joint angles its") == again
    words = {WAYS[1]: "another target", WAYS[2]: "another seat"}
    words[WAYS[3]] = "another seat and another target"
    end = words.get((seat, target), "")
    assert told.reason.endswith(end)


@pytest.mark.parametrize(
    ("known", "shared"),
    [
        ((True, None), (True, False)),
        ((None, False), (True, False)),
        ((False, None), (False, False)),  # the simplest that is left
        ((None, True), (None, True)),  # none is left
    ],
)
def test_what_is_known_of_seat_or_target_is_kept(
    ur5: DrawnRobot, known: tuple[bool | None, bool | None], shared: tuple[bool | None, bool | None]
) -> None:
    """The files are of one seat and two targets."""
    files = two_files(ur5, seat=True, target=False, again=False)
    assert relation(*files, known).shared == shared


def test_a_given_target_that_is_not_the_files_fits_no_seat(ur5: DrawnRobot) -> None:
    """Neither one seat nor one target brings them together, and one of them was given."""
    files = two_files(ur5, seat=True, target=False, again=True)
    told = relation(*files, (True, True))
    assert told == Relation((True, True), "it and a do not fit the one seat that is given")
    told = relation(*two_files(ur5, seat=False, target=False, again=True), (None, True))
    assert told.reason == "it and a do not fit the one target that is given"


def test_too_few_poses_tell_nothing(ur5: DrawnRobot) -> None:
    """Ten of points, twenty of lengths, of the file that has fewer."""
    a, b = two_files(ur5, seat=True, target=True, again=False, count=10)
    assert relation(a, b).shared == (True, True)
    few = replace(b, group=b.group.part(np.arange(9)))
    told = Relation((None, True), "it or a has fewer than 10 poses")
    assert relation(a, few, (None, True)) == told
    rng = np.random.default_rng(2)
    tables = [length_table(ur5, ur5.angles(n, rng), 2e-5, rng, SEAT[None]) for n in (20, 19)]
    one, other = (measured(name, table) for name, table in zip("ab", tables, strict=True))
    assert relation(one, other).reason == "it or a has fewer than 20 poses"
    assert relation(other, one).reason == "it or b has fewer than 20 poses"


@pytest.mark.parametrize("again", [True, False], ids=["equal poses", "other poses"])
@pytest.mark.parametrize("seat", [True, False])
def test_lengths_tell_their_seat_by_the_catalogue_robot_where_it_is_another(
    ur5: DrawnRobot, again: bool, seat: bool
) -> None:
    """From two seats the robot's errors do not cancel, whatever the angles."""
    rng = np.random.default_rng(5)
    q = ur5.angles(40, rng)
    other = q if again else ur5.angles(40, rng)
    first = length_table(ur5, q, 2e-5, rng, SEAT[None])
    second = length_table(ur5, other, 2e-5, rng, (SEAT if seat else MOVED)[None])
    told = relation(measured("a", first), measured("b", second))
    assert told.shared == (seat, True)
    assert told.reason.startswith("at equal joint angles") == (again and seat)
    assert "deg" not in told.reason
    if not seat:
        apart = float(told.reason.partition("two seats, ")[2].partition(" mm")[0])
        assert apart == pytest.approx(300.0, abs=5.0)


def test_what_fits_badly_tells_nothing_and_says_how_badly(ur5: DrawnRobot) -> None:
    """Beyond five tolerances it is another robot; one seat and target that leave 5 mm are none."""
    a, b = two_files(ur5, seat=True, target=True, again=False)
    off = np.random.default_rng(1).standard_normal((20, 3))

    def told(size: float, sigma: float = 1e-5) -> Relation:
        group = replace(b.group, values=b.group.values + size * off, sigma=np.full((20, 3), sigma))
        return relation(a, replace(b, group=group))

    assert told(3e-3).shared == (True, True)
    left = "beside a it fits the catalogue robot to 12.4 mm at best"
    assert told(1e-2) == Relation((None, None), left)
    doubt = told(6e-3, 2e-3)
    assert doubt.shared == (None, None)
    assert doubt.reason.endswith("mm by the catalogue robot: too little to tell")


def test_the_tolerance_is_of_the_robot_or_of_its_repetition_or_of_the_instruments_noise(
    ur5: DrawnRobot,
) -> None:
    """0.5 mm at equal angles, a thousandth of the reach else, four sigmas where that is more."""
    a, b = two_files(ur5, seat=True, target=True, again=True)
    rows = (np.arange(20), np.arange(20))
    assert FilePair(a, b, rows, paired=True).tolerance == 5e-4
    long = reach(ur5.robot)
    assert 0.7 < long < 1.2  # [m] of a UR5
    assert FilePair(a, b, rows, paired=False).tolerance == pytest.approx(1e-3 * long)
    noisy = replace(b, group=replace(b.group, sigma=np.full((20, 3), 2e-3)))
    for pair in (FilePair(a, noisy, rows, paired=True), FilePair(noisy, a, rows, paired=False)):
        assert pair.tolerance == pytest.approx(8e-3)


def test_the_residual_of_a_file_is_what_seat_and_target_leave() -> None:
    """Exact points leave none; one 3 mm off along z in the base's frame leaves just that."""
    rng = np.random.default_rng(4)
    exact = drawn_robot("ur5", rng, 0.0, 0.0)
    q = exact.angles(12, rng)
    table = point_table(exact, q, 0.0, rng)
    file, rows = measured("a", table), np.arange(12)
    seat = np.concatenate((SEAT_TURN, SEAT + np.array([0.0, 0.0, 3e-3])))
    residual = file.residual(seat, TARGET[None], rows, file.flange(rows))
    np.testing.assert_allclose(residual, np.broadcast_to([0.0, 0.0, -3e-3], (1, 12, 3)), atol=1e-12)
    lengths = measured("a", length_table(exact, q, 0.0, rng, SEAT[None]))
    longer = replace(lengths, group=replace(lengths.group, values=lengths.group.values + 2e-3))
    at = np.concatenate((np.zeros(3), SEAT))
    residual = longer.residual(at, TARGET[None], rows, longer.flange(rows))
    np.testing.assert_allclose(residual, np.full((1, 12, 1), -2e-3), atol=1e-12)


def test_a_whole_pose_is_three_points_of_its_target() -> None:
    """Its position, and 0.1 m along its x and y: what turns it by 1 mrad moves these 0.1 mm."""
    rng = np.random.default_rng(4)
    turn = Rotation.from_rotvec([[0.0, 0.0, np.pi / 2.0]])
    values = np.concatenate(([[1.0, 2.0, 3.0]], turn.as_rotvec()), axis=1)
    pose = group("pose", "camera", np.zeros((1, 6)), values, np.ones((1, 6)), "board", "a.csv")
    points = MeasuredFile("a", pose, drawn_robot("ur5", rng).robot).values
    expected = [[[1.0, 2.0, 3.0]], [[1.0, 2.1, 3.0]], [[0.9, 2.0, 3.0]]]
    np.testing.assert_allclose(points, expected, atol=1e-12)


def test_two_fitted_files_are_apart_by_their_targets_and_turned_and_moved_by_their_seats() -> None:
    first = np.array([0.0, 0.0, 0.1, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    second = np.array([0.0, 0.0, 0.3, 1.3, 2.4, 3.0, 0.02, 0.01, 0.02])
    fit = PairFit(0.0, np.stack((first, second)))
    assert fit.turned == pytest.approx(np.rad2deg(0.2))
    assert fit.moved == pytest.approx(0.5)
    assert fit.apart == pytest.approx(0.03)


def test_rows_of_equal_angles_are_paired_once_and_a_hundred_at_most() -> None:
    """Within 1 mrad of every joint; a pose that was measured again is one pair."""
    a = np.arange(12.0)[:, None] * np.ones(6)
    b = a[[3, 5, 5, 7, 0]].copy()
    b[3, 2] += 1.1e-3
    b[4, 5] -= 0.9e-3
    rows_a, rows_b = _equal_angles(a, b)
    assert sorted(zip(rows_a.tolist(), rows_b.tolist(), strict=True)) == [(0, 4), (3, 0), (5, 1)]
    many = np.arange(150.0)[:, None] * np.ones(6)
    pairs = _equal_angles(many, many[::-1])
    assert len(pairs[0]) == 100
    assert np.array_equal(many[pairs[0]], many[::-1][pairs[1]])
    none = _equal_angles(a, a + 0.5)
    assert none[0].size == none[1].size == 0


def test_a_length_is_told_in_metres_from_one_metre_on() -> None:
    assert [_length(metres) for metres in (0.0123456, 0.99, 1.0, 2.3456)] == [
        "12.3 mm",
        "990 mm",
        "1 m",
        "2.35 m",
    ]

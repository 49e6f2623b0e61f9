"""Plans of still poses: what is feasible, what a pose tells, the order, and the files."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from ballbar.acquisition.formats.table_file import jointtarget_text
from ballbar.acquisition.pose_tables import import_poses
from ballbar.acquisition.table.text import LogText
from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.files import write_yaml
from ballbar.cell.poses import PoseTable
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.commands.cli import app
from ballbar.ident.estimator.model import still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.robust_fit import equations_at
from ballbar.ident.options import FitOptions
from ballbar.ident.table_fit import fit_table
from ballbar.planning.capsules import smallest_distance
from ballbar.planning.feasible_poses import Candidates, Screen, feasible, random_candidates
from ballbar.planning.files import write_pose_plan
from ballbar.planning.pose_information import expected_group, information_of
from ballbar.planning.pose_plan import (
    APART,
    Design,
    PosePlan,
    decrease,
    exchanged,
    greedy,
    pose_plan,
)
from ballbar.planning.pose_request import POSE_SCHEMA, PosePlanRequest
from ballbar.planning.programs import pose_program
from ballbar.planning.request import load_request
from ballbar.planning.route import clear_moves, nearest_neighbours, two_opt
from ballbar.planning.stations import PoseSetup, setup_of, station_frames
from tests.helpers.measured_plans import DrawnRobot, drawn_robot

PLANS = Path(__file__).parents[2] / "scenarios" / "plans"
TRACKER, WIRE = PLANS / "irb2400_tracker.yaml", PLANS / "irb2400_drawwire.yaml"
RUNNER = CliRunner()


def data_of(path: Path, **values: object) -> dict[str, object]:
    """A shipped request with other values."""
    return load_request(path).model_dump(mode="json", by_alias=True) | values


def setup_with(data: dict[str, object]) -> PoseSetup:
    return setup_of(PosePlanRequest.model_validate_json(json.dumps(data)), relative_to=PLANS)


def changed(path: Path, **values: object) -> PoseSetup:
    """The setup of a shipped request with other values and fewer candidates."""
    return setup_with(data_of(path, **{"candidates": 250, "poses": 30, **values}))


def socket_setup(**values: object) -> PoseSetup:
    """Two sockets 50 mm apart before an IRB 1600, which come from above."""
    sockets = (("a", 0.0), ("b", 0.05))
    data = {
        "schema": f"{POSE_SCHEMA}/1",
        "name": "sockets",
        "robot": "irb1600",
        "instrument": "socket_pair_50",
        "seats": [
            {"name": n, "position_m": [0.7, y, 0.2], "axis": [0, 0, 1], "cone_deg": 80}
            for n, y in sockets
        ],
        "targets": [{"position_m": [0.0, 0.0, 0.15]}],
        "distances": [{"pairs": [["a", "b"]]}],
        "candidates": 300,
        **values,
    }
    return setup_with(data)


def planned(setup: PoseSetup) -> PosePlan:
    return pose_plan(setup, seconds=100.0, since=lambda: 0.0)


@pytest.fixture(scope="module")
def tracker() -> PosePlan:
    return planned(changed(TRACKER))


@pytest.fixture(scope="module")
def wire() -> PosePlan:
    return planned(changed(WIRE, poses=40))  # one length a pose: more than the unknowns


def keeps_limits(setup: PoseSetup, poses: Candidates) -> None:
    """Fails for a pose outside the axis box or too close."""
    assert (poses.axes >= setup.lower).all()
    assert (poses.axes <= setup.upper).all()
    for k, station in enumerate(setup.stations):
        own = poses.axes[poses.station == k]
        frames = station_frames(setup, station, own)
        line = setup.instrument.measured != "socket"
        apart = smallest_distance(setup, station, frames, line=line)
        assert apart.min() >= setup.request.limits.clearance_m


def test_planned_poses_of_a_tracker_keep_limits_and_line_of_sight(tracker: PosePlan) -> None:
    setup, poses = tracker.setup, tracker.poses
    keeps_limits(setup, poses)
    station = setup.stations[0]
    frames = station_frames(setup, station, poses.axes)
    to_tracker = station.origin[:, None] - frames.tip
    looks = frames.x[-2]  # the reflector looks along the flange's x axis
    cosine = (looks * to_tracker).sum(axis=0) / np.linalg.norm(to_tracker, axis=0)
    assert np.degrees(np.arccos(cosine)).max() <= 60.0 + 1e-9


@pytest.mark.slow
def test_planned_lengths_stay_within_the_stroke_and_its_margin(wire: PosePlan) -> None:
    setup = wire.setup
    keeps_limits(setup, wire.poses)
    for k, station in enumerate(setup.stations):
        own = wire.poses.axes[wire.poses.station == k]
        tip = station_frames(setup, station, own).tip
        length = np.linalg.norm(tip - station.origin[:, None], axis=0)
        assert len(own) > 5
        assert length.min() >= 0.1 + 0.19  # a tenth of the wire's stroke
        assert length.max() <= 2.0 - 0.19


def test_a_stroke_of_two_millimetres_is_met_by_inverse_kinematics() -> None:
    seats = [{"position_m": [0.9, 0.0, 0.6]}]
    setup = setup_with(data_of(WIRE, instrument="qc20w_300", seats=seats))
    poses = random_candidates(setup, 100, np.random.default_rng(1))
    tip = station_frames(setup, setup.stations[0], poses.axes).tip
    length = np.linalg.norm(tip - setup.stations[0].origin[:, None], axis=0)
    assert np.abs(length - 0.3).max() < 0.9e-3
    assert length.std() > 2e-4  # spread over the stroke


def test_sockets_hold_the_ball_and_the_flange_comes_from_above() -> None:
    setup = socket_setup()
    poses = random_candidates(setup, 200, np.random.default_rng(1))
    keeps_limits(setup, poses)
    assert set(poses.station.tolist()) == {0, 1}
    for k, station in enumerate(setup.stations):
        frames = station_frames(setup, station, poses.axes[poses.station == k])
        assert np.abs(frames.tip - station.origin[:, None]).max() < 1e-6
        stem = frames.origin[-2] - frames.tip
        tilt = np.arccos(stem[2] / np.linalg.norm(stem, axis=0))
        assert np.degrees(tilt).max() <= 80.0 + 1e-9


@pytest.mark.parametrize("name", ["theodolite_pair", "dial_gauge", "tracker_pose"])
def test_an_instrument_of_any_kind_is_planned_by_what_it_measures(name: str) -> None:
    """Regression: bearings were a fault of the program, a plane allowed no pose."""
    places = {"dial_gauge": ([0.8, 0.0, 0.4], [0.0, 0.0, 0.1])}
    seat, target = places.get(name, ([3.0, 0.0, 0.5], [0.05, 0.0, 0.1]))
    setup = changed(
        TRACKER, instrument=name, seats=[{"position_m": seat}], targets=[{"position_m": target}]
    )
    poses, kind = random_candidates(setup, 60, np.random.default_rng(1)), setup.instrument.kind
    group = expected_group(setup, setup.stations[0], poses.axes)
    assert group.values.shape == (60, kind.columns)
    if name == "dial_gauge":  # a tenth of its travel of 10 mm stays free at either end
        assert group.values.min() > 0.99e-3
        assert group.values.max() < 9.01e-3
    assert (np.linalg.matrix_rank(information_of(setup).rows(poses)) == kind.equations).all()


def test_a_box_and_the_floor_exclude_poses() -> None:
    box = {"name": "shelf", "lower_m": [0.5, -0.5, 0.0], "upper_m": [1.5, 0.5, 1.0]}
    free = changed(TRACKER)
    setup = changed(TRACKER, limits={"keep_out": [box], "floor_m": 0.3})
    low, high = np.array(box["lower_m"]), np.array(box["upper_m"])
    inside, lowest = [], []
    for each in (setup, free):
        poses = random_candidates(each, 200, np.random.default_rng(1))
        tip = station_frames(each, each.stations[0], poses.axes).tip.T
        inside.append(int(((low < tip) & (tip < high)).all(axis=1).sum()))
        lowest.append(float(tip[:, 2].min()))
    assert inside[0] == 0 < inside[1]
    assert lowest[1] < 0.3 < lowest[0]


@pytest.mark.parametrize("path", [TRACKER, WIRE], ids=["points", "lengths"])
def test_the_rows_add_up_to_the_information_of_an_identification(path: Path) -> None:
    setup = changed(path)
    information = information_of(setup)
    poses = random_candidates(setup, 30, np.random.default_rng(5))
    rows = information.rows(poses).reshape(-1, information.layout.count)
    groups = tuple(
        expected_group(setup, station, poses.axes[poses.station == k])
        for k, station in enumerate(setup.stations)
    )
    table = PoseTable("all", setup.robot, groups)
    model = still_model(table, information.layout, information.corrections, np.zeros(6))
    weights = [np.ones(group.size) for group in groups]
    whole = equations_at(model, information.layout.mean, ExcessNoise(position=5e-5), weights)
    scale = np.outer(information.layout.sigma, information.layout.sigma)
    total = information.prior + rows.T @ rows
    rounding = 1e-14 * np.abs(total).max()
    assert total == pytest.approx(whole.normal * scale, rel=1e-9, abs=rounding)


def test_the_rows_of_a_length_are_its_derivative() -> None:
    setup = changed(WIRE)
    information, station = information_of(setup), setup.stations[0]
    poses = random_candidates(setup, 20, np.random.default_rng(5))
    poses = poses.part(poses.station == 0)
    rows = information.rows(poses)[:, 0]
    layout = information.layout
    q = expected_group(setup, station, poses.axes).q
    sigma = np.hypot(setup.instrument.sigma_length, setup.request.unexplained_m)

    def length(chain: Chain) -> Array:
        frames = forward(chain, q)
        tip = frames.tip + np.einsum("ikn,k->in", frames.rotation(), station.point)
        return np.asarray(np.linalg.norm(tip - station.origin[:, None], axis=0))

    for i, parameter in enumerate(layout.parameters):
        ends = []
        for step in (1e-6, -1e-6):  # [m, rad]; central differences are good to 1e-9
            values = getattr(setup.chain, parameter.kind).copy()
            values[parameter.row] += step
            ends.append(length(replace(setup.chain, **{parameter.kind: values})))
        slope = (ends[0] - ends[1]) / 2e-6
        at = i
        expected = np.abs(slope) * layout.sigma[at] / sigma  # the sign of a row is free
        assert np.abs(rows[:, at]) == pytest.approx(expected, rel=1e-4, abs=1e-4)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_a_pose_changes_the_objective_by_what_the_update_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, root = rng.normal(size=(12, 3, 8)), rng.normal(size=(8, 8))
    design = Design(rng.normal(size=(12, 6)), rows, np.eye(8), root)
    selected = np.arange(5)
    covariance = np.linalg.inv(design.normal(selected))
    gain = decrease(rows, covariance, root)
    for k in range(5, 12):
        after = design.objective(np.append(selected, k))
        assert design.objective(selected) - after == pytest.approx(gain[k], rel=1e-6)
    loss = decrease(rows[selected], covariance, root, -1.0)
    for k in selected:
        after = design.objective(np.delete(selected, k))
        assert after - design.objective(selected) == pytest.approx(loss[k], rel=1e-6)


def test_an_exchange_never_makes_the_selection_worse_and_poses_stay_apart() -> None:
    setup = changed(TRACKER)
    information = information_of(setup)
    poses = random_candidates(setup, 300, np.random.default_rng(2))
    rows = information.rows(poses)
    design = Design(poses.axes, rows, information.prior, information.root)
    start = greedy(design, 30)
    after = exchanged(design, start)
    assert design.objective(after) < design.objective(start)
    assert len(set(after.tolist())) == 30
    axes = poses.axes[after]
    far = np.abs(axes[:, None] - axes[None]).max(axis=2) + 2.0 * np.pi * np.eye(30)
    assert far.min() >= APART
    assert (exchanged(design, start, lambda: False) == start).all()


def test_a_plan_is_predicted_to_beat_random_poses(tracker: PosePlan, wire: PosePlan) -> None:
    assert (tracker.poses.size, wire.poses.size) == (30, 40)
    assert tracker.gain > 1.3
    assert wire.gain > 1.7
    assert tracker.prediction.tcp_sigma.mean() < tracker.random.min()
    assert wire.prediction.tcp_sigma.mean() < wire.random.min()
    assert tracker.prediction.tcp_sigma.mean() < 0.1 * tracker.information.catalogue_sigma().mean()


def errors(plan: PosePlan, seeds: range) -> tuple[Array, Array]:
    """TCP errors [m] of drawn robots, identified from the plan and from random poses."""
    setup, rng = plan.setup, np.random.default_rng(plan.setup.request.seed)
    candidates, count = random_candidates(setup, 250, rng), plan.poses.size

    def error(robot: DrawnRobot, poses: Candidates, noise: np.random.Generator) -> float:
        result = fit_table(robot.measured(poses, noise), FitOptions(joint_errors="none"))
        return robot.error_of(result.identified_robot()).mean

    out = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        robot = drawn_robot(setup, rng)
        sets = [candidates.part(rng.permutation(candidates.size)[:count]) for _ in range(3)]
        random = np.median([error(robot, poses, rng) for poses in sets])
        out.append((error(robot, plan.poses, rng), random))
    by_plan, by_random = np.array(out).T
    return by_plan, by_random


@pytest.mark.long
def test_the_real_error_follows_the_prediction(tracker: PosePlan, wire: PosePlan) -> None:
    """Robots with sag and with joint errors that are not fitted, as in docs/planning.md."""
    by_plan, by_random = errors(tracker, range(100, 105))
    assert np.median(by_random / by_plan) > 1.05
    assert (
        by_plan.mean() < tracker.prediction.tcp_sigma.mean()
    )  # that allows for larger joint errors
    by_plan, by_random = errors(wire, range(100, 105))
    assert np.median(by_random / by_plan) > 1.4


def test_refinement_begins_only_within_the_time_given(tracker: PosePlan) -> None:
    hurried = pose_plan(tracker.setup, seconds=0.0, since=lambda: 1.0)
    assert hurried.poses.size == 30
    assert 1.0 < hurried.gain < tracker.gain


def test_the_order_of_a_plan_is_short_and_its_moves_are_clear(tracker: PosePlan) -> None:
    setup, axes = tracker.setup, tracker.poses.axes
    assert not tracker.route.blocked
    moves = np.array([k for k in range(1, len(axes)) if k not in tracker.route.passing])
    assert clear_moves(setup, 0, axes[moves - 1], axes[moves]).all()
    speed = setup.robot.axis_speed_max
    rng = np.random.default_rng(1)
    shuffled = [np.diff(axes[rng.permutation(30)], axis=0) for _ in range(20)]
    times = [float((np.abs(step) / speed).max(axis=1).sum()) for step in shuffled]
    assert tracker.route.seconds < 0.7 * min(times)


def test_a_plan_goes_seat_by_seat(wire: PosePlan) -> None:
    assert (np.diff(wire.poses.station) >= 0).all()


def test_two_opt_shortens_an_order_and_solves_small_ones() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(size=(7, 2))
    time = np.linalg.norm(points[:, None] - points[None], axis=2)

    def length(order: Array | tuple[int, ...]) -> float:
        return float(time[list(order)[:-1], list(order)[1:]].sum())

    best = min(length(order) for order in permutations(range(7)))
    starts = [two_opt(time, nearest_neighbours(time, first)) for first in range(7)]
    assert min(length(order) for order in starts) == pytest.approx(best)
    for first, order in enumerate(starts):
        assert sorted(order.tolist()) == list(range(7))
        assert length(order) <= length(nearest_neighbours(time, first)) + 1e-12


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_the_command_writes_a_table_that_check_reads_once_it_is_filled(tmp_path: Path) -> None:
    file, folder = tmp_path / "request.yaml", tmp_path / "plan"
    write_yaml(file, data_of(TRACKER, candidates=200, poses=30))
    done = RUNNER.invoke(app, ["plan", str(file), "--out", str(folder)])
    assert done.exit_code == 0, done.output
    assert "predicted TCP sigma" in done.output
    (folder / "irb2400_tracker.src").write_text("of a robot of another controller")
    again = RUNNER.invoke(app, ["plan", str(file), "--out", str(folder), "--json"])
    assert again.exit_code == 0
    result = json.loads(again.stdout)
    assert result["acceptable"] is True
    assert result["plan"]["poses"] == 30
    assert set(result["files"]) == {
        *("poses.csv", "poses.yaml", "plan.yaml", "request.yaml"),
        "irb2400_tracker.mod",
    }
    rows = rows_of(folder / "poses.csv")
    axes = np.radians([[float(row[f"axis{i}_deg"]) for i in range(1, 7)] for row in rows])
    setup = setup_of(load_request(file), relative_to=tmp_path)
    measured = drawn_robot(setup, np.random.default_rng(1)).measured(
        Candidates(axes, np.zeros(30, dtype=np.intp)), np.random.default_rng(2)
    )
    for row, (x, y, z) in zip(rows, measured.groups[0].values * 1e3, strict=True):
        row |= {"x_mm": f"{x:.4f}", "y_mm": f"{y:.4f}", "z_mm": f"{z:.4f}"}
    with (folder / "poses.csv").open("w", newline="") as out:
        writer = csv.DictWriter(out, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    read = import_poses(folder).table
    assert read.seats == ("tracker",)
    assert read.targets == ("reflector",)
    assert read.groups[0].values == pytest.approx(measured.groups[0].values, abs=1e-7)
    assert read.q == pytest.approx(measured.q, abs=1e-9)
    checked = RUNNER.invoke(app, ["check", str(folder)])
    assert checked.exit_code == 0, checked.output


def test_programs_read_back_are_the_poses(tracker: PosePlan) -> None:
    text = pose_program("rapid", tracker)
    lines = text.splitlines()
    targets = jointtarget_text(
        LogText("p.mod", "utf-8", lines, np.arange(1, len(lines) + 1), quoted=False)
    )
    read = np.array([[float(v) for v in line.split("\t")] for line in targets.lines[1:]])
    names = re.findall(r"CONST jointtarget (\w+):=", text)
    poses = [k for k, name in enumerate(names) if name.startswith("p")]
    expected = np.degrees(tracker.poses.axes)
    assert read[poses] == pytest.approx(expected, abs=1e-4)
    assert re.findall(r"MoveAbsJ (\w+)", text) == names
    assert text.count("WaitTime 3;") == 30
    for language, move in (("pdl2", r"MOVE JOINT TO \{(.*)\}"), ("krl", r"PTP \{(.*)\}")):
        program = pose_program(language, tracker)
        moves = [re.sub(r"A\d ", "", found) for found in re.findall(move, program)]
        read = np.array([[float(v) for v in found.split(",")] for found in moves])
        assert read[poses] == pytest.approx(expected, abs=1e-4)
    assert pose_program("krl", tracker).count("WAIT SEC 3") == 30


def test_a_program_stops_where_a_person_attaches_the_instrument(wire: PosePlan) -> None:
    for language, stop in (("rapid", "Stop; !"), ("pdl2", "PAUSE --"), ("krl", "HALT ;")):
        assert pose_program(language, wire).count(f"{stop} attach") == 40


def test_a_seat_out_of_reach_says_by_how_much() -> None:
    with pytest.raises(InputError, match=r"most by reach; the target comes no closer than 2\d* mm"):
        random_candidates(socket_setup(robot="irb2400"), 100, np.random.default_rng(1))


def test_what_excludes_poses_is_counted() -> None:
    setup, screen = changed(TRACKER), Screen()
    drawn = np.random.default_rng(1).uniform(setup.lower, setup.upper, (500, 6))
    axes, source = feasible(setup, 0, drawn, np.random.default_rng(1), screen)
    assert screen.drawn == 500
    assert len(axes) == 500 - sum(screen.excluded.values())
    assert (axes == drawn[source]).all()
    assert screen.excluded["aim of the target"] > 200


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"limits": {"axis_lower_deg": [0.0] * 7}}, r"axis_lower_deg: 7 values, but irb2400 has 6"),
        ({"limits": {"axis_margin_deg": 100.0}}, r"leave axis \d nothing"),
        ({"distances": [{"pairs": [["left", "no"]]}]}, r"states no distance of its own"),
        (
            {"distances": [{"pairs": [["left", "no"]], "length_m": 1.0, "sigma_m": 1e-3}]},
            r"nothing is measured at seat 'no'\. Valid seats: left, right",
        ),
    ],
)
def test_a_request_that_does_not_fit_the_robot_is_refused(
    change: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        setup_with(data_of(WIRE, **change))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"seats": [{"position_m": [1.0, 0.0, 0.0]}, {"position_m": [1.0, 0.0, 0.2]}]},
            r"expected another name than 'seat'",
        ),
        (
            {"targets": [{"position_m": [0.0, 0.0, 0.1], "cone_deg": 30}]},
            r"give axis beside cone_deg",
        ),
        ({"poses": 5}, r"poses = 5"),
    ],
)
def test_a_wrong_request_is_refused_with_its_key(
    tmp_path: Path, change: dict[str, object], words: str
) -> None:
    write_yaml(tmp_path / "request.yaml", data_of(WIRE, **change))
    with pytest.raises(DescriptionError, match=words):
        load_request(tmp_path / "request.yaml")


def test_options_of_trajectories_are_refused_for_still_poses(tmp_path: Path) -> None:
    command = ["plan", str(TRACKER), "--out", str(tmp_path / "out"), "--what-if", "rate=20"]
    done = RUNNER.invoke(app, command)
    assert done.exit_code != 0
    assert "--what-if belongs to trajectories" in f"{done.output}{done.exception}"


def test_planned_pictures_show_the_whole_board_and_more_than_chance(tmp_path: Path) -> None:
    """Corners by a pinhole of 69 deg across 2016 px, 8 x 6 squares of 20 mm."""
    setup = changed(PLANS / "so101_phone.yaml", poses=12, candidates=200)
    plan = planned(setup)
    grid = 0.02 * np.array([[x, y, 0.0] for y in range(7) for x in range(9)])
    seat, target = setup.request.seats[0], setup.request.targets[0]
    assert seat.rotvec_rad is not None
    board = grid + np.array(target.position_m)  # on the flange, parallel to it
    frames = forward(setup.chain, controller_to_joints(setup.robot, plan.poses.axes))
    placed = np.einsum("ijn,cj->nci", frames.rotation(), board) + frames.tip.T[:, None]
    turn = Rotation.from_rotvec(seat.rotvec_rad).as_matrix()
    seen = (placed - np.array(seat.position_m)) @ turn
    pixels = 1008.0 / np.tan(np.deg2rad(34.5)) * seen[..., :2] / seen[..., 2:]
    assert (seen[..., 2] > 0.0).all()
    assert (np.abs(pixels) < [1008.0, 756.0]).all()
    normal = turn.T @ frames.rotation()[:, 2]
    middle = seen.mean(axis=1)
    facing = np.einsum("in,ni->n", normal, middle) / np.linalg.norm(middle, axis=1)
    assert (facing > np.cos(np.deg2rad(60.0)) - 1e-6).all()
    assert plan.gain > 1.0
    assert 1e-4 < plan.prediction.tcp_sigma.mean() < 1e-2
    written = write_pose_plan(plan, tmp_path / "plan", relative_to=PLANS)
    assert set(written) == {"joints.csv", "plan.yaml"}  # what is measured comes from the pictures
    rows = rows_of(tmp_path / "plan" / "joints.csv")
    assert [row["image"] for row in rows] == [f"p{k:03d}.jpg" for k in range(1, 13)]
    angles = [[float(row[f"J{j} [deg]"]) for j in range(1, 6)] for row in rows]
    assert np.radians(angles) == pytest.approx(plan.poses.axes, abs=1e-5)

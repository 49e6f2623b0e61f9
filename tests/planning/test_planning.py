"""Planning: limits of a path, its predicted uncertainty, and programs that match the plan."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.cell.descriptions import ProgramLanguage
from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.geometry import bar_frames, robot_frames
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.ident.robot.accuracy import position_sigma
from ballbar.ident.robot.tcp_uncertainty import scale_error
from ballbar.planning.candidate import PathCandidate, genome_of, space_of
from ballbar.planning.clearance import clearance
from ballbar.planning.crlb import predict
from ballbar.planning.evaluation import Evaluator, check, evaluate, evaluators, objective, tcp_rms
from ballbar.planning.files import path_data
from ballbar.planning.force import DRAWS, predicted_forces
from ballbar.planning.limits import violations
from ballbar.planning.plan import assess, covered, first_path, hints
from ballbar.planning.programs import (
    SUFFIXES,
    TELESCOPING,
    ProgrammedPath,
    path_program,
    path_table,
    without_program,
)
from ballbar.planning.questions import question
from ballbar.planning.request import PlanCell, PlanLimits, PlanRequest, PlanTiming, load_request
from ballbar.planning.search import SearchProgress, evaluating_processes, ranked, search
from ballbar.planning.trajectory import SAG, Targets, Trajectory, targets_of, trajectories
from ballbar.planning.verify import (
    checks,
    plant_errors,
    run_in_plant,
    set_without_strain,
    violations_in,
)
from ballbar.planning.what_if import answers
from ballbar.planning.workspace import KeepOut
from ballbar.scenario import load_scenario
from ballbar.sim.errors.static_errors import THESIS_3_1, true_geometry
from ballbar.sim.path_files import load_lissajous
from tests.helpers.first_path import first_runnable
from tests.helpers.program_reader import read_krl, read_pdl2, read_rapid

ROOT = Path(__file__).parents[2]
SCENARIOS = ROOT / "scenarios"
MANUAL_POSITION = np.array([0.70, 0.0, 0.54])  # where scenarios/irb2400.yaml puts the ball-bar


def request(**limits: float) -> PlanRequest:
    cell = PlanCell(robot="irb2400", ballbar="lund_600", ballbar_position_m=tuple(MANUAL_POSITION))
    return PlanRequest(schema="ballbar-plan/1", name="test", cell=cell, limits=PlanLimits(**limits))


@pytest.fixture(scope="module")
def evaluator() -> Evaluator:
    return evaluators(request())["lund_600"]


@pytest.fixture(scope="module")
def manual() -> PathCandidate:
    return PathCandidate(load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml"), MANUAL_POSITION)


@pytest.fixture(scope="module")
def trajectory(evaluator: Evaluator, manual: PathCandidate) -> Trajectory:
    return trajectories(evaluator.cell, manual, PlanTiming())[0]


@given(st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_a_candidate_has_the_numbers_that_gave_it(seed: int) -> None:
    space = space_of(load_request(SCENARIOS / "plans" / "irb2400.yaml"))
    z = np.random.default_rng(seed).random(space.size)
    again = space.candidate(genome_of(space, space.candidate(z)))
    for one, other in zip(
        path_data(again).values(), path_data(space.candidate(z)).values(), strict=True
    ):
        if not isinstance(one, str):
            assert one == pytest.approx(other, abs=0.011)  # two decimals of a degree
    assert again.position == pytest.approx(space.candidate(z).position, abs=1e-9)


def test_the_objective_of_a_search_is_the_tcp_sigma_over_the_grid(
    evaluator: Evaluator, trajectory: Trajectory
) -> None:
    found = predict(evaluator.predictor, trajectory, np.zeros(trajectory.t.size))
    assert tcp_rms(evaluator, found) == pytest.approx(
        np.sqrt(np.mean(found.tcp_sigma**2)), rel=1e-6
    )
    moved = found.layout.machine
    longhand = position_sigma(*found.tool, np.linalg.inv(found.normal)[np.ix_(moved, moved)])
    assert found.tcp_sigma == pytest.approx(longhand, rel=1e-4)  # an inverse without scaling


def test_the_prediction_is_the_bound_of_fits_afterwards(
    evaluator: Evaluator, trajectory: Trajectory
) -> None:
    with (ROOT / "docs" / "studies" / "everything_on_irb2400_4.csv").open() as file:
        bounds = [
            float(row["bound_mm"]) * 1e-3 for row in csv.DictReader(file) if row["paths"] == "a"
        ]
    tension = predicted_forces(evaluator.force_model, trajectory).tension[0]
    found = predict(evaluator.predictor, trajectory, tension)
    both = np.hypot(
        tcp_rms(evaluator, found), scale_error(evaluator.cell, evaluator.predictor.grid)
    )  # the fit counts the scale in
    mean_over_rms = found.tcp_sigma.mean() / tcp_rms(evaluator, found)
    assert both * mean_over_rms == pytest.approx(
        np.median(bounds), rel=0.1
    )  # noise levels are estimated there, assumed here


def test_better_sensors_never_predict_less(evaluator: Evaluator, trajectory: Trajectory) -> None:
    still = np.zeros(trajectory.t.size)

    def sigma(**changed: object) -> float:
        sensors = evaluator.request.sensors.model_copy(update=changed)
        return tcp_rms(
            evaluator, predict(replace(evaluator.predictor, sensors=sensors), trajectory, still)
        )

    usual = sigma()
    assert sigma(encoder_sigma_rad=2e-6) < usual < sigma(encoder_sigma_rad=5e-5)
    assert sigma(rod_sigma_m=5e-6) < usual
    assert sigma(encoders=(1, 2, 4)) > usual


def test_a_path_run_in_half_the_time_is_too_fast(
    evaluator: Evaluator, manual: PathCandidate
) -> None:
    limits = PlanLimits(axis_speed_share=0.13)
    slow, fast = (
        trajectories(evaluator.cell, manual, PlanTiming(duration_s=d, dwell_s=1.0, stops=0))[0]
        for d in (120.0, 60.0)
    )
    assert "axis_speed_share" not in {v.limit for v in violations(evaluator.cell, limits, slow)}
    worst = {v.limit: v for v in violations(evaluator.cell, limits, fast)}["axis_speed_share"]
    assert "axis 2 at" in worst.sentence
    assert "deg/s, limit 20" in worst.sentence  # 13 % of 150 deg/s


@pytest.mark.parametrize(
    ("limit", "value"),
    [
        ("axis_margin_deg", 40.0),
        ("axis_acceleration_deg_per_s2", 5.0),
        ("tcp_speed_m_per_s", 0.05),
        ("wrist_margin_deg", 60.0),
        ("elbow_margin_deg", 80.0),
        ("shoulder_margin_m", 0.9),
        ("ballbar_margin_deg", 50.0),
        ("cable_turns", 0.3),
    ],
)
def test_every_limit_of_motion_can_be_violated(
    evaluator: Evaluator, trajectory: Trajectory, limit: str, value: float
) -> None:
    assert limit not in {v.limit for v in violations(evaluator.cell, PlanLimits(), trajectory)}
    found = {
        v.limit: v for v in violations(evaluator.cell, PlanLimits(**{limit: value}), trajectory)
    }
    assert found[limit].excess > 0.0


def test_a_box_in_the_way_is_named_and_its_distance_is_that_of_the_tool(
    evaluator: Evaluator, trajectory: Trajectory
) -> None:
    highest = trajectory.tip[:, 2].max()
    high = (5.0, 5.0, highest + 2.0)
    motion = (trajectory.nominal, trajectory.q, trajectory.b, trajectory.t)
    free = evaluator.clearance.nearest(*motion)
    lamp = KeepOut(name="lamp", lower_m=(-5.0, -5.0, highest - 0.5), upper_m=high)
    boxed = request().cell.model_copy(update={"keep_out": (lamp,)})
    found = clearance(evaluator.cell, boxed).nearest(*motion)
    assert "box lamp" in found.pair
    assert found.distance < free.distance


def test_capsules_are_as_far_apart_as_two_segments(
    evaluator: Evaluator, trajectory: Trajectory
) -> None:
    """Oracle: the rod against the forearm by brute force over points of both axes."""
    of = evaluator.clearance
    pairs = tuple(p for p in of.pairs if {of.names[k] for k in p} == {"upper arm", "rod"})
    only = replace(of, pairs=pairs)
    found = only.nearest(trajectory.nominal, trajectory.q, trajectory.b, trajectory.t)
    k = int(np.flatnonzero(np.isclose(trajectory.t, found.t))[0])
    robot = robot_frames(trajectory.nominal, trajectory.q[k : k + 1])
    bar = bar_frames(trajectory.nominal, trajectory.b[k : k + 1])
    share = np.linspace(0.0, 1.0, 801)[:, None]
    ball, tip = bar.origin[0][:, 0], bar.tip[:, 0]
    along = (tip - ball) / np.linalg.norm(tip - ball)
    rod = ball + 0.1 * along + share * (tip - ball - 0.2 * along)
    arm = robot.origin[1][:, 0] + share * (robot.origin[2] - robot.origin[1])[:, 0]
    axes = np.linalg.norm(rod[:, None] - arm[None], axis=2).min()
    apart = axes - of.radii["rod"] - of.radii["upper arm"]
    assert found.distance == pytest.approx(apart, abs=1e-3)  # points 1 mm apart


def test_a_request_that_cannot_be_met_says_why() -> None:
    cell = PlanCell(robot="irb2400", ballbar="lund_600", ballbar_position_m=(3.5, 0.0, 0.5))
    far = request().model_copy(update={"cell": cell})
    with pytest.raises(
        InputError, match=r"no path found: \d+ random paths .* out of reach 100%.*Move the ball-bar"
    ):
        first_path(evaluators(far), seconds=1.0)


def test_another_rod_is_taken_where_the_first_one_allows_nothing() -> None:
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    requested = requested.model_copy(
        update={"cell": requested.cell.model_copy(update={"ballbar_choices": ("lund_900",)})}
    )
    both = evaluators(requested)
    assert [one.cell.ballbar.length for one in both.values()] == [0.6, 0.9]
    both["lund_600"] = replace(
        both["lund_600"],
        limits=both["lund_600"].limits.model_copy(update={"wrist_margin_deg": 89.0}),
    )
    start, _ = first_path(both)
    assert start.rod == "lund_900"
    assert not check(both["lund_900"], space_of(requested).candidate(start.genome)).violations


def test_a_search_may_begin_with_a_path_that_exists(tmp_path: Path) -> None:
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    cell = requested.cell.model_copy(update={"ballbar_choices": ("lund_900",)})
    requested = requested.model_copy(update={"cell": cell, "start_from": ("irb2400_a.yaml",)})
    found = hints(requested, SCENARIOS / "paths")
    assert [hint.rod for hint in found] == ["lund_600", "lund_900"]
    for hint in found:
        begun = space_of(requested).candidate(hint.genome).shape
        expected = load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml")
        for s in (0.0, 0.1, 0.37):
            angles, wanted = (shape.angles(np.array([s])) for shape in (begun, expected))
            assert np.exp(1j * angles) == pytest.approx(np.exp(1j * wanted), abs=1e-3)
    middle = 0.5 * sum(np.array(corner) for corner in cell.region)
    planned = hints(
        requested.model_copy(update={"start_from": ("irb2400_planned.yaml",)}), SCENARIOS / "paths"
    )
    assert space_of(requested).candidate(found[0].genome).position == pytest.approx(middle)
    assert space_of(requested).candidate(planned[0].genome).position == pytest.approx(
        [0.897, -0.195, 0.486]
    )
    with pytest.raises(DescriptionError, match=r"nowhere\.yaml"):
        hints(requested.model_copy(update={"start_from": ("nowhere.yaml",)}), tmp_path)


def test_cover_of_the_sphere_is_that_of_a_cap() -> None:
    assert covered(np.array([[0.0], [0.0], [1.0]])) == pytest.approx(
        0.5 * (1.0 - np.cos(np.radians(10.0))), rel=0.1
    )  # 2000 points


@pytest.fixture(scope="module")
def runnable() -> tuple[Evaluator, PathCandidate]:
    return first_runnable()


@pytest.mark.parametrize(
    ("robot", "suffix"), [("irb120", "mod"), ("nj220", "pdl"), ("kr10_r1100", "src")]
)
def test_a_program_is_written_in_the_language_of_the_robots_controller(
    robot: str, suffix: str
) -> None:
    """RAPID and PDL2 were written for a KUKA."""
    described = load_robot(robot)
    assert described.program_language is not None
    assert SUFFIXES[described.program_language] == suffix
    assert without_program(described) == ""


def test_where_no_program_is_written_the_reason_is_given() -> None:
    assert "robot ur10e states no `program_language`" in without_program(load_robot("ur10e"))
    assert "panda has 7 axes, programs are for six" in without_program(load_robot("panda"))


READERS = {"rapid": read_rapid, "pdl2": read_pdl2, "krl": read_krl}


@pytest.mark.parametrize("language", READERS)
def test_a_program_for_a_telescoping_bar_leaves_the_servo_as_it_is(
    language: ProgramLanguage,
) -> None:
    t, dwells = np.array([0.0, 2.0, 4.0, 8.0]), np.array([0.0, 0.0, 1.0, 0.0])
    targets = Targets(t, np.outer(t, np.arange(6.0) - 2.0), dwells, 0.0)
    robot = load_robot("kr10_r1100")
    text = path_program(language, ProgrammedPath("plan", robot, targets, ["limit"], TELESCOPING))
    program = READERS[language](text)
    assert program.axes == pytest.approx(targets.axes)
    assert program.rests == pytest.approx(dwells)
    assert "soft" not in text.lower()
    assert "mount the telescoping bar" in text
    assert "ball-bar" not in text


def test_programs_read_back_are_the_path(runnable: tuple[Evaluator, PathCandidate]) -> None:
    evaluator, candidate = runnable
    trajectory = evaluate(evaluator, candidate).trajectory
    assert trajectory is not None
    robot, timing = evaluator.cell.robot, evaluator.request.timing
    targets = targets_of(evaluator.cell, trajectory, timing)
    assert targets.sag <= SAG
    path = ProgrammedPath("one", robot, targets, ["limit line"])
    for language, read in READERS.items():
        program = read(path_program(language, path))
        assert program.axes == pytest.approx(targets.axes, abs=5e-5)
        assert program.rests == pytest.approx(targets.dwells)
        assert any("RUN SLOWLY FIRST" in line for line in program.comments)
        assert "limit line" in program.comments
    moves = read_rapid(path_program("rapid", path))
    assert moves.softness == dict.fromkeys(range(1, 7), 80.0)
    assert moves.seconds.sum() + moves.rests.sum() == pytest.approx(
        timing.duration_s, abs=0.5
    )  # four digits of each segment
    rows = [line for line in path_table(path).splitlines() if not line.startswith("#")]
    assert np.array([[float(x) for x in row.split(",")] for row in rows[1:]])[
        :, 1:7
    ] == pytest.approx(targets.axes, abs=5e-5)
    at = np.interp(targets.t[5], trajectory.t, joints_to_axes(robot, trajectory.q)[:, 0])
    assert np.radians(targets.axes[5, 0]) == pytest.approx(at, abs=1e-3)


@pytest.mark.slow
def test_the_expected_force_is_what_mujoco_measures(
    evaluator: Evaluator, manual: PathCandidate, trajectory: Trajectory
) -> None:
    motion = run_in_plant(evaluator.cell, evaluator.request, manual, seed=0)
    errors = plant_errors(table=True)
    true = true_geometry(trajectory.nominal, errors, evaluator.cell, seed=0)
    true = set_without_strain(true, trajectory.q[:1])
    deviations = np.array([[true[name] - trajectory.nominal[name]] for name in THESIS_3_1])
    model = evaluator.force_model
    assert model is not None
    model = replace(model, robots=replace(model.robots, errors=deviations))
    expected = predicted_forces(model, trajectory).tension[0]
    measured = np.interp(trajectory.t, motion.t, motion.rod_force)
    assert np.std(measured) > 25.0
    # N; play and stiction are not in the expectation
    assert np.sqrt(np.mean((expected - measured) ** 2)) < 10.0


@pytest.mark.long
@pytest.mark.parametrize("robot", ["irb2400", "nj220"])
def test_the_planned_paths_keep_every_limit_in_mujoco(robot: str) -> None:
    requested = load_request(SCENARIOS / "plans" / f"{robot}.yaml")
    scenario = load_scenario(SCENARIOS / f"{robot}_planned.yaml")
    evaluator = evaluators(requested)[scenario.cell.ballbar]
    shape = load_lissajous(SCENARIOS / scenario.path.file)
    candidate = PathCandidate(shape, np.array(scenario.cell.ballbar_position_m))
    motion = run_in_plant(evaluator.cell, requested, candidate, seed=2)
    found = checks(evaluator.cell, requested.limits, evaluator.clearance, motion)
    assert violations_in(found) == 0, [c for c in found if c.instants]
    strict = requested.limits.model_copy(update={"force_N": 1.0})
    assert violations_in(checks(evaluator.cell, strict, evaluator.clearance, motion)) > 0


@pytest.mark.slow
@pytest.mark.long
def test_a_search_finds_better_paths_and_ctrl_c_keeps_the_best() -> None:
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    start, _ = first_path(evaluators(requested))
    seen: list[float] = []

    def stop_when_better(progress: SearchProgress) -> None:
        seen.append(progress.tcp)
        if progress.best is not None and progress.best.objective < start.objective:
            raise KeyboardInterrupt

    with evaluating_processes(requested, 2) as pool:
        limits = {"seconds": 30.0, "evaluations": 500}
        found = search(requested, pool, first=[start], hints=[], show=stop_when_better, **limits)
        best_for_all = ranked(found.incumbents, pool)
    assert found.stopped
    assert found.best is not None
    assert found.best.objective < start.objective
    evaluator = evaluators(requested)[start.rod]
    assert best_for_all[0].objective <= objective(evaluator, start.genome, robots=DRAWS)
    assert [one.objective for one in best_for_all] == pytest.approx(
        sorted(objective(evaluator, one.genome, robots=DRAWS) for one in best_for_all)
    )
    assert seen == sorted(seen, reverse=True)


def test_what_if_answers_one_thing_at_a_time(runnable: tuple[Evaluator, PathCandidate]) -> None:
    evaluator, candidate = runnable
    plan = assess(evaluator, candidate)
    requested = [
        question(text)
        for text in ("encoder=5e-6,1e-5,1e-4", "plate_length=0.25,0.5", "encoders=1245,124")
    ]
    found = list(answers(plan, requested))
    tcp = [a.tcp for a in found]
    assert tcp[1] == pytest.approx(plan.evaluation.tcp, rel=1e-9)  # as it is
    assert tcp[0] < tcp[1] < tcp[2]
    assert found[4].scale == pytest.approx(
        0.5 * found[3].scale, rel=0.2
    )  # the longer plate widens the workspace too
    assert tcp[6] > tcp[5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("encodr=1", "there is no 'encodr'"),
        ("encoder=a", "give numbers in rad"),
        ("encoder=5", "from 1e-08 to 0.01"),
        ("encoders=17", "sets of at least two encoders"),
    ],
)
def test_a_wrong_what_if_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        question(text)


def test_the_round_end_of_the_forearm_reaches_the_centre_of_the_wrist(
    evaluator: Evaluator, trajectory: Trajectory
) -> None:
    """Its capsule ends a radius before it; that of the upper arm is from joint 2 to joint 3."""
    of, some = evaluator.clearance, slice(0, 3)
    robot = robot_frames(trajectory.nominal, trajectory.q[some])
    bar = bar_frames(trajectory.nominal, trajectory.b[some])
    half, centres, axes = of._placed(robot, bar)
    along = axes.reshape(*centres.shape, 3)[..., 2]
    bodies = {name: k for k, name in enumerate(of.names)}
    origin = robot.origin.transpose(2, 0, 1)  # (N, J + 1, 3)
    for name, start, end in (("upper arm", 1, 2), ("forearm", 2, 4)):
        k = bodies[name]
        reach = half[:, k, None] * along[:, k]
        radius = of.radii[name] if name == "forearm" else 0.0
        line = origin[:, end] - origin[:, start]
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        np.testing.assert_allclose(centres[:, k] - reach, origin[:, start], atol=1e-9)
        np.testing.assert_allclose(centres[:, k] + reach + radius * line, origin[:, end], atol=1e-9)

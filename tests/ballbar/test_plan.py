"""The command `ballbar plan`: which path it keeps, what it writes and what it says."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from typer.testing import CliRunner

from ballbar.cell.errors import InputError
from ballbar.cell.files import DESCRIPTIONS
from ballbar.cell.geometry import bar_frames
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.cell.strict_yaml import load_model, load_yaml
from ballbar.commands.cli import app
from ballbar.plan import picture
from ballbar.plan import show as command
from ballbar.plan.beam import OFFSET_PLATE, PLATE_FORCE
from ballbar.plan.summary import say_answers, say_checks, say_plan, say_plate, say_pose_plan
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.evaluation import Evaluator
from ballbar.planning.files import planned_path_data
from ballbar.planning.plan import PathPlan, assess
from ballbar.planning.request import PlanCell, PlanRequest, load_request
from ballbar.planning.verify import Check
from ballbar.planning.what_if import Answer
from ballbar.scenario import load_scenario
from ballbar.sim.path_files import LissajousFile
from tests.helpers.first_path import first_runnable
from tests.helpers.simulated_recordings import SCENARIOS


@pytest.fixture(scope="module")
def runnable() -> tuple[Evaluator, PathCandidate]:
    return first_runnable()


@pytest.mark.slow
@pytest.mark.parametrize("violating", [0, 1, 2])
def test_the_best_path_that_keeps_all_limits_in_mujoco_is_taken(
    violating: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    runnable: tuple[Evaluator, PathCandidate],
) -> None:
    best = assess(*runnable)
    candidate = best.evaluation.candidate
    moved = replace(candidate, position=candidate.position + np.array([1e-3, 0.0, 0.0]))
    found = [best, replace(best, evaluation=replace(best.evaluation, candidate=moved))]
    monkeypatch.setattr(command, "searched", lambda *_: iter(found))
    monkeypatch.setattr(command, "plan_picture", lambda _: b"")

    def checked(plan: PathPlan, _: int) -> list[Check]:
        return [Check("force_N", 1.0, 2.0, "N", 7 if plan in found[:violating] else 0, 10)]

    monkeypatch.setattr(command, "check_in_plant", checked)
    file, said = SCENARIOS / "plans" / "irb2400.yaml", Console(file=io.StringIO(), width=120)
    options = command.PlanOptions(folder=tmp_path, seconds=1.0, out=said, err=said)
    kept = command.make_plan(load_request(file), file, options)
    assert kept == (violating < 2)
    taken = found[min(violating, 1)].evaluation.candidate
    assert load_model(tmp_path / "path.yaml", LissajousFile).ballbar_position_m == pytest.approx(
        taken.position
    )
    assert isinstance(said.file, io.StringIO)
    assert said.file.getvalue().count("the next best path") == min(violating, 1)


@pytest.mark.long
def test_the_command_writes_a_scenario_that_can_be_loaded(
    tmp_path: Path, runnable: tuple[Evaluator, PathCandidate]
) -> None:
    out = tmp_path / "plan"
    request = ("plan", str(SCENARIOS / "plans" / "irb2400.yaml"), "--set", "name=mine")
    result = CliRunner().invoke(app, [*request, "--seconds", "0", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert load_request(out / "request.yaml").name == "mine"
    written = {p.name for p in out.iterdir()}
    names = {"path.yaml", "scenario.yaml", "plan.yaml", "plan.svg", "path.csv", "request.yaml"}
    assert written == {*names, "mine.mod"}
    assert "mathdefault" not in (out / "plan.svg").read_text(), "numbers, not what makes them"
    assert load_scenario(out / "scenario.yaml").path.file == "path.yaml"
    assert "predicted TCP sigma" in result.output
    assert "% (within 10 deg of the path; shipped plans cover 5 to 21%" in result.output
    assert "0 of" in result.output
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    # the file says where the ball-bar stands
    again = command.given_path(requested, out / "path.yaml", None)
    assert planned_path_data(again) == load_yaml(out / "path.yaml").data
    (out / "path.yaml").write_text(
        (out / "path.yaml").read_text().partition("ballbar_position_m")[0]
    )
    with pytest.raises(InputError, match="base position of the ball-bar is not known"):
        command.given_path(requested, out / "path.yaml", None)


POSITION = (0.897, -0.195, 0.486)  # as in scenarios/irb2400_planned.yaml


@pytest.fixture(scope="module")
def given() -> PathPlan:
    """The path of scenarios/irb2400_planned.yaml, with round figures in place of predicted ones."""
    cell = PlanCell(robot="irb2400", ballbar="lund_600", ballbar_position_m=POSITION)
    requested = PlanRequest(schema="ballbar-plan/1", name="test", cell=cell)
    path = SCENARIOS / "paths" / "irb2400_planned.yaml"
    return command.given_path(requested, path, POSITION)


def written(say: Callable[..., None], *shown: object) -> str:
    """The text that a summary prints, in lines of 200 characters."""
    text = io.StringIO()
    say(Console(file=text, width=200), *shown)
    return text.getvalue()


def words(line: str) -> str:
    return " ".join(line.split())


def test_a_plan_says_where_it_comes_from_and_what_it_will_identify(given: PathPlan) -> None:
    text = words(written(say_plan, given))
    tcp = given.tcp * 1e6
    assert text.startswith("path as given; ball-bar lund_600 at (0.897, -0.195, 0.486) m predicted")
    spread = f"({tcp.min():.1f} to {tcp.max():.1f} over {tcp.size} robots)"
    largest = given.typical.tcp_sigma.max() * 1e6
    assert f"{np.median(tcp):.1f} um rms {spread}, largest {largest:.0f} um; the scale" in text
    assert f"ba5 adds {given.scale_adds * 1e6:.1f} um sphere covered" in text
    assert given.forces is not None
    least, most = given.forces.interval
    assert "(within 10 deg of the path; shipped plans cover 5 to 21%, and" in text
    assert f"rod force {least:.0f} to {most:.0f} N expected sign changes of the load of" in text
    assert "stopped" not in text
    assert "states no" not in text
    count, names = text.partition("hardly seen by the path (")[2].split("): ")
    assert int(count) == len(names.split())
    sigma, prior = given.typical.sigma, given.typical.prior
    assert names.split() == [name for name in sigma if sigma[name] / prior[name] > 0.9]


def test_a_search_says_its_time_and_that_it_was_stopped(given: PathPlan) -> None:
    one = replace(
        given, predictions=given.predictions[:1], evaluated=321, seconds=42.4, stopped=True
    )
    text = words(written(say_plan, one))
    assert text.startswith("stopped before its time; this is the best so far path found in 42 s, ")
    assert "42 s, 321 tried; ball-bar lund_600" in text
    assert f"{one.tcp[0] * 1e6:.1f} um rms, largest" in text


def test_limits_in_mujoco_are_counted_over_all_robots() -> None:
    rows = [
        (3, [Check("rod force", 41.23, 50.0, "N", 0, 10), Check("share", 0.5, 1.0, "", 0, 5)]),
        (8, [Check("rod force", 61.0, 50.0, "N", 7, 10), Check("share", 0.25, 1.0, "", 0, 5)]),
    ]
    lines = [words(line) for line in written(say_checks, rows).splitlines()]
    assert lines[1:] == [
        "limit allowed robot 3 robot 8 violated",
        "rod force 50 41.2 N 61.0 N 7 of 20",
        "share 1 0.500 0.250 0 of 10",
    ]


ANSWERS = [
    Answer("encoder", "5e-06 rad", 3e-6, 4e-6, ""),
    Answer("plate_length", "0.5 m", None, 2e-6, "no path: [reach]"),
]


def test_what_if_adds_the_scale_in_squares(given: PathPlan) -> None:
    lines = [words(line) for line in written(say_answers, given, ANSWERS).splitlines()]
    assert lines[0] == "what if value TCP sigma [um] scale adds [um] together [um]"
    tcp, scale = given.evaluation.tcp * 1e6, given.scale_adds * 1e6
    assert lines[1] == f"as planned {tcp:.1f} {scale:.1f} {np.hypot(tcp, scale):.1f}"
    assert lines[2:] == [
        "encoder 5e-06 rad 3.0 4.0 5.0",
        "plate_length 0.5 m - 2.0 - no path: [reach]",
    ]
    assert command.answers_csv(ANSWERS).decode().splitlines() == [
        "what_if,value,tcp_sigma_m,scale_adds_m,note",
        "encoder,5e-06 rad,3e-06,4e-06,",
        "plate_length,0.5 m,,2e-06,no path: [reach]",
    ]


def test_the_plate_of_the_thesis_bends_as_its_moment_integrated_twice() -> None:
    plate = OFFSET_PLATE
    own = 2700.0 * 9.81 * plate.width * plate.thickness  # [N/m] weight
    out = plate.length - (np.arange(10_000) + 0.5) * plate.length / 10_000  # [m] from the free end
    stiffness = 70e9 * plate.width * plate.thickness**3 / 12.0
    turn = (PLATE_FORCE * out + 0.5 * own * out**2) / stiffness * plate.length / 10_000  # [rad]
    deflection = 1e6 * (turn * out).sum()
    text = words(written(say_plate))
    assert (
        f"45 mm of aluminium, 250 mm long, 100 N: the tip deflects by {deflection:.1f} um" in text
    )
    assert f"{deflection:.1f} urad seen from 1 m" in text
    assert f"turns by {1e6 * turn.sum():.0f} urad" in text


@pytest.mark.parametrize(("text", "position"), [("0.7,0,0.54", (0.7, 0.0, 0.54)), ("0.7,0", None)])
def test_a_position_is_three_numbers(text: str, position: tuple[float, ...] | None) -> None:
    if position is None:
        with pytest.raises(InputError, match=r"--position 0\.7,0: give three numbers in metres"):
            command.parse_position(text)
    else:
        assert command.parse_position(text) == position


def pose_plan(**route: object) -> Any:
    """Six poses of two seats and one target, as far as they are printed."""
    names = SimpleNamespace
    stations = [names(seat=seat, target="ball") for seat in ("floor", "table")]
    setup = names(robot=names(name="ur10e"), instrument=names(name="tracker"), stations=stations)
    moves = {"seconds": 61.6, "passing": {3: None}, "released": (), "blocked": ()} | route
    return names(
        setup=setup,
        route=names(**moves),
        poses=names(size=6),
        seconds=7.4,
        random=np.array([40e-6, 20e-6, 30e-6]),
        prediction=names(tcp_sigma=np.array([10e-6, 14e-6])),
        information=names(catalogue_sigma=lambda: np.array([0.9e-3, 1.1e-3])),
        gain=2.5,
        narrow=(),
    )


def test_a_plan_of_poses_is_compared_with_random_ones() -> None:
    text = words(written(say_pose_plan, pose_plan()))
    assert text == words(
        "6 poses of ur10e for tracker, 2 seats, 1 target; selected in 7 s predicted TCP sigma over "
        "the workspace: 12.0 um mean, 14 um largest; catalogue robot 1000 um as many random poses: "
        "30.0 um (20.0 to 40.0 over 3 sets); 2.50 times that of the plan moves: 62 s at top speed, "
        "1 over intermediate poses"
    )
    text = words(written(say_pose_plan, pose_plan(released=(2, 4), blocked=(0, 5))))
    assert text.endswith(
        "2 moves leave the instrument's stroke: take it off between poses "
        "too close on the way to poses 1, 6: do not run the program so"
    )


def drawn(draw: Callable[..., None], *shown: object) -> Axes:
    axes = Figure().subplots()
    draw(axes, *shown)
    return axes


def test_the_sphere_keeps_areas(given: PathPlan) -> None:
    """Lambert's projection has r = 2 sin(angle / 2); circles stand at 30, 60, 90, 120 degrees."""
    line, *circles = drawn(picture._sphere, given).lines
    z = bar_frames(given.trajectory.nominal, given.trajectory.b).z[2]
    angle = np.arctan2(np.hypot(z[0], z[1]), z[2])
    xy = np.array(line.get_data())
    np.testing.assert_allclose(np.hypot(*xy), 2.0 * np.sin(0.5 * angle), atol=1e-12)
    np.testing.assert_allclose(xy[0] * z[1], xy[1] * z[0], atol=1e-12)
    radii = [np.hypot(*np.array(circle.get_data())) for circle in circles]
    for radius, degrees in zip(radii, (30, 60, 90, 120), strict=True):
        np.testing.assert_allclose(radius, 2.0 * np.sin(np.radians(degrees) / 2.0))


def test_axes_are_drawn_as_shares_of_their_ranges(given: PathPlan) -> None:
    axes = drawn(picture._axes, given)
    robot = given.evaluator.cell.robot
    angles = joints_to_axes(robot, given.trajectory.q)
    for k, line in enumerate(axes.lines):
        low, high = robot.axis_lower[k], robot.axis_upper[k]
        np.testing.assert_allclose(low + line.get_ydata() * (high - low), angles[:, k], atol=1e-12)
    assert [line.get_label() for line in axes.lines] == list("123456")


def test_the_force_of_each_robot_is_drawn_with_their_median(given: PathPlan) -> None:
    assert given.forces is not None
    *each, middle, zero = drawn(picture._along_rod, given).lines
    np.testing.assert_array_equal([line.get_ydata() for line in each], given.forces.tension)
    np.testing.assert_allclose(middle.get_ydata(), np.median(given.forces.tension, axis=0))
    assert list(zero.get_ydata()) == [0.0, 0.0]


def test_lengths_are_drawn_about_the_nominal_with_the_stroke(given: PathPlan) -> None:
    nominal = given.evaluator.cell.ballbar.length
    lengths = nominal + np.array([[1e-3], [-2e-3]]) * np.ones(given.trajectory.t.size)
    stroke = (nominal - 3e-3, nominal + 4e-3)
    plan: Any = replace(given, lengths=SimpleNamespace(length=lengths, stroke=stroke))
    axes = drawn(picture._along_rod, plan)
    first = [float(line.get_ydata()[0]) for line in axes.lines]
    assert first == pytest.approx([1.0, -2.0, -3.0, 4.0, 0.0])
    assert "of 2 robots" in axes.get_title()


def test_unknowns_are_drawn_over_their_priors(given: PathPlan) -> None:
    axes = drawn(picture._sigma, given)
    (marks,) = axes.lines
    names = [label.get_text() for label in axes.get_xticklabels()]
    sigma, prior = given.typical.sigma, given.typical.prior
    assert {"ra2", "rtheta3", "compliance2"} & set(names)
    assert not any(name.startswith(("b", "o")) and "backlash" not in name for name in names)
    np.testing.assert_allclose(marks.get_ydata(), [sigma[n] / prior[n] for n in names])


def test_what_if_is_drawn_with_and_without_the_scale(
    given: PathPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = list[Figure]()
    monkeypatch.setattr(picture, "svg_text", lambda figure: figures.append(figure) or "")
    picture.what_if_picture(given, [*ANSWERS, replace(ANSWERS[0], tcp=6e-6, scale=8e-6)])
    left, right = figures[0].axes
    tcp, total, planned = (np.asarray(line.get_ydata(), dtype=float) for line in left.lines)
    assert (tcp.tolist(), total.tolist()) == (pytest.approx([3.0, 6.0]), pytest.approx([5.0, 10.0]))
    assert planned[0] == pytest.approx(given.evaluation.tcp * 1e6)
    assert np.isnan(np.asarray(right.lines[0].get_ydata(), dtype=float)).all()
    assert (left.get_title(), right.get_title()) == ("encoder", "plate length")
    assert left.get_ylim()[0] == 0.0


# --- the steps of the command


def options(folder: Path, **given: Any) -> command.PlanOptions:
    said = Console(file=io.StringIO(), width=200)
    return command.PlanOptions(folder=folder, seconds=1.0, out=said, err=said, **given)


def text_of(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize(
    ("violating", "kept", "tried"), [(0, True, 1), (2, True, 3), (9, False, 4)]
)
def test_four_paths_are_tried_in_mujoco_and_the_last_is_kept(
    monkeypatch: pytest.MonkeyPatch, violating: int, kept: bool, tried: int
) -> None:
    """Each as two robots; what a seat holds by itself is not run at all."""
    for name in ("say_plan", "say_gain", "say_checks"):
        monkeypatch.setattr(command.summary, name, lambda *_: None)
    plans: Any = [SimpleNamespace(forces=1, k=k) for k in range(9)]
    run = list[tuple[int, int]]()

    def checked(plan: Any, seed: int) -> list[Check]:
        run.append((plan.k, seed))
        return [Check("force_N", 1.0, 2.0, "N", int(plan.k < violating and seed == 1), 10)]

    monkeypatch.setattr(command, "check_in_plant", checked)
    said = Console(file=io.StringIO(), width=200)
    plan, feasible = command.checked(iter(plans), said, said)
    assert feasible == kept
    assert plan is plans[tried - 1]
    assert run == [(k, seed) for k in range(tried) for seed in (0, 1)]
    assert text_of(said).count("the next best path") == tried - 1
    free: Any = SimpleNamespace(forces=None)
    run.clear()
    assert command.checked(iter([free]), said, said) == (free, True)
    assert not run
    assert "not run in MuJoCo" in text_of(said)


def test_options_of_trajectories_are_refused_for_still_poses_and_a_position_without_a_path(
    tmp_path: Path,
) -> None:
    request: Any = SimpleNamespace()
    for key, value in (("path", Path("a")), ("position", (0.0, 0.0, 1.0)), ("what_if", ["a=1"])):
        given = options(tmp_path, **{key: value})
        with pytest.raises(InputError, match=f"--{key.replace('_', '-')} belongs to trajectories"):
            command._plan_poses(request, tmp_path / "r.yaml", given, set())
    alone = options(tmp_path, position=(0.0, 0.0, 1.0))
    with pytest.raises(InputError, match="--position belongs to --path"):
        command._plan_path(request, tmp_path / "r.yaml", alone, set())


def test_answers_are_written_in_metres_and_none_where_no_path_was_found() -> None:
    answers = [
        Answer("rod", "0.8", 2.34567e-5, 1.23456e-6, ""), Answer("rod", "9", None, 2e-6, "no path"),
    ]  # fmt: skip
    assert command.answers_csv(answers).decode().splitlines() == [
        "what_if,value,tcp_sigma_m,scale_adds_m,note",
        "rod,0.8,2.346e-05,1.235e-06,",
        "rod,9,,2e-06,no path",
    ]


@pytest.mark.parametrize("thickness", [False, True])
def test_answers_have_a_table_a_picture_and_of_the_plates_thickness_that_of_the_plate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, thickness: bool
) -> None:
    monkeypatch.setattr(command, "answers", lambda *_: [Answer("k", "1", 1e-5, 0.0, "")])
    for name in ("say_answers", "say_plate"):
        monkeypatch.setattr(command.summary, name, lambda *_: None)
    for name in ("what_if_picture", "plate_picture"):
        monkeypatch.setattr(command, name, lambda *_: b"<svg/>")
    said = Console(file=io.StringIO(), width=200)
    asked: Any = [SimpleNamespace(key="rod"), SimpleNamespace(key="plate_thickness")][
        : 1 + thickness
    ]
    names = command.answer(cast(Any, None), asked, tmp_path, said, said)
    assert names == ["what_if.csv", "what_if.svg", *["plate.svg"] * thickness]
    assert {file.name for file in tmp_path.iterdir()} == set(names)


def test_files_of_an_earlier_plan_go_and_those_of_this_one_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrote = list[Any]()
    monkeypatch.setattr(
        command, "write_request", lambda *given, **named: wrote.append((given, named))
    )
    for name in ("plan.yaml", "old.mod", "mine.txt", DESCRIPTIONS):
        (tmp_path / name).write_text("a")
    given = options(tmp_path, overrides=["a=1"])
    command._complete(tmp_path / "r.yaml", given, {"old.mod", "gone.src", DESCRIPTIONS})
    assert {file.name for file in tmp_path.iterdir()} == {"plan.yaml", "mine.txt", DESCRIPTIONS}
    assert wrote == [((tmp_path / "r.yaml", tmp_path), {"overrides": ["a=1"]})]


def test_the_position_is_that_of_the_option_then_of_the_request_then_of_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(command, "evaluators", lambda *_: {0.6: "evaluator"})
    monkeypatch.setattr(command, "assess", lambda evaluator, candidate: (evaluator, candidate))
    of_file: tuple[float, ...] | None = (3.0, 0.0, 0.0)
    monkeypatch.setattr(command, "known_path", lambda *_, **__: ("shape", of_file))
    cell = SimpleNamespace(ballbar_position_m=(2.0, 0.0, 0.0), rods=[0.6, 0.9])
    request: Any = SimpleNamespace(cell=cell, telescoping=False)

    def at(position: tuple[float, float, float] | None) -> float:
        plan: Any = command.given_path(request, Path("p.yaml"), position)
        assert plan[0] == "evaluator"
        return float(plan[1].position[0])

    assert at((1.0, 0.0, 0.0)) == 1.0
    assert at(None) == 2.0
    cell.ballbar_position_m = None
    assert at(None) == 3.0


def test_a_search_shows_its_best_in_micrometres_and_takes_all_cores(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shown, asked = list[str](), dict[str, Any]()

    @contextmanager
    def status(_: Console, text: str) -> Iterator[Callable[[str], None]]:
        shown.append(text)
        yield shown.append

    def plans(_: Any, **given: Any) -> Iterator[str]:
        asked.update(given)
        given["show"](SimpleNamespace(tcp=23.46e-6, evaluated=1200, feasible=31))
        yield from ("best", "next")

    monkeypatch.setattr(command, "status", status)
    monkeypatch.setattr(command, "plans", plans)
    found = command.searched(cast(Any, None), tmp_path, 40.0, Console(file=io.StringIO()))
    assert list(found) == ["best", "next"]
    assert asked["seconds"] == 40.0
    assert asked["workers"] == os.cpu_count()
    assert 0.0 <= asked["since"]() < 60.0
    assert re.match(r"\d+ s: TCP sigma 23\.5 um, 1200 tried, 31 can be run", shown[1])

"""`ballbar plan`: the search with the best plan so far, then files, pictures and a summary."""

from __future__ import annotations

import csv
import io
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.files import DESCRIPTIONS, claimed_folder, write_whole
from ballbar.plan import summary
from ballbar.plan.known_results import known_from
from ballbar.plan.picture import plan_picture, plate_picture, what_if_picture
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.clearance import clearance
from ballbar.planning.evaluation import evaluators
from ballbar.planning.files import (
    JOINTS,
    REQUEST,
    output_names,
    write_plan,
    write_pose_plan,
    write_request,
)
from ballbar.planning.known import Known
from ballbar.planning.plan import PathPlan, assess, known_path, plans
from ballbar.planning.pose_plan import pose_plan
from ballbar.planning.pose_request import PosePlanRequest
from ballbar.planning.programs import without_program
from ballbar.planning.questions import Question, check_questions, question
from ballbar.planning.request import PlanRequest
from ballbar.planning.search import SearchProgress
from ballbar.planning.stations import setup_of
from ballbar.planning.verify import Check, checks, run_in_plant, violations_in
from ballbar.planning.what_if import Answer, answers
from ballbar.terminal import animated
from ballbar.units import UM

ATTEMPTS = 4  # trajectories of a search that are run in MuJoCo while limits are violated
CHECKED_ROBOTS = (0, 1)  # seeds of ballbar.planning.verify: thesis Table 3.1, and a drawn robot
_POSITION = (
    "--position belongs to --path. For a search, set cell.ballbar_position_m or "
    "cell.ballbar_region_m of the request, here with --set."
)
_NOT_RUN = (
    "not run in MuJoCo: nothing loads the tool, and the robot follows its targets under "
    "its usual servo; the limits above hold for the nominal robot"
)
# Of CMA-ES: those of one race. The race of its neighbours gained nothing in four of four searches
# (IRB 2400, seeds 61 to 63, NJ 220), which took a third of the time.
EVALUATIONS = 12_500


@dataclass(frozen=True)
class PlanOptions:
    """How a request is planned, and to which folder."""

    folder: Path
    seconds: float  # of the search, at most
    out: Console
    err: Console
    overrides: Sequence[str] = ()  # texts `KEY=VALUE` that replaced values of the file
    path: Path | None = None  # a path file, in place of a search
    position: tuple[float, float, float] | None = None  # [m] of the ball-bar's base, with `path`
    what_if: Sequence[str] = ()  # questions `KEY=A,B`
    after: Sequence[Path] = ()  # results of the machine: the path adds to what they know


def make_plan(request: PlanRequest | PosePlanRequest, file: Path, options: PlanOptions) -> bool:
    """Makes, checks, writes and prints the plan that a request asks for.

    file : that of the request.

    Returns whether no limit is violated; of still poses, whether every move keeps the clearance.
    Raises InputError for bad options or files, and where too few poses can be measured.
    """
    outputs = output_names(request)
    with claimed_folder(options.folder, outputs, "the plan"):
        if isinstance(request, PosePlanRequest):
            return _plan_poses(request, file, options, outputs)
        return _plan_path(request, file, options, outputs)


def _plan_path(request: PlanRequest, file: Path, options: PlanOptions, outputs: set[str]) -> bool:
    """A trajectory of a search or of a path file, and answers to what-if questions."""
    folder, out, err = options.folder, options.out, options.err
    if options.position is not None and options.path is None:
        raise InputError(_POSITION)
    questions = [question(text) for text in options.what_if]
    check_questions(request, questions)
    known = known_from(options.after, request, err) if options.after else None
    if options.path:
        candidates = iter([given_path(request, options.path, options.position, known)])
    else:
        candidates = searched(request, file.parent, options.seconds, err, known)
    plan, feasible = checked(candidates, out, err)
    names = [*write_plan(plan, folder), REQUEST, "plan.svg"]
    write_whole(folder / "plan.svg", plan_picture(plan))
    _complete(file, options, outputs - set(names))
    questions += summary.instead(plan)
    if questions:
        names += answer(plan, questions, folder, out, err)
    _say_files(out, folder, names, plan.evaluator.cell.robot)
    return feasible


def _plan_poses(
    request: PosePlanRequest, file: Path, options: PlanOptions, outputs: set[str]
) -> bool:
    """Still poses."""
    for key in ("path", "position", "what_if", "after"):
        if getattr(options, key):
            option = key.replace("_", "-")
            raise InputError(f"--{option} belongs to trajectories; a plan of still poses has none.")
    setup, folder, out = setup_of(request, relative_to=file.parent), options.folder, options.out
    begin = time.monotonic()
    with status(options.err, "planning poses ...") as show:
        plan = pose_plan(
            setup, seconds=options.seconds, since=lambda: time.monotonic() - begin, show=show
        )
    names = [*write_pose_plan(plan, folder, relative_to=file.parent), REQUEST]
    _complete(file, options, outputs - set(names))
    summary.say_pose_plan(out, plan)
    _say_files(out, folder, names, setup.robot)
    if setup.request.board is None:
        out.print(f"Measure, fill in poses.csv, then: ballbar check {escape(str(folder))}")
    else:
        out.print(
            "Take a picture at each pose, write its name and the angles shown into joints.csv, "
            f"then: ballbar camera detect PICTURES --board {setup.request.board.file} --joints "
            f"{escape(str(folder / JOINTS))} --out found"
        )
    return not plan.route.blocked


def _complete(file: Path, options: PlanOptions, earlier: set[str]) -> None:
    """Writes request.yaml, and removes files of an earlier plan, such as another robot's program.

    earlier : names of files that this plan does not write.
    """
    write_request(file, options.folder, overrides=options.overrides)
    for name in earlier - {DESCRIPTIONS}:
        (options.folder / name).unlink(missing_ok=True)


def _say_files(out: Console, folder: Path, names: Sequence[str], robot: Robot) -> None:
    if reason := without_program(robot):
        out.print(escape(reason))
    out.print(f"Files in {escape(str(folder))}: {', '.join(names)}")


def checked(candidates: Iterator[PathPlan], out: Console, err: Console) -> tuple[PathPlan, bool]:
    """The first plan that keeps all limits in MuJoCo, or the last of ATTEMPTS; whether it does.

    candidates : best first. Nothing is written before, so that Ctrl-C leaves no unchecked plan.
    """
    feasible = False
    for attempt, plan in enumerate(islice(candidates, ATTEMPTS)):
        if attempt:
            out.print("[yellow]Limits are violated in MuJoCo; the next best path of the search:[/]")
        summary.say_plan(out, plan)
        summary.say_gain(out, plan)
        if plan.forces is None:
            out.print(_NOT_RUN)
            return plan, True
        with status(err, "running it in MuJoCo on soft servo ..."):
            results = [(seed, check_in_plant(plan, seed)) for seed in CHECKED_ROBOTS]
        summary.say_checks(out, results)
        feasible = not sum(violations_in(checks_of_robot) for _, checks_of_robot in results)
        if feasible:
            break
    return plan, feasible


def searched(
    request: PlanRequest,
    relative_to: Path,
    seconds: float,
    err: Console,
    known: Known | None = None,
) -> Iterator[PathPlan]:
    """Plans of a search, best first; the terminal shows the best trajectory so far."""
    since = time.monotonic()

    def elapsed() -> float:
        return time.monotonic() - since

    with status(err, "looking for a first path (Ctrl-C stops and keeps the best)") as show:

        def show_progress(progress: SearchProgress) -> None:
            show(
                f"{elapsed():.0f} s: TCP sigma {progress.tcp * UM:.1f} um, "
                f"{progress.evaluated} tried, {progress.feasible} can be run "
                "(Ctrl-C stops and keeps the best)"
            )

        results = plans(
            request,
            relative_to=relative_to,
            workers=os.cpu_count() or 1,
            seconds=seconds,
            evaluations=EVALUATIONS,
            show=show_progress,
            since=elapsed,
            known=known,
        )
        best = next(results)
    return chain((best,), results)


def answer(
    plan: PathPlan, questions: Sequence[Question], folder: Path, out: Console, err: Console
) -> list[str]:
    """Prints and writes the expected TCP error of other rigs. Returns the names of the files."""
    results = []
    with status(err, "what if ...") as show:
        for result in answers(plan, questions):
            results.append(result)
            show(f"what if {result.key} were {result.value} ...")
    summary.say_answers(out, plan, results)
    write_whole(folder / "what_if.csv", answers_csv(results))
    write_whole(folder / "what_if.svg", what_if_picture(plan, results))
    names = ["what_if.csv", "what_if.svg"]
    if any(q.key == "plate_thickness" for q in questions):
        summary.say_plate(out)
        write_whole(folder / "plate.svg", plate_picture())
        names.append("plate.svg")
    return names


def answers_csv(results: Sequence[Answer]) -> bytes:
    """The what-if answers as a CSV file, SI units."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("what_if", "value", "tcp_sigma_m", "scale_adds_m", "note"))
    rows.writerows(
        (a.key, a.value, "" if a.tcp is None else f"{a.tcp:.4g}", f"{a.scale:.4g}", a.note)
        for a in results
    )
    return text.getvalue().encode()


def given_path(
    request: PlanRequest,
    path: Path,
    position: tuple[float, float, float] | None,
    known: Known | None = None,
) -> PathPlan:
    """A path file, evaluated as a plan.

    position : base position [m] of the ball-bar; None takes that of the request or of the file.
    known : from results of the machine.

    Raises InputError where the path cannot be run or no position is known.
    """
    shape, position_of_file = known_path(path, telescoping=request.telescoping)
    base = position or request.cell.ballbar_position_m or position_of_file
    if base is None:
        raise InputError(
            f"--path {path}: the base position of the ball-bar is not known. Give --position "
            "X,Y,Z, or ballbar_position_m in the path file or in the request's cell."
        )
    evaluator = evaluators(request, known)[request.cell.rods[0]]
    return assess(evaluator, PathCandidate(shape, np.array(base)))


def check_in_plant(plan: PathPlan, seed: int) -> list[Check]:
    """All limits, checked over the run of one robot in MuJoCo."""
    cell, request = plan.evaluator.cell, plan.request
    motion = run_in_plant(
        cell, request, plan.evaluation.candidate, seed=seed, beginning=plan.trajectory.q[0]
    )
    return checks(cell, request.limits, clearance(cell, request.cell), motion)


@contextmanager
def status(err: Console, text: str) -> Iterator[Callable[[str], None]]:
    """Shows what is being done, on a terminal without --quiet; the callback changes the text."""
    if animated(err):
        with err.status(text) as line:
            yield line.update
    else:
        yield lambda _: None


def parse_position(text: str) -> tuple[float, float, float]:
    """`0.7,0,0.54` as three coordinates [m]. Raises InputError."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--position {text}: give three numbers in metres, such as 0.7,0,0.54"
        ) from None
    return x, y, z

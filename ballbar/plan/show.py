"""`ballbar plan`: a search with the best trajectory so far, then files, pictures and a summary."""

from __future__ import annotations

import csv
import io
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballbar.plan.beam import OFFSET_PLATE, PLATE_FORCE, tip_deflection, tip_slope
from ballbar.plan.picture import plan_picture, plate_picture, what_if_picture
from ballbar.result.calibration import calibration_file, load_calibration
from ballbar.terminal import animated, wide_console
from ballbar.units import MM, UM, URAD
from cell.errors import InputError
from cell.files import claimed_folder, write_whole
from cell.load import load_robot
from planning.candidate import Candidate
from planning.clearance import clearance
from planning.evaluation import evaluators
from planning.export import BALLBAR, TELESCOPING, program_files, without_program
from planning.files import OUTPUTS, REQUEST, write_plan, write_request
from planning.known import Known, known_of
from planning.next_step import EVERY_ENCODER, ROD_SIGMA
from planning.plan import COVERED_WITHIN, Plan, assess, known_path, plans
from planning.questions import CHANGES, ENCODERS, Question, check_questions, question
from planning.request import PlanRequest, load_request
from planning.search import Progress
from planning.verify import Check, checks, run_in_plant, violations_in
from planning.what_if import Answer, answers

ATTEMPTS = 4  # trajectories of a search that are run in MuJoCo while limits are violated
CHECKED_ROBOTS = (0, 1)  # seeds of planning.verify: thesis Table 3.1, and a drawn robot
WIDTH = 120  # characters of a table in a pipe or file
EVALUATIONS = 20_000  # of CMA-ES: about a minute on two cores
# A length has no Hayati angles in its model, and leaves base tilt and clock to the robot's errors.
_HELD = ("rbeta", "otx", "oty", "offset", "skew")
WORTHWHILE = 0.1  # of the TCP sigma that results state: less hardly shows in a robot
UNSEEN = 0.9  # of its prior: standard deviation above which an unknown counts as hardly seen


def default_folder(file: Path, overrides: Sequence[str]) -> Path:
    """Folder of a request's plan without --out; overrides : as of `plan_path`."""
    return Path("runs") / f"{load_request(file, overrides=overrides).name}-plan"


def plan_path(
    file: Path,
    *,
    folder: Path,
    path: Path | None,
    position: tuple[float, float, float] | None,
    seconds: float,
    what_if: Sequence[str],
    after: Sequence[Path] = (),
    overrides: Sequence[str] = (),
    out: Console,
    err: Console,
) -> bool:
    """Plans a trajectory or takes a path file, checks and writes it, and answers what-if questions.

    file : planning request. path, position : a path file and the base position [m] of the ball-bar,
    instead of a search. seconds : duration of the search. what_if : questions `KEY=A,B`.
    after : results of the machine; the path adds to what they know.
    overrides : texts `KEY=VALUE` that replace values of the request.

    Returns whether no limit is violated. Raises InputError for bad options or files.
    """
    request = load_request(file, overrides=overrides)
    questions = [question(text) for text in what_if]
    check_questions(request, questions)
    known = known_from(after, request) if after else None
    outputs = {*OUTPUTS, *program_files(request.name)}
    with claimed_folder(folder, outputs, "the plan"):
        if path:
            candidates = iter([given_path(request, path, position, known)])
        else:
            candidates = searched(request, file.parent, seconds, err, known)
        violated = 0
        write_request(file, folder, overrides=overrides)
        for attempt, plan in enumerate(islice(candidates, ATTEMPTS)):
            if attempt:
                out.print(
                    "[yellow]Limits are violated in MuJoCo; the next best path of the search:[/]"
                )
            names = [*write_plan(plan, folder), REQUEST]
            write_whole(folder / "plan.svg", plan_picture(plan))
            say_plan(out, plan)
            say_gain(out, plan)
            if plan.forces is None:
                out.print(
                    "not run in MuJoCo: nothing loads a telescoping bar, and the robot follows its "
                    "targets under its usual servo; the limits above hold for the nominal robot"
                )
                break
            with status(err, "running it in MuJoCo on soft servo ..."):
                results = [(seed, check_in_plant(plan, seed)) for seed in CHECKED_ROBOTS]
            violated = sum(violations_in(checks_of_robot) for _, checks_of_robot in results)
            say_checks(out, results)
            if not violated:
                break
        questions += instead(plan)
        if questions:
            names += answer(plan, questions, folder, out, err)
        if reason := without_program(plan.evaluator.cell.robot):
            out.print(escape(reason))
        out.print(f"Files in {escape(str(folder))}: {', '.join([*names, 'plan.svg'])}")
    return violated == 0


def searched(
    request: PlanRequest,
    relative_to: Path,
    seconds: float,
    err: Console,
    known: Known | None = None,
) -> Iterator[Plan]:
    """Plans of a search, best first."""
    since = time.monotonic()
    with search_status(err) as show:
        results = plans(
            request,
            relative_to=relative_to,
            workers=os.cpu_count() or 1,
            seconds=seconds,
            evaluations=EVALUATIONS,
            show=show,
            since=lambda: time.monotonic() - since,
            known=known,
        )
        best = next(results)
    return chain((best,), results)


def answer(
    plan: Plan, questions: Sequence[Question], folder: Path, out: Console, err: Console
) -> list[str]:
    """Prints and writes the expected TCP error of other rigs. Returns the names of the files."""
    results = []
    with status(err, "what if ...") as show:
        for result in answers(plan, questions):
            results.append(result)
            show(f"what if {result.key} were {result.value} ...")
    say_answers(out, plan, results)
    write_whole(folder / "what_if.csv", answers_csv(results))
    write_whole(folder / "what_if.svg", what_if_picture(plan, results))
    names = ["what_if.csv", "what_if.svg"]
    if any(q.key == "plate_thickness" for q in questions):
        say_plate(out)
        write_whole(folder / "plate.svg", plate_picture())
        names.append("plate.svg")
    return names


def say_answers(out: Console, plan: Plan, results: Sequence[Answer]) -> None:
    """Prints the expected TCP error with one value of the rig changed at a time."""
    table = Table(box=None, pad_edge=False)
    lengths = ("TCP sigma [um]", "scale adds [um]", "together [um]")
    for heading in ("what if", "value", *lengths, ""):
        table.add_column(escape(heading), justify="left" if heading in ("what if", "") else "right")
    planned = Answer(
        key="as planned", value="", tcp=plan.evaluation.tcp, scale=plan.scale_adds, note=""
    )
    for row in (planned, *results):
        sigma, total = ("-" if v is None else f"{v * UM:.1f}" for v in (row.tcp, row.total))
        table.add_row(row.key, row.value, sigma, f"{row.scale * UM:.1f}", total, escape(row.note))
    wide_console(out, WIDTH).print(table)


def say_plate(out: Console) -> None:
    """Prints deflection and slope of the thesis's offset plate (sec. 4.5)."""
    deflection = tip_deflection(OFFSET_PLATE, PLATE_FORCE) * UM
    slope = tip_slope(OFFSET_PLATE, PLATE_FORCE) * URAD
    out.print(
        f"plate: {OFFSET_PLATE.thickness * MM:.0f} mm of aluminium, "
        f"{OFFSET_PLATE.length * MM:.0f} mm long, {PLATE_FORCE:.0f} N: the tip deflects by "
        f"{deflection:.1f} um, {deflection:.1f} urad seen from 1 m (thesis Fig. 4.4: 10), and "
        f"turns by {slope:.0f} urad"
    )


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
) -> Plan:
    """A path file, evaluated as a plan.

    position : base position [m] of the ball-bar; None takes that of the request or of the file.
    known : from results of the machine.

    Raises InputError where the path cannot be run or no position is known.
    """
    shape, position_of_file = known_path(path)
    base = position or request.cell.ballbar_position_m or position_of_file
    if base is None:
        raise InputError(
            f"--path {path}: the base position of the ball-bar is not known. Give --position "
            "X,Y,Z, or ballbar_position_m in the path file or in the request's cell."
        )
    evaluator = evaluators(request, known)[request.cell.rods[0]]
    return assess(evaluator, Candidate(shape, np.array(base)))


def check_in_plant(plan: Plan, seed: int) -> list[Check]:
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


@contextmanager
def search_status(err: Console) -> Iterator[Callable[[Progress], None]]:
    """Shows the best trajectory of a search so far."""
    since = time.monotonic()
    with status(err, "looking for a first path (Ctrl-C stops and keeps the best)") as show:
        yield lambda progress: show(
            f"{time.monotonic() - since:.0f} s: TCP sigma {progress.tcp * UM:.1f} um, "
            f"{progress.evaluated} tried, {progress.feasible} can be run "
            "(Ctrl-C stops and keeps the best)"
        )


def say_plan(out: Console, plan: Plan) -> None:
    """Prints where a plan comes from and what it is predicted to identify."""
    typical, tcp = plan.typical, plan.tcp * UM
    position = ", ".join(f"{v:.3f}" for v in plan.evaluation.candidate.position)
    if plan.stopped:
        out.print("[yellow]stopped[/] before its time; this is the best so far")
    searched = f"found in {plan.seconds:.0f} s, {plan.evaluated} tried"
    out.print(
        f"path {searched if plan.evaluated else 'as given'}; "
        f"{TELESCOPING if plan.lengths else BALLBAR} {escape(Path(plan.rod).stem)} at "
        f"({position}) m"
    )
    spread = f" ({tcp.min():.1f} to {tcp.max():.1f} over {len(tcp)} robots)" if len(tcp) > 1 else ""
    scale = "the bar's calibrated length" if plan.lengths else "the lengths of plate and ba5"
    adds = f"; the scale from {scale} adds {plan.scale_adds * UM:.1f} um" if plan.scale_adds else ""
    out.print(
        f"predicted TCP sigma over the workspace: {np.median(tcp):.1f} um rms{spread}, "
        f"largest {typical.tcp_sigma.max() * UM:.0f} um{adds}"
    )
    out.print(
        f"sphere covered {plan.coverage:.0%} (within {np.degrees(COVERED_WITHIN):.0f} deg of the "
        f"path; shipped plans cover 5 to 21%, and the sigma above counts it), {_expected(plan)}"
    )
    if plan.lengths is not None and plan.lengths.warning:
        out.print(f"[yellow]warning:[/] {plan.lengths.warning}")
    if plan.forces is not None:
        reversals = ", ".join(f"{n:.0f}" for n in plan.reversals)
        out.print(f"sign changes of the load of gears 1 to 6: {reversals}")
    indices = ", ".join(f"{name} {value:.3g}" for name, value in plan.indices().items())
    out.print(f"observability {indices}")
    priors = dict(zip(typical.layout.names, typical.layout.sigma, strict=True))
    held = () if plan.lengths is None else _HELD
    unseen = [
        name
        for name, sigma in typical.sigma.items()
        if sigma > UNSEEN * priors[name] and not name.startswith(held)
    ]
    out.print(f"hardly seen by the path ({len(unseen)}): {' '.join(unseen)}")


def say_gain(out: Console, plan: Plan) -> None:
    """Prints what a path adds to the results that it comes after."""
    before = plan.tcp_before
    if before is None:
        return
    now, then = before * UM, float(np.median(plan.tcp)) * UM
    out.print(
        f"TCP sigma without scale by the results so far {now:.1f} um rms, with this path "
        f"{then:.1f} um ({1.0 - then / now:.0%} less)"
    )
    if not worthwhile(plan):
        out.print(
            f"[yellow]this path lowers it by less than {WORTHWHILE:.0%}[/]; what would, if "
            "anything, is below. Another seat of the ball-bar may: free its place in the request "
            "(ballbar_region_m)"
        )


def worthwhile(plan: Plan) -> bool:
    """Whether a path lowers the TCP sigma of the results before by WORTHWHILE; True without."""
    before = plan.tcp_before
    return before is None or float(np.median(plan.tcp)) <= (1.0 - WORTHWHILE) * before


def instead(plan: Plan) -> list[Question]:
    """Questions of what else would help, where the path hardly adds to the results before it."""
    if worthwhile(plan) or plan.request.telescoping:
        return []
    sensors, bar = plan.request.sensors, plan.evaluator.cell.ballbar
    out = []
    if set(sensors.encoders) != set(EVERY_ENCODER):
        out.append(Question(ENCODERS, "", (EVERY_ENCODER,)))
    if (sensors.rod_sigma_m or bar.length_tolerance) > ROD_SIGMA:
        out.append(Question("rod_sigma", CHANGES["rod_sigma"].unit, (ROD_SIGMA,)))
    out.append(Question("duration", "s", (2.0 * plan.request.timing.duration_s,)))
    return out


def known_from(results: Sequence[Path], request: PlanRequest) -> Known:
    """What results say of the machine of a request.

    Raises InputError for a result of still poses, of model dh with a ball-bar, of another robot
    than the request's or without covariance, and for results of unlike robots, ball-bars or plates.
    """
    machines = []
    for result in results:
        file = calibration_file(result)
        if not file.is_file():
            raise InputError(f"{file}: no such file. Name a calibration.yaml, or its folder.")
        calibration = load_calibration(file)
        content = calibration.file
        cell = calibration.cell()
        if content.model == "dh" and cell.ballbar.stroke is None:
            raise InputError(
                f"{file}: is of model dh, and a path is predicted with the complete model, of "
                "which it states no uncertainty. Identify the recordings with --model complete."
            )
        machines.append(calibration.machine(cell))
        wanted = load_robot(request.cell.robot).title
        first = machines[0].robot.cell
        if cell.robot.title != wanted:
            raise InputError(f"{file}: is of {cell.robot.title}, the request of {wanted}")
        if (cell.ballbar.name, cell.plate.name) != (first.ballbar.name, first.plate.name):
            raise InputError(
                f"{file}: is of another ball-bar or plate than {calibration_file(results[0])}; "
                "give results of the same ones"
            )
    return known_of(machines)


def _expected(plan: Plan) -> str:
    """Force in the rod of a ball-bar, or length of a telescoping bar beside its stroke."""
    if plan.forces is not None:
        tension = plan.forces.tension
        return f"rod force {tension.min():.0f} to {tension.max():.0f} N expected"
    if plan.lengths is None:
        return ""
    nominal = plan.evaluator.cell.ballbar.length
    off = (plan.lengths.length - nominal) * MM
    low, high = ((end - nominal) * MM for end in plan.lengths.stroke)
    return (
        f"length {off.min():+.1f} to {off.max():+.1f} mm about {nominal * MM:.0f} mm expected "
        f"({len(off)} robots with errors of 1 mm and 1 mrad), stroke {low:+.1f} to {high:+.1f} mm"
    )


def say_checks(out: Console, results: list[tuple[int, list[Check]]]) -> None:
    """Prints the limits against the motion in MuJoCo. results : (seed of a robot, its checks)."""
    table = Table(box=None, pad_edge=False)
    for heading in ("limit", "allowed", *(f"robot {seed}" for seed, _ in results), "violated"):
        table.add_column(heading, justify="left" if heading == "limit" else "right")
    for rows in zip(*(checks_of_robot for _, checks_of_robot in results), strict=True):
        bad, instants = sum(row.instants for row in rows), sum(row.looked_at for row in rows)
        values = (f"{row.worst:.3g} {row.unit}".strip() for row in rows)
        violated = f"[{'red' if bad else 'green'}]{bad} of {instants}[/]"
        table.add_row(rows[0].limit, f"{rows[0].allowed:.3g}", *values, violated)
    out.print("MuJoCo, soft servo, robots with errors; worst value of each limit:")
    wide_console(out, WIDTH).print(table)


def parse_position(text: str) -> tuple[float, float, float]:
    """`0.7,0,0.54` as three coordinates [m]. Raises InputError."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--position {text}: give three numbers in metres, such as 0.7,0,0.54"
        ) from None
    return x, y, z

"""What `ballbar plan` does and shows: a search with the best so far, files, picture, numbers at a glance."""

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

from ballbar.plan.beam import FIGURES, OFFSET_PLATE, PLATE_FORCE
from ballbar.plan.picture import plan_picture, plate_picture, what_if_picture
from ballbar.terminal import animated
from cell.errors import InputError
from cell.files import claim_folder, write_whole
from planning.candidate import Candidate
from planning.clearance import clearance
from planning.files import OUTPUTS, write_plan
from planning.judge import judges
from planning.plan import Plan, assessed, known_path, plans
from planning.request import PlanRequest, load_request
from planning.search import Progress
from planning.verify import Check, checks, run_in_plant, violations_in
from planning.what_if import Answer, Question, answers, question

ATTEMPTS = 4  # paths of a search that are run in MuJoCo, should limits be violated
CHECKED_ROBOTS = (0, 1)  # seeds of planning.verify: thesis Table 3.1, and one drawn
WIDTH = 120  # characters of a table in a pipe or file
EVALUATIONS = 20_000  # of CMA-ES: some minutes on two quiet cores


def default_folder(file: Path) -> Path:
    """Where a request's plan goes without --out."""
    return Path("runs") / f"{load_request(file).name}-plan"


def plan_path(
    file: Path,
    *,
    folder: Path,
    path: Path | None,
    position: tuple[float, float, float] | None,
    seconds: float,
    what_if: Sequence[str],
    out: Console,
    err: Console,
) -> bool:
    """Plans, or takes the path that is given, checks it, writes the files and says what they hold; then answers what_if questions.

    Returns whether no limit is violated.
    """
    request, questions = load_request(file), [question(text) for text in what_if]
    claim_folder(folder, {*OUTPUTS, f"{request.name}.mod", f"{request.name}.pdl"}, "the plan")
    found = (
        iter([given_path(request, path, position)])
        if path
        else searched(request, file.parent, seconds, err)
    )
    for attempt, plan in enumerate(islice(found, ATTEMPTS)):
        if attempt:
            out.print("[yellow]Limits are violated in MuJoCo; the next best path of the search:[/]")
        names = write_plan(plan, folder)
        write_whole(folder / "plan.svg", plan_picture(plan))
        say_plan(out, plan)
        with under_way(err, "running it in MuJoCo on soft servo ..."):
            ran = [(seed, check_in_plant(plan, seed)) for seed in CHECKED_ROBOTS]
        violated = sum(violations_in(one) for _, one in ran)
        say_checks(out, ran)
        if not violated:
            break
    if questions:
        names += answer(plan, questions, folder, out, err)
    out.print(f"Files in {escape(str(folder))}: {', '.join([*names, 'plan.svg'])}")
    return violated == 0


def searched(
    request: PlanRequest, relative_to: Path, seconds: float, err: Console
) -> Iterator[Plan]:
    """What a search finds, best first."""
    since = time.monotonic()
    with showing(err) as show:
        found = plans(
            request,
            relative_to=relative_to,
            workers=os.cpu_count() or 1,
            seconds=seconds,
            evaluations=EVALUATIONS,
            show=show,
            since=lambda: time.monotonic() - since,
        )
        best = next(found)
    return chain((best,), found)


def answer(
    plan: Plan, questions: Sequence[Question], folder: Path, out: Console, err: Console
) -> list[str]:
    """Prints and writes what other rigs would come to."""
    given = []
    with under_way(err, "what if ...") as say:
        for one in answers(plan, questions):
            given.append(one)
            say(f"what if {one.key} were {one.value} ...")
    say_answers(out, plan, given)
    write_whole(folder / "what_if.csv", answers_csv(given))
    write_whole(folder / "what_if.svg", what_if_picture(plan, given))
    names = ["what_if.csv", "what_if.svg"]
    if any(q.key == "plate_thickness" for q in questions):
        say_plate(out)
        write_whole(folder / "plate.svg", plate_picture())
        names.append("plate.svg")
    return names


def say_answers(out: Console, plan: Plan, given: Sequence[Answer]) -> None:
    """The table: expected TCP error with one thing changed at a time."""
    shown = Table(box=None, pad_edge=False)
    for heading in (
        "what if",
        "value",
        "TCP sigma [um]",
        "plate's length adds [um]",
        "together [um]",
        "",
    ):
        shown.add_column(escape(heading), justify="left" if heading in ("what if", "") else "right")
    here = plan.found.tcp
    shown.add_row(
        "as planned",
        "",
        f"{here * 1e6:.1f}",
        f"{plan.plate_adds * 1e6:.1f}",
        f"{np.hypot(here, plan.plate_adds) * 1e6:.1f}",
        "",
    )
    for one in given:
        sigma, total = ("-" if v is None else f"{v * 1e6:.1f}" for v in (one.tcp, one.total))
        shown.add_row(one.key, one.value, sigma, f"{one.scale * 1e6:.1f}", total, escape(one.note))
    _wide(out).print(shown)


def say_plate(out: Console) -> None:
    """The rule of thesis sec. 4.5."""
    sinks, turns = FIGURES["plate_deflection"]() * 1e6, FIGURES["plate_slope"]() * 1e6
    out.print(
        f"plate: {OFFSET_PLATE.thickness * 1e3:.0f} mm of aluminium, {OFFSET_PLATE.length * 1e3:.0f} mm long, {PLATE_FORCE:.0f} N: the "
        f"tip sinks by {sinks:.1f} um, {sinks:.1f} urad seen from 1 m (thesis Fig. 4.4: 10), and turns by {turns:.0f} urad"
    )


def answers_csv(given: Sequence[Answer]) -> bytes:
    """The table as a file, SI units."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("what_if", "value", "tcp_sigma_m", "plate_length_adds_m", "note"))
    rows.writerows(
        (a.key, a.value, "" if a.tcp is None else f"{a.tcp:.4g}", f"{a.scale:.4g}", a.note)
        for a in given
    )
    return text.getvalue().encode()


def given_path(
    request: PlanRequest, path: Path, position: tuple[float, float, float] | None
) -> Plan:
    """A path file, judged as a plan. Raises InputError where it cannot be run or no position is known."""
    shape, planned_for = known_path(path)
    place = position or request.cell.ballbar_position_m or planned_for
    if place is None:
        raise InputError(
            "--path needs to know where the ball-bar stands: give --position X,Y,Z, or ballbar_position_m in the path file or in the "
            "request's cell"
        )
    judge = judges(request)[request.cell.ballbar]
    return assessed(judge, Candidate(shape, np.array(place)))


def check_in_plant(plan: Plan, seed: int) -> list[Check]:
    """All limits over one robot's run."""
    cell, request = plan.judge.cell, plan.request
    motion = run_in_plant(cell, request, plan.found.candidate, seed=seed)
    return checks(cell, request.limits, clearance(cell, request.cell), motion)


@contextmanager
def under_way(err: Console, words: str) -> Iterator[Callable[[str], None]]:
    """What is being done, on a terminal that is not asked to be quiet; nothing in a pipe."""
    if animated(err):
        with err.status(words) as status:
            yield status.update
    else:
        yield lambda _: None


@contextmanager
def showing(err: Console) -> Iterator[Callable[[Progress], None]]:
    """The best so far."""
    since = time.monotonic()
    with under_way(err, "looking for a first path (Ctrl-C stops and keeps the best)") as say:
        yield lambda p: say(
            f"{time.monotonic() - since:.0f} s: TCP sigma {p.tcp * 1e6:.1f} um, {p.evaluated} tried, {p.feasible} can be run "
            "(Ctrl-C stops and keeps the best)"
        )


def say_plan(out: Console, plan: Plan) -> None:
    """Numbers at a glance."""
    typical, forces = plan.typical, plan.found.forces
    assert forces is not None
    position = ", ".join(f"{v:.3f}" for v in plan.found.candidate.position)
    if plan.stopped:
        out.print("[yellow]stopped[/] before its time; this is the best so far")
    found = (
        f"found in {plan.seconds:.0f} s, {plan.evaluated} tried" if plan.evaluated else "as given"
    )
    out.print(f"path {found}; ball-bar {plan.rod} at ({position}) m")
    out.print(
        f"predicted TCP sigma over the workspace: {np.median(plan.tcp) * 1e6:.1f} um rms ({plan.tcp.min() * 1e6:.1f} to "
        f"{plan.tcp.max() * 1e6:.1f} over {len(plan.tcp)} robots), largest {typical.tcp_sigma.max() * 1e6:.0f} um; "
        f"the plate's own length adds {plan.plate_adds * 1e6:.1f} um"
    )
    out.print(
        f"sphere covered {plan.coverage:.0%}, rod force {forces.tension.min():.0f} to {forces.tension.max():.0f} N expected"
    )
    out.print(
        f"sign changes of the load of gears 1 to 6: {', '.join(f'{n:.0f}' for n in plan.reversals)}"
    )
    out.print(
        "observability "
        + ", ".join(f"{name} {value:.3g}" for name, value in plan.indices().items())
    )
    unseen = [
        n
        for n, s in typical.sigma.items()
        if s > 0.9 * typical.layout.sigma[typical.layout.names.index(n)]
    ]
    out.print(f"hardly seen by the path ({len(unseen)}): {' '.join(unseen)}")


def say_checks(out: Console, found: list[tuple[int, list[Check]]]) -> None:
    """Limits against what MuJoCo did."""
    shown = Table(box=None, pad_edge=False)
    for heading in ("limit", "allowed", *(f"robot {seed}" for seed, _ in found), "violated"):
        shown.add_column(heading, justify="left" if heading == "limit" else "right")
    for rows in zip(*(one for _, one in found), strict=True):
        bad = sum(row.instants for row in rows)
        colour = "red" if bad else "green"
        values = (f"{row.worst:.3g} {row.unit}".strip() for row in rows)
        shown.add_row(
            rows[0].limit,
            f"{rows[0].allowed:.3g}",
            *values,
            f"[{colour}]{bad} of {sum(row.looked_at for row in rows)}[/]",
        )
    out.print("MuJoCo, soft servo, robots with errors; worst value of each limit:")
    _wide(out).print(shown)


def _wide(out: Console) -> Console:
    """Room for a table in a pipe or file."""
    return out if out.is_terminal else Console(file=out.file, width=WIDTH, quiet=out.quiet)


def parse_position(text: str) -> tuple[float, float, float]:
    """`0.7,0,0.54` as metres. Raises InputError."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--position {text}: give three numbers in metres, such as 0.7,0,0.54"
        ) from None
    return x, y, z

"""`ballbar plan` for still poses: search, files and a summary."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from ballbar.plan.show import status
from ballbar.units import UM
from cell.files import claimed_folder
from planning.export import without_program
from planning.files import REQUEST, write_request
from planning.poses.files import output_names, write_pose_plan
from planning.poses.plan import PosePlan, pose_plan
from planning.poses.request import load_pose_request
from planning.poses.setup import setup_of


def default_pose_folder(file: Path, overrides: Sequence[str]) -> Path:
    """Folder of a request's plan without --out; overrides : as of `plan_poses`."""
    return Path("runs") / f"{load_pose_request(file, overrides=overrides).name}-plan"


def plan_poses(
    file: Path,
    *,
    folder: Path,
    seconds: float,
    overrides: Sequence[str] = (),
    out: Console,
    err: Console,
) -> bool:
    """Plans still poses and writes them.

    file : request. seconds : of the search at most. overrides : texts `KEY=VALUE` that replace
    values of the request.

    Returns whether every move keeps the clearance. Raises InputError where too few poses can be
    measured.
    """
    request = load_pose_request(file, overrides=overrides)
    setup = setup_of(request, relative_to=file.parent)
    with claimed_folder(folder, output_names(request), "the plan"):
        begin = time.monotonic()
        with status(err, "planning poses ...") as show:
            plan = pose_plan(
                setup, seconds=seconds, since=lambda: time.monotonic() - begin, show=show
            )
        names = [*write_pose_plan(plan, folder, relative_to=file.parent), REQUEST]
        write_request(file, folder, overrides=overrides)
        say_pose_plan(out, plan)
        if reason := without_program(setup.robot):
            out.print(escape(reason))
        out.print(f"Files in {escape(str(folder))}: {', '.join(names)}")
        out.print(f"Measure, fill in poses.csv, then: ballbar check {escape(str(folder))}")
    return not plan.route.blocked


def say_pose_plan(out: Console, plan: PosePlan) -> None:
    """Prints what a plan is predicted to determine, and its moves."""
    setup, route = plan.setup, plan.route
    seats = len({s.seat for s in setup.stations})
    targets = len({s.target for s in setup.stations})
    out.print(
        f"{plan.poses.size} poses of {escape(setup.robot.name)} for "
        f"{escape(setup.instrument.name)}, {seats} "
        f"seat{'s' * (seats > 1)}, {targets} target{'s' * (targets > 1)}; selected in "
        f"{plan.seconds:.0f} s"
    )
    random = plan.random * UM
    out.print(
        f"predicted TCP sigma over the workspace: {plan.sigma.mean() * UM:.1f} um mean, "
        f"{plan.sigma.max() * UM:.0f} um largest; catalogue robot "
        f"{plan.information.catalogue_sigma().mean() * UM:.0f} um"
    )
    out.print(
        f"as many random poses: {np.median(random):.1f} um ({random.min():.1f} to "
        f"{random.max():.1f} over {random.size} sets); {plan.gain:.2f} times that of the plan"
    )
    if plan.narrow:
        axes = ", ".join(str(axis) for axis in plan.narrow)
        out.print(
            f"[yellow]workspace beyond the poses[/] in axes {axes}: the identified robot will not "
            "be trusted there"
        )
    out.print(
        f"moves: {route.seconds:.0f} s at top speed, {len(route.passing)} over intermediate poses"
    )
    if route.released:
        out.print(
            f"{len(route.released)} moves leave the instrument's stroke: take it off between poses"
        )
    if route.blocked:
        numbers = ", ".join(str(k + 1) for k in route.blocked)
        out.print(f"[red]too close[/] on the way to poses {numbers}: do not run the program so")

"""Summary of a plan at the terminal: prediction, gain, limits in MuJoCo, answers to what-ifs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballbar.cell.number_text import significant_text
from ballbar.cell.typical_machine import arm_length
from ballbar.plan.beam import OFFSET_PLATE, PLATE_FORCE, tip_deflection, tip_slope
from ballbar.planning.force import MACHINES
from ballbar.planning.next_step import EVERY_ENCODER, ROD_SIGMA
from ballbar.planning.plan import COVERED_WITHIN, PathPlan
from ballbar.planning.pose_plan import PosePlan
from ballbar.planning.questions import CHANGES, ENCODERS, Question
from ballbar.planning.verify import Check
from ballbar.planning.what_if import Answer
from ballbar.terminal import wide_console
from ballbar.units import MM, UM, URAD

WIDTH = 120  # characters of a table in a pipe or file
# A length has no Hayati angles in its model, and leaves base tilt and clock to the robot's errors.
_FIXED = ("rbeta", "otx", "oty", "offset", "skew")
WORTHWHILE = 0.1  # of the TCP sigma that results state: less hardly shows in a robot
UNSEEN = 0.9  # of its prior: standard deviation above which an unknown counts as hardly seen


def say_plan(out: Console, plan: PathPlan) -> None:
    """Prints where a plan comes from and what it is predicted to identify."""
    typical, tcp = plan.typical, plan.tcp * UM
    position = ", ".join(f"{v:.3f}" for v in plan.evaluation.candidate.position)
    beside = f", {escape(Path(name).stem)} beside it" if (name := plan.request.cell.tracker) else ""
    if plan.stopped:
        out.print("[yellow]stopped[/] before its time; this is the best so far")
    searched = f"found in {plan.seconds:.0f} s, {plan.evaluated} tried"
    out.print(
        f"path {searched if plan.evaluated else 'as given'}; "
        f"{plan.gauge} {escape(Path(plan.rod).stem)} at ({position}) m{beside}"
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
        f"path; shipped plans cover 5 to 21%, and the sigma above counts it){_expected(plan)}"
    )
    if keys := plan.evaluator.typical.keys:
        robot = plan.evaluator.cell.robot
        out.print(
            f"the file of {escape(robot.name)} states no {', '.join(keys)}: the force in the rod "
            f"is that of a robot typical of its size ({arm_length(robot):.2f} m), and its limit "
            "holds for the spread over published robots; the fit uses no typical value"
        )
    if plan.lengths is not None and plan.lengths.warning:
        out.print(f"[yellow]warning:[/] {plan.lengths.warning}")
    if plan.forces is not None:
        reversals = ", ".join(f"{n:.0f}" for n in plan.reversals)
        out.print(f"sign changes of the load of gears 1 to 6: {reversals}")
    indices = ", ".join(f"{name} {value:.3g}" for name, value in plan.indices().items())
    out.print(f"observability {indices}")
    priors = typical.prior
    fixed = () if plan.lengths is None else _FIXED
    unseen = [
        name
        for name, sigma in typical.sigma.items()
        if sigma > UNSEEN * priors[name] and not name.startswith(fixed)
    ]
    out.print(f"hardly seen by the path ({len(unseen)}): {' '.join(unseen)}")


def _expected(plan: PathPlan) -> str:
    """Force in the rod of a ball-bar, or length of a telescoping bar beside its stroke."""
    if plan.forces is not None:
        least, most = plan.forces.interval
        over = f" over the spread of {MACHINES} robots" if plan.evaluator.typical.keys else ""
        return f", rod force {least:.0f} to {most:.0f} N expected{over}"
    if plan.lengths is None:
        return ""
    nominal = plan.evaluator.cell.ballbar.length
    off = (plan.lengths.length - nominal) * MM
    low, high = ((end - nominal) * MM for end in plan.lengths.stroke)
    return (
        f", length {off.min():+.1f} to {off.max():+.1f} mm about {nominal * MM:.0f} mm expected "
        f"({len(off)} robots with errors of 1 mm and 1 mrad), stroke {low:+.1f} to {high:+.1f} mm"
    )


def say_gain(out: Console, plan: PathPlan) -> None:
    """Prints what a path adds to the results that it comes after."""
    before = plan.tcp_before
    if before is None:
        return
    now, then = before * UM, float(np.median(plan.tcp)) * UM
    out.print(
        f"TCP sigma, scale known, by the results so far {now:.1f} um rms, with this path "
        f"{then:.1f} um ({1.0 - then / now:.0%} less)"
    )
    if not worthwhile(plan):
        advice = "; what would, if anything, is below" if instead(plan) else ""
        if plan.request.cell.ballbar_position_m is not None:
            advice += (
                ". Another seat of the ball-bar may: free its place in the request "
                "(ballbar_region_m)"
            )
        out.print(f"[yellow]this path lowers it by less than {WORTHWHILE:.0%}[/]{advice}")


def worthwhile(plan: PathPlan) -> bool:
    """Whether a path lowers the TCP sigma of the results before by WORTHWHILE; True without."""
    before = plan.tcp_before
    return before is None or float(np.median(plan.tcp)) <= (1.0 - WORTHWHILE) * before


def instead(plan: PathPlan) -> list[Question]:
    """Questions of what else would help, where the path hardly adds to the results before it."""
    if worthwhile(plan) or plan.request.telescoping:
        return []
    sensors, bar = plan.request.sensors, plan.evaluator.cell.ballbar
    questions = [Question("duration", "s", (2.0 * plan.request.timing.duration_s,))]
    if (sensors.rod_sigma_m or bar.length_tolerance) > ROD_SIGMA:
        questions.insert(0, Question("rod_sigma", CHANGES["rod_sigma"].unit, (ROD_SIGMA,)))
    if set(sensors.encoders) != set(EVERY_ENCODER):
        questions.insert(0, Question(ENCODERS, "", (EVERY_ENCODER,)))
    return questions


def say_checks(out: Console, results: list[tuple[int, list[Check]]]) -> None:
    """Prints the limits against the motion in MuJoCo. results : (seed of a robot, its checks)."""
    table = Table(box=None, pad_edge=False)
    for heading in ("limit", "allowed", *(f"robot {seed}" for seed, _ in results), "violated"):
        table.add_column(heading, justify="left" if heading == "limit" else "right")
    for rows in zip(*(checks_of_robot for _, checks_of_robot in results), strict=True):
        bad, instants = sum(row.instants for row in rows), sum(row.looked_at for row in rows)
        values = (f"{significant_text(row.worst)} {row.unit}".strip() for row in rows)
        violated = f"[{'red' if bad else 'green'}]{bad} of {instants}[/]"
        table.add_row(rows[0].limit, f"{rows[0].allowed:.3g}", *values, violated)
    out.print("MuJoCo, soft servo, robots with errors; worst value of each limit:")
    wide_console(out, WIDTH).print(table)


def say_answers(out: Console, plan: PathPlan, results: Sequence[Answer]) -> None:
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
    random, sigma = plan.random * UM, plan.prediction.tcp_sigma * UM
    out.print(
        f"predicted TCP sigma over the workspace: {sigma.mean():.1f} um mean, "
        f"{sigma.max():.0f} um largest; catalogue robot "
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

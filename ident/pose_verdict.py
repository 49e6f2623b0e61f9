"""Verdict on an identification from still poses: status and sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cell.poses import PoseGroup, PoseTable
from ident.cross_validation import at_one_place, only_lengths
from ident.estimator.priors import FAR, robot_prior
from ident.estimator.regions import distinct_poses
from ident.verdict import Status, Verdict

if TYPE_CHECKING:
    from ident.pose_result import PoseIdentification

STRANGE = 3e-3  # [m] cross-validated: industrial robots, identified, stay below 0.5 mm
OVERFITTED = 1.8  # cross-validated error over that of the fitted poses
NO_GAIN = 0.9  # of the nominal robot's error: less than a tenth was won
LOST = 0.1  # of the poses: so many outliers have a cause
NARROW = np.deg2rad(20.0)  # [rad] range of a joint's angles that tells little of it
DISTINCT = 0.7  # share of the rows that are poses of their own
LOCAL = 2.0  # stated uncertainty over the fitted ranges against that beside the poses
LOWEST_CERTAIN = 4  # orders up to it may stand for another smooth error of the joints
SEATS = 3  # of lengths, whose rods point in all directions
LISTED = 5  # rows that a warning names


def judge_poses(result: PoseIdentification) -> Verdict:
    """Status, sentence and warnings."""
    status, sentence = _judged(result)
    return Verdict(status, sentence, tuple(_warnings(result)))


def _judged(result: PoseIdentification) -> tuple[Status, str]:
    """The first rule that applies."""
    fit, validation = result.fit, result.cross_validation
    fitted, before = result.residual_means
    lost = int((~validation.counting).sum())
    partial = only_lengths(result.table)
    what = result.table.groups[0].kind.judged if partial else "position"
    nominal = float(np.median(result.residual_nominal))
    errors = (
        f"poses {validation.left_out} that were not fitted are predicted to "
        f"{validation.mean * 1e3:.3f} mm in {what} (95 %: {validation.quantile * 1e3:.3f} mm); "
        f"with the nominal robot {before * 1e3:.3f} mm"
    )
    if partial:
        tool = float(result.sigma_at_poses.mean())
        errors += f"; stated TCP uncertainty at the measured poses {tool * 1e3:.3f} mm"
    if validation.mean > STRANGE or not np.isfinite(validation.mean):
        return Status.IMPLAUSIBLE, (
            f"Not the declared robot, or not its joint angles: {errors}. Check `robot`, the order, "
            "signs and units of the joint columns, the unit of the measured values, and whether "
            "two seats of the instrument go by one name."
        )
    if not fit.converged:
        return Status.NOT_CONVERGED, (
            f"Not converged after {fit.iterations} iterations: do not use these parameters. Check "
            "the joint columns and the robot's file; measure more poses, spread over all joints."
        )
    if lost > LOST * result.table.size:
        return Status.SUSPECT, (
            f"Usable, with care: {lost} of {result.table.size} poses lie too far from the model to "
            f"count. Look for what they have in common. Of the others, {errors}."
        )
    if validation.mean > result.residual_nominal.mean():
        return Status.MISFIT, (
            f"Misfit: the identified robot is worse than the nominal one where it was not fitted; "
            f"{errors}. Do not use these parameters. Check the joint columns, and whether "
            "instrument or target moved; measure more poses, spread over all joints."
        )
    if validation.mean > NO_GAIN * nominal:
        return Status.SUSPECT, (
            f"Usable, with care: little was won over the nominal robot; {errors}. Measure more "
            "poses, spread over all joints."
        )
    if validation.mean > OVERFITTED * fitted:
        return Status.SUSPECT, (
            f"Usable, with care: too few poses for so many parameters; fitted ones lie within "
            f"{fitted * 1e3:.3f} mm, but {errors}. Measure more poses, spread over all joints."
        )
    if at_one_place(fit) and not result.elsewhere:
        return Status.SUSPECT, (
            f"Usable, with care: all was measured at one place, and the statement holds there; "
            f"elsewhere the robot may be several times worse: {errors}. Measure at another place "
            "too, or validate with poses of another place."
        )
    return Status.GOOD, f"Good fit: {errors}."


def _warnings(result: PoseIdentification) -> list[str]:
    table, fit, findings = result.table, result.fit, result.findings
    out = []
    names = [f"{g.file}:{row}" for g in table.groups for row in g.rows]
    out += [step.sentence for step in findings.steps]
    if findings.outliers.size:
        out.append(
            f"{_poses(findings.outliers.size)} far from the model and counting little or not at "
            f"all: {_listed([names[i] for i in findings.outliers])}"
        )
    if findings.unsettled.size:
        out.append(
            f"{_poses(findings.unsettled.size)} read before the robot stood still (their errors "
            "lie along the last move), and left out: "
            f"{_listed([names[i] for i in findings.unsettled])}; wait longer before reading"
        )
    if findings.unfinished:
        out.append(
            f"the joint angles were read with {abs(findings.unfinished) * 100:.2g} % of the last "
            "move missing: before the robot stood still, or before it had settled; wait longer "
            "before reading"
        )
    for drift in findings.drifts:
        turn = f" and {drift.turn * 1e3:.3f} mrad" if drift.turn else ""
        out.append(
            f"{drift.seat} drifts against the robot by {drift.shift * 1e3:.3f} mm{turn} over the "
            "measurement; it is not part of the model: measure reference points, or in a shorter "
            "time"
        )
    steps = np.rad2deg(fit.model.angle_noise * np.sqrt(12.0))
    if steps.any():
        axes = ", ".join(str(j + 1) for j in np.flatnonzero(steps))
        out.append(
            f"the angles of joints {axes} are rounded to {steps.max():g} deg; their weights allow "
            "for it, but exact angles would make a better robot"
        )
    if result.scale_pull is not None:
        size, sigma = result.scale_pull
        out.append(
            f"the measured values are {size:+.3%} (sigma {sigma:.3%}) off the robot's catalogue "
            "lengths, all in one proportion: check their unit, the instrument's scale and the "
            "robot's variant; the scale of the result is that of the instrument"
        )
    rods = all(group.measured == "length" for group in table.groups)
    if rods and len(table.seats) < SEATS:
        out.append(
            f"lengths from {len(table.seats)} seat{'s' * (len(table.seats) > 1)} judge the robot "
            "along the rods alone; the stated uncertainty of points allows for joint errors that "
            f"do not show there: measure from {SEATS} seats around the robot"
        )
    distinct = sum(
        int(distinct_poses(np.concatenate([g.q for g in same])).max()) + 1
        for same in _of_one_thing(table)
    )
    if distinct < DISTINCT * table.size:
        out.append(
            f"the {table.size} rows are {distinct} poses, measured repeatedly; repeats tell of "
            "noise, not of other poses"
        )
    ranges = np.ptp(table.q, axis=0)
    if (narrow := np.flatnonzero(ranges < NARROW)).size:
        each = ", ".join(f"{j + 1} ({np.rad2deg(ranges[j]):.1f} deg)" for j in narrow)
        out.append(
            f"joints that hardly moved: {each}; their parameters stay near the catalogue and the "
            "result holds only where they stood"
        )
    away, beside = (float(s.mean()) for s in (result.tcp_sigma, result.sigma_at_poses))
    if away > LOCAL * beside:
        out.append(
            f"the poses cover a part of the ranges of their joints: at them the stated TCP "
            f"uncertainty is {beside * 1e3:.3f} mm, extrapolated over the ranges "
            f"{away * 1e3:.3f} mm"
        )
    out += _of_parameters(result)
    out += _of_orders(result)
    return out


def _of_parameters(result: PoseIdentification) -> list[str]:
    layout, x = result.fit.model.unknowns, result.fit.x
    far = []
    for i, parameter in enumerate(layout.parameters):
        off = float(x[i] - layout.mean[i])
        if abs(off) > FAR * robot_prior(parameter):
            unit = "mm" if parameter.is_length else "mrad"
            far.append(f"{parameter.name} {off * 1e3:+.2f} {unit}")
    if not far:
        return []
    return [
        f"far from the catalogue: {', '.join(far)}; a joint's zero may have been set wrongly, or "
        "the robot's file is of another variant"
    ]


def _of_orders(result: PoseIdentification) -> list[str]:
    if result.search is None or not result.search.orders:
        return []
    out, orders = [], result.search.orders
    low = [f"joint {o.joint + 1}: {o.order:g}" for o in orders if o.order <= LOWEST_CERTAIN]
    if low:
        out.append(
            f"low orders were found ({_listed(low)}); they may stand for another smooth error of "
            "the robot rather than of that joint"
        )
    ambiguous = [o for o in orders if o.aliases]
    if ambiguous:
        each = [
            f"joint {o.joint + 1}: {o.order:g} or {' or '.join(f'{a:g}' for a in o.aliases[:4])}"
            for o in ambiguous
        ]
        out.append(
            f"orders that these angles do not tell apart ({_listed(each)}), because the angles lie "
            "on a grid or cover a part of a turn"
        )
    return out


def _of_one_thing(table: PoseTable) -> list[list[PoseGroup]]:
    """The groups of each pair of seat and target: at another one, a pose tells something new."""
    pairs = dict.fromkeys((g.seat, g.target) for g in table.groups)
    return [[g for g in table.groups if (g.seat, g.target) == pair] for pair in pairs]


def _poses(count: int) -> str:
    return f"{count} pose{'s' * (count != 1)}"


def _listed(items: list[str]) -> str:
    more = f" and {len(items) - LISTED} more" if len(items) > LISTED else ""
    return ", ".join(items[:LISTED]) + more

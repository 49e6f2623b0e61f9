"""Remarks on still poses in a fit: what was left out, what moved, and what the poses leave open."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ballbar.ident.cameras import remarks_of
from ballbar.ident.estimator.order_search import JointOrder
from ballbar.ident.estimator.priors import FAR, robot_prior
from ballbar.ident.estimator.regions import distinct_poses
from ballbar.ident.estimator.uncertainty import STRONG
from ballbar.ident.evidence import Evidence
from ballbar.ident.findings import Findings
from ballbar.ident.table_estimate import TableEstimate

NARROW = np.deg2rad(20.0)  # [rad] range of a joint's angles that tells little of it
DISTINCT = 0.7  # share of the rows that are poses of their own
LOCAL = 2.0  # stated uncertainty over the fitted ranges against that beside the poses
LOWEST_CERTAIN = 4  # orders up to it may stand for another smooth error of the joints
SEATS = 3  # of lengths, whose rods point in all directions
LISTED = 5  # rows that a warning names


def table_remarks(evidence: Evidence) -> Iterator[str]:
    """Remarks on the still poses of a fit; none where it has no still poses."""
    estimate = evidence.table
    if estimate is None:
        return
    yield from _findings(estimate, estimate.findings)
    if not estimate.judges:
        yield (
            f"{_poses(estimate.table.size)} of {estimate.table.name} hardly tell more than where "
            "instrument and target are; the verdict is by the recordings alone"
        )
    yield from _rounded(estimate)
    yield from (*estimate.doubts, *remarks_of(estimate.fit))
    if estimate.alone:
        yield from _scale(estimate)
    yield from _repeated(estimate)
    if estimate.alone:
        yield from _local(estimate)
        yield from _far(estimate)
    yield from _on_one_flank(estimate)
    yield from _orders(estimate.search.orders if estimate.search else ())


def _rounded(estimate: TableEstimate) -> Iterator[str]:
    steps = np.rad2deg(estimate.fit.model.angle_noise * np.sqrt(12.0))
    if steps.any():
        axes = ", ".join(str(j + 1) for j in np.flatnonzero(steps))
        yield (
            f"the angles of joints {axes} are rounded to {steps.max():g} deg; their weights allow "
            "for it, but exact angles would make a better robot"
        )


def _findings(estimate: TableEstimate, findings: Findings) -> Iterator[str]:
    names = [f"{g.file}:{row}" for g in estimate.table.groups for row in g.rows]
    yield from (step.sentence for step in findings.steps)
    if findings.outliers.size:
        yield (
            f"{_poses(findings.outliers.size)} far from the model and counting little or not at "
            f"all: {_listed([names[i] for i in findings.outliers])}"
        )
    yield from _strays(findings, names)
    if findings.unsettled.size:
        left_out = ", and left out" if estimate.alone else ""
        yield (
            f"{_poses(findings.unsettled.size)} read before the robot stood still (their errors "
            f"lie along the last move){left_out}: "
            f"{_listed([names[i] for i in findings.unsettled])}; wait longer before reading"
        )
    if findings.unfinished:
        yield (
            f"the joint angles were read with {abs(findings.unfinished) * 100:.2g} % of the last "
            "move missing: before the robot stood still, or before it had settled; wait longer "
            "before reading"
        )
    for drift in findings.drifts:
        turn = f" and {drift.turn * 1e3:.3f} mrad" if drift.turn else ""
        yield (
            f"{drift.seat} drifts against the robot by {drift.shift * 1e3:.3f} mm{turn} over the "
            "measurement; it is not part of the model: measure reference points, or in a shorter "
            "time"
        )


def _strays(findings: Findings, names: list[str]) -> Iterator[str]:
    """Rows whose joint angles are those of another row."""
    fits = {i: j for i, j, fitting in findings.strays if fitting}
    pairs = [f"{names[i]} and {names[j]}" for i, j in fits.items() if i < j and fits.get(j) == i]
    others = [f"{names[i]} that of {names[j]}" for i, j in fits.items() if fits.get(j) != i]
    same = [f"{names[i]} as {names[j]}" for i, j, fitting in findings.strays if not fitting]
    for rows, what, remedy in (
        (pairs, "fit each other's joint angles", "exchange their angles, or the names of"),
        (others, "fit the joint angles of another row", "correct their angles, or the names of"),
        (same, "have the joint angles of another row, whose values are others",
         "correct their angles, or the names of"),
    ):  # fmt: skip
        if rows:
            yield f"rows that {what}: {_listed(rows)}; {remedy} their pictures"


def _scale(estimate: TableEstimate) -> Iterator[str]:
    """Remarks where the robot's size follows from the instrument's scale or a few rods alone."""
    if estimate.scale_pull is not None:
        size, sigma = estimate.scale_pull
        yield (
            f"the measured values are {size:+.3%} (sigma {sigma:.3%}) off the robot's catalogue "
            "lengths, all in one proportion: check their unit, the instrument's scale and the "
            "robot's variant; the scale of the result is that of the instrument"
        )
    seats = estimate.table.seats
    rods = all(group.measured == "length" for group in estimate.table.groups)
    if rods and len(seats) < SEATS:
        yield (
            f"lengths from {len(seats)} seat{'s' * (len(seats) > 1)} judge the robot "
            "along the rods alone; the stated uncertainty of points allows for joint errors that "
            f"do not show there: measure from {SEATS} seats around the robot"
        )


def _repeated(estimate: TableEstimate) -> Iterator[str]:
    """At another seat or target, a pose tells something new."""
    table = estimate.table
    still = [g for g in table.groups if g.motion is None]
    pairs = dict.fromkeys((g.seat, g.target) for g in still)
    angles = [np.concatenate([g.q for g in still if (g.seat, g.target) == pair]) for pair in pairs]
    distinct = sum(int(distinct_poses(q).max()) + 1 for q in angles)
    if distinct < DISTINCT * (rows := sum(g.size for g in still)):
        yield (
            f"the {rows} rows are {distinct} poses, measured repeatedly; repeats tell of "
            "noise, not of other poses"
        )


def _local(estimate: TableEstimate) -> Iterator[str]:
    """Joints and ranges of which the poses tell little."""
    ranges = np.ptp(estimate.table.q, axis=0)
    if (narrow := np.flatnonzero(ranges < NARROW)).size:
        each = ", ".join(f"{j + 1} ({np.rad2deg(ranges[j]):.1f} deg)" for j in narrow)
        yield (
            f"joints that hardly moved: {each}; their parameters stay near the catalogue and the "
            "result holds only where they stood"
        )
    away, beside = (float(s.mean()) for s in (estimate.tcp_sigma, estimate.sigma_at_poses))
    if away > LOCAL * beside:
        yield (
            f"the poses cover a part of the ranges of their joints: at them the stated TCP "
            f"uncertainty is {beside * 1e3:.3f} mm, extrapolated over the ranges "
            f"{away * 1e3:.3f} mm"
        )


def _far(estimate: TableEstimate) -> Iterator[str]:
    layout, x = estimate.fit.model.unknowns, estimate.fit.x
    far = []
    for i, parameter in enumerate(layout.parameters):
        off = float(x[i] - layout.mean[i])
        if abs(off) > FAR * robot_prior(parameter):
            unit = "mm" if parameter.is_length else "mrad"
            far.append(f"{parameter.name} {off * 1e3:+.2f} {unit}")
    if far:
        yield (
            f"far from the catalogue: {', '.join(far)}; a joint's zero may have been set wrongly, "
            "or the robot's file is of another variant"
        )


def _on_one_flank(estimate: TableEstimate) -> Iterator[str]:
    """Zeros that the poses do not tell from play."""
    fit, joints = estimate.fit, range(1, estimate.table.robot.joints + 1)
    place = {name: i for i, name in enumerate(fit.model.unknowns.names)}
    sigma, each = np.sqrt(np.diag(fit.covariance)), []
    for i, k in ((place.get(f"rtheta{j}"), place.get(f"backlash{j}")) for j in joints):
        if i is None or k is None:
            continue
        if abs(fit.covariance[i, k]) > STRONG * sigma[i] * sigma[k]:
            each.append(f"{fit.model.unknowns.names[i]} ({np.rad2deg(sigma[i]):.2f} deg)")
    if each:
        yield (
            f"zeros that no pose tells from play: {', '.join(each)}, standard deviation in "
            "brackets; in all poses the weight presses these gears to one flank. Poses beyond the "
            "vertical, where it presses them to the other, tell both"
        )


def _orders(orders: tuple[JointOrder, ...]) -> Iterator[str]:
    low = [f"joint {o.joint + 1}: {o.order:g}" for o in orders if o.order <= LOWEST_CERTAIN]
    if low:
        yield (
            f"low orders were found ({_listed(low)}); they may stand for another smooth error of "
            "the robot rather than of that joint"
        )
    each = [
        f"joint {o.joint + 1}: {o.order:g} or {' or '.join(f'{a:g}' for a in o.aliases[:4])}"
        for o in orders
        if o.aliases
    ]
    if each:
        yield (
            f"orders that these angles do not tell apart ({_listed(each)}), because the angles lie "
            "on a grid or cover a part of a turn"
        )


def _poses(count: int) -> str:
    return f"{count} pose{'s' * (count != 1)}"


def _listed(items: list[str]) -> str:
    more = f" and {len(items) - LISTED} more" if len(items) > LISTED else ""
    return ", ".join(items[:LISTED]) + more

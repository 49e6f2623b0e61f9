"""A machine that recordings identified, held against still poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.identify import identify_together
from ballbar.ident.machine_at_rest import arm_at_rest, table_at_rest
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification, Machine
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.verification import Verification
from ballbar.ident.verify_table import verify
from ballbar.sim.truth import Truth
from tests.helpers.tracker_points import still_points

SEED, MEASURED = 3, 2e-5  # [m] of still poses along each axis
Run = tuple[Cell, Logs, Truth]


def test_bare_rows_at_the_angles_at_rest_stand_as_the_robot_does(
    cell: Cell, nominal: Geometry
) -> None:
    """Gears yield, and bearings tilt beside the joints: to first order, 3e-8 m of 0.3 mm."""
    corrections = tuple(CORRECTIONS[n](cell, ()) for n in ("joint_compliance", "bearing_tilt"))
    coefficients = [c for correction in corrections for c in correction.coefficients]
    values = np.array([c.mean + c.sigma for c in coefficients])
    robot = IdentifiedRobot(cell, nominal, corrections, values)
    q = np.array([0.1, 0.2, -0.3, 0.4, 0.8, 0.5]) + 0.2 * np.random.default_rng(1).uniform(
        -1.0, 1.0, (10, 6)
    )
    assert np.abs(robot.deflected(q)[1]).max() > 1e-5
    group = PoseGroup(
        measured="point",
        seat="tracker",
        target="reflector",
        q=q,
        values=np.zeros((10, 3)),
        sigma=np.ones((10, 3)),
        rows=np.arange(10),
        file="points.csv",
    )
    (still,) = table_at_rest(robot, PoseTable("points", cell.robot, (group,))).groups
    assert forward(nominal.robot, still.q).poses() == pytest.approx(robot.poses(q), abs=1e-7)


def checked(
    machine: Machine,
    run: Run,
    targets: Mapping[str, Placement],
    *,
    seed: int = 301,
    turned: int = 0,
    moved: float = 0.0,
) -> Verification:
    """Twelve points of today; the zero of an axis turned by 1 mrad, or the target moved [m]."""
    cell, _, truth = run
    (group,) = still_points(cell, truth, seed).groups
    q = group.q.copy()
    if turned:
        q -= 1e-3 * np.asarray(cell.robot.controller_to_joint)[turned - 1]
    known = {name: replace(p, origin=p.origin - [0.0, 0.0, moved]) for name, p in targets.items()}
    table = PoseTable("today", cell.robot, (replace(group, q=q),))
    arm = arm_at_rest(machine, known, MEASURED)
    return verify(arm, known, MEASURED, table_at_rest(machine.robot, table))


def test_still_poses_are_held_against_a_robot_that_recordings_identified(
    drawn_run: Run, drawn_alone: Identification
) -> None:
    alone = drawn_alone.machine
    for seed in range(301, 304):
        outcome = checked(alone, drawn_run, {}, seed=seed)
        assert outcome.explanations == (), outcome.sentence
        assert outcome.notes == ()
    for axis in (2, 3, 4, 5):
        (named,) = checked(alone, drawn_run, {}, turned=axis).named
        assert (named.cause.kind, named.cause.name) == ("axis", str(axis))
        assert named.size[0] == pytest.approx(1e-3, abs=4.0 * named.sigma[0])


def test_a_target_that_was_identified_with_recordings_and_moved_is_named(drawn_run: Run) -> None:
    cell, logs, truth = drawn_run
    result = identify_together(cell, [logs], still_points(cell, truth, SEED))
    assert result.poses is not None
    targets = {name: entry.placement for name, entry in result.poses.targets.items()}
    assert checked(result.machine, drawn_run, targets).explanations == ()
    (named,) = checked(result.machine, drawn_run, targets, moved=3e-4).named
    assert (named.cause.kind, named.cause.name) == ("target", "reflector")
    assert named.size == pytest.approx([0.0, 0.0, 3e-4], abs=4.0 * named.sigma.max())
    assert checked(result.machine, drawn_run, targets, turned=3).named[0].cause.name == "3"

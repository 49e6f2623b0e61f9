"""Recordings and still poses of one robot in one fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.load import load_robot
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.ident.verdict import Status
from ballbar.sim.truth import Truth
from tests.helpers.tracker_points import SIGMA, still_points

KINEMATICS = FitOptions(model="dh")
Run = tuple[Cell, Logs, Truth]


def test_a_tracker_s_points_tell_what_a_recording_leaves_open(
    drawn_alone: Identification, drawn_mixed: Identification
) -> None:
    """The scale above all; seat and target come out beside, and a wrong point does not count."""
    mixed = drawn_mixed
    assert drawn_alone.poses is None
    assert mixed.poses is not None
    assert mixed.verdict.status is Status.GOOD, mixed.verdict.sentence
    scales = [
        (r.robot.tcp.sigma**2 - r.robot.tcp.without_scale**2).mean() for r in (mixed, drawn_alone)
    ]
    assert scales[0] < 0.5 * scales[1]  # the variance that the scale alone leaves
    seat = mixed.poses.seats["tracker"]
    assert seat.whole
    assert np.abs(seat.placement.origin - [2.5, -1.0, 0.3]).max() < 5.0 * seat.sigma.max()
    assert mixed.poses.ignored == 1
    assert any("1 pose far from the model" in warning for warning in mixed.verdict.warnings)
    assert mixed.poses.cross_validation.mean < 8.0 * SIGMA  # of poses that the recording predicts
    errors = np.delete(mixed.poses.errors[0], 4)
    assert SIGMA < errors.mean() < 8.0 * SIGMA  # the robot's own scatter at rest is above it


def test_a_few_points_beside_a_recording_do_not_judge_the_robot(drawn_run: Run) -> None:
    """Without one of four, seat and target are hardly known: "not the declared robot" it was."""
    cell, logs, truth = drawn_run
    result = identify_together(cell, [logs], still_points(cell, truth, 3, count=4))
    assert result.verdict.acceptable, result.verdict.sentence
    assert any("4 poses of tracker hardly tell more" in w for w in result.verdict.warnings)


def test_still_poses_of_another_robot_are_named(drawn_run: Run) -> None:
    """A zero of 0.5 mrad that only the still poses have."""
    cell, logs, truth = drawn_run
    table = still_points(cell, truth, 3, count=40)
    (group,) = table.groups
    q = group.q + np.array([0.0, 5e-4, 0.0, 0.0, 0.0, 0.0]) * np.sign(group.q[:, :1])
    other = replace(table, groups=(replace(group, q=q),))
    result = identify_together(cell, [logs], other)
    assert any("still poses of tracker lie" in warning for warning in result.verdict.warnings)


def test_a_table_of_a_robot_of_another_name_is_refused(drawn_run: Run) -> None:
    cell, logs, truth = drawn_run
    table = replace(still_points(cell, truth, 3), robot=load_robot("ur5"))
    with pytest.raises(InputError, match="is of robot ur5, the recordings are of irb2400"):
        identify_together(cell, [logs], table, options=KINEMATICS)

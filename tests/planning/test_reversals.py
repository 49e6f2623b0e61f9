"""Friction where an axis reverses: what a plan predicts, and what the plant does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.evaluation import Evaluator, check, evaluators
from ballbar.planning.limits import reversal
from ballbar.planning.plan import known_path
from ballbar.planning.request import load_request
from ballbar.planning.verify import _rate, run_in_plant
from tests.helpers.simulated_recordings import SCENARIOS

BEFORE, AFTER = 0.2, 0.9  # [s] about a reversal, in which friction is overcome
LEAST = 10.0  # [deg/s^2]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "low", "high"), [("irb2400", 0.9, 1.5), ("nj220", 0.6, 1.0)])
def test_friction_adds_where_axes_reverse_what_is_predicted(
    name: str, low: float, high: float
) -> None:
    """Without friction the prediction is less than 0.65 of that."""
    (evaluator,) = evaluators(load_request(SCENARIOS / "plans" / f"{name}.yaml")).values()
    shape, position = known_path(SCENARIOS / "paths" / f"{name}_planned.yaml")
    predicted, planned, reached = reversals(evaluator, PathCandidate(shape, np.array(position)))
    assert predicted.size > 25
    assert low < np.median(predicted / reached) < high
    assert np.median(planned / reached) < 0.65


def reversals(evaluator: Evaluator, candidate: PathCandidate) -> tuple[Array, Array, Array]:
    """(K,) [deg/s^2] where an axis reverses: predicted, planned, and reached in MuJoCo."""
    cell, request, trajectory = (
        evaluator.cell,
        evaluator.request,
        check(evaluator, candidate).trajectory,
    )
    assert trajectory is not None
    assert evaluator.held is not None
    moved = run_in_plant(cell, request, candidate, seed=1, beginning=trajectory.q[0])
    to_axis, rows = cell.robot.joint_to_axis, []
    bend = np.degrees(np.abs(_rate(_rate(moved.q, moved.t), moved.t) @ to_axis))
    for axis in range(cell.robot.joints):
        only = to_axis @ np.diag(np.eye(cell.robot.joints)[axis]) @ np.linalg.inv(to_axis)
        alone = replace(
            trajectory, speed=trajectory.speed @ only, acceleration=trajectory.acceleration @ only
        )
        predicted, planned = (
            reversal(cell.robot, request.limits, alone, held).value
            for held in (evaluator.held, 0.0 * evaluator.held)
        )
        for k in np.flatnonzero(predicted > LEAST):
            near = np.abs(moved.t - trajectory.t[k] - 0.5 * (AFTER - BEFORE)) < 0.5 * (
                AFTER + BEFORE
            )
            rows.append((predicted[k], planned[k], bend[near, axis].max()))
    predicted, planned, reached = np.array(rows).T
    return predicted, planned, reached

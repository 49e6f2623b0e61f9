"""The command of a run: the wrist turns as a whole to where its axes keep their ranges."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.sim import path as paths
from ballbar.sim.path import reference_path
from tests.helpers.synthetic_recording import CELL, NOMINAL, SHAPE


def test_an_axis_that_leaves_its_range_for_a_moment_turns_as_a_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """About -170 deg for most of the time, at -403 once: less than its range of 400, but on the
    mean the path is nearer to zero than to a whole turn."""

    def one_branch(*given: object) -> list[Array]:
        phase = np.asarray(given[-1])
        q = np.zeros((phase.size, 6))
        q[:, 1], q[:, 2], q[:, 4] = -1.2, 0.6, 0.7
        q[:, 5] = np.radians(-170.0 - 233.0 * np.exp(-(((phase - 0.5) / 0.05) ** 2)))
        return [q]

    monkeypatch.setattr(paths, "branches_along", one_branch)
    run = reference_path(CELL.robot, NOMINAL, SHAPE, duration=60.0, dwell=2.0, stops=0, step=0.1)
    axes = joints_to_axes(CELL.robot, run.q)[:, 5]
    assert (axes > CELL.robot.axis_lower[5]).all()
    assert (axes < CELL.robot.axis_upper[5]).all()
    assert np.ptp(axes) == pytest.approx(np.radians(233.0), rel=1e-3)

"""Robots of five, six and seven axes without masses are identified from logs of a minute."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, robot_frames, robot_geometry
from ballbar.cell.logs import RobotLog
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.priors import fixed_names
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import accuracy_grid, position_error, tcp_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.verdict import Status
from tests.helpers.one_recording import identify
from tests.helpers.other_robots import (
    CLOCK,
    FIVE_AXES,
    SEVEN_AXES,
    UR,
    OtherMinute,
    Rows,
    cell_of,
    other_minute,
)

DROPPED = ("joint_compliance", "gear_backlash", "gear_ripple")


class Run:
    """One robot, off by a millimetre and a milliradian in every parameter, and its logs."""

    def __init__(self, folder: Path, rows: Rows) -> None:
        self.cell: Cell = cell_of(folder, rows)
        self.minute: OtherMinute = other_minute(self.cell, rows)
        nominal, rng = self.minute.nominal, np.random.default_rng(1)
        fixed = fixed_names(nominal.table)
        names = [name for name in (*nominal.table.robot, "bd3") if name not in fixed]
        self.true: Geometry = nominal.replaced(
            {name: nominal[name] + 1e-3 * rng.standard_normal() for name in names}
        )
        self.logs = self.minute.logs(self.true)

    def identified(self, **options: object) -> Identification:
        chosen = FitOptions(samples=600, **options)  # type: ignore[arg-type]
        return identify(self.cell, *self.logs, options=chosen)

    def tcp_error(self, result: Identification) -> float:
        return tcp_error(result.robot.geometry, self.true, accuracy_grid(self.cell.robot)).mean


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(FIVE_AXES, id="five", marks=pytest.mark.long),
        pytest.param(UR, id="ur"),
        pytest.param(SEVEN_AXES, id="seven", marks=pytest.mark.slow),
    ],
)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return Run(tmp_path_factory.mktemp("robot"), request.param)


@pytest.mark.slow
def test_kinematics_of_any_robot_are_found_within_their_stated_noise(run: Run) -> None:
    result = run.identified()
    assert result.verdict.status is Status.GOOD
    assert result.verdict.warnings == ()
    # Of some thirty parameters; the largest of as many normal deviates stays below 4.
    far = [
        abs(result.robot.geometry[name] - run.true[name]) / sigma
        for name, sigma in result.robot.sigma.items()
    ]
    assert max(far) < 4.0
    assert run.tcp_error(result) < 10e-6  # where 2 mm were planted
    (recording,) = result.recordings
    assert recording.clock is not None
    assert recording.clock.offset == pytest.approx(CLOCK.offset, abs=20e-6)
    dropped = {d.name for d in result.robot.dropped}
    assert dropped == set(run.minute.nominal.table.gauge)


@pytest.mark.slow
def test_corrections_without_masses_and_gears_are_left_out_with_a_warning(run: Run) -> None:
    result = run.identified(model="complete")
    (warning,) = (text for text in result.verdict.warnings if "joint_compliance" in text)
    assert all(name in warning for name in DROPPED)
    assert "the file of robot other has no `links`, `gears`" in warning
    assert not {c.name for c in result.robot.corrections} & set(DROPPED)
    assert set(run.minute.nominal.table.hayati) <= set(result.robot.sigma)
    assert run.tcp_error(result) < 30e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", DROPPED)
def test_a_correction_that_is_asked_for_needs_its_data(run: Run, name: str) -> None:
    with pytest.raises(InputError, match=r"robot other has no `(links|gears)`"):
        run.identified(model="complete", corrections=(name,))


def test_the_log_of_a_robot_with_another_number_of_axes_is_refused(
    run: Run, tmp_path: Path
) -> None:
    other = cell_of(tmp_path, UR if run.cell.robot.joints != 6 else SEVEN_AXES)
    with pytest.raises(InputError, match="joint angles, robot other has"):
        identify(other, *run.logs)


SAG = 5e-4  # [rad/m] of a unit weight's coefficient


@pytest.mark.slow
def test_the_sag_of_a_robot_without_masses_is_found_by_unit_weights(tmp_path: Path) -> None:
    """Up to 1 mrad at the elbow: 0.37 mm of the tool without the correction, 0.015 mm with it."""
    run = Run(tmp_path, UR)
    robot, bar = run.logs
    correction = unit_weights(run.cell.robot)
    values = SAG * np.random.default_rng(2).standard_normal(len(correction.coefficients))

    nominal = robot_geometry(run.cell.robot)
    sagging = IdentifiedRobot(run.cell.robot, nominal, (correction,), values)

    def sag(q: Array) -> Array:
        return sagging.joints(q) - q

    logged = robot.q
    for _ in range(3):  # the robot stands at `robot.q` where its log says `logged`
        logged = robot.q - sag(logged)
    grid = accuracy_grid(run.cell.robot)
    true = robot_frames(run.true, grid + sag(grid)).tip.T

    def identified(**options: object) -> tuple[Identification, float]:
        chosen = FitOptions(samples=600, **options)  # type: ignore[arg-type]
        result = identify(run.cell, RobotLog(robot.t, logged), bar, options=chosen)
        return result, position_error(result.robot.identified.tool(grid), true).mean

    result, error = identified()
    # the play of a rod without tension is at the limit of its support, and no part of the robot
    assert [c.name for c in result.robot.corrections if c.name != "rod_strain"] == ["unit_weights"]
    assert result.verdict.status is Status.GOOD
    assert any(
        "; unit_weights stands for joint_compliance" in text for text in result.verdict.warnings
    )
    off = np.array(
        [
            (result.robot.geometry[name] - run.true[name]) / sigma
            for name, sigma in result.robot.sigma.items()
        ]
    )
    assert np.abs(off).max() < 4.0
    without, wrong = identified(model="complete", corrections=())
    assert without.verdict.status is Status.MISFIT
    assert error < wrong / 3.0
    assert error < 3.0 * result.robot.tcp_sigma.mean()

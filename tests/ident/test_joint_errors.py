"""Joint errors of a recorded robot that its file does not list."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import robot_frames
from ballbar.cell.load import load_robot
from ballbar.ident.complete_fit import FIRST_EXCESS, fit_pose, posed
from ballbar.ident.corrections.gear_ripple import harmonic_orders
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.corrections.joint_harmonics import JOINT_HARMONICS, joint_harmonics
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.identify import identify_together
from ballbar.ident.joint_errors import candidate_orders, linearised, may_have_joint_errors
from ballbar.ident.loads.gear_loads import mass_model, own_weight
from ballbar.ident.options import FitOptions, Listener
from ballbar.ident.recording_fit import fit_recording
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.verdict import Status
from ballbar.report.parameters import correction_tables
from tests.helpers.minute_logs import minute_logs
from tests.helpers.synthetic_recording import CELL, NOMINAL

JOINT, ORDER, SIZE = 1, 17, 2.5e-4  # from 0, cycles a turn, [rad]
OPTIONS, FEW = FitOptions(samples=400), FitOptions(samples=250)
# The machine of the logs: gears as of the file, and a rod that does not yield.
RIGID = {"rod_stiffness": 1e10, "joint_stiffness": (1e10, 1e10), "joint_backlash": (5e-9, 5e-9)}
MACHINE = replace(CELL, ballbar=replace(CELL.ballbar, **RIGID))
MODULE = importlib.import_module(
    "ballbar.ident.identify"
)  # the package has a function of that name


def identified(
    cell: Cell = MACHINE, *, order: int = ORDER, size: float = SIZE, seed: int = 0
) -> Identification:
    logs = minute_logs(compliance=1.0, joint_error=(JOINT, float(order), size), seed=seed)
    return identify_together(cell, [logs], options=OPTIONS)


def tcp_error(result: Identification, order: int, size: float = SIZE) -> float:
    """[m] mean over the grid, of the arm that carries its own weight."""
    q: Array = accuracy_grid(CELL.robot)
    load = own_weight(mass_model(CELL), NOMINAL, q).gear
    gears = q @ CELL.robot.joint_to_gear - (load / CELL.robot.gears.stiffness[:, None]).T
    gears[:, JOINT] += size * np.sin(order * gears[:, JOINT])
    true = robot_frames(NOMINAL, gears @ CELL.robot.gear_to_joint).tip.T
    return position_error(result.robot.identified.tool(q), true).mean


def amplitudes(result: Identification) -> dict[str, float]:
    """[rad] of every joint error by joint and order, as the names have them."""
    (correction,) = (c for c in result.robot.corrections if c.name == JOINT_HARMONICS)
    values = {c.name: c.value for c in correction.coefficients}
    return {
        name.removesuffix("_cos"): float(np.hypot(value, values[name.replace("_cos", "_sin")]))
        for name, value in values.items()
        if name.endswith("_cos")
    }


@pytest.mark.slow
def test_an_error_that_no_list_holds_is_found_and_the_tool_with_it() -> None:
    result = identified()
    assert result.verdict.status is Status.GOOD
    assert list(amplitudes(result)) == ["joint2_17"]
    assert amplitudes(result)["joint2_17"] == pytest.approx(SIZE, rel=0.02)
    assert result.verdict.warnings[-1] == (
        "joint errors found by evidence: joint 2: 17 cycles a turn, 250 urad. They are in the "
        "result; a held-out recording (--validate) confirms them"
    )
    assert tcp_error(result, ORDER) < 15e-6  # measured 3 um; without the search 173 um
    rows = [row for table in correction_tables(result.robot) for row in table.rows]
    (row,) = (row for row in rows if row["name"] == "joint 2, 17 a turn")
    assert float(row["value"]) == pytest.approx(250.0, abs=5.0)


def test_without_an_error_none_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is searched where all is explained."""
    monkeypatch.setattr(MODULE, "fit_joint_errors", pytest.fail)
    result = identify_together(CELL, [minute_logs()], options=OPTIONS)
    assert result.verdict.status is Status.GOOD
    assert result.robot.corrections == ()


@pytest.mark.slow
def test_a_search_where_nothing_is_left_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A listed error: the complete fit explains it, and the search is made all the same."""
    monkeypatch.setattr(MODULE, "may_have_joint_errors", lambda _: True)
    stages: list[str] = []
    listed = next(
        order for gear, order, _ in harmonic_orders(CELL.robot) if gear == JOINT and order > 1
    )
    error = (JOINT, listed, 6e-5)
    result = identify_together(
        CELL, [minute_logs(joint_error=error)], options=OPTIONS, listener=Listener(stages.append)
    )
    assert stages[-1] == "searching joint errors"
    assert JOINT_HARMONICS not in {c.name for c in result.robot.corrections}
    assert "gear_ripple" in {c.name for c in result.robot.corrections}


def with_orders_times(factor: float, cell: Cell = CELL) -> Cell:
    """The cell whose file lists other orders than the gears have."""
    gears = cell.robot.gears
    assert gears is not None
    harmonics = tuple(
        tuple((n * factor if n in (40.0, 80.0) else n, a) for n, a in listed)
        for listed in gears.harmonics
    )
    return replace(cell, robot=replace(cell.robot, gears=replace(gears, harmonics=harmonics)))


@pytest.mark.slow
def test_the_right_order_is_found_where_the_file_lists_another() -> None:
    cell = with_orders_times(0.9, MACHINE)
    assert (JOINT, 36.0) in [pair[:2] for pair in harmonic_orders(cell.robot)]
    result = identified(cell, order=40, size=1e-4)
    assert list(amplitudes(result)) == ["joint2_40"]
    assert amplitudes(result)["joint2_40"] == pytest.approx(1e-4, rel=0.05)
    assert tcp_error(result, 40, 1e-4) < 15e-6


@pytest.mark.slow
def test_candidates_are_columns_of_the_fit_and_blocks_are_numbered_over_all_recordings() -> None:
    recordings = [
        fit_recording(CELL, minute_logs(joint_error=(JOINT, ORDER, SIZE), seed=seed), FEW)
        for seed in (1, 2)
    ]
    chosen = [joint_compliance(CELL.robot), joint_harmonics([(JOINT, ORDER)])]
    pose = posed(CELL, recordings, chosen, FEW)
    model = linearised(fit := fit_pose(pose, FIRST_EXCESS))
    column = model.jacobian[fit.model.unknowns.names.index("joint2_17_cos")]
    expected = model.joints[JOINT] * np.cos(ORDER * model.angles[JOINT])
    # a clock that moved a little less than the regressors must follow
    assert column == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())
    samples = sum(r.samples.times.size for r in recordings)
    assert model.residual.shape[1] == model.groups.size == model.regions.size == samples
    assert np.unique(np.diff(model.groups)).tolist() == [0, 1]
    # the gradient of the whole cost, the knots of the tension included, vanishes at the estimate
    gradient = model.products(model.residual[None])[:, 0] + model.prior_gradient
    assert gradient == pytest.approx(fit.linear.gradient, abs=1e-6 * np.abs(gradient).max() + 1e-3)
    every = [
        whole_jacobian(fit.model, fit.x, k, point, weights)
        for k, (point, weights, _) in enumerate(fit.recorded)
    ]
    columns = np.concatenate(every, axis=2)
    assert model.columns == pytest.approx(columns, rel=1e-12)
    flat = columns.reshape(fit.x.size, -1)
    scale = np.sqrt(np.outer(*[(flat**2).sum(axis=1)] * 2))
    assert (np.abs(model.gram() - flat @ flat.T) <= 1e-12 * scale).all()
    assert np.diag(model.prior_normal) == pytest.approx(fit.model.unknowns.sigma**-2.0)


def test_listed_orders_are_no_candidates_and_turns_of_the_motor_are() -> None:
    robot = CELL.robot
    ratio = 1.0 / abs(float(robot.transmission[0, 0]))
    pairs = candidate_orders(robot, [])
    assert (0, ratio) in pairs
    assert (0, 2.0 * ratio) in pairs
    listed = [pair[:2] for pair in harmonic_orders(CELL.robot)]
    left = candidate_orders(robot, listed)
    assert not {(g, round(n, 3)) for g, n in left} & {(g, round(n, 3)) for g, n in listed}
    assert (JOINT, ORDER) in left
    direct = load_robot("ur10e")  # states no motor ratios
    assert {type(order) for _, order in candidate_orders(direct, [])} == {int}


def test_a_good_fit_is_searched_only_where_the_file_lists_no_orders() -> None:
    result = identify_together(CELL, [minute_logs()], options=OPTIONS)
    assert not may_have_joint_errors(result)
    unlisted = replace(CELL, robot=replace(CELL.robot, gears=None))
    identified_robot = replace(result.robot.identified, description=unlisted)
    robot = replace(result.robot, identified=identified_robot)
    assert may_have_joint_errors(replace(result, robot=robot))
    coloured = replace(result.fit, coloured=3.0)
    assert may_have_joint_errors(replace(result, fit=coloured))
    uncertain = replace(result.verdict, status=Status.UNCERTAIN)
    assert may_have_joint_errors(replace(result, fit=coloured, verdict=uncertain))
    assert not may_have_joint_errors(replace(result, verdict=uncertain))
    suspect = replace(result.verdict, status=Status.SUSPECT)
    assert may_have_joint_errors(replace(result, verdict=suspect))
    lost = replace(result.verdict, status=Status.NOT_CONVERGED)
    assert not may_have_joint_errors(replace(result, robot=robot, verdict=lost))

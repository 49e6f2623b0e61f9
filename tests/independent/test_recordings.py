"""The independent generator shares nothing with us and agrees with our kinematics."""

from __future__ import annotations

import ast
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar import identify
from ballbar.cell.geometry import bar_frames, nominal_geometry, robot_frames
from ballbar.cell.load import load_cell
from ballbar.ident.options import FitOptions
from tests.helpers.independent_truth import true_geometry
from tests.independent.machine import POSITION, Effects, drawn, files, nominal
from tests.independent.path import FIRST, path
from tests.independent.recording import Plan, accuracy_box, aligned_distance, record, record_path
from tests.independent.screws import Pose
from tests.independent.statics import held, unloaded

HERE = Path(__file__).parent
ALLOWED = {"numpy", "scipy", "yaml", "tests.independent", *sys.stdlib_module_names}
SHORT = 60.0  # [s]


def test_the_generator_imports_nothing_of_ours() -> None:
    for file in HERE.glob("[!t]*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                own = name if name.startswith("tests.") else name.split(".")[0]
                assert any(own == a or own.startswith(f"{a}.") for a in ALLOWED), (file.name, name)


def test_products_of_exponentials_are_our_rows() -> None:
    machine, rng = nominal(files()), np.random.default_rng(3)
    geometry = nominal_geometry(load_cell("irb2400", "lund_600", "plate_250"), POSITION)
    q, b = rng.uniform(-np.pi, np.pi, (50, 6)), rng.uniform(-np.pi, np.pi, (50, 5))
    c = np.zeros((len(machine.arm.chain.twists), 50))
    c[machine.arm.joints] = q.T
    ends = (machine.arm.chain.place(c).end, machine.bar.chain.place(np.insert(b, 3, 0, 1).T).end)
    for end, frames in zip(ends, (robot_frames(geometry, q), bar_frames(geometry, b)), strict=True):
        poses = frames.poses()
        np.testing.assert_allclose(end.p, poses[:, :3, 3], atol=1e-14)  # rounding
        np.testing.assert_allclose(end.R, poses[:, :3, :3], atol=1e-14)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_truth_that_intervals_are_judged_by_is_the_machines(seed: int) -> None:
    machine = replace(drawn(files(), seed), ripples=())
    catalogue = nominal_geometry(load_cell("irb2400", "lund_600", "plate_250"), POSITION)
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (200, 6))
    c = np.zeros((len(machine.arm.chain.twists), 200))
    c[machine.arm.joints] = q.T
    actual = machine.arm.chain.place(c).end.p
    tips = [robot_frames(g, q).tip.T for g in (true_geometry(catalogue, machine), catalogue)]
    true, stated = (aligned_distance(tip, actual).max() for tip in tips)
    assert stated > 1e-3  # [m]
    assert true < 5e-6  # [m] second order: 1 mm times 1 mrad, thrice


@pytest.mark.slow
def test_the_loop_is_closed_and_the_rod_balances_the_gears() -> None:
    cell = files()
    machine, way = drawn(cell, 1, Effects(bearing=(1e-7,) * 6, knee=0.1)), path(cell, FIRST, SHORT)
    grown = np.zeros((2, way.command.t.size))
    motion = held(machine, way.command, grown, way.bar, Pose(np.eye(3), np.zeros(3)))
    assert motion.opening < 1e-12  # rounding after the last Newton step
    assert 10.0 < np.sqrt((motion.tension**2).mean()) < 150.0  # [N] a soft servo, 1 mm


@pytest.mark.slow
def test_the_unloaded_robot_sags_under_its_own_weight() -> None:
    machine = nominal(files())
    rigid = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 6))
    c = np.zeros((len(machine.arm.chain.twists), 20))
    c[machine.arm.joints] = (rigid @ machine.to_joint).T
    straight = machine.arm.chain.place(c).end.p
    sag = straight - unloaded(machine, rigid)
    assert 5e-5 < np.abs(sag).max() < 3e-3  # [m] 600 N m on 6e5 N m/rad over a metre


def test_readings_lead_back_to_the_motors() -> None:
    machine = drawn(files(), 4)
    rigid = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 6))
    motors = machine.motors(rigid)
    np.testing.assert_allclose(machine.gears(motors), rigid, atol=1e-12)  # six turns of iteration
    np.testing.assert_allclose(machine.from_readings(machine.read(motors)), motors, atol=1e-12)


@pytest.mark.long
@pytest.mark.slow
def test_a_lag_delays_the_logged_motors_by_itself(tmp_path: Path) -> None:
    plan = Plan(1, Effects(lag=(0.0, 0.02, 0.0, 0.0, 0.0, 0.0)), duration=SHORT)
    record_path(plan, 0, tmp_path / "late")
    record_path(Plan(1, duration=SHORT), 0, tmp_path / "sound")
    late, sound = (
        np.loadtxt(tmp_path / name / "raw" / "robot.csv", delimiter=",", skiprows=1)
        for name in ("late", "sound")
    )
    speed = np.gradient(sound[:, 2], sound[:, 0])
    found = ((sound - late)[:, 2] * speed).sum() / (speed**2).sum()
    assert found == pytest.approx(0.02, rel=0.02)  # second order of the filter
    np.testing.assert_array_equal(late[:, 1], sound[:, 1])


@pytest.mark.slow
def test_a_machine_with_every_ordinary_error_is_identified_as_well_as_stated(
    tmp_path: Path,
) -> None:
    truth = record(Plan(1, duration=SHORT), tmp_path)[0]
    options = FitOptions(samples=600)
    found = identify(tmp_path / "1", tmp_path / "2", options=options).data.identification
    q = accuracy_box(files())
    error = aligned_distance(found.robot.identified.tool(q), truth.tool(q))
    assert found.verdict.acceptable
    assert error.mean() < 3.0 * found.robot.tcp_sigma.mean()

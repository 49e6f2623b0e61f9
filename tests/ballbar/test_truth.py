"""A result against the truth of its simulation: the true tool, true values and clocks."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import (
    Geometry,
    bar_frames,
    mirrored,
    nominal_chain,
    parameter_named,
    parameter_table,
    robot_frames,
)
from ballbar.cell.load import load_robot
from ballbar.ident.loads.gear_loads import mass_model, own_weight
from ballbar.sim.truth import PoseTruth, RippleTruth, Truth
from ballbar.truth import compare
from ballbar.truth.compare import (
    _of_followed,
    _true_values,
    compare_with_truth,
    identification_against_truth,
    reference_of,
    result_against_truth,
    true_tool,
)
from tests.helpers.simulated_recordings import Recorded

POSES = np.random.default_rng(3).uniform(-0.8, 0.8, (6, 6))


@pytest.fixture(scope="module")
def cell(recorded: Recorded) -> Cell:
    return recorded.simulation.cell


@pytest.fixture(scope="module")
def geometry(recorded: Recorded) -> Geometry:
    return recorded.simulation.truth.geometry


def truth(**given: Any) -> Truth:
    plant: dict[str, Any] = {
        "transmission_error": (), "gear_stiffness_N_m_per_rad": None, "typical": (),
        "masses": None, "gear_backlash_half_width_rad": np.zeros(6),
    }  # fmt: skip
    logs = {"resolvers": given.pop("resolvers", None), "tracker": None, "joint_lag_s": ()}
    plant |= given
    return cast(
        Truth, SimpleNamespace(plant=SimpleNamespace(**plant), logs=SimpleNamespace(**logs))
    )


def joints_of(cell: Cell, gears: Array) -> Array:
    return np.asarray(gears @ cell.robot.gear_to_joint)


def test_without_errors_the_true_tool_is_that_of_the_geometry(
    cell: Cell, geometry: Geometry
) -> None:
    tool = true_tool(cell, truth(), geometry, POSES)
    np.testing.assert_allclose(tool, robot_frames(geometry, POSES).tip.T, atol=1e-12)
    point = np.array([0.02, -0.01, 0.1])
    frames = robot_frames(geometry, POSES)
    expected = [frames.tip[:, k] + frames.rotation()[:, :, k] @ point for k in range(6)]
    np.testing.assert_allclose(
        true_tool(cell, truth(), geometry, POSES, point), expected, atol=1e-12
    )


def test_a_gears_ripple_is_one_of_the_angle_that_it_turns_its_output_to(
    cell: Cell, geometry: Geometry
) -> None:
    """The encoder shows the output's angle less its ripple."""
    ripple = RippleTruth(axis=2, cycles_per_turn=60.0, amplitude_rad=4e-4, phase_rad=0.3)
    output = POSES @ cell.robot.joint_to_gear
    shown = output.copy()
    shown[:, 1] -= 4e-4 * np.sin(60.0 * output[:, 1] + 0.3)
    q = joints_of(cell, shown)
    tool = true_tool(cell, truth(transmission_error=(ripple,)), geometry, q)
    np.testing.assert_allclose(tool, robot_frames(geometry, POSES).tip.T, atol=1e-9)


def test_a_resolvers_error_is_taken_off_what_the_motor_shows(
    cell: Cell, geometry: Geometry
) -> None:
    sine = SimpleNamespace(at=lambda angle: 1e-3 * np.sin(angle))
    cosine = SimpleNamespace(at=lambda angle: 5e-4 * np.cos(angle))
    motors = [()] * 6
    motors[0], motors[3] = (sine, cosine), (sine,)  # type: ignore[call-overload]
    resolvers = SimpleNamespace(motors=motors)
    shown = POSES @ np.linalg.inv(cell.robot.transmission)
    true = shown.copy()
    true[:, 0] -= 1e-3 * np.sin(shown[:, 0]) + 5e-4 * np.cos(shown[:, 0])
    true[:, 3] -= 1e-3 * np.sin(shown[:, 3])
    expected = robot_frames(geometry, true @ cell.robot.transmission).tip.T
    tool = true_tool(cell, truth(resolvers=resolvers), geometry, POSES)
    np.testing.assert_allclose(tool, expected, atol=1e-12)


def test_gears_give_way_under_the_arms_own_weight_and_lie_on_the_flank_it_presses_to(
    cell: Cell, geometry: Geometry
) -> None:
    stiffness, half = np.linspace(1e5, 6e5, 6), np.linspace(1e-4, 6e-4, 6)
    plant = {"gear_stiffness_N_m_per_rad": stiffness, "gear_backlash_half_width_rad": half}
    weight = own_weight(mass_model(cell), geometry, POSES).gear.T
    assert np.abs(weight).max() > 100.0
    undecided = np.array([3.0, 3.0, 3.0, 0.15, 0.15, 0.15])
    flank = np.where(np.abs(weight) < undecided, 0.0, np.sign(weight))
    gears = POSES @ cell.robot.joint_to_gear - weight / stiffness - half * flank
    expected = robot_frames(geometry, joints_of(cell, gears)).tip.T
    np.testing.assert_allclose(
        true_tool(cell, truth(**plant), geometry, POSES), expected, atol=1e-12
    )
    drawn = SimpleNamespace(on=lambda given: given)
    np.testing.assert_allclose(
        true_tool(cell, truth(**plant, masses=drawn), geometry, POSES), expected, atol=1e-12
    )


def test_the_directions_of_b2_and_b4_that_are_declared_are_the_references(
    geometry: Geometry,
) -> None:
    for directions, joints in (
        ({"b2": 1, "b4": 1}, ()),
        ({"b2": -1}, (2,)),
        ({"b2": -1, "b4": -1}, (2, 4)),
    ):
        expected = geometry
        for joint in joints:
            expected = mirrored(expected, joint)
        given = cast(Truth, SimpleNamespace(geometry=geometry, directions=directions))
        found = reference_of(given)
        b = np.random.default_rng(1).uniform(-1, 1, (3, 5))
        np.testing.assert_array_equal(bar_frames(found, b).tip, bar_frames(expected, b).tip)
    ignored = cast(Truth, SimpleNamespace(geometry=geometry, directions={"b1": -1}))
    assert reference_of(ignored) is geometry


@pytest.mark.parametrize("name", ["ur10", "irb2400"])
def test_the_first_of_parallel_axes_has_what_the_others_differ_by(name: str) -> None:
    """Axes 2, 3 and 4 of a UR are parallel: only the sum of their shifts can be seen."""
    robot = load_robot(name)
    nominal = nominal_chain(robot)
    shift = np.arange(1.0, 7.0) * 1e-3
    values = _true_values(replace(nominal, d=nominal.d + shift), robot)
    rows = [parameter_named(n).row for n in parameter_table(robot).hayati[:-1]]
    assert rows == ([1, 2] if name == "ur10" else [1])
    expected = nominal.d + shift
    expected[1] = nominal.d[1] + shift[1 : rows[-1] + 2].sum()
    for k in range(6):
        if (key := f"rd{k + 1}") in values:
            assert values[key] == (pytest.approx(expected[k]), 0.0)
    assert "rd2" in values
    assert values["ra2"] == (pytest.approx(nominal.a[1]), 0.0)


@cache
def an_estimate(clock: Clock | None) -> Any:
    return SimpleNamespace(clock=clock, geometry="own", nominal="nominal", sigma={"bd3": 1.0})


def test_a_recording_is_compared_with_its_own_part_and_its_own_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = list[Any]()
    monkeypatch.setattr(compare, "compare_with_truth", lambda *given: asked.append(given))
    monkeypatch.setattr(compare, "replace", lambda model, geometry: (model, geometry))
    robot = SimpleNamespace(identified="robot", sigma={"ra1": 1.0})
    recordings = [an_estimate(None), an_estimate(Clock(1.0, 2e-5))]
    result = cast(Any, SimpleNamespace(robot=robot, recordings=recordings))
    given = Truth.model_construct()
    identification_against_truth(result, given)
    identification_against_truth(result, given, 1)
    assert [clock for *_, clock in asked] == [None, (1.0, 2e-5)]
    assert asked[0][:4] == (("robot", "own"), "nominal", given, ["ra1", "bd3"])


def test_clock_errors_are_identified_minus_true(
    recorded: Recorded, geometry: Geometry, cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = list[Any]()
    monkeypatch.setattr(compare, "robot_comparison", lambda *given: asked.append(given))
    model = cast(Any, SimpleNamespace(cell=cell))
    true = recorded.simulation.truth.clock
    clock = true.offset_s + 3e-6, true.skew - 2e-7
    for stated in (clock, None):
        compare_with_truth(model, geometry, recorded.simulation.truth, ["ra1"], stated)
    assert asked[0][5] == pytest.approx((3e-6, -2e-7), abs=1e-12)
    assert asked[1][5] is None
    assert asked[0][4] == ["ra1"]


def test_a_followed_robots_clock_is_late_by_that_of_its_joints_too(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """offset - true offset - lag of the joints; the first clock that a table states."""
    tracker = SimpleNamespace(led_m=(0.0, 0.0, 0.1), offset_s=0.5, skew=1e-5)
    logs = SimpleNamespace(tracker=tracker, joint_lag_s=(0.004, 0.004))
    given = cast(Any, SimpleNamespace(logs=logs, geometry=recorded.simulation.truth.geometry))
    file = tmp_path / "rec.truth.yaml"
    described = SimpleNamespace(robot="irb2400", measured_by="mocap", plate=None)
    folders = list[Path]()

    def load(folder: Path) -> Any:
        folders.append(folder)
        return described

    monkeypatch.setattr(compare, "load_recording_file", load)
    monkeypatch.setattr(compare, "CellSettings", lambda **given: given)
    monkeypatch.setattr(compare, "scenario_cell", lambda chosen, **_: chosen)
    compared = SimpleNamespace()
    monkeypatch.setattr(compare, "_at_target", lambda *given: (compared, given))
    monkeypatch.setattr(compare, "replace", lambda whole, **changes: (whole, changes))
    groups = [
        SimpleNamespace(clock=None),
        SimpleNamespace(clock=SimpleNamespace(offset_s=0.51, skew=3e-5)),
    ]
    model = cast(
        Any, SimpleNamespace(file=SimpleNamespace(groups=groups), targets={"led": 0}, path="c")
    )
    (whole, (_, name, *_)), changes = cast(Any, _of_followed(given, model, file))
    assert whole is compared
    assert name == "led"
    assert changes["offset"] == pytest.approx(0.006)
    assert changes["skew"] == pytest.approx(2e-5)
    assert folders == [tmp_path / "rec"]
    still = cast(
        Any, SimpleNamespace(file=SimpleNamespace(groups=groups[:1]), targets={}, path="c")
    )
    with pytest.raises(InputError, match="is the truth of recordings, and c is of still poses"):
        _of_followed(given, still, file)


def test_a_result_of_logs_has_no_truth_of_still_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = PoseTruth.model_construct(targets={"ball": 0})
    monkeypatch.setattr(compare, "load_truth", lambda _: poses)
    of_logs = cast(Any, SimpleNamespace(of_logs=True, path="c"))
    with pytest.raises(InputError, match="t: is the truth of still poses, and c is of recordings"):
        result_against_truth(of_logs, Path("t"))
    other = cast(Any, SimpleNamespace(of_logs=False, targets={"led": 0}))
    with pytest.raises(InputError, match="target led is not in the truth, which has ball"):
        result_against_truth(other, Path("t"))


@pytest.mark.parametrize("clock", [None, SimpleNamespace(offset_s=0.1, skew=1e-5)])
def test_a_stored_result_is_compared_with_its_clock_where_it_has_one(
    clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = list[Any]()
    monkeypatch.setattr(compare, "compare_with_truth", lambda *given: asked.append(given))
    given = Truth.model_construct()
    monkeypatch.setattr(compare, "load_truth", lambda _: given)
    file = SimpleNamespace(logs=[SimpleNamespace(clock=clock)], identified=["ra1"])
    model = SimpleNamespace(
        of_logs=True, file=file, identified_robot=lambda: "robot", nominal="nominal"
    )
    result_against_truth(cast(Any, model), Path("t"))
    assert asked == [("robot", "nominal", given, ["ra1"], (0.1, 1e-5) if clock else None)]

"""Robots of 5 to 8 axes from files that state geometry and axis limits only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.closed_form import robot_branches
from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.geometry import (
    nominal_geometry,
    parameter_named,
    parameter_table,
    robot_frames,
    table_of_names,
)
from ballbar.cell.inverse import UnreachableError, refine
from ballbar.cell.load import load_ballbar, load_robot
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes, joints_to_motors
from tests.helpers.other_robots import FIVE_AXES, SEVEN_AXES, UR, Rows, cell_of, robot_text

SIX_AXES_BETAS = ("rbeta2", "rbeta6")


def refusal(folder: Path, text: str) -> str:
    path = folder / "wrong.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError) as error:
        load_robot(str(path))
    return str(error.value)


@pytest.mark.parametrize("rows", [FIVE_AXES, UR, SEVEN_AXES])
def test_a_robot_needs_only_its_dh_rows_and_axis_limits(tmp_path: Path, rows: Rows) -> None:
    robot = cell_of(tmp_path, rows).robot
    assert robot.joints == len(rows)
    assert np.array_equal(robot.transmission, np.eye(len(rows)))
    assert np.array_equal(robot.controller_to_joint, np.eye(len(rows)))
    assert not robot.controller_offset.any()
    assert np.isinf(robot.axis_speed_max).all()
    # 60 % of 720 deg would be 216 deg to either side
    np.testing.assert_allclose(np.degrees(robot.accuracy_upper), 120.0)
    np.testing.assert_allclose(np.degrees(robot.accuracy_lower), -120.0)
    assert robot.gravity.tolist() == [0.0, 0.0, -9.81]
    assert (robot.links, robot.gears, robot.servo, robot.armature) == (None, None, None, None)
    angles = np.linspace(-1.0, 1.0, 3 * len(rows)).reshape(3, -1)
    assert np.array_equal(joints_to_axes(robot, controller_to_joints(robot, angles)), angles)
    with pytest.raises(ValueError, match=rf"expected \(N, {len(rows)}\)"):
        joints_to_motors(robot, np.zeros((2, 9)))


def test_the_accuracy_box_is_the_middle_of_a_narrow_axis_range(tmp_path: Path) -> None:
    path = tmp_path / "narrow.yaml"
    text = robot_text(UR).replace("axis_lower_deg: [-360,", "axis_lower_deg: [160,")
    path.write_text(
        text + "controller_to_joint: identity\nmotor_to_joint: identity\n", encoding="utf-8"
    )
    robot = load_robot(str(path))
    box = np.degrees([robot.accuracy_lower[0], robot.accuracy_upper[0]])
    np.testing.assert_allclose(box, [200.0, 320.0])


def test_parallel_axes_have_a_hayati_angle_each_and_share_their_d(tmp_path: Path) -> None:
    """The second to fourth axis of a UR are parallel; no two of the seven-axis robot are."""
    ur = parameter_table(cell_of(tmp_path, UR).robot)
    assert ur.hayati == ("rbeta2", "rbeta3", "rbeta6")
    assert ur.gauge == ("rd1", "rtheta1", "rd3", "rd4")
    assert (ur.plate, len(ur.names)) == ("ra6", 24 + 3 + 20 + 5)
    seven = parameter_table(cell_of(tmp_path, SEVEN_AXES).robot)
    assert (seven.hayati, seven.gauge) == (("rbeta7",), ("rd1", "rtheta1"))
    assert (seven.plate, len(seven.names)) == ("ra7", 28 + 1 + 20 + 5)


@pytest.mark.parametrize("name", ["irb2400", "nj220"])
def test_the_table_of_the_shipped_robots_is_that_of_the_thesis(name: str) -> None:
    table = parameter_table(load_robot(name))
    kinds = ("a", "d", "alpha", "theta")
    assert table.names == (
        *(f"r{kind}{row}" for kind in kinds for row in range(1, 7)),
        *SIX_AXES_BETAS,
        *(f"b{kind}{row}" for kind in kinds for row in range(1, 6)),
        *("ox", "oy", "oz", "otx", "oty"),
    )
    assert (table.gauge, table.plate) == (("rd1", "rtheta1", "rd3"), "ra6")


def test_a_table_is_known_by_its_names_in_any_order(tmp_path: Path) -> None:
    table = parameter_table(cell_of(tmp_path, UR).robot)
    assert table_of_names(reversed(table.names)) == table
    assert [parameter_named(name) for name in table.names] == list(table.parameters)
    with pytest.raises(KeyError, match="rgamma1"):
        parameter_named("rgamma1")


def test_the_plate_adds_to_the_last_row(tmp_path: Path) -> None:
    cell = cell_of(tmp_path, SEVEN_AXES)
    chain = nominal_geometry(cell, np.zeros(3)).robot
    assert chain.rows == 7
    assert chain.a[6] == pytest.approx(cell.plate.length)
    assert chain.d[6] == pytest.approx(0.126 + cell.plate.tool_offset)


def test_newton_brings_seven_joints_to_a_pose_and_five_only_where_they_can(tmp_path: Path) -> None:
    seven = nominal_geometry(cell_of(tmp_path, SEVEN_AXES), np.zeros(3))
    frames = [np.radians([[10.0, 30.0, 20.0, -80.0, 15.0, 60.0, turn]]) for turn in (20.0, 25.0)]
    poses = robot_frames(seven, frames[1]).poses()
    q = refine(seven.robot, frames[0], poses)
    np.testing.assert_allclose(robot_frames(seven, q).poses(), poses, atol=1e-12)
    five = nominal_geometry(cell_of(tmp_path, FIVE_AXES), np.zeros(3))
    start = np.radians([[10.0, 20.0, 60.0, 40.0, 15.0]])
    reached = robot_frames(five, start + 0.05).poses()
    np.testing.assert_allclose(refine(five.robot, start, reached), start + 0.05, atol=1e-9)
    reached[0, 0, 3] += 1e-3
    with pytest.raises(UnreachableError, match=r"pose 0 of 1 .* is not reached"):
        refine(five.robot, start, reached)
    with pytest.raises(InputError, match="six axes with parallel axes 2 and 3"):
        robot_branches(five.robot, reached)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "axis_upper_deg: [360, 360, 360, 360, 360, 360]",
            "axis_upper_deg: [360, 360, 360, 360, 360]",
            "axis_upper_deg: found 5 values, expected 6, one for each row of dh.",
        ),
        (
            "title:",
            "motor_to_joint: [[1, 0], [0, 1]]\ntitle:",
            "motor_to_joint: found 2 values, expected 6, one for each row of dh.",
        ),
        (
            "title:",
            "rotor_inertia_kg_m2: [1, 1, 1]\ntitle:",
            "rotor_inertia_kg_m2: found 3 values, expected 6, one for each row of dh.",
        ),
        (
            "title:",
            "servo: {soft: {kp_N_m_per_rad: [1], kv_N_m_s_per_rad: [1, 1, 1, 1, 1, 1]}}\ntitle:",
            "servo.soft.kp_N_m_per_rad: found 1 values, expected 6, one for each row of dh.",
        ),
        (
            "title:",
            "links: {base: {mass_kg: 1, com_m: [0, 0, 0], inertia_kg_m2: [1, 1, 1, 0, 0, 0]}}\n"
            "title:",
            "links: found base; expected base, link1, link2, link3, link4, link5, link6.",
        ),
        (
            "  - {a_m: 0.0, d_m: 0.1333, alpha_deg: 90, theta_deg: 0}\n"
            "  - {a_m: 0.0, d_m: 0.0997, alpha_deg: -90, theta_deg: 0}\n",
            "",
            "dh: expected at least 5 items, found 4.",
        ),
    ],
)
def test_lists_have_as_many_entries_as_there_are_axes(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = robot_text(UR)
    assert text.count(old) == 1
    assert message in refusal(tmp_path, text.replace(old, new))


def test_a_wrong_row_of_dh_is_counted(tmp_path: Path) -> None:
    """The row without theta counted as none: "found 0"."""
    text = robot_text(UR)
    rows = [line for line in text.splitlines() if line.startswith("  - {a_m")]
    text = text.replace("\n".join(rows), rows[0].partition(", theta")[0] + "}")
    message = refusal(tmp_path, text)
    assert "dh: expected at least 5 items, found 1." in message
    assert "dh[0].theta_deg is missing. Add yours to dh[0]; irb2400 has `theta_deg: 0`." in message


def test_what_is_missing_is_shown_by_an_example_and_may_be_optional(tmp_path: Path) -> None:
    message = refusal(tmp_path, robot_text(UR).replace("title:", "gears: {}\ntitle:"))
    assert (
        "gears.lost_motion_rad is missing. Add yours to gears; irb2400 has `lost_motion_rad: "
        "[0.00012, 0.00012, 0.00012, 0.00018, 0.00018, 0.00024]`. Or leave out gears, which is "
        "optional."
    ) in message
    assert "irb2400 has `transmission_error: [{axes: [1, 2, 3], cycles" in message


def test_an_empty_ballbar_file_is_answered_with_the_shape_of_each_key(tmp_path: Path) -> None:
    (tmp_path / "bar.yaml").write_text("schema: ballbar-bar/1\n")
    with pytest.raises(DescriptionError) as refused:
        load_ballbar("bar.yaml", relative_to=tmp_path)
    lines = str(refused.value).splitlines()
    assert len(lines) == 10
    assert all("; lund_600 has `" in line for line in lines)
    assert any("`encoder: {lines: 3600, bits: 12, noise_sigma_rad: 2e-06}`" in s for s in lines)


@pytest.mark.parametrize("key", ["links", "servo", "gears", "rotor_inertia_kg_m2"])
def test_what_a_file_does_not_state_is_asked_for_by_its_key(tmp_path: Path, key: str) -> None:
    robot = cell_of(tmp_path, UR).robot
    assert robot.lacks(key)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=f"robot other has no `{key}`.*kind: kinematic"):
        robot.required(key)  # type: ignore[call-overload]
    assert not load_robot("irb2400").lacks(key)  # type: ignore[arg-type]

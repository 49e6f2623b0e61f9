"""Robots, ball-bars and plates: shipped numbers against independent computations, and refusals."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbar.cell.chain import Chain, Frames, forward
from ballbar.cell.descriptions import BallBar, Robot
from ballbar.cell.errors import DescriptionError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.instruments.plane import TouchedPlane
from ballbar.cell.load import (
    ballbar_names,
    instrument_names,
    load_ballbar,
    load_cell,
    load_instrument,
    load_plate,
    load_robot,
    plate_names,
    robot_names,
)
from ballbar.cell.robot_angles import (
    controller_to_joints,
    gear_to_axis_torques,
    joints_to_axes,
    joints_to_motors,
    motors_to_joints,
)

Array = NDArray[np.float64]

SHIPPED = Path(__file__).parents[2] / "cell"
ROBOTS = ("irb2400", "nj220")

# CNR-STIIMA-IRAS/comau-experimental, comau_nj220foundry.urdf: joint origins (xyz, and rpy in right
# angles), each joint about z.
NJ220_URDF_JOINTS = [
    ((0.0, 0.0, 0.235), (2, 0, 2)),
    ((-0.4, 0.0, -0.595), (-1, 1, 0)),
    ((1.175, 0.0, 0.0), (-2, 0, 1)),
    ((-0.25, 0.105, 0.0), (1, 1, 0)),
    ((0.0, 0.0, -1.0203), (1, 0, 1)),
    ((0.0, -0.1905, 0.0), (-1, -1, 0)),
    ((0.0, 0.0, -0.0395), (2, 0, -1)),  # flange
]
# The same file, base and links 1-6 in their own frames: mass, com, inertia xx yy zz xy xz yz.
NJ220_URDF_LINKS = [
    (780.97, (-0.0358, 0.0, 0.1332), (25.7894, 33.6476, 48.0778, 0.0024, -0.0077, 0.0)),
    (420.57, (-0.3140, 0.0254, -0.4740), (35.7818, 30.9723, 34.6744, 0.5202, 10.0054, 0.1602)),
    (120.35, (0.5138, 0.0184, -0.0033), (2.2176, 21.9600, 21.6711, 0.1083, -0.4664, -0.0016)),
    (303.81, (-0.2104, -0.0424, -0.0194), (8.3559, 10.8913, 6.7235, -0.2441, 1.1650, 0.3306)),
    (90.96, (-0.0257, 0.0, -0.7123), (11.9712, 12.0896, 0.6293, 0.0002, 0.7290, -0.0002)),
    (50.62, (0.0, -0.0938, 0.0151), (0.8659, 0.6683, 0.3874, 0.0, -0.0001, 0.0264)),
    (5.34, (-0.0006, 0.0001, -0.0239), (0.01515, 0.01500, 0.02913, 0.0, 0.0, 0.0)),
]
NJ220_MASS_SCALE = 0.688  # machine 1220 kg over 1772.6 kg of the URDF


def flange_frames(robot: Robot, q: Array) -> Frames:
    return forward(Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(6)), q)


def turn(axis: int, quarters: float) -> Array:
    """Rotation by right angles about x, y or z."""
    c, s = np.cos(quarters * np.pi / 2.0), np.sin(quarters * np.pi / 2.0)
    rotation = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return rotation


def nj220_urdf_frames(quarters: tuple[float, ...]) -> tuple[list[Array], list[Array]]:
    """Rotations and origins of base, links 1-6 and flange in the URDF; angles in right angles."""
    rotations, origins = [np.eye(3)], [np.zeros(3)]
    for (xyz, (roll, pitch, yaw)), angle in zip(NJ220_URDF_JOINTS, (*quarters, 0.0), strict=True):
        origins.append(origins[-1] + rotations[-1] @ xyz)
        rotations.append(
            rotations[-1] @ turn(2, yaw) @ turn(1, pitch) @ turn(0, roll) @ turn(2, angle)
        )
    return rotations, origins


def changed(folder: Path, source: str, old: str, new: str) -> Path:
    """A copy of a shipped file with one passage replaced."""
    text = (SHIPPED / source).read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {source}"
    path = folder / "mine.yaml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    load = {
        "robot": load_robot,
        "bar": load_ballbar,
        "plate": load_plate,
        "instrument": load_instrument,
    }
    kind = path.read_text(encoding="utf-8").split("schema: ballbar-")[1].split("/")[0]
    with pytest.raises(DescriptionError, match=re.escape(str(path))) as caught:
        load[kind](str(path))
    return str(caught.value).replace(str(path), "mine.yaml")


def test_every_shipped_description_loads_under_its_own_name() -> None:
    assert {"irb2400", "nj220", "panda", "ur5"} < set(robot_names())
    assert ballbar_names() == ["lund_1200", "lund_600", "lund_900"]
    assert plate_names() == ["plate_250", "plate_250_thin"]
    assert [load_robot(name).name for name in robot_names()] == robot_names()
    assert [load_ballbar(name).name for name in ballbar_names()] == ballbar_names()


def test_the_irb2400_at_zero_holds_its_flange_where_the_data_sheet_draws_it() -> None:
    robot = load_robot("irb2400")
    frames = flange_frames(robot, np.zeros((1, 6)))
    # Upper arm straight up, forearm straight forward: x = a1 + d4 + d6, z = d1 + a2 + a3.
    np.testing.assert_allclose(
        frames.tip[:, 0], [0.100 + 0.755 + 0.085, 0.0, 0.615 + 0.705 + 0.135], atol=1e-15
    )
    np.testing.assert_allclose(frames.tip[:, 0], [0.940, 0.0, 1.455], atol=1e-15)
    np.testing.assert_allclose(frames.z[6, :, 0], [1.0, 0.0, 0.0], atol=1e-15)


def test_the_nj220_at_zero_reaches_the_sum_of_its_lengths() -> None:
    frames = flange_frames(load_robot("nj220"), np.zeros((1, 6)))
    np.testing.assert_allclose(
        frames.tip[:, 0], [0.400 + 1.125 + 0.230, 0.0, 0.830 + 1.175 + 0.250], atol=1e-15
    )


def test_the_irb2400_transmission_is_the_matrix_of_the_thesis() -> None:
    robot = load_robot("irb2400")
    np.testing.assert_allclose(
        np.abs(1.0 / np.diag(robot.transmission)),
        [129.6, 129.99, 129.6, 55.0, 55.2, 44.0],
        rtol=1e-15,
    )
    one_turn_each = motors_to_joints(robot, np.full(6, 1.0))
    main = [-5 / 648, 100 / 12999, -100 / 12999 - 5 / 648]
    expected = [*main, -1 / 55, -1 / 759 - 5 / 276, -62 / 41745 - 5 / 552 - 1 / 44]
    np.testing.assert_allclose(one_turn_each, expected, rtol=1e-15)


@pytest.mark.parametrize("name", ROBOTS)
def test_motor_and_axis_angles_lead_to_joint_angles_and_back(name: str) -> None:
    robot = load_robot(name)
    q = np.random.default_rng(1).uniform(-3.0, 3.0, (50, 6))
    # Rounding of the inverse.
    np.testing.assert_allclose(motors_to_joints(robot, joints_to_motors(robot, q)), q, atol=1e-14)
    np.testing.assert_allclose(controller_to_joints(robot, joints_to_axes(robot, q)), q, atol=1e-14)


@pytest.mark.parametrize("name", ROBOTS)
def test_axis_3_follows_motor_3_alone_because_of_the_parallel_rod(name: str) -> None:
    robot = load_robot(name)
    axes_per_motor = robot.transmission @ robot.joint_to_axis
    assert np.abs(np.delete(axes_per_motor[:, 2], 2)).max() < 1e-17
    assert np.abs(robot.transmission[1, 2]) > 1e-3  # while joint 3 does follow motor 2


@pytest.mark.parametrize("name", ROBOTS)
def test_axis_3_is_the_angle_of_the_forearm_against_the_horizontal(name: str) -> None:
    robot = load_robot(name)
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 6)) * [0, 1, 1, 0, 0, 0]
    forearm = flange_frames(robot, q).z[3]
    below = np.arctan2(-forearm[2], forearm[0])
    direction = robot.controller_to_joint[2, 2]
    np.testing.assert_allclose(direction * joints_to_axes(robot, q)[:, 2], below, atol=1e-14)


def test_the_nj220_logged_angles_map_as_the_thesis_prints() -> None:
    logged = np.deg2rad([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    l1, l2, l3, l4, l5, l6 = logged
    np.testing.assert_allclose(
        controller_to_joints(load_robot("nj220"), logged),
        [-l1, l2, -l3 - l2, -l4, l5, -l6],
        atol=1e-15,
    )


def test_the_nj220_transmission_is_gear_ratios_times_the_map_of_its_axes() -> None:
    robot = load_robot("nj220")
    ratios = np.diag(1.0 / np.array([180.0, 180.0, 180.0, 160.0, 160.0, 110.0]))
    np.testing.assert_allclose(robot.transmission, ratios @ robot.controller_to_joint, atol=1e-18)


def test_angles_without_six_columns_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"angles have shape \(3, 5\), expected \(N, 6\) or \(6,\)"
    ):
        motors_to_joints(load_robot("irb2400"), np.zeros((3, 5)))


def test_the_urdf_of_the_nj220_and_our_dh_rows_are_the_same_machine() -> None:
    rotations, origins = nj220_urdf_frames((0, 0, -1, 0, 0, 0))
    robot = load_robot("nj220")
    ours = flange_frames(robot, np.zeros((1, 6)))
    # The URDF has 0.105 + 1.0203 m for 1.125 m.
    np.testing.assert_allclose(origins[7], ours.tip[:, 0], atol=3.1e-4)
    # Thesis App. A: sign of each logged angle against the DH angle.
    directions = [-1.0, 1.0, -1.0, -1.0, 1.0, -1.0]
    for joint, direction in enumerate(directions):
        axis = rotations[joint + 1][:, 2]
        np.testing.assert_allclose(direction * axis, ours.z[joint, :, 0], atol=1e-15)
        apart = np.cross(origins[joint + 1] - ours.origin[joint, :, 0], axis)
        assert np.linalg.norm(apart) < 3.1e-4  # the two axes are one line
    np.testing.assert_allclose(np.diag(robot.controller_to_joint), directions)


def test_the_nj220_mass_properties_are_those_of_the_urdf_seen_from_the_base() -> None:
    rotations, origins = nj220_urdf_frames((0, 0, -1, 0, 0, 0))
    links = load_robot("nj220").links
    for link, rotation, origin, (mass, com, (xx, yy, zz, xy, xz, yz)) in zip(
        links, rotations[:7], origins[:7], NJ220_URDF_LINKS, strict=True
    ):
        inertia = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
        # Our file is rounded to 0.01 kg, 0.1 mm and 1e-4 kg m^2.
        assert link.mass == pytest.approx(NJ220_MASS_SCALE * mass, abs=0.0051)
        np.testing.assert_allclose(link.com, origin + rotation @ com, atol=5.1e-5)
        np.testing.assert_allclose(link.inertia, NJ220_MASS_SCALE * inertia, atol=5.1e-5)


@pytest.mark.parametrize(
    ("name", "total", "within"), [("irb2400", 380.0, 0.35), ("nj220", 1220.0, 0.50)]
)
def test_the_links_weigh_what_the_machine_weighs_and_lie_near_their_joints(
    name: str, total: float, within: float
) -> None:
    robot = load_robot(name)
    assert sum(link.mass for link in robot.links) == pytest.approx(total, rel=1e-3)
    origins = flange_frames(robot, np.zeros((1, 6))).origin[:, :, 0]
    for i, link in enumerate(robot.links[1:]):  # link i + 1 reaches from joint origin i to i + 1
        start, span = origins[i], origins[i + 1] - origins[i]
        along = (
            0.0 if not span.any() else np.clip((link.com - start) @ span / (span @ span), 0.0, 1.0)
        )
        assert np.linalg.norm(link.com - start - along * span) < within


@pytest.mark.parametrize("name", ROBOTS)
def test_every_inertia_is_that_of_a_real_body(name: str) -> None:
    for described in (load_robot(name), load_ballbar("lund_600")):
        for link in described.links:
            moments = np.linalg.eigvalsh(link.inertia)
            assert moments[0] > 0.0
            assert moments[2] <= moments[0] + moments[1]


def test_the_nj220_servo_is_that_of_the_irb2400_scaled_by_gear_stiffness() -> None:
    nj220, irb2400 = load_robot("nj220"), load_robot("irb2400")
    soft = np.array([6.0e5, 6.0e5, 4.5e5, 6.0e4, 5.0e4, 3.5e4])
    stiffer = np.array([2.5e6, 3.0e6, 2.4e6, 4.0e5, 3.5e5, 4.0e5]) / soft
    for name in ("soft", "stiff"):
        ours, smaller = nj220.servo[name], irb2400.servo[name]
        np.testing.assert_allclose(ours.kp, stiffer * smaller.kp, rtol=1e-4)  # printed digits
        np.testing.assert_allclose(ours.kv, stiffer * smaller.kv, rtol=1e-3)


def test_the_armature_is_the_rotor_inertia_seen_through_the_gear() -> None:
    # 1.3e-3 kg m^2 times 129.6^2, and so on, to the printed digits.
    expected = [21.8, 22.0, 21.8, 0.48, 0.55, 0.19]
    np.testing.assert_allclose(load_robot("irb2400").armature, expected, rtol=0.02)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_accuracy_box_lies_within_the_limits_and_above_the_floor(name: str) -> None:
    robot = load_robot(name)
    plate = load_plate("plate_250")
    axes = np.random.default_rng(3).uniform(robot.accuracy_lower, robot.accuracy_upper, (2000, 6))
    assert (axes >= robot.axis_lower).all()
    assert (axes <= robot.axis_upper).all()
    a, d = robot.a.copy(), robot.d.copy()
    a[5] += plate.length
    d[5] += plate.tool_offset
    tip = forward(
        Chain(a, d, robot.alpha, robot.theta, np.zeros(6)), controller_to_joints(robot, axes)
    ).tip
    assert (tip[2] > 0.0).mean() > 0.99
    assert (tip[0] > 0.0).mean() > 0.98


def test_rod_and_joints_of_a_ballbar_give_way_by_what_the_thesis_calculated_for_150_newtons() -> (
    None
):
    """Sec. 5.3: 2.7 um, 2.8 um a joint, 8.3 um in all; tubes are as stiff as they are short."""
    bar = load_ballbar("lund_600")
    gimbal, universal_joint = (150.0 / stiffness for stiffness in bar.joint_stiffness)
    assert 150.0 / bar.rod_stiffness == pytest.approx(2.7e-6, rel=2e-3)
    assert (gimbal, universal_joint) == pytest.approx((2.8e-6, 2.8e-6), rel=2e-3)
    assert 150.0 / bar.axial_stiffness == pytest.approx(8.3e-6, rel=2e-3)
    assert bar.backlash == sum(bar.joint_backlash) == 5e-6
    for name, tube in (("lund_900", 0.8), ("lund_1200", 1.1)):
        longer = load_ballbar(name)
        assert longer.rod_stiffness * tube == pytest.approx(bar.rod_stiffness * 0.5, rel=2e-3)
        assert longer.joint_stiffness == bar.joint_stiffness


@pytest.mark.parametrize(
    ("name", "length"), [("lund_600", 0.6), ("lund_900", 0.9), ("lund_1200", 1.2)]
)
def test_a_ball_bar_at_zero_stands_straight_up_with_its_rod_within(
    name: str, length: float
) -> None:
    bar = load_ballbar(name)
    tip = forward(Chain(bar.a, bar.d, bar.alpha, bar.theta, np.zeros(5)), np.zeros((1, 5))).tip[
        :, 0
    ]
    np.testing.assert_allclose(tip, [0.0, 0.0, length], atol=1e-15)
    assert bar.length == length
    tube = length - 0.1  # [m] between the fittings
    assert bar.links[2].mass == pytest.approx(0.35 * tube + 2 * 0.10, abs=1e-9)
    across = 0.35 * tube**3 / 12.0 + 2 * 0.10 * (length / 2.0 - 0.05) ** 2
    # Five printed decimals.
    np.testing.assert_allclose(np.diag(bar.links[2].inertia)[:2], across, atol=5e-6)
    np.testing.assert_allclose(bar.links[2].com, [0.0, 0.0, length / 2.0])


def test_descriptions_cannot_be_changed_in_place() -> None:
    cell = load_cell("irb2400", "lund_600", "plate_250")
    assert (cell.plate.length, cell.plate.length_sigma, cell.plate.mass) == (0.250, 5e-6, 4.3)
    for values in (
        cell.robot.a,
        cell.robot.links[1].inertia,
        cell.robot.servo["soft"].kp,
        cell.ballbar.alpha,
        cell.plate.body.com,
    ):
        assert values.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


def test_a_description_of_the_wrong_shape_is_refused() -> None:
    bar = load_ballbar("lund_600")
    with pytest.raises(
        ValueError, match=r"BallBar.a: expected finite numbers of shape \(5,\), got shape \(6,\)"
    ):
        BallBar(**{**vars(bar), "a": np.zeros(6)})


def test_an_unknown_name_lists_the_shipped_ones_and_the_nearest() -> None:
    with pytest.raises(
        DescriptionError,
        match=r"unknown robot 'irb240'. Did you mean irb2400\? Valid names: .*irb2400, .*nj220, .*"
        "ur5e. A file of your",
    ):
        load_robot("irb240")
    with pytest.raises(DescriptionError, match=r"unknown instrument '../instruments/lund_600'"):
        load_ballbar("../instruments/lund_600")


def test_ballbars_and_other_instruments_share_a_folder_and_are_told_apart_by_schema(
    tmp_path: Path,
) -> None:
    assert not set(ballbar_names()) & set(instrument_names())
    assert {"qc20w_300", "tracker_point"} < set(instrument_names())
    with pytest.raises(
        DescriptionError,
        match=r"tracker_point is another instrument \(ballbar-instrument/1\); expected a ball-bar "
        r"with encoders \(ballbar-bar/1\): lund_1200, lund_600, lund_900, or a file of your own",
    ):
        load_ballbar("tracker_point")
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        (SHIPPED / "instruments/lund_600.yaml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    assert load_ballbar("mine.yaml", relative_to=tmp_path).length == load_ballbar("lund_600").length
    for name in ("lund_600", str(mine)):
        with pytest.raises(
            DescriptionError,
            match=rf"is a ball-bar with encoders.*: {', '.join(instrument_names())}",
        ):
            load_instrument(name)
    with pytest.raises(DescriptionError, match=r"Did you mean lund_600\? Valid names: lund_1200"):
        load_ballbar("lund_60")


def test_a_path_is_taken_from_the_folder_of_the_file_that_names_it(tmp_path: Path) -> None:
    changed(tmp_path, "plates/plate_250.yaml", "length_m: 0.250", "length_m: 0.260")
    plate = load_plate("mine.yaml", relative_to=tmp_path)
    assert (plate.name, plate.length) == ("mine", 0.260)


@pytest.mark.parametrize(
    ("source", "old", "new", "message"),
    [
        (
            "robots/irb2400.yaml",
            "a_m: 0.100, d_m: 0.615",
            "a_m: 100, d_m: 0.615",
            "dh[0].a_m = 100: longer than 5 m. Lengths are metres: for 100 mm write 0.1.",
        ),
        (
            "robots/irb2400.yaml",
            "d_m: 0.615, alpha_deg: -90",
            "d_m: 0.615, alpha_deg: -1.5708",
            "dh[0].alpha_deg = -1.5708: looks like radians. Angles here are degrees: "
            "-1.5708 rad is -90.0002 deg.",
        ),
        (
            "robots/irb2400.yaml",
            "  - {a_m: 0.0, d_m: 0.085, alpha_deg: 0, theta_deg: 0}\n",
            "",
            "motor_to_joint: found 6 values, expected 5, one for each row of dh.",
        ),
        (
            "robots/irb2400.yaml",
            '[0, 0, "-5/648", 0, 0, 0]',
            '[0, 0, "-5/0", 0, 0, 0]',
            "motor_to_joint[2][2] = '-5/0': a fraction cannot have denominator 0.",
        ),
        (
            "robots/irb2400.yaml",
            '[0, 0, "-5/648", 0, 0, 0]',
            '[0, 0, "2**9", 0, 0, 0]',
            "motor_to_joint[2][2] = '2**9': expected a number, without quotes or unit.",
        ),
        (
            "robots/irb2400.yaml",
            '[0, 0, "-5/648", 0, 0, 0]',
            "[0, 0, 0, 0, 0, 0]",
            "motor_to_joint[2][2] = 0: the ratio of an axis to itself cannot be 0.",
        ),
        (
            "robots/irb2400.yaml",
            "axis_upper_deg: [180, 110,",
            "axis_upper_deg: [180, -110,",
            "axis_upper_deg[1] = -110: expected more than the lower limit -100.",
        ),
        (
            "robots/irb2400.yaml",
            "accuracy_upper_deg: [60,",
            "accuracy_upper_deg: [200,",
            "accuracy_upper_deg[0] = 200: expected a value above -60 and up to the axis limit 180.",
        ),
        (
            "robots/irb2400.yaml",
            "mass_kg: 192.0",
            "mass_kg: 0",
            "links.link1.mass_kg = 0: expected more than 0.",
        ),
        (
            "robots/irb2400.yaml",
            "[9.82, 6.16, 8.30, 0, 0, 0]",
            "[9.82, 6.16, 8.30, 9, 0, 0]",
            "links.link1.inertia_kg_m2: principal moments -1.194, 8.3, 17.17 kg m^2 "
            "must all be positive.",
        ),
        (
            "robots/irb2400.yaml",
            "[9.82, 6.16, 8.30, 0, 0, 0]",
            "[98.2, 6.16, 8.30, 0, 0, 0]",
            "links.link1.inertia_kg_m2: principal moments 6.16, 8.3, 98.2 kg m^2: "
            "the largest exceeds the sum of the others.",
        ),
        (
            "robots/irb2400.yaml",
            "axis_speed_max_deg_per_s",
            "axis_speed_max_rad_per_s",
            "unknown key axis_speed_max_rad_per_s. Did you mean axis_speed_max_deg_per_s? "
            "Valid keys: accuracy_lower_deg,",
        ),
        (
            "instruments/lund_600.yaml",
            "d_m: 0.600",
            "d_m: 0.0",
            "dh[2].d_m = 0.0: expected the length of the rod, more than 0.",
        ),
        (
            "instruments/lund_600.yaml",
            "bits: 12",
            "bits: 14",
            "encoder.bits = 14: expected 13 or less.",
        ),
        (
            "plates/plate_250.yaml",
            "length_m: 0.250  #",
            "length_m: 250  #",
            "length_m = 250: longer than 5 m. Lengths are metres",
        ),
        *(
            ("plates/plate_250.yaml", "length_m: 0.250  #", f"length_m: {wrong}  #", said)
            for wrong, said in (
                ("0.0", "length_m = 0.0: expected more than 0"),
                ("-0.25", "length_m = -0.25: expected more than 0"),
            )
        ),
        (
            "instruments/dial_gauge.yaml",
            ", sigma_m: 3.0e-6",
            "",
            "chain[2]: sigma_m of this sensed prismatic joint is 0 or missing; state the standard "
            "deviation of what it reads.",
        ),
        (
            "instruments/tracker_pose.yaml",
            "sensed: true, sigma_rad: 9.0e-5",
            "sensed: true, sigma_rad: 0.0",
            "chain[3]: sigma_rad of this sensed ball joint is 0 or missing",
        ),
    ],
)
def test_a_wrong_number_is_refused_with_its_line_key_and_value(
    tmp_path: Path, source: str, old: str, new: str, message: str
) -> None:
    text = (SHIPPED / source).read_text(encoding="utf-8")
    path = changed(tmp_path, source, old, new)
    wrong = old
    if "row of dh" in message:  # one was cut out
        text, wrong = path.read_text(encoding="utf-8"), "motor_to_joint:"
    line = text[: text.index(wrong)].count("\n") + 1
    sentences = refusal(path).split("\n")
    assert any(s.startswith(f"mine.yaml:{line}: {message}") for s in sentences), sentences


_HEAD = "schema: ballbar-instrument/1\ntitle: Machine\nchain:\n"
_LENGTH = "  - {joint: prismatic, sensed: true, nominal_m: 0.5, lower_m: 0.1, upper_m: 1.0"


@pytest.mark.parametrize("key", ["lower_m: 0.1", "upper_m: 1.0", "sigma_m: 1e-5"])
def test_sensed_lengths_of_one_chain_share_range_and_noise(tmp_path: Path, key: str) -> None:
    joints = [f"{_LENGTH}, sigma_m: 1e-5}}"] * 3
    path = tmp_path / "mine.yaml"

    def load() -> Instrument:
        path.write_text(_HEAD + "\n".join([*joints, "  - {joint: ball}", ""]), encoding="utf-8")
        return load_instrument(str(path))

    machine = load()
    assert (machine.lower, machine.upper, machine.sigma_length) == (0.1, 1.0, 1e-5)
    joints[1] = joints[1].replace(key, key.partition(":")[0] + ": 0.2")
    with pytest.raises(
        DescriptionError, match=rf":5: chain\[1\]: {key[:7]}.* differs from"
    ) as said:
        load()
    assert "give each the same" in str(said.value)


def test_the_noise_of_a_direction_is_the_larger_of_both_angles(tmp_path: Path) -> None:
    pair = "instruments/theodolite_pair.yaml"
    for angle in ("azimuth", "elevation"):
        path = changed(tmp_path, pair, f"1.0e-5}}  # {angle}", f"3.0e-5}}  # {angle}")
        assert load_instrument(str(path)).sigma_direction == 3e-5


def test_range_and_noise_are_those_of_the_sensed_length_wherever_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slide = "  - {joint: prismatic, nominal_m: 0.4, lower_m: 0.0, upper_m: 0.8}\n"
    chains = (("prismatic*", "prismatic", "prismatic", "ball"),)
    monkeypatch.setattr(TouchedPlane, "chains", chains)
    joints = f"{_LENGTH}, sigma_m: 1e-5}}\n{slide}{slide}  - {{joint: ball}}\n"
    path = tmp_path / "mine.yaml"
    path.write_text(f"{_HEAD}{joints}", encoding="utf-8")
    gauge = load_instrument(str(path))
    assert (gauge.lower, gauge.upper, gauge.sigma_length) == (0.1, 1.0, 1e-5)


def test_a_file_of_another_kind_is_recognised_by_its_schema(tmp_path: Path) -> None:
    path = tmp_path / "bar.yaml"
    path.write_text(
        (SHIPPED / "instruments/lund_600.yaml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    with pytest.raises(
        DescriptionError, match=r"bar\.yaml:3: schema = 'ballbar-bar/1': expected 'ballbar-plate/1'"
    ):
        load_plate(str(path))


@pytest.mark.parametrize("name", robot_names())
def test_a_torque_on_the_arm_side_does_the_motors_work(name: str) -> None:
    """Each motor turned alone: its axis passes on the power that it exerts."""
    robot = load_robot(name)
    motors = np.diag(np.random.default_rng(5).normal(0.0, 1.0, robot.joints))
    at_motor = np.random.default_rng(6).normal(0.0, 3.0, robot.joints)
    at_axis = gear_to_axis_torques(robot, at_motor / np.diag(robot.transmission))
    axes = motors_to_joints(robot, motors) @ robot.joint_to_axis
    np.testing.assert_allclose(at_axis * np.diag(axes), at_motor * np.diag(motors), rtol=1e-12)

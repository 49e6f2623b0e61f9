"""Measured values in SI units: every unit, convention and deviation by an independent way."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.acquisition.pose_tables import import_poses, read_poses
from ballbar.cell.arrays import Array
from ballbar.cell.load import load_instrument
from ballbar.cell.robot_angles import joints_to_axes
from tests.helpers.pose_files import (
    JOINTS,
    LENGTHS,
    NAMES,
    POINTS,
    ROBOT,
    ROTATIONS,
    Q,
    columns,
    lines,
    write,
)

POSE = ["x", "y", "z", "a", "b", "c"]
EVERY_MM = {"m": 1e-3, "cm": 0.1, "mm": 1.0, "um": 1e3, "inch": 1.0 / 25.4}


def posed(folder: Path, raw: Array, names: list[str], **values: Any) -> Path:
    """A folder with poses whose rotation has these columns."""
    numbers = np.hstack((columns(), raw))
    return write(
        folder,
        lines(numbers, [*NAMES, *names]),
        measured_by="tracker_pose",
        values={"columns": ["x", "y", "z", *names], "unit": "mm", **values},
    )


@pytest.mark.parametrize("unit", EVERY_MM)
def test_units_of_length(tmp_path: Path, unit: str) -> None:
    table = lines(columns(length=1e3 * EVERY_MM[unit]))
    folder = write(tmp_path, table, values={"columns": ["x", "y", "z"], "unit": unit})
    np.testing.assert_allclose(read_poses(folder).groups[0].values, POINTS, atol=1e-9)


def test_angles_in_rad_and_of_the_dh_model(tmp_path: Path) -> None:
    folder = write(tmp_path, lines(columns(angle=1.0)), joints={"columns": JOINTS, "unit": "rad"})
    np.testing.assert_allclose(read_poses(folder).q, Q, atol=1e-9)
    # Axis 3 of the IRB 2400 is the angle of the forearm against the horizontal.
    axes = np.deg2rad([[10.0, 20.0, 30.0, 0.0, 5.0, 0.0], [0.0, -20.0, 10.0, 5.0, 9.0, 3.0]])
    numbers = np.hstack((np.rad2deg(axes), [[0.15], [0.16]]))

    robot: dict[str, Any] = {"robot": "irb2400", "measured_by": "drawwire_2m"}
    values = {"columns": ["l"], "unit": "m"}
    table = lines(numbers, [*JOINTS, "l"])
    logged = read_poses(write(tmp_path, table, **robot, values=values))
    np.testing.assert_allclose(joints_to_axes(logged.robot, logged.q), axes, atol=1e-12)
    joints = {"columns": JOINTS, "unit": "deg", "angles": "joints"}
    of_model = read_poses(write(tmp_path, table, **robot, values=values, joints=joints))
    np.testing.assert_allclose(of_model.q, axes, atol=1e-12)


def test_a_value_is_the_difference_or_the_sum_of_two_columns(tmp_path: Path) -> None:
    extra = np.random.default_rng(1).normal(0.0, 3.0, POINTS.shape)
    numbers = np.hstack((columns()[:, :6], POINTS * 1e3 + extra, extra))
    names = [*JOINTS, "x_t", "y_t", "z_t", "x_dif", "y_dif", "z_dif"]
    for sign, shown in ((1.0, "-"), (-1.0, "+")):
        numbers[:, 9:] = sign * extra
        values = {"columns": [f"{c}_t {shown} {c}_dif" for c in "xyz"], "unit": "mm"}
        folder = write(tmp_path, lines(numbers, names), values=values)
        np.testing.assert_allclose(read_poses(folder).groups[0].values, POINTS, atol=1e-9)


def test_lengths_with_an_offset_and_the_sigma_of_the_instrument(tmp_path: Path) -> None:
    folder = write(
        tmp_path,
        lines(np.hstack((columns()[:, :6], (LENGTHS - 0.3) * 1e3)), [*JOINTS, "length"]),
        measured_by="drawwire_2m",
        values={"columns": ["length"], "unit": "mm", "offset_m": 0.3},
    )
    (group,) = read_poses(folder).groups
    np.testing.assert_allclose(group.values, LENGTHS, atol=1e-9)
    np.testing.assert_array_equal(group.sigma, load_instrument("drawwire_2m").sigma(group.values))


@pytest.mark.parametrize("elevation", ["elevation", "zenith"])
def test_points_as_azimuth_elevation_and_distance(tmp_path: Path, elevation: str) -> None:
    distance = np.linalg.norm(POINTS, axis=1)
    up = np.arcsin(POINTS[:, 2] / distance)
    azimuth = np.arctan2(POINTS[:, 1], POINTS[:, 0])
    height = up if elevation == "elevation" else 0.5 * np.pi - up
    numbers = np.column_stack(
        (columns()[:, :6], np.rad2deg(azimuth), np.rad2deg(height), distance * 1e3)
    )
    deviation = np.tile([2e-4, 1e-4, 0.01], (len(Q), 1))  # [deg, deg, mm]
    folder = write(
        tmp_path,
        lines(np.hstack((numbers, deviation)), [*JOINTS, "Hz", "V", "D", "sh", "sv", "sd"]),
        values={
            **{"columns": ["Hz", "V", "D"], "spherical": elevation},
            **{"unit": "mm", "angle_unit": "deg"},
        },
        sigma={"columns": ["sh", "sv", "sd"]},
    )
    (group,) = read_poses(folder).groups
    np.testing.assert_allclose(group.values, POINTS, atol=1e-9)
    across = np.deg2rad(np.array([2e-4, 1e-4])) * distance[:, None] * [1.0, 1.0]
    across[:, 0] *= np.cos(up)
    total = (across**2).sum(axis=1) + 1e-5**2
    np.testing.assert_allclose((group.sigma**2).sum(axis=1), total, rtol=1e-6)


@pytest.mark.parametrize("convention", ["XYZ", "ZYX", "zyx", "ZYZ", "rotvec"])
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_conventions_of_rotations(tmp_path: Path, convention: str, unit: str) -> None:
    angles = ROTATIONS.as_rotvec() if convention == "rotvec" else ROTATIONS.as_euler(convention)
    raw = np.rad2deg(angles) if unit == "deg" else angles
    folder = posed(tmp_path, raw, ["a", "b", "c"], angle_unit=unit, rotation=convention)
    (group,) = read_poses(folder).groups
    got = Rotation.from_rotvec(np.array(group.values[:, 3:]))
    assert (got * ROTATIONS.inv()).magnitude().max() < 1e-8
    np.testing.assert_allclose(group.values[:, :3], POINTS, atol=1e-9)


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_quaternions(tmp_path: Path, order: str) -> None:
    quat = ROTATIONS.as_quat(scalar_first=order == "wxyz")
    names = [f"q{c}" for c in order]
    folder = posed(tmp_path, quat, names, rotation=f"quat_{order}")
    (group,) = read_poses(folder).groups
    got = Rotation.from_rotvec(np.array(group.values[:, 3:]))
    assert (got * ROTATIONS.inv()).magnitude().max() < 1e-8


def test_deviations_of_euler_angles_become_those_of_small_turns(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    angles = ROTATIONS.as_euler("XYZ")
    spread = np.array([1e-4, 2e-4, 3e-4])  # [rad]
    deviation = np.tile([0.01, 0.02, 0.03, *np.rad2deg(spread)], (len(Q), 1))
    numbers = np.hstack((columns(), np.rad2deg(angles), deviation))
    names = [*NAMES, "a", "b", "c", *(f"s{k}" for k in range(6))]
    folder = write(
        tmp_path,
        lines(numbers, names),
        measured_by="tracker_pose",
        values={"columns": POSE, "unit": "mm", "angle_unit": "deg", "rotation": "XYZ"},
        sigma={"columns": [f"s{k}" for k in range(6)]},
    )
    (group,) = read_poses(folder).groups
    np.testing.assert_allclose(group.sigma[:, :3], np.tile([1e-5, 2e-5, 3e-5], (len(Q), 1)))
    drawn = angles[7] + rng.normal(size=(40_000, 3)) * spread
    turns = (Rotation.from_euler("XYZ", drawn) * ROTATIONS[7].inv()).as_rotvec()
    # The spread of 40 000 draws is known to 0.4 %; four times that.
    np.testing.assert_allclose(group.sigma[7, 3:], turns.std(axis=0), rtol=0.015)


def test_constant_sigma_and_a_deviation_of_zero(tmp_path: Path) -> None:
    constant = read_poses(write(tmp_path, sigma={"length_m": 2.0e-5}))
    np.testing.assert_array_equal(constant.groups[0].sigma, np.full((len(Q), 3), 2.0e-5))
    deviation = np.full((len(Q), 3), 0.05)
    deviation[4] = 0.0
    table = lines(np.hstack((columns(), deviation)), [*NAMES, "sx", "sy", "sz"])
    read = import_poses(write(tmp_path, table, sigma={"columns": ["sx", "sy", "sz"]}))
    sigma = read.table.groups[0].sigma
    np.testing.assert_allclose(sigma[3], 5.0e-5)
    np.testing.assert_allclose(sigma[4], load_instrument("tracker_point").sigma(POINTS)[4])
    (entry,) = read.report.findings
    assert (entry.kind, entry.lines) == ("sigma 0", (6,))


def test_sockets_have_no_values_and_the_distance_of_their_drawing(tmp_path: Path) -> None:
    def sockets(description: dict[str, Any]) -> None:
        first = description["tables"][0]
        description["tables"].append({**first, "seat": "b"})
        description["distances"] = [{"pairs": [["a", "b"]]}]

    keys: dict[str, Any] = {"measured_by": "socket_pair_50", "values": None, "seat": "a"}
    folder = write(tmp_path, lines(columns()), sockets, **keys)
    table = read_poses(folder)
    assert [group.seat for group in table.groups] == ["a", "b"]
    assert table.groups[0].values.shape == (len(Q), 0)
    assert table.groups[0].sigma.shape == (len(Q), 3)
    (distance,) = table.distances
    assert (distance.seats, distance.length, distance.sigma) == (("a", "b"), 0.05, 2e-4)
    np.testing.assert_array_equal(ROBOT.a, table.robot.a)


def test_one_table_has_an_instrument_of_its_own(tmp_path: Path) -> None:
    def wire(description: dict[str, Any]) -> None:
        first = description["tables"][0]
        values = {"columns": ["l"], "unit": "m"}
        more = {**first, "values": values, "instrument": "drawwire_2m", "seat": "wire"}
        description["tables"].append(more)

    table = lines(np.hstack((columns(), LENGTHS)), [*NAMES, "l"])
    groups = read_poses(write(tmp_path, table, wire)).groups
    assert [group.measured for group in groups] == ["point", "length"]


@pytest.mark.parametrize(
    ("stamps", "form"),
    [
        (["20200714163904", "20200714163924", "20200714164004"], None),
        (["2020-07-14 16:39:04", "2020-07-14T16:39:24", "2020-07-14 16:40:04.0"], None),
        (["1594744744", "1594744764", "1594744804"], None),
        (["5.0", "25.0", "65.0"], "s"),
    ],
)
def test_times_of_the_poses(tmp_path: Path, stamps: list[str], form: str | None) -> None:
    rows = [f"{row},{stamp}" for row, stamp in zip(lines(columns()[:3], []), stamps, strict=True)]
    time = {"column": "t"} if form is None else {"column": "t", "form": form}
    folder = write(tmp_path, [",".join([*NAMES, "t"]), *rows], time=time)
    np.testing.assert_allclose(read_poses(folder).groups[0].time, [0.0, 20.0, 60.0], atol=1e-9)


def test_stamps_cut_by_a_spreadsheet_are_dropped_with_a_finding(tmp_path: Path) -> None:
    rows = [f"{row};2,02011E+13;21,5" for row in lines(columns(), [], ";", comma=True)]
    folder = write(
        tmp_path,
        [";".join([*NAMES, "t", "temperature"]), *rows],
        time={"column": "t"},
        temperature={"column": "temperature"},
    )
    read = import_poses(folder)
    assert read.table.groups[0].time is None
    np.testing.assert_array_equal(read.table.groups[0].temperature, 21.5)
    entry = next(f for f in read.report.findings if f.kind == "time not used")
    assert (entry.severity, entry.count) == ("repaired", len(Q))
    assert "2.02011E+13: cut by a spreadsheet" in entry.sentence


def test_a_missing_temperature_drops_the_temperatures_not_the_pose(tmp_path: Path) -> None:
    rows = [f"{row},{'' if k == 3 else 20.0}" for k, row in enumerate(lines(columns(), []))]
    folder = write(tmp_path, [",".join([*NAMES, "T"]), *rows], temperature={"column": "T"})
    read = import_poses(folder)
    assert read.table.size == len(Q)
    assert read.table.groups[0].temperature is None
    assert read.report.findings[0].kind == "temperature not used"

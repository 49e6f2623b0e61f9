"""The shipped robots have the kinematics that their manufacturers' URDFs publish.

The tables and the product of transforms are in tests.helpers.published_urdf; neither uses the
project's kinematics. No transform is allowed between the two: base and flange frames are the same.
"""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell import load
from ballbar.cell.chain import Chain, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import parameter_table
from ballbar.cell.load import load_robot, robot_names
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from tests.helpers.published_urdf import PUBLISHED, tip_pose
from tests.helpers.real_robots import DATA

MASSES = {"irb2400", "nj220", "so101"}
# Rows whose axis is parallel to the next one, from 1.
PARALLEL = {name: (2, 3) if name.startswith(("ur", "so101")) else (2,) for name in PUBLISHED}
PARALLEL |= {"panda": (), "iiwa14": ()}
AXES = [f"joint_{number}" for number in range(1, 7)]
POSITION, QUATERNION = ("ps_x", "ps_y", "ps_z"), ("os_x", "os_y", "os_z", "os_w")
SHARES = (0.5, 0.31, 0.83)  # of the axis ranges: three poses; the second near a wrist turned


def axis_angles(robot: Robot, share: float) -> np.ndarray:
    """(J,) [rad] axis angles within the limits, not all at one share of them."""
    shares = np.clip(share + 0.1 * np.cos(3.0 * np.arange(robot.joints)), 0.0, 1.0)
    return robot.axis_lower + shares * (robot.axis_upper - robot.axis_lower)


def urdf_angles(name: str, axes: np.ndarray) -> np.ndarray:
    """Joint angles of the URDF at axis angles of the controller."""
    angles = axes.copy()
    if name == "m20ia":  # robot_interface_streaming_m20ia.launch: J23_factor = 1
        angles[2] += axes[1]
    if name in {"irb2400", "irb4400"}:  # robot_interface_download_*.launch: J23_coupled = true
        angles[2] -= axes[1]
    return angles


def flange_pose(robot: Robot, axes: np.ndarray) -> np.ndarray:
    chain = Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(robot.joints))
    pose = forward(chain, controller_to_joints(robot, axes)[None]).poses()[0]
    return np.asarray(pose)


def test_every_shipped_robot_is_compared_with_a_published_urdf() -> None:
    """That of the NJ 220 is in test_descriptions."""
    assert set(robot_names()) - {"nj220"} == set(PUBLISHED)


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_flange_of_a_shipped_robot_is_where_its_urdf_has_it(name: str) -> None:
    robot = load_robot(name)
    for axes in (np.zeros(robot.joints), *(axis_angles(robot, share) for share in SHARES)):
        expected = tip_pose(PUBLISHED[name].joints, urdf_angles(name, axes))
        # 1e-6: angles of the URDFs are printed with 7 digits and more
        np.testing.assert_allclose(flange_pose(robot, axes), expected, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_neighbours_that_are_parallel_are_known(name: str) -> None:
    robot = load_robot(name)
    parallel = parameter_table(robot).hayati_rows[:-1]  # the last is that across the plate
    assert tuple(row + 1 for row in parallel) == PARALLEL[name]
    for row in parallel:
        assert robot.alpha[row] == 0.0  # not 180 deg: signs are the controller's
        assert robot.d[row] == 0.0


@pytest.mark.parametrize("name", sorted(set(PUBLISHED) - MASSES))
def test_a_description_without_masses_says_which_are_missing(name: str) -> None:
    robot = load_robot(name)
    assert robot.links is None
    assert robot.gears is None
    assert np.isfinite(robot.axis_speed_max).all()
    assert (robot.accuracy_lower < robot.accuracy_upper).all()


def test_fanuc_axis_3_keeps_the_forearm_level_while_axis_2_moves() -> None:
    robot = load_robot("m20ia")
    level = flange_pose(robot, np.zeros(6))
    leaning = flange_pose(robot, np.deg2rad([0.0, 40.0, 0.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(leaning[:3, :3], level[:3, :3], atol=1e-12)
    axes = np.deg2rad([10.0, 40.0, 20.0, 5.0, -30.0, 60.0])
    np.testing.assert_allclose(joints_to_axes(robot, controller_to_joints(robot, axes)), axes)


def recorded_tcp_poses() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axis angles (N, 6) [rad], TCP positions (N, 3) [m] and quaternions (N, 4) of a real robot.

    They are those that its controller showed, one row after the other: position, orientation,
    speed, axes. Samples in motion are left out.
    """
    (file,) = (DATA / "irb4400_vicon").glob("*.csv.gz")
    kept: list[list[float]] = []
    latest: dict[str, float] = {}
    with gzip.open(file, "rt", encoding="utf-8") as text:
        for row in csv.DictReader(text):
            latest |= {key: float(value) for key, value in row.items() if value}
            if row["joint_1"] and latest["tcp_speeds"] < 1.0:  # [mm/s]
                kept.append([latest[name] for name in (*AXES, *POSITION, *QUATERNION)])
    samples = np.unique(kept, axis=0)
    return np.deg2rad(samples[:, :6]), samples[:, 6:9] / 1e3, samples[:, 9:]


def test_the_irb4400_stands_where_the_controller_of_a_real_one_shows_its_tcp() -> None:
    """Its tool is 239 mm long on the axis of the flange, with the flange's axes."""
    if not DATA.is_dir():
        pytest.skip("no recordings of real robots beside the project (../shared/real_robots)")
    axes, tcp, quaternion = recorded_tcp_poses()
    assert np.ptp(axes, axis=0).min() > np.deg2rad(10.0)
    robot = load_robot("irb4400")
    flanges = np.array([flange_pose(robot, row) for row in axes])
    turned = Rotation.from_matrix(flanges[:, :3, :3])
    turn = (turned.inv() * Rotation.from_quat(quaternion)).magnitude()
    tool = turned.inv().apply(tcp - flanges[:, :3, 3])
    off = np.linalg.norm(tool - [0.0, 0.0, np.median(tool[:, 2])], axis=1)
    assert np.median(off) < 5e-6  # [m]
    assert np.median(turn) < 5e-6  # [rad]


@pytest.mark.parametrize(("name", "source"), [(n, u.source) for n, u in PUBLISHED.items()])
def test_the_file_of_a_robot_names_the_commit_it_was_checked_against(
    name: str, source: str
) -> None:
    text = (Path(load.__file__).parent / f"robots/{name}.yaml").read_text()
    assert source.rsplit(", ", 1)[1] in text

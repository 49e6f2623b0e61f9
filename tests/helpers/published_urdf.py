"""Joint origins and axes of robots as their URDFs publish them, and forward kinematics from these.

A plain product of homogeneous transforms, independent of the project's kinematics. Each chain
starts at the frame that the description calls base, and ends at the flange frame named beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
MINUS_X, MINUS_Y, MINUS_Z = (-1, 0, 0), (0, -1, 0), (0, 0, -1)
NO_TURN = (0.0, 0.0, 0.0)
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Joint:
    """Origin of a joint in its parent's frame, and its axis; None for a fixed joint."""

    xyz: Triple  # [m]
    axis: Triple | None
    rpy: Triple = NO_TURN  # [rad]


@dataclass(frozen=True)
class PublishedUrdf:
    """One robot."""

    source: str  # repository, file, commit
    frames: str  # first and last link
    joints: tuple[Joint, ...]


def _published(source: str, frames: str, joints: str) -> PublishedUrdf:
    """The robot of these joints: x y z [m], axis, and roll pitch yaw [rad] of those that turn."""
    return PublishedUrdf(source, frames, tuple(map(_joint, joints.split("; "))))


def _joint(text: str) -> Joint:
    x, y, z, axis, *turn = text.split()
    roll, pitch, yaw = map(_number, turn or "000")
    return Joint((_number(x), _number(y), _number(z)), AXES[axis], (roll, pitch, yaw))


def _number(text: str) -> float:
    return ANGLES[text] if text in ANGLES else float(text)


AXES = {"x": X, "y": Y, "z": Z, "-x": MINUS_X, "-y": MINUS_Y, "-z": MINUS_Z, "fixed": None}
ANGLES = {"pi": pi, "-pi": -pi, "pi/2": pi / 2, "-pi/2": -pi / 2}
# Of UR's files offsets of 2e-11 m are left out; a quarter turn is printed as 1.570796327, and as
# 1.5708 in that of the IRB 4400 (pi/2 here).
PUBLISHED = {
    "ur5": _published(
        "ros-industrial/universal_robot, ur_description/config/ur5/default_kinematics.yaml, "
        "9238b2c4b788c43326569a60e43282aa1b1914ad",
        "base to tool0",
        "0 0 0.089159 z; 0 0 0 z 1.570796327 0 0; -0.425 0 0 z; -0.39225 0 0.10915 z; "
        "0 -0.09465 0 z 1.570796327 0 0; 0 0.0823 0 z 1.570796327 pi pi",
    ),
    "ur10": _published(
        "ros-industrial/universal_robot, ur_description/config/ur10/default_kinematics.yaml, "
        "e30bc2ed83093a1fd1468cf77bb61b1b1725df9d",
        "base to tool0",
        "0 0 0.1273 z; 0 0 0 z 1.570796327 0 0; -0.612 0 0 z; -0.5723 0 0.163941 z; "
        "0 -0.1157 0 z 1.570796327 0 0; 0 0.0922 0 z 1.570796327 pi pi",
    ),
    "ur5e": _published(
        "ros-industrial/universal_robot, ur_description/config/ur5e/default_kinematics.yaml, "
        "6485dfa6444f769f854d8135c123d4baf6796f44",
        "base to tool0",
        "0 0 0.1625 z; 0 0 0 z 1.570796327 0 0; -0.425 0 0 z; -0.3922 0 0.1333 z; "
        "0 -0.0997 0 z 1.570796327 0 0; 0 0.0996 0 z 1.570796327 pi pi",
    ),
    "ur10e": _published(
        "yerayNS-CDEI/ur_arm_control, urdf/ur10e.urdf (ur_description of ROS Humble, expanded), "
        "d572ef234de91c5cea6d8ce81a6f3b95a1e31503",
        "base to tool0",
        "0 0 0.1807 z; 0 0 0 z 1.570796327 0 0; -0.6127 0 0 z; -0.57155 0 0.17415 z; "
        "0 -0.11985 0 z 1.570796327 0 0; 0 0.11655 0 z 1.570796327 pi pi",
    ),
    "irb120": _published(
        "ros-industrial/abb, abb_irb120_support/urdf/irb120_3_58_macro.xacro, "
        "59e17fb621af582f149e0b86179b68a51bd10e1d",
        "base_link to tool0",
        "0 0 0 z; 0 0 0.29 y; 0 0 0.27 y; 0 0 0.07 x; 0.302 0 0 y; 0.072 0 0 x; "
        "0 0 0 fixed 0 pi/2 0",
    ),
    "irb1600": _published(
        "ros-industrial/abb, abb_irb1600_support/urdf/irb1600_10_145_macro.xacro, "
        "09a4feed7b9f6f529542b9415e7e0b8a7f8893b8",
        "base_link to tool0",
        "0 0 0 z; 0.15 0 0.4865 y; 0 0 0.7 y; 0.3 0 0 x; 0.3 0 0 y; 0.065 0 0 x; "
        "0 0 0 fixed 0 pi/2 0",
    ),
    "irb2400": _published(
        "ros-industrial/abb, abb_irb2400_support/urdf/irb2400_12_155_macro.xacro, "
        "d266f42024b83698eecdee3c44f029c0e9b4b59e",
        "base_link to tool0",
        "0 0 0 z; 0.1 0 0.615 y; 0 0 0.705 y; 0 0 0.135 x; 0.755 0 0 y; 0 0 0 x; "
        "0.085 0 0 fixed 0 pi/2 0",
    ),
    "irb4400": _published(
        "ros-industrial/abb, abb_irb4400_support/urdf/irb4400_macro.xacro, "
        "9aaf5ada0cf0fc7fc389205dae9ef1fbad0861b9",
        "base_link to tool0",
        "0 0 0 z; 0.2 0 0.68 y; 0 0 0.89 y; 0 0 0.15 x; 0.88 0 0 y; 0 0 0 x; "
        "0.14 0 0 fixed 0 pi/2 0",
    ),
    "irb4600": _published(
        "ros-industrial/abb, abb_irb4600_support/urdf/irb4600_40_255_macro.xacro, "
        "0707207a3f24c21bb98d39756f67ec83f4e0d977",
        "base_link to tool0",
        "0 0 0.495 z; 0.175 0 0 y; 0 0 1.095 y; 0 0 0.175 x; 1.27 0 0 y; 0.135 0 0 x; "
        "0 0 0 fixed 0 pi/2 0",
    ),
    "irb6640": _published(
        "ros-industrial/abb, abb_irb6640_support/urdf/irb6640_185_280_macro.xacro, "
        "d7348925ea5aa8518ee70b36b2fa311f5c27aca6",
        "base_link to tool0",
        "0 0 0.78 z; 0.32 0 0 y; 0 0 1.075 y; 0 0 0.2 x; 1.392 0 0 y; 0.2 0 0 x; "
        "0 0 0 fixed 0 pi/2 0",
    ),
    "kr10_r1100": _published(
        "ros-industrial/kuka_experimental, kuka_kr10_support/urdf/kr10r1100sixx_macro.xacro, "
        "62c4af1c3a02141002db9de59e0c8536fab2f28b",
        "base_link to tool0",
        "0 0 0.4 -z; 0.025 0 0 y; 0.56 0 0 y; 0 0 0.035 -x; 0.515 0 0 y; 0.08 0 0 -x; "
        "0 0 0 fixed 0 pi/2 0",
    ),
    "kr210": _published(
        "ros-industrial/kuka_experimental, kuka_kr210_support/urdf/kr210r2700extra_macro.xacro, "
        "01ae9a4c28bd13178449bd3c5937190cc3b7e25a",
        "base_link to tool0",
        "0 0 0.675 -z; 0.35 0 0 y; 1.15 0 0 y; 0 0 -0.041 -x; 1.2 0 0 y; 0.215 0 0 -x; "
        "0 0 0 fixed 0 pi/2 0",
    ),
    "panda": _published(
        "frankaemika/franka_ros, franka_description/robots/common/franka_arm.xacro, "
        "b2a62ff6052db4deff8b5ad734658deea2403390",
        "panda_link0 to panda_link8",
        "0 0 0.333 z; 0 0 0 z -pi/2 0 0; 0 -0.316 0 z pi/2 0 0; 0.0825 0 0 z pi/2 0 0; "
        "-0.0825 0.384 0 z -pi/2 0 0; 0 0 0 z pi/2 0 0; 0.088 0 0 z pi/2 0 0; 0 0 0.107 fixed",
    ),
    "so101": _published(
        "TheRobotStudio/SO-ARM100, Simulation/SO101/so101_new_calib.urdf, "
        "0aee1d0f885a9643b91f544be1ef86d1200432c2",
        "base, moved onto axis 1, to gripper, moved along its z to gripperframe",
        "0 0 0.0948817 z -pi 0 pi/2; -0.0303992 -0.0182778 -0.0542 z -pi/2 -pi/2 0; "
        "-0.11257 -0.028 0 z 0 0 pi/2; -0.1349 0.0052 0 z 0 0 -pi/2; "
        "0 -0.0611 0.0181 z pi/2 0 pi; 0 0 -0.0981274 fixed",
    ),
    "iiwa14": _published(
        "lbr-stack/lbr_fri_ros2_stack, lbr_description/urdf/iiwa14/iiwa14_description.xacro, "
        "122a16a3d5e09fe673508066f332e584a10ce1e4",
        "link_0 to link_ee",
        "0 0 0.1475 z; 0 -0.01 0.2125 y; 0 0.01 0.228 z; 0 0.0105 0.192 -y; 0 -0.0105 0.2075 z; "
        "0 -0.0707 0.1925 y; 0 0.0707 0.091 z; 0 0 0.035 fixed",
    ),
    "m20ia": _published(
        "ros-industrial/fanuc, fanuc_m20ia_support/urdf/m20ia_macro.xacro, "
        "526347abe10e6cd77cc1ed183414361dd4fdb218",
        "base_link to tool0",
        "0 0 0.525 z; 0.15 0 0 y; 0 0 0.79 -y; 0 0 0.25 -x; 0.835 0 0 -y; 0.1 0 0 -x; "
        "0 0 0 fixed pi -pi/2 0",
    ),
    "gp25": _published(
        "ros-industrial/motoman, motoman_gp25_support/urdf/gp25_macro.xacro, "
        "0961ed72690b3f506deede8f55a9404b3eaeab90",
        "base_link to tool0",
        "0 0 0.505 z; 0.15 0 0 y; 0 0 0.76 -y; 0 0 0.2 -x; 0.795 0 0 -y; 0 0 0 -x; "
        "0.1 0 0 fixed 3.1415926 -1.570796 0",
    ),
}


def turn(axis: Triple, angle: float) -> np.ndarray:
    """(4, 4) rotation by Rodrigues' formula."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    pose = np.eye(4)
    pose[:3, :3] += sin(angle) * k + (1.0 - cos(angle)) * k @ k
    return pose


def tip_pose(joints: Sequence[Joint], angles: Sequence[float]) -> np.ndarray:
    """(4, 4) [m] pose of the last link in the first, angles [rad] of the joints that turn."""
    pose, left = np.eye(4), list(angles)
    for joint in joints:
        shift = np.eye(4)
        shift[:3, 3] = joint.xyz
        roll, pitch, yaw = joint.rpy
        pose = pose @ shift @ turn(Z, yaw) @ turn(Y, pitch) @ turn(X, roll)
        if joint.axis is not None:
            pose = pose @ turn(joint.axis, left.pop(0))
    assert not left
    return pose

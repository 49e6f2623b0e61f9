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
UR_QUARTER = 1.570796327  # as UR prints it
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


TO_FRONT = Joint((0, 0, 0), None, (0, pi / 2, 0))  # tool0 of ABB and KUKA: z along link 6's x
TO_FRONT_TURNED = Joint((0, 0, 0), None, (pi, -pi / 2, 0))  # of Fanuc


def _ur(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float) -> tuple[Joint, ...]:
    """The origins that all arms of UR share; offsets of 2e-11 m in the files are left out."""
    return (
        Joint((0, 0, d1), Z),
        Joint((0, 0, 0), Z, (UR_QUARTER, 0, 0)),
        Joint((a2, 0, 0), Z),
        Joint((a3, 0, d4), Z),
        Joint((0, -d5, 0), Z, (UR_QUARTER, 0, 0)),
        Joint((0, d6, 0), Z, (UR_QUARTER, pi, pi)),
    )


_UR = "ros-industrial/universal_robot, ur_description/config/{}/default_kinematics.yaml, {}"
_ABB = "ros-industrial/abb, {}_macro.xacro, {}"
_KUKA = "ros-industrial/kuka_experimental, {}_macro.xacro, {}"

PUBLISHED = {
    "ur5": PublishedUrdf(
        _UR.format("ur5", "9238b2c4b788c43326569a60e43282aa1b1914ad"),
        "base to tool0",
        _ur(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    ),
    "ur10": PublishedUrdf(
        _UR.format("ur10", "e30bc2ed83093a1fd1468cf77bb61b1b1725df9d"),
        "base to tool0",
        _ur(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    ),
    "ur5e": PublishedUrdf(
        _UR.format("ur5e", "6485dfa6444f769f854d8135c123d4baf6796f44"),
        "base to tool0",
        _ur(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    ),
    "ur10e": PublishedUrdf(
        "yerayNS-CDEI/ur_arm_control, urdf/ur10e.urdf (ur_description of ROS Humble, expanded), "
        "d572ef234de91c5cea6d8ce81a6f3b95a1e31503",
        "base to tool0",
        _ur(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    ),
    "irb120": PublishedUrdf(
        _ABB.format(
            "abb_irb120_support/urdf/irb120_3_58", "59e17fb621af582f149e0b86179b68a51bd10e1d"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0), Z),
            Joint((0, 0, 0.29), Y),
            Joint((0, 0, 0.27), Y),
            Joint((0, 0, 0.07), X),
            Joint((0.302, 0, 0), Y),
            Joint((0.072, 0, 0), X),
            TO_FRONT,
        ),
    ),
    "irb1600": PublishedUrdf(
        _ABB.format(
            "abb_irb1600_support/urdf/irb1600_10_145", "09a4feed7b9f6f529542b9415e7e0b8a7f8893b8"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0), Z),
            Joint((0.15, 0, 0.4865), Y),
            Joint((0, 0, 0.700), Y),
            Joint((0.300, 0, 0), X),
            Joint((0.300, 0, 0), Y),
            Joint((0.065, 0, 0), X),
            TO_FRONT,
        ),
    ),
    "irb2400": PublishedUrdf(
        _ABB.format(
            "abb_irb2400_support/urdf/irb2400_12_155", "d266f42024b83698eecdee3c44f029c0e9b4b59e"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0), Z),
            Joint((0.1, 0, 0.615), Y),
            Joint((0, 0, 0.705), Y),
            Joint((0, 0, 0.135), X),
            Joint((0.755, 0, 0), Y),
            Joint((0, 0, 0), X),
            Joint((0.085, 0, 0), None, (0, pi / 2, 0)),
        ),
    ),
    "irb4600": PublishedUrdf(
        _ABB.format(
            "abb_irb4600_support/urdf/irb4600_40_255", "0707207a3f24c21bb98d39756f67ec83f4e0d977"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0.495), Z),
            Joint((0.175, 0, 0), Y),
            Joint((0, 0, 1.095), Y),
            Joint((0, 0, 0.175), X),
            Joint((1.270, 0, 0), Y),
            Joint((0.135, 0, 0), X),
            TO_FRONT,
        ),
    ),
    "irb6640": PublishedUrdf(
        _ABB.format(
            "abb_irb6640_support/urdf/irb6640_185_280", "d7348925ea5aa8518ee70b36b2fa311f5c27aca6"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0.780), Z),
            Joint((0.320, 0, 0), Y),
            Joint((0, 0, 1.075), Y),
            Joint((0, 0, 0.2), X),
            Joint((1.392, 0, 0), Y),
            Joint((0.2, 0, 0), X),
            TO_FRONT,
        ),
    ),
    "kr10_r1100": PublishedUrdf(
        _KUKA.format(
            "kuka_kr10_support/urdf/kr10r1100sixx", "62c4af1c3a02141002db9de59e0c8536fab2f28b"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0.400), MINUS_Z),
            Joint((0.025, 0, 0), Y),
            Joint((0.560, 0, 0), Y),
            Joint((0, 0, 0.035), MINUS_X),
            Joint((0.515, 0, 0), Y),
            Joint((0.080, 0, 0), MINUS_X),
            TO_FRONT,
        ),
    ),
    "kr210": PublishedUrdf(
        _KUKA.format(
            "kuka_kr210_support/urdf/kr210r2700extra", "01ae9a4c28bd13178449bd3c5937190cc3b7e25a"
        ),
        "base_link to tool0",
        (
            Joint((0, 0, 0.675), MINUS_Z),
            Joint((0.350, 0, 0), Y),
            Joint((1.150, 0, 0), Y),
            Joint((0, 0, -0.041), MINUS_X),
            Joint((1.200, 0, 0), Y),
            Joint((0.215, 0, 0), MINUS_X),
            TO_FRONT,
        ),
    ),
    "panda": PublishedUrdf(
        "frankaemika/franka_ros, franka_description/robots/common/franka_arm.xacro, "
        "b2a62ff6052db4deff8b5ad734658deea2403390",
        "panda_link0 to panda_link8",
        (
            Joint((0, 0, 0.333), Z),
            Joint((0, 0, 0), Z, (-pi / 2, 0, 0)),
            Joint((0, -0.316, 0), Z, (pi / 2, 0, 0)),
            Joint((0.0825, 0, 0), Z, (pi / 2, 0, 0)),
            Joint((-0.0825, 0.384, 0), Z, (-pi / 2, 0, 0)),
            Joint((0, 0, 0), Z, (pi / 2, 0, 0)),
            Joint((0.088, 0, 0), Z, (pi / 2, 0, 0)),
            Joint((0, 0, 0.107), None),
        ),
    ),
    "iiwa14": PublishedUrdf(
        "lbr-stack/lbr_fri_ros2_stack, lbr_description/urdf/iiwa14/iiwa14_description.xacro, "
        "122a16a3d5e09fe673508066f332e584a10ce1e4",
        "link_0 to link_ee",
        (
            Joint((0, 0, 0.1475), Z),
            Joint((0, -0.01, 0.2125), Y),
            Joint((0, 0.01, 0.228), Z),
            Joint((0, 0.0105, 0.192), MINUS_Y),
            Joint((0, -0.0105, 0.2075), Z),
            Joint((0, -0.0707, 0.1925), Y),
            Joint((0, 0.0707, 0.091), Z),
            Joint((0, 0, 0.035), None),
        ),
    ),
    "m20ia": PublishedUrdf(
        "ros-industrial/fanuc, fanuc_m20ia_support/urdf/m20ia_macro.xacro, "
        "526347abe10e6cd77cc1ed183414361dd4fdb218",
        "base_link to tool0",
        (
            Joint((0, 0, 0.525), Z),
            Joint((0.150, 0, 0), Y),
            Joint((0, 0, 0.790), MINUS_Y),
            Joint((0, 0, 0.250), MINUS_X),
            Joint((0.835, 0, 0), MINUS_Y),
            Joint((0.100, 0, 0), MINUS_X),
            TO_FRONT_TURNED,
        ),
    ),
    "gp25": PublishedUrdf(
        "ros-industrial/motoman, motoman_gp25_support/urdf/gp25_macro.xacro, "
        "0961ed72690b3f506deede8f55a9404b3eaeab90",
        "base_link to tool0",
        (
            Joint((0, 0, 0.505), Z),
            Joint((0.150, 0, 0), Y),
            Joint((0, 0, 0.760), MINUS_Y),
            Joint((0, 0, 0.200), MINUS_X),
            Joint((0.795, 0, 0), MINUS_Y),
            Joint((0, 0, 0), MINUS_X),
            Joint((0.100, 0, 0), None, (3.1415926, -1.570796, 0)),
        ),
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

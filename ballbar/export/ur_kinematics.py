"""The kinematics file of a UR robot for `ur_description`: one origin for each joint.

Format: UniversalRobots/Universal_Robots_ROS2_Description, config/*/default_kinematics.yaml and
urdf/ur_macro.xacro: six joints about z, whose origins are x y z [m] and roll pitch yaw [rad] in the
link before; the first one's in base_link_inertia, whose frame is the controller's base.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.chain import Chain
from ballbar.cell.errors import InputError
from ballbar.cell.rotation import roll_pitch_yaw
from ballbar.export.new_origins import check_new_chain, matched, new_origins
from ballbar.export.result import Result, noted_text, number
from ballbar.robot_file.urdf import UrdfJoint
from ballbar.robot_file.urdf_chain import UrdfChain

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
HEAD = (
    "For ur_description: kinematics_params (ROS 2), kinematics_config (ROS 1).",
    "The hash is of this result, not the controller's: the driver will say that it differs.",
    "The controller itself goes on with its own calibration; its poses are not those of this file.",
)
_ALPHA = (0.5, 0.0, 0.0, 0.5, -0.5, 0.0)  # [pi rad] twists of every arm of UR


def ur_kinematics(result: Result) -> str:
    """Text of kinematics.yaml. Raises InputError for a robot that is not one of UR."""
    nominal = result.nominal
    if not _is_ur(nominal):
        raise InputError(
            f"robot {result.name}: ur-kinematics is the format of Universal Robots' arms, with "
            "twists 90 0 0 90 -90 0 deg. Export with --to urdf, or --into a file of the robot."
        )
    chain = ur_chain(_nominal_origins(nominal))
    match = matched(result.robot, nominal, chain, "ur_description")
    origins, tip = new_origins(match, nominal, result.chain, chain)
    values = [(pose[:3, 3], roll_pitch_yaw(pose[:3, :3])) for pose in origins]
    again = ur_chain([(tuple(xyz.tolist()), tuple(rpy.tolist())) for xyz, rpy in values])
    check_new_chain(result.robot, match, result.chain, tip, again, "ur_description")
    lines = ["kinematics:"]
    for link, (xyz, rpy) in zip(LINKS, values, strict=True):
        named = zip(("x", "y", "z", "roll", "pitch", "yaw"), (*xyz, *rpy), strict=True)
        lines += [f"  {link}:", *(f"    {key}: {number(value)}" for key, value in named)]
    lines.append(f"  hash: calib_{int(result.sha256[:16], 16)}")
    return noted_text(result, "#", HEAD, lines)


def ur_chain(origins: list[tuple[tuple[float, ...], tuple[float, ...]]]) -> UrdfChain:
    """The chain of ur_description with six origins: xyz (3,) [m] and rpy (3,) [rad] of each."""
    links = ("base_link_inertia", *(f"{link}_link" for link in LINKS))
    joints = tuple(
        UrdfJoint(
            name=LINKS[i],
            kind="revolute",
            parent=links[i],
            child=links[i + 1],
            xyz=xyz,
            rpy=rpy,
            axis=(0.0, 0.0, 1.0),
        )
        for i, (xyz, rpy) in enumerate(origins)
    )
    return UrdfChain(links[0], links[-1], joints, (np.eye(4),) * (len(LINKS) + 1))


def _nominal_origins(rows: Chain) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    a, d, quarter = rows.a, rows.d, 0.5 * np.pi
    return [
        ((0.0, 0.0, float(d[0])), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (quarter, 0.0, 0.0)),
        ((float(a[1]), 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((float(a[2]), 0.0, float(d[3])), (0.0, 0.0, 0.0)),
        ((0.0, -float(d[4]), 0.0), (quarter, 0.0, 0.0)),
        ((0.0, float(d[5]), 0.0), (quarter, np.pi, np.pi)),
    ]


def _is_ur(rows: Chain) -> bool:
    if rows.rows != len(LINKS):
        return False
    zero = np.concatenate((rows.a[[0, 3, 4, 5]], rows.d[[1, 2]], rows.theta))
    twists = np.abs(rows.alpha - np.pi * np.array(_ALPHA)).max()
    return bool(twists < 1e-9 and np.abs(zero).max() < 1e-9)

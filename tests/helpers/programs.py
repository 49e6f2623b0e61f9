"""Programs as controllers and teach pendants write them, with targets that a robot can take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.robot_angles import controller_to_joints

FAR = "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]"
TOOL = "[TRUE,[[10.5,-20,180.25],[0.965925826,0,0.258819045,0]],[4.2,[5,0,90],[1,0,0,0],0,0,0]]"
TABLE = '[FALSE,TRUE,"",[[700,-100,300],[1,0,0,0]],[[10,20,30],[0.707106781,0,0,0.707106781]]]'


def tool_frame() -> Array:
    """(4, 4) of TOOL."""
    return frame([10.5, -20.0, 180.25], [0.965925826, 0.0, 0.258819045, 0.0])


def table_frame() -> Array:
    """(4, 4) of TABLE."""
    half = [0.707106781, 0.0, 0.0, 0.707106781]
    return frame([700.0, -100.0, 300.0], [1.0, 0.0, 0.0, 0.0]) @ frame([10.0, 20.0, 30.0], half)


def frame(position_mm: Sequence[float], wxyz: Sequence[float]) -> Array:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat([*wxyz[1:], wxyz[0]]).as_matrix()
    out[:3, 3] = np.array(position_mm) * 1e-3
    return out


def flange(robot: Robot, axes_deg: Array) -> Array:
    """(4, 4) of the nominal robot."""
    q = controller_to_joints(robot, np.radians(axes_deg))[None]
    return forward(nominal_chain(robot), q).poses()[0]


def robtarget(robot: Robot, axes_deg: Array, tool: Array, work_object: Array) -> str:
    """Value of a robtarget at axis angles, numbers as a teach pendant shows them."""
    pose = np.linalg.solve(work_object, flange(robot, axes_deg) @ tool)
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    place = ",".join(f"{v:.3f}" for v in pose[:3, 3] * 1e3)
    turn = ",".join(f"{v:.9f}" for v in (w, x, y, z))
    quadrants = ",".join(str(int(np.floor(axes_deg[i] / 90.0))) for i in (0, 3, 5))
    cfx = int(axes_deg[4] < 0.0)
    return f"[[{place}],[{turn}],[{quadrants},{cfx}],{FAR}]"


def e6pos(robot: Robot, axes_deg: Array, tool: Array, base: Array, *, status: int = 2) -> str:
    """Value of an E6POS at axis angles."""
    pose = np.linalg.solve(base, flange(robot, axes_deg) @ tool)
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    x, y, z = pose[:3, 3] * 1e3
    turn = int(((axes_deg < 0.0) * 2 ** np.arange(6)).sum())
    return (
        f"{{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.5f},B {b:.5f},C {c:.5f},S {status},T {turn},"
        "E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}"
    )

"""Origins of a URDF's joints that give its chain the identified geometry.

Link i of the file and frame i of the DH rows are on one body. With the pose B of the DH base in the
file's base link, the chain of the file is `L_i = B T_(i-1) Rz(s_i u_i) M_i`, where M_i places link
i on axis i of the rows: it takes the joint's own axis to z and lies on it. B, the signs s and M are
those of the nominal robot; M is turned by the identified change of theta, so that a link turns with
the zero position of its own joint. With identified rows in T, the origin of joint i follows from
the links before and behind it; links keep their places on the axes, and what changes is a small
correction of each origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward, row_placements
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.number_text import significant_text
from ballbar.cell.rigid_fit import nearest_rotation
from ballbar.robot_file.urdf_chain import UrdfChain, inverse_pose

SAME = 2e-5  # [m, rad] between the file's geometry and that of the nominal robot: its digits
EXACT = 1e-9  # [m] of the new chain against the identified one
CHECKED = 100  # poses at which they are compared
_SEED = 7


@dataclass(frozen=True, eq=False)
class Match:
    """How the nominal rows lie in the chain of a file."""

    sign: Array  # (J,) DH joint angle = sign * joint position of the file
    T_base_dh: Array  # (4, 4) [m]
    T_flange_tip: Array  # (4, 4) [m] up to the child link of the last joint


def matched(robot: Robot, nominal: Chain, chain: UrdfChain, source: str) -> Match:
    """How a file's chain and the nominal rows lie to each other.

    Raises InputError where the file is not of this robot, or its zero position another one.
    """
    if len(chain.joints) != nominal.rows:
        names = ", ".join(joint.name for joint in chain.joints)
        raise InputError(
            f"{source}: the chain has {len(chain.joints)} turning joints ({names}), robot "
            f"{robot.name} has {nominal.rows}. Name them with --joints a,b,c."
        )
    u = _poses(robot)
    tips = chain.tip_poses(u)
    best: tuple[float, Match] | None = None
    for sign in _signs(robot):
        base, tip = _constants(tips, forward(nominal, u * sign).poses())
        error = float(np.abs(tips - base @ forward(nominal, u * sign).poses() @ tip).max())
        if best is None or error < best[0]:
            best = error, Match(sign, base, tip)
        if error < SAME:
            return Match(sign, base, tip)
    assert best is not None  # there is a first choice of signs
    difference = significant_text(best[0] * 1e3)
    raise InputError(
        f"{source}: its geometry is not that of the nominal robot {robot.name}: they differ by up "
        f"to {difference} mm or mrad, whatever the base and the tip, with joint positions equal up "
        "to sign. Is it this robot, uncalibrated, with the same zero position?"
    )


def new_origins(
    match: Match, nominal: Chain, identified: Chain, chain: UrdfChain
) -> tuple[list[Array], Array]:
    """(4, 4) [m] origins of the J joints in their parents' frames, and the tip.

    The tip is the child link of the last joint, its pose (4, 4) [m] in the frame of the last row.
    """
    change = identified.theta - nominal.theta
    change[-1] = 0.0  # a gauge: the turn of flange and targets
    rows = [_pose(*placement) for placement in row_placements(identified)]
    frames = forward(nominal, np.zeros((1, nominal.rows)))
    link = np.eye(4)  # nominal
    behind = inverse_pose(match.T_base_dh)  # of link i in the frame of row i
    origins, fixed = [], chain.fixed
    for i, joint in enumerate(chain.joints):
        link = link @ fixed[i]
        place = inverse_pose(match.T_base_dh @ frames.poses(i)[0]) @ link
        on_axis = _turn_z(float(change[i])) @ _on_axis(place, joint.axis, float(match.sign[i]))
        origins.append(inverse_pose(chain.before[i]) @ inverse_pose(behind) @ on_axis)
        behind = inverse_pose(rows[i]) @ on_axis
    return origins, behind


def check_new_chain(
    robot: Robot, match: Match, identified: Chain, flange: Array, chain: UrdfChain, source: str
) -> float:
    """[m] largest distance of the new chain's tip from the identified one over CHECKED poses.

    flange : (4, 4) [m] tip in the frame of the last row. Raises InputError if it exceeds EXACT.
    """
    u = _poses(robot)
    expected = match.T_base_dh @ forward(identified, u * match.sign).poses() @ flange
    error = float(np.abs(chain.tip_poses(u) - expected).max())
    if error > EXACT:
        raise InputError(
            f"{source}: with the new origins its chain would differ from the identified one by "
            f"{significant_text(error * 1e3)} mm; nothing was written."
        )
    return error


def _poses(robot: Robot) -> Array:
    """(CHECKED, J) [rad] joint positions, at most half a turn from zero."""
    low, high = np.maximum(robot.axis_lower, -np.pi), np.minimum(robot.axis_upper, np.pi)
    share = np.random.default_rng(_SEED).random((CHECKED, robot.joints))
    return np.asarray(low + share * (high - low))


def _signs(robot: Robot) -> list[Array]:
    """Signs to try: joint positions as DH joints, as the controller's axes, then all others."""
    first = [np.ones(robot.joints), np.sign(np.diag(robot.controller_to_joint))]
    return [*first, *(np.array(s) for s in product((1.0, -1.0), repeat=robot.joints))]


def _constants(tips: Array, rows: Array) -> tuple[Array, Array]:
    """(4, 4) B and F that bring `B rows F` nearest to tips, both (N, 4, 4) poses.

    `tips F^-1 = B rows` is linear in the elements of B and F^-1 (Dornaika & Horaud 1998); the
    solution is put to the nearest rotations, and the translations are solved for again.
    """
    n = len(tips)
    # rotations: R_t X - B R_r = 0 with X = R_F^-1
    system = np.zeros((n, 9, 18))
    eye = np.eye(3)
    for k in range(n):
        system[k, :, :9] = np.kron(tips[k, :3, :3], eye)  # row-major elements of X
        system[k, :, 9:] = -np.kron(eye, rows[k, :3, :3].T)
    null = np.linalg.svd(system.reshape(-1, 18), full_matrices=False)[2][-1]
    scale = np.sign(np.linalg.det(null[9:].reshape(3, 3))) or 1.0
    parts = (null[:9].reshape(3, 3), null[9:].reshape(3, 3))
    inverse_turn, base_turn = (nearest_rotation(scale * part) for part in parts)
    # positions: p_t + R_t y = R_B p_r + b with y = -R_F^-1 p_F
    matrix = np.concatenate((np.tile(np.eye(3), (n, 1, 1)), -tips[:, :3, :3]), axis=2)
    right = tips[:, :3, 3] - rows[:, :3, 3] @ base_turn.T
    solution = np.linalg.lstsq(matrix.reshape(-1, 6), right.reshape(-1), rcond=None)[0]
    base, tip_inverse = np.eye(4), np.eye(4)
    base[:3, :3], base[:3, 3] = base_turn, solution[:3]
    tip_inverse[:3, :3], tip_inverse[:3, 3] = inverse_turn, solution[3:]
    return base, inverse_pose(tip_inverse)


def _on_axis(place: Array, axis: tuple[float, ...], sign: float) -> Array:
    """A link's pose in the frame of its row, put exactly on the joint's axis.

    The digits of a file leave 1e-6 rad; the joint's own axis becomes sign * z, through the origin.
    """
    pose, direction = place.copy(), np.array([0.0, 0.0, sign])
    for _ in range(3):  # the sine stands for the angle: each turn leaves its cube
        link_axis = pose[:3, :3] @ np.array(axis) / np.linalg.norm(axis)
        turn = Rotation.from_rotvec(np.cross(link_axis, direction)).as_matrix()
        pose[:3, :3] = turn @ pose[:3, :3]
    pose[:2, 3] = 0.0
    return np.asarray(pose)


def _pose(rotation: Array, translation: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def _turn_z(angle: float) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return pose

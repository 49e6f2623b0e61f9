"""Still poses of two robots without anything of sim/ or ballbar.cell.chain: plain 4 x 4 matrices.

The Panda is moved by Franka's published rows, which are of Craig's convention, the IRB 120 by the
axes of its joints in space (product of exponentials). Their errors are errors of these numbers, not
of the rows that are identified. Tables and poses.yaml are written by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# franka_description: a and alpha before joint i, d and theta behind it; [m], quarter turns
PANDA = (
    (0.0, 0, 0.333), (0.0, -1, 0.0), (0.0, 1, 0.316), (0.0825, 1, 0.0),
    (-0.0825, -1, 0.384), (0.0, 1, 0.0), (0.088, 1, 0.0),
)  # fmt: skip
PANDA_FLANGE = 0.107  # [m]
PANDA_LIMITS = (
    (-2.8, 2.8),
    (-1.7, 1.7),
    (-2.8, 2.8),
    (-3.0, -0.1),
    (-2.8, 2.8),
    (0.0, 3.7),
    (-2.8, 2.8),
)
# abb_irb120_support: a point on each axis [m], and its direction, all joints at zero
IRB120 = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    ((0.0, 0.0, 0.29), (0.0, 1.0, 0.0)),
    ((0.0, 0.0, 0.56), (0.0, 1.0, 0.0)),
    ((0.0, 0.0, 0.63), (1.0, 0.0, 0.0)),
    ((0.302, 0.0, 0.63), (0.0, 1.0, 0.0)),
    ((0.302, 0.0, 0.63), (1.0, 0.0, 0.0)),
)
IRB120_FLANGE = (0.374, 0.0, 0.63)  # [m]
IRB120_LIMITS = ((-2.5, 2.5), (-1.5, 1.5), (-1.5, 1.1), (-2.6, 2.6), (-2.0, 2.0), (-3.0, 3.0))
LENGTH, ANGLE = 3e-4, 5e-4  # [m], [rad] standard deviation of the errors
SAG = 5e-4  # [rad/m] of the joints under a weight at the flange
Flange = Callable[[Array], Array]  # from joint angles (N, J) to poses (N, 4, 4)


@dataclass(frozen=True, eq=False)
class OwnArm:
    """A robot with errors and sag."""

    name: str
    limits: Array  # (J, 2) [rad]
    rigid: Flange
    sag: Array  # (J,) [rad/m]

    def target(self, q: Array, point: Array) -> Array:
        """(N, 3) [m] place of a point of the flange at angles q (N, J), the arm sagging."""
        pose = self.rigid(q + self.sag * self._levers(q))
        return np.asarray(pose[:, :3, :3] @ point + pose[:, :3, 3])

    def _levers(self, q: Array) -> Array:
        """(N, J) [m] by how much the flange falls per turn of each joint, by differences."""
        out = np.empty_like(q)
        for j in range(q.shape[1]):
            step = 1e-5 * np.eye(q.shape[1])[j]
            out[:, j] = -(self.rigid(q + step)[:, 2, 3] - self.rigid(q - step)[:, 2, 3]) / 2e-5
        return out

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """(N, J) [rad] random angles within the limits."""
        return rng.uniform(self.limits[:, 0], self.limits[:, 1], (count, len(self.limits)))


def panda(rng: np.random.Generator | None) -> OwnArm:
    """A Panda with drawn errors; without a generator the nominal one."""
    rows = np.array(PANDA) * [1.0, 0.5 * np.pi, 1.0]
    sizes = (LENGTH, ANGLE, LENGTH, ANGLE)
    errors = np.zeros((7, 4)) if rng is None else rng.standard_normal((7, 4)) * sizes

    def flange(q: Array) -> Array:
        pose = np.tile(np.eye(4), (len(q), 1, 1))
        for i, (a, alpha, d) in enumerate(rows):
            before = _shift([a + errors[i, 0], 0.0, 0.0])
            before = _turn([1.0, 0.0, 0.0], np.array([alpha + errors[i, 1]]))[0] @ before
            behind = _shift([0.0, 0.0, d + errors[i, 2]])
            pose = pose @ before @ _turn([0.0, 0.0, 1.0], q[:, i] + errors[i, 3]) @ behind
        return np.asarray(pose @ _shift([0.0, 0.0, PANDA_FLANGE]))

    return OwnArm("panda", np.array(PANDA_LIMITS), flange, _sag(7, rng))


def irb120(rng: np.random.Generator | None) -> OwnArm:
    """An IRB 120 with drawn errors; without a generator the nominal one."""
    points, directions = (np.array([axis[k] for axis in IRB120]) for k in (0, 1))
    offsets = np.zeros(6)
    if rng is not None:
        points = points + LENGTH * rng.standard_normal((6, 3))
        directions = directions + ANGLE * rng.standard_normal((6, 3))
        offsets = ANGLE * rng.standard_normal(6)
    zero = np.eye(4)
    zero[:3, 3] = IRB120_FLANGE
    zero[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]

    def flange(q: Array) -> Array:
        pose = np.tile(np.eye(4), (len(q), 1, 1))
        for i, (point, direction) in enumerate(zip(points, directions, strict=True)):
            turn = _turn(direction / np.linalg.norm(direction), q[:, i] + offsets[i])
            pose = pose @ _shift(point) @ turn @ _shift(-point)
        return np.asarray(pose @ zero)

    return OwnArm("irb120", np.array(IRB120_LIMITS), flange, _sag(6, rng))


def socket_poses(
    arm: OwnArm, rng: np.random.Generator, count: int, *, play: float
) -> tuple[Array, list[str]]:
    """Angles (2 N, J) at which a ball lies in one of two sockets, and the socket of each."""
    ball, found, seats = np.array([0.0, 0.0, 0.1]), [], []
    for seat, y in (("left", -0.025), ("right", 0.025)):
        wanted = np.array([0.45, y, 0.1]) + play * rng.standard_normal((3 * count, 3))
        q = arm.drawn(rng, 3 * count)
        for k in range(18):  # the sag is computed once the ball is nearly there
            pose = arm.rigid(q)
            near = pose[:, :3, :3] @ ball + pose[:, :3, 3]
            error = wanted - (arm.target(q, ball) if k > 13 else near)
            q = np.clip(q + _step(arm, q, ball, error), arm.limits[:, 0], arm.limits[:, 1])
        good = np.linalg.norm(wanted - arm.target(q, ball), axis=1) < 1e-8
        found.append(q[good][:count])
        seats += [seat] * len(found[-1])
    return np.concatenate(found), seats


def length_poses(
    arm: OwnArm, rng: np.random.Generator, count: int, *, noise: float
) -> tuple[Array, list[str], Array]:
    """Angles (3 N, J), the seat of each, and the lengths (3 N,) [m] from it."""
    hook = np.array([0.05, 0.0, 0.08])
    q, seats, lengths = [], [], []
    for seat, place in (("a", (0.8, 0.5, 0.0)), ("b", (0.8, -0.5, 0.1)), ("c", (-0.6, 0.6, 0.0))):
        each = arm.drawn(rng, count)
        length = np.linalg.norm(arm.target(each, hook) - place, axis=1)
        q.append(each)
        seats += [seat] * count
        lengths.append(length + noise * rng.standard_normal(count))
    return np.concatenate(q), seats, np.concatenate(lengths)


def written(
    folder: Path, arm: OwnArm, q: Array, seats: list[str], lengths: Array | None, *, sigma: float
) -> Path:
    """A folder with a table and its poses.yaml; lengths in mm, angles in degrees."""
    folder.mkdir(parents=True)
    axes = [f"J{j + 1}" for j in range(q.shape[1])]
    lines = [";".join(["hole", *axes, *(["L"] if lengths is not None else [])])]
    for k, seat in enumerate(seats):
        cells = [f"{angle:.9f}" for angle in np.rad2deg(q[k])]
        lines.append(
            ";".join([seat, *cells, *([f"{lengths[k] * 1e3:.7f}"] if lengths is not None else [])])
        )
    (folder / "table.csv").write_text("\n".join(lines) + "\n")
    kind = "socket_pair_50" if lengths is None else "drawwire_2m"
    text = f"""schema: ballbar-poses/1
kind: simulated
robot: {arm.name}
instrument: {kind}
tables:
  - files: [table.csv]
    joints: {{columns: [{", ".join(axes)}], unit: deg}}
    seat: {{column: hole}}
    sigma: {{length_m: {sigma:.2e}}}
"""
    if lengths is not None:
        text += "    values: {columns: [L], unit: mm}\n"
    (folder / "poses.yaml").write_text(text)
    return folder


def _sag(joints: int, rng: np.random.Generator | None) -> Array:
    return np.zeros(joints) if rng is None else np.abs(SAG * rng.standard_normal(joints))


def _shift(by: Array | list[float]) -> Array:
    """(4, 4)"""
    out = np.eye(4)
    out[:3, 3] = by
    return out


def _turn(axis: Array | list[float], angle: Array) -> Array:
    """(N, 4, 4) turns about a unit vector through the origin, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out = np.tile(np.eye(4), (len(angle), 1, 1))
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    out[:, :3, :3] += sine * skew + versine * (skew @ skew)
    return out


def _step(arm: OwnArm, q: Array, point: Array, error: Array) -> Array:
    """(N, J) damped Newton steps towards errors (N, 3), by differences of the rigid arm."""
    columns, place = np.empty((len(q), 3, q.shape[1])), arm.rigid(q) @ np.append(point, 1.0)
    for j in range(q.shape[1]):
        moved = arm.rigid(q + 1e-7 * np.eye(q.shape[1])[j]) @ np.append(point, 1.0)
        columns[:, :, j] = (moved - place)[:, :3] / 1e-7
    square = columns @ columns.transpose(0, 2, 1) + 1e-8 * np.eye(3)
    solved = np.linalg.solve(square, error[..., None])
    step = (columns.transpose(0, 2, 1) @ solved)[..., 0]
    return np.asarray(step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / 0.3, 1.0))

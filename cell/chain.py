"""Forward kinematics of a chain of Denavit-Hartenberg rows, and the screws of its parameters.

Standard DH with a Hayati angle: `A_i = Rz(theta_i + q_i) Tz(d_i) Tx(a_i) Rx(alpha_i) Ry(beta_i)`
(thesis sec. 2.1; Hayati & Mirmirani 1985). beta is zero except at nearly parallel axes, where it
replaces d.

Every parameter moves the rest of the chain as a screw: `theta_i` turns and `d_i` shifts along
z_{i-1} through O_{i-1}; `a_i` shifts and `alpha_i` turns along x_i through O_i; `beta_i` turns
about y_i through O_i. The derivative of the end pose with respect to all parameters therefore
follows from the frames, without symbolic or numeric differentiation.

The sample index comes last, (3, N), so that eleven rows over thousands of samples are a few long
vector operations.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array as Array  # noqa: PLC0414  ident and ballbar import it from here
from ballbar.cell.arrays import read_only

KINDS = ("a", "d", "alpha", "theta", "beta")


@dataclass(frozen=True, eq=False)
class Chain:
    """DH parameters of J rows."""

    a: Array  # (J,) [m] link lengths along x_i
    d: Array  # (J,) [m] link offsets along z_{i-1}
    alpha: Array  # (J,) [rad] link twists about x_i
    theta: Array  # (J,) [rad] joint offsets about z_{i-1}, added to the joint angles
    beta: Array  # (J,) [rad] Hayati angles about y_i

    def __post_init__(self) -> None:
        for field in fields(self):
            values = read_only(getattr(self, field.name))
            if values.shape != np.shape(self.a) or values.ndim != 1:
                raise ValueError(
                    f"chain: {field.name} has shape {values.shape}, a {np.shape(self.a)}"
                )
            object.__setattr__(self, field.name, values)

    @property
    def rows(self) -> int:
        return int(self.a.size)


@dataclass(frozen=True, eq=False)
class Frames:
    """All frames of a chain at N samples, in base coordinates; entry 0 is the base frame itself."""

    x: Array  # (J+1, 3, N)
    y: Array  # (J+1, 3, N)
    z: Array  # (J+1, 3, N)
    origin: Array  # (J+1, 3, N) [m]
    x_link: Array  # (J, 3, N) x axis of row i before its Hayati angle: the axis of a_i and alpha_i

    def part(self, samples: slice | NDArray[Any]) -> Frames:
        """The frames at some of the samples."""
        return Frames(*(getattr(self, field.name)[..., samples] for field in fields(self)))

    @property
    def tip(self) -> Array:
        """(3, N) [m] origin of the last frame."""
        return np.asarray(self.origin[-1])

    def rotation(self, row: int = -1) -> Array:
        """(3, 3, N) rotation matrix of one frame, columns x, y, z."""
        return np.stack((self.x[row], self.y[row], self.z[row]), axis=1)

    def poses(self, row: int = -1) -> Array:
        """(N, 4, 4) homogeneous transforms T_base_frame of one frame."""
        pose: Array = np.zeros((self.x.shape[2], 4, 4))
        pose[:, :3, :3] = self.rotation(row).transpose(2, 0, 1)
        pose[:, :3, 3] = self.origin[row].T
        pose[:, 3, 3] = 1.0
        return pose


def forward(
    chain: Chain,
    q: Array,
    *,
    base_rotation: Array | None = None,
    base_origin: Array | None = None,
    slide: tuple[int, Array] | None = None,
) -> Frames:
    """Frames of the chain at every sample.

    q : (N, J) [rad] joint angles. base_rotation, base_origin : (3, 3), (3,) [m] pose of the chain's
        base; by default the identity. slide : row, from 0, of a prismatic joint, and (N,) [m] by
        which it lengthens that row's d.

    Raises ValueError if `q` has not one column per row.
    """
    if q.ndim != 2 or q.shape[1] != chain.rows:
        raise ValueError(f"joint angles {q.shape} do not fit a chain of {chain.rows} rows")
    rows, n = chain.rows, q.shape[0]
    axes = np.empty((3, rows + 1, 3, n))
    origin = np.empty((rows + 1, 3, n))
    x_link = np.empty((rows, 3, n))
    base = np.eye(3) if base_rotation is None else base_rotation
    axes[:, 0] = base.T[:, :, None]
    origin[0] = 0.0 if base_origin is None else np.asarray(base_origin)[:, None]
    angle = q.T + chain.theta[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    across, part = np.empty((3, n)), np.empty((3, n))
    for i in range(rows):  # into arrays that are there: new ones would take half of the time
        (x, y, z), (next_x, next_y, next_z), link = axes[:, i], axes[:, i + 1], x_link[i]
        alpha, beta = chain.alpha[i], chain.beta[i]
        _turn((x, y), (cos[i], sin[i]), (link, across, part))
        _turn((across, z), (np.cos(alpha), np.sin(alpha)), (next_y, next_z, part))
        along = chain.d[i] + slide[1] if slide and slide[0] == i else chain.d[i]
        np.multiply(along, z, out=origin[i + 1])
        origin[i + 1] += origin[i]
        origin[i + 1] += np.multiply(chain.a[i], link, out=part)
        next_x[:] = link
        if beta != 0.0:
            across[:] = next_z
            _turn((across, link), (np.cos(beta), np.sin(beta)), (next_z, next_x, part))
    return Frames(axes[0], axes[1], axes[2], origin, x_link)


def _turn(axes: tuple[Array, ...], by: tuple[Array, ...], out: tuple[Array, ...]) -> None:
    """Writes two axes (3, N) turned about the third one, by cosine and sine (N,) of an angle.

    out : the two, and one more (3, N) to work in.
    """
    (u, v), (cos, sin), (new_u, new_v, part) = axes, by, out
    np.multiply(cos, u, out=new_u)
    new_u += np.multiply(sin, v, out=part)
    np.multiply(cos, v, out=new_v)
    new_v -= np.multiply(sin, u, out=part)


def cross(u: Array, v: Array) -> Array:
    """Cross product of (3, N) arrays along their first axis; several times as fast as np.cross."""
    out = np.empty(np.broadcast(u, v).shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(u[j], v[k], out=out[i])
        out[i] -= u[k] * v[j]
    return out


def screw(frames: Frames, kind: str, row: int, out: Array | None = None) -> Array:
    """(6, N) motion of the last frame for a unit change of one parameter, in base coordinates.

    Components 0..2 are the velocity of the tip [m per unit], 3..5 the angular velocity [rad per
    unit]. The joint angle q_i has the screw of `theta` of its row.

    kind : one of KINDS. row : from 0; with -1, `alpha` and `beta` tilt the base frame. out : (6, N)
        array to write to.
    """
    if kind in ("theta", "d"):
        axis, point = frames.z[row], frames.origin[row]
    elif kind == "beta":
        axis, point = frames.y[row + 1], frames.origin[row + 1]
    elif kind in ("a", "alpha"):
        axis, point = frames.x_link[row] if row >= 0 else frames.x[0], frames.origin[row + 1]
    else:
        raise ValueError(f"parameter kind {kind!r} is none of {KINDS}")
    out = np.empty((6, axis.shape[1])) if out is None else out
    _write_screw(out, axis, None if kind in ("a", "d") else frames.tip - point)
    return out


def _write_screw(out: Array, axis: Array, arm: Array | None) -> None:
    """Write the screw of an axis (3, N) to out (6, N): a shift, or a turn of a tip at `arm`."""
    if arm is None:
        out[:3], out[3:] = axis, 0.0
        return
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(axis[j], arm[k], out=out[i])
        out[i] -= axis[k] * arm[j]
    out[3:] = axis


def joint_screws(frames: Frames) -> Array:
    """(J, 6, N) motion [m/rad, -] of the last frame for a unit speed of each joint."""
    rows = frames.x_link.shape[0]
    out = np.empty((rows, 6, frames.tip.shape[1]))
    for i in range(rows):
        _write_screw(out[i], frames.z[i], frames.tip - frames.origin[i])
    return out


def row_placements(chain: Chain) -> list[tuple[Array, Array]]:
    """Pose of each row's frame at joint angle zero, in the frame that turns with its joint.

    Returns J pairs of a rotation matrix (3, 3) and a translation (3,) [m].
    """
    out = []
    for i in range(chain.rows):
        row = Chain(*(getattr(chain, field.name)[i : i + 1] for field in fields(chain)))
        frames = forward(row, np.zeros((1, 1)))
        out.append((frames.rotation()[:, :, 0], frames.tip[:, 0]))
    return out

"""Kinematic parameters of robot and ball-bar as one vector, with the thesis's names.

`ra1..ra6 rd1.. ralpha1.. rtheta1.. rbeta2 rbeta6` are the robot's rows, the tool in row 6;
`ba1..ba5 bd1.. balpha1.. btheta1..` those of the ball-bar. Its base pose in the robot's base frame
is the position `ox oy oz` and the tilt `otx oty`, a turn about x, then y. Source: thesis secs.
2.1-2.2; names of the parameters: thesis Tables 3.1-3.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cell.arrays import Array, read_only
from cell.chain import Chain, Frames, forward, screw

if TYPE_CHECKING:
    from cell.descriptions import Cell

ROBOT_ROWS, BAR_ROWS = 6, 5  # one per joint
# Rows whose axis is nearly parallel to the next one: joint 2 to joint 3, and joint 6 to b5 across
# the plate.
HAYATI_ROWS = (1, 5)


@dataclass(frozen=True)
class Parameter:
    """One kinematic parameter and its place in the mechanism."""

    name: str
    side: str  # "robot", "bar" or "base"
    kind: str  # DH kind, or "origin" / "tilt" of the ball-bar's base
    row: int  # from 0

    @property
    def is_length(self) -> bool:
        return self.kind in ("a", "d", "origin")

    @property
    def unit(self) -> str:
        return "m" if self.is_length else "rad"


def _parameters() -> tuple[Parameter, ...]:
    robot = [
        Parameter(f"r{k}{i + 1}", "robot", k, i)
        for k in ("a", "d", "alpha", "theta")
        for i in range(ROBOT_ROWS)
    ]
    hayati = [Parameter(f"rbeta{row + 1}", "robot", "beta", row) for row in HAYATI_ROWS]
    bar = [
        Parameter(f"b{k}{i + 1}", "bar", k, i)
        for k in ("a", "d", "alpha", "theta")
        for i in range(BAR_ROWS)
    ]
    base = [Parameter(f"o{c}", "base", "origin", i) for i, c in enumerate("xyz")]
    tilt = [Parameter(f"ot{c}", "base", "tilt", i) for i, c in enumerate("xy")]
    return tuple(robot + hayati + bar + base + tilt)


PARAMETERS = _parameters()
NAMES = tuple(p.name for p in PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}
ORIGIN, TILT = slice(INDEX["ox"], INDEX["oz"] + 1), slice(INDEX["otx"], INDEX["oty"] + 1)


@dataclass(frozen=True, eq=False)
class Geometry:
    """All kinematic parameters of one cell, as the vector `values` in the order of NAMES."""

    values: Array  # (P,) [m, rad]

    def __post_init__(self) -> None:
        values = read_only(self.values)
        if values.shape != (len(NAMES),):
            raise ValueError(f"geometry: {values.shape} values, expected ({len(NAMES)},)")
        object.__setattr__(self, "values", values)

    def __getitem__(self, name: str) -> float:
        return float(self.values[INDEX[name]])

    def replaced(self, changes: dict[str, float]) -> Geometry:
        """The geometry with the named parameters changed. Raises KeyError for an unknown name."""
        values = self.values.copy()
        for name, value in changes.items():
            values[INDEX[name]] = value
        return Geometry(values)

    @property
    def robot(self) -> Chain:
        n = ROBOT_ROWS
        beta = np.zeros(n)
        beta[list(HAYATI_ROWS)] = self.values[4 * n : 4 * n + len(HAYATI_ROWS)]
        a, d, alpha, theta = self.values[: 4 * n].reshape(4, n)
        return Chain(a, d, alpha, theta, beta)

    @property
    def bar(self) -> Chain:
        start = 4 * ROBOT_ROWS + len(HAYATI_ROWS)
        a, d, alpha, theta = self.values[start : start + 4 * BAR_ROWS].reshape(4, BAR_ROWS)
        return Chain(a, d, alpha, theta, np.zeros(BAR_ROWS))

    @property
    def origin(self) -> Array:
        """(3,) [m] position of the ball-bar's base in the robot's base frame."""
        return self.values[ORIGIN]

    @property
    def bar_base_rotation(self) -> Array:
        """(3, 3) orientation of the ball-bar's base: Rx(otx) Ry(oty)."""
        (cx, cy), (sx, sy) = np.cos(self.values[TILT]), np.sin(self.values[TILT])
        return np.array([[cy, 0.0, sy], [sx * sy, cx, -sx * cy], [-cx * sy, sx, cx * cy]])


def mirrored(geometry: Geometry, joint: int) -> Geometry:
    """The geometry of the same mechanism whose encoder b2 or b4 counts in the other direction.

    joint : 2 or 4. The directions of b2 and b4 and the configurations of gimbal and universal joint
        are one gauge: readings `(-e_j, e_others)` of the mirrored geometry give the pose that
        `(e_j, e_others)` gave before, exactly, for an imperfect ball-bar too
        (notes/start, "Signs and configuration").

    Raises ValueError for another joint.
    """
    if joint not in (2, 4):
        raise ValueError(f"joint {joint}: only b2 and b4 have a direction that cannot be observed")
    i, j, k = joint - 1, joint, joint + 1
    changes = {f"b{kind}{joint}": -geometry[f"b{kind}{joint}"] for kind in ("a", "d", "theta")}
    changes |= {
        f"ba{i}": -geometry[f"ba{i}"],
        f"balpha{i}": np.pi - geometry[f"balpha{i}"],
        f"balpha{j}": -np.pi - geometry[f"balpha{j}"],
    }
    changes |= {f"btheta{n}": geometry[f"btheta{n}"] + np.pi for n in (i, k)}
    return geometry.replaced(changes)


def nominal_geometry(cell: Cell, origin: Array) -> Geometry:
    """Catalogue geometry of a cell with the ball-bar at `origin` (3,) [m] and encoder offsets 0.

    The offset plate is `ra6`; tool changer and universal joint add to the flange's `rd6`.
    """
    robot, bar, plate = cell.robot, cell.ballbar, cell.plate
    a, d = robot.a.copy(), robot.d.copy()
    a[5] += plate.length
    d[5] += plate.tool_offset
    rows = (
        a,
        d,
        robot.alpha,
        robot.theta,
        np.zeros(len(HAYATI_ROWS)),
        bar.a,
        bar.d,
        bar.alpha,
        bar.theta,
        origin,
        [0.0, 0.0],
    )
    return Geometry(np.concatenate([np.asarray(r, dtype=np.float64) for r in rows]))


def robot_frames(geometry: Geometry, q: Array) -> Frames:
    """Frames of the robot at joint angles q (N, 6) [rad]; the last is that of the tool."""
    return forward(geometry.robot, q)


def bar_frames(geometry: Geometry, b: Array) -> Frames:
    """Frames of the ball-bar at encoder angles b (N, 5) [rad]; the last is that of the tool.

    The encoder offsets are part of btheta.
    """
    return forward(
        geometry.bar, b, base_rotation=geometry.bar_base_rotation, base_origin=geometry.origin
    )


def parameter_screw(
    geometry: Geometry, robot: Frames, bar: Frames, parameter: Parameter, out: Array | None = None
) -> Array:
    """(6, N) motion of the tool frame of robot or ball-bar for a unit change of one parameter.

    Components [m, rad per unit] are those of cell.chain.screw. out : (6, N) array to write to.
    """
    if parameter.side != "base":
        frames = robot if parameter.side == "robot" else bar
        return screw(frames, parameter.kind, parameter.row, out)
    out = np.empty((6, bar.tip.shape[1])) if out is None else out
    out[:] = 0.0
    if parameter.kind == "origin":
        out[parameter.row] = 1.0
        return out
    axis = np.array([1.0, 0.0, 0.0])
    if parameter.row == 1:
        axis = np.array([0.0, np.cos(geometry["otx"]), np.sin(geometry["otx"])])
    out[:3] = np.cross(axis, (bar.tip - bar.origin[0]).T).T
    out[3:] = axis[:, None]
    return out
